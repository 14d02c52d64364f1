"""Steady vibration of beams that are held at more places than their beginning, or that carry springs and dashpots."""

import cmath

import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    Clamp,
    Dashpot,
    Guide,
    HarmonicBase,
    HarmonicLoad,
    InputError,
    Model,
    Pin,
    PointMass,
    RayleighDamping,
    Roller,
    RotationalSpring,
    Spring,
    State,
    backbone,
    frequency_response,
    linear_frf,
    natural_modes,
    periodic_motion,
    reduce_model,
    simulate,
)
from ancf_casadi.response.harmonic_balance.beams import SlopeCorrections, full_system
from tests.boundary.cases import REFERENCES

LENGTH, SLENDERNESS = 1.0, 1000.0  # m, length per radius of gyration
RADIUS = LENGTH / SLENDERNESS  # of gyration, m
EI, MU = 210e9 * 0.02 * (12**0.5 * RADIUS) ** 3 / 12, 8000.0 * 0.02 * 12**0.5 * RADIUS


def strip(elements, **changes):
    """Weightless steel strip along x."""
    settings = {"axis": (1.0, 0.0), "gravity": (0.0, 0.0), **changes}
    return Model(Beam.uniform(length=LENGTH, width=0.02, thickness=12**0.5 * RADIUS, density=8000.0,
                              elastic_modulus=210e9, elements=elements, **settings))  # fmt: skip


PINNED, CLAMPED = (Pin(0.0), Pin(LENGTH)), (Clamp(0.0), Clamp(LENGTH))


@pytest.mark.slow
@pytest.mark.parametrize(("supports", "name"), [(PINNED, "backbone_pp"), (CLAMPED, "backbone_cc")])
def test_ends_that_do_not_move_harden_the_beam(supports, name):
    """Amplitudes are those of the middle, in radii of gyration."""
    ratios = [ratio for (ratio,) in REFERENCES[name]["rows"].values()]
    expected = dict(zip((0.5, 1, 2, 3) if name == "backbone_pp" else (0.5, 1), ratios, strict=False))
    curve = backbone(strip(8, supports=supports), amplitude=1.02 * max(expected) * RADIUS, points=6)
    for amplitude, ratio in expected.items():
        assert curve.frequency(amplitude * RADIUS) / curve.natural_frequency == pytest.approx(ratio, rel=1e-4)


F = np.array([3.0, 7.5, 8.5, 20.0, 31.0, 60.0])
ALPHA = 0.8  # 1/s


def waves(f):
    """Receptance of the middle of a pinned beam, and displacement of the middle of a clamped one per that of its ends.

    Closed solutions of EI y'''' = mu (w^2 - i w alpha) y; in the second, the damping resists the absolute velocity.
    """
    receptance, transmissibility = [], []
    for omega in 2 * np.pi * f:
        k = (MU * (omega**2 - 1j * omega * ALPHA) / EI) ** 0.25
        x = k * LENGTH / 2
        receptance.append((cmath.tan(x) - cmath.tanh(x)) / (4 * EI * k**3))
        ends = cmath.cos(x) * cmath.sinh(x) + cmath.cosh(x) * cmath.sin(x)
        transmissibility.append((cmath.sinh(x) + cmath.sin(x)) / ends)
    return np.array(receptance), np.array(transmissibility)


def test_the_middle_of_a_pinned_beam_has_the_receptance_of_the_differential_equation():
    found = linear_frf(strip(30, supports=PINNED), RayleighDamping(alpha=ALPHA), F)
    assert found.points == found.load_points == (0.5,)  # the tip is held
    assert np.abs(found.values[0, 0] / waves(F)[0] - 1).max() < 1e-4


def test_both_ends_of_a_clamped_beam_move_with_the_base():
    found = linear_frf(strip(30, supports=CLAMPED), RayleighDamping(alpha=ALPHA), F, kind="transmissibility")
    assert np.abs(found.values[0, 0] / waves(F)[1] - 1).max() < 1e-4


def test_the_tip_of_a_beam_that_nothing_holds_has_the_receptance_of_the_differential_equation():
    found = linear_frf(strip(30, supports=()), RayleighDamping(alpha=ALPHA), F)
    expected = []
    for omega in 2 * np.pi * F:
        k = (MU * (omega**2 - 1j * omega * ALPHA) / EI) ** 0.25
        x = k * LENGTH
        above = cmath.sin(x) * cmath.cosh(x) - cmath.cos(x) * cmath.sinh(x)
        expected.append(above / (EI * k**3 * (cmath.cos(x) * cmath.cosh(x) - 1)))
    assert np.abs(found.values[0, 0] / expected - 1).max() < 1e-4
    chosen = linear_frf(strip(8, supports=()), RayleighDamping(alpha=ALPHA))
    peak = chosen.frequencies[15:][np.argmax(chosen.amplitude[0, 0, 15:])]
    assert peak == pytest.approx(18.2449, rel=1e-3)  # (4.730041/L)^2 (EI/mu)^(1/2)/(2 pi)


def test_dashpots_count_in_the_damping_ratios_that_are_reported():
    """A dashpot c in the middle gives mode 1 the ratio 2 c/(2 omega m)."""
    model = strip(20, supports=PINNED, attachments=(Dashpot(0.5, (0.0, 0.9)),))
    omega = (np.pi / LENGTH) ** 2 * (EI / MU) ** 0.5
    ratio = 100 * 0.9 / (omega * MU * LENGTH)
    (note,) = linear_frf(model, None).table().notes
    assert f"{omega / (2 * np.pi):.4g} Hz ({ratio:.3g} %)" in note


@pytest.mark.parametrize("kind", ["receptance", "relative-transmissibility"])
def test_a_dashpot_acts_as_a_force_in_proportion_to_the_velocity_relative_to_the_base(kind):
    """Without the dashpot, the middle has the displacement x; with it, x/(1 + i w c H)."""
    law, coefficient = RayleighDamping(alpha=ALPHA), 10.0
    dashpot = Dashpot(0.5, (0.0, coefficient))
    bare = linear_frf(strip(30, supports=PINNED), law, F, kind=kind).values[0, 0]
    damped = linear_frf(strip(30, supports=PINNED, attachments=(dashpot,)), law, F, kind=kind).values[0, 0]
    factor = 1 / (1 + 2j * np.pi * F * coefficient * waves(F)[0])
    assert np.abs(factor).min() < 0.5
    assert np.abs(damped / bare / factor - 1).max() < 1e-4


@pytest.mark.parametrize("amplitude", [1e-8, 1e-3])
def test_a_dashpot_alone_bounds_a_resonance_and_takes_the_energy_that_the_base_supplies(amplitude):
    """The dashpot loses pi c w k^2 A^2 per period in a harmonic k with the amplitude A relative to the base."""
    model = strip(4, supports=CLAMPED, attachments=(Dashpot(0.5, (0.0, 2.0)),))
    motion = periodic_motion(model, base=HarmonicBase(amplitude, 18.0, direction=(0.0, 1.0)))
    assert motion.supplied_energy == pytest.approx(motion.dissipated_energy, rel=1e-6)
    harmonics = np.abs(motion.harmonics(0.5))[1:]
    orders = np.arange(1, len(harmonics) + 1)
    expected = np.pi * 2.0 * 2 * np.pi * motion.frequency * float((orders**2 * harmonics**2).sum())
    assert motion.dissipated_energy == pytest.approx(expected, rel=1e-6)
    linear = linear_frf(model, None, [18.0], kind="relative-transmissibility").amplitude[0, 0, 0]
    ratio = motion.amplitude() / (amplitude * linear)
    assert abs(ratio - 1) < 1e-6 if amplitude < 1e-5 else ratio < 0.9  # the beam hardens


SET_UPS = {
    "clamped": {"supports": CLAMPED, "attachments": (Dashpot(0.4, (0.5, 0.5)),)},
    "elastic": {
        "supports": (Pin(0.0),),
        "attachments": (RotationalSpring(0.0, 2.0), PointMass(0.45, 0.05, 1e-5), Spring(0.7, (30.0, 60.0))),
        "gravity": (0.0, -9.81),
    },
    "guided": {"supports": (Guide(0.0, (0.0, 1.0)),), "attachments": (Spring(0.0, (0.0, 500.0)),)},
    "oblique": {"supports": (Clamp(0.0), Roller(1.0, (1.0, 1.0)))},
    "bent": {"supports": (Clamp(0.0), Pin(0.6)), "natural_curvature": 0.4},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SET_UPS)
def test_a_steady_state_repeats_itself_in_a_time_integration(name):
    model, law = strip(4, **SET_UPS[name]), RayleighDamping(alpha=3.0, beta=1e-4)
    frequency = {"guided": 5.0, "elastic": 4.0}.get(name, 17.0)
    base = HarmonicBase(2e-3, frequency, direction=(0.6, 0.8))
    path = periodic_motion(model, damping=law, base=base).trajectory(64)
    start = State(path.coordinates[0], path.velocities[0])
    run = simulate(model, damping=law, base=base, start=start, duration=1 / frequency, sample_rate=64 * frequency,
                   method="radau", tolerance=3e-9)  # fmt: skip
    swing = np.ptp(path.coordinates - path.coordinates[:, :1], axis=0).max()
    assert np.abs(run.coordinates - path.coordinates).max() < 2e-5 * swing
    across = path.clamp_force[1:, 1]
    assert np.abs(run.clamp_force[1:, 1] - across).max() < 1e-3 * np.abs(across).max()


@pytest.mark.parametrize(
    ("changes", "symmetric"),
    [
        ({"supports": (Clamp(0.0), Roller(1.0, (1.0, 0.0)))}, True),
        ({"supports": (Clamp(0.0), Roller(1.0, (0.0, 2.0)))}, True),
        ({"supports": (Clamp(0.0), Roller(1.0, (1.0, 1.0)))}, False),
        ({"supports": (Guide(0.0, (0.0, 1.0)),), "attachments": (Spring(0.5, (3.0, 5.0)),)}, True),
        ({"natural_curvature": 0.3}, False),
        ({"gravity": (0.0, -1.0)}, False),
    ],
)
def test_a_beam_is_its_own_mirror_image_unless_something_is_oblique_or_bent(changes, symmetric):
    model = strip(2, **changes)
    system = full_system(model, RayleighDamping(alpha=1.0))
    assert (system.mirror < 0.0).any() == symmetric
    balance, rng = system.functions(1).balance, np.random.default_rng(1)
    q, v, a = (rng.normal(size=model.freedoms) for _ in range(3))
    u = np.zeros(12)
    u[[1, 4, 7, 10]] = rng.normal(size=4)  # across the beam
    forces = balance(q, v, a, u, system.values).full().ravel()
    across = np.tile([1.0, -1.0], model.size // 2) * model.with_fixed_base(np.ones(model.freedoms))
    signs = system.mirror if symmetric else np.round(model.of_free(across))
    mirrored = balance(*(signs * vector for vector in (q, v, a)), -u, system.values).full().ravel()
    assert np.allclose(mirrored, signs * forces, rtol=1e-9, atol=1e-9 * np.abs(forces).max()) == symmetric


@pytest.mark.parametrize("angle", [0.5, np.pi / 2])
def test_a_turned_clamp_turns_the_direction_in_which_responses_are_read(angle):
    law, f = RayleighDamping(alpha=0.4), [1.0, 1.6, 3.0]
    straight, turned = strip(3), strip(3, supports=(Clamp(rotation=angle),))
    frfs = [linear_frf(model, law, f).values for model in (straight, turned)]
    np.testing.assert_allclose(frfs[1], frfs[0], rtol=1e-5)
    motions = [
        periodic_motion(model, damping=law, base=HarmonicBase(2e-3, 1.6, direction=model.beam.across))
        for model in (straight, turned)
    ]
    amplitudes, phases = ([getattr(motion, name)() for motion in motions] for name in ("amplitude", "phase"))
    assert amplitudes[1] == pytest.approx(amplitudes[0], rel=1e-6)
    assert phases[1] == pytest.approx(phases[0], abs=1e-6)
    curve = backbone(turned, amplitude=0.02, points=2)
    assert curve.amplitudes[-1] == pytest.approx(0.02, rel=0.5)


@pytest.mark.parametrize("amplitude", [4.229485e-4, 6.968284e-4, 8.944272e-4, 4e-3])
def test_a_beam_on_a_roller_has_a_steady_state_at_every_amplitude(amplitude):
    """Newton's method fails in long steps, because the beam hardly stretches; the reduced model does not stretch."""
    model, law = strip(8, supports=(Pin(0.0), Roller(LENGTH))), RayleighDamping(alpha=0.5)
    frequency = 1.07 * natural_modes(model, count=1).frequencies[0]
    base = HarmonicBase(amplitude=amplitude, frequency=frequency, direction=(0.0, 1.0))
    reduced = periodic_motion(reduce_model(model, modes=5, damping=law), base=base)
    full = periodic_motion(model, damping=law, base=base)
    assert full.amplitude(0.5) == pytest.approx(reduced.amplitude(0.5), rel=4e-4)


@pytest.mark.slow
def test_the_resonance_of_a_beam_on_a_roller_has_no_fold_in_small_motion():
    """A step that lands on the other side of the resonance would turn back, and count as two folds."""
    strip_of_steel = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9,
                                  elements=6, axis=(1.0, 0.0), gravity=(0.0, 0.0),
                                  supports=(Pin(0.0), Roller(0.5)))  # fmt: skip
    model, law = Model(strip_of_steel), RayleighDamping(alpha=0.8)
    frequency = natural_modes(model, count=1).frequencies[0]
    ends = 0.9 * frequency, 1.1 * frequency
    base = HarmonicBase(amplitude=1e-4, frequency=ends[0], direction=(0.0, 1.0))
    curve = frequency_response(model, ends, damping=law, base=base)
    assert not curve.bifurcations and (np.diff(curve.frequencies) > 0.0).all()
    reduced = frequency_response(reduce_model(model, modes=4, damping=law), ends, base=base)
    assert curve.amplitude(0.25).max() == pytest.approx(reduced.amplitude(0.25).max(), rel=1e-3)


HELD_BEYOND_THE_BEGINNING = {
    "roller": (Pin(0.0), Roller(0.6)),
    "oblique": (Clamp(0.0), Roller(1.0, (1.0, 1.0))),
    "guides": (Guide(0.0, (0.0, 1.0)), Guide(1.0, (1.0, 0.0))),
    "spans": (Clamp(0.0), Roller(0.4), Roller(0.7)),
}


@pytest.mark.parametrize("name", HELD_BEYOND_THE_BEGINNING)
def test_corrections_of_a_beam_on_rollers_bend_it_without_stretching_it(name):
    """A sum stretches the slopes by half the square of their turn; turned slopes keep to the supports as well."""
    model = strip(8, supports=HELD_BEYOND_THE_BEGINNING[name])
    shape = model.of_free(natural_modes(model, count=2).shapes[:, 1:])
    straight, corrections = model.of_free(model.straight)[:, None], SlopeCorrections.of(model)

    def stretch(q):
        return np.abs(model.gauss_strains(model.whole(q[:, 0], np.array([0.0, 0.0, *model.beam.axis])))).max()

    change = 0.05 * LENGTH / np.abs(model.with_fixed_base(shape)[1::4]).max() * shape
    bent = corrections.add_corrections(straight, change)
    assert stretch(bent) < 0.05 * stretch(straight + change)
    further = corrections.turn_vectors(straight, bent, 1e-4 * change, "forth")
    assert stretch(bent + further) - stretch(bent) < 0.05 * (stretch(bent + 1e-4 * change) - stretch(bent))
    small = corrections.add_corrections(straight, 1e-4 * change) - straight
    assert np.abs(small - 1e-4 * change).max() < 1e-3 * np.abs(1e-4 * change).max()


@pytest.mark.parametrize("name", HELD_BEYOND_THE_BEGINNING)
def test_residuals_turn_back_by_the_transpose_of_the_matrix_that_turns_corrections_forth(name):
    model, rng = strip(4, supports=HELD_BEYOND_THE_BEGINNING[name]), np.random.default_rng(3)
    corrections, straight = SlopeCorrections.of(model), model.of_free(model.straight)[:, None]
    change, residual = rng.normal(size=(2, model.freedoms, 1))
    bent = corrections.add_corrections(straight, 0.1 * model.free_scale[:, None] * rng.normal(size=straight.shape))
    forth = corrections.turn_vectors(straight, bent, change, "forth")
    back = corrections.turn_vectors(straight, bent, residual, "back")
    assert np.vdot(residual, forth) == pytest.approx(np.vdot(back, change), rel=1e-9)


@pytest.mark.parametrize(
    ("supports", "amplitude"), [((Pin(0.0), Roller(0.6)), 1e-3), ((Clamp(0.0), Roller(1.0, (1.0, 1.0))), 2e-4)]
)
def test_a_beam_on_a_roller_has_a_curve_of_as_many_points_as_its_reduced_model(supports, amplitude):
    """Corrections that stretch the beam would need four to eight times as many."""
    model, law = strip(4, supports=supports), RayleighDamping(alpha=0.8)
    frequency = natural_modes(model, count=1).frequencies[0]
    ends = 0.95 * frequency, 1.05 * frequency
    base = HarmonicBase(amplitude=amplitude, frequency=ends[0], direction=(0.0, 1.0))
    full = frequency_response(model, ends, damping=law, base=base, points=4)
    reduced = frequency_response(reduce_model(model, modes=2, damping=law), ends, base=base, points=4)
    assert len(full.motions) <= 1.5 * len(reduced.motions)
    assert full.amplitude().max() == pytest.approx(reduced.amplitude().max(), rel=1e-3)


@pytest.mark.parametrize(
    ("supports", "load"),
    [(PINNED, HarmonicLoad((3.0, 4.0), 8.0)), (CLAMPED, HarmonicLoad((0.0, 0.0), 8.0, moment=2.0))],
)
def test_a_load_on_a_support_moves_nothing(supports, load):
    model = strip(4, supports=supports)
    curve = frequency_response(model, (8.0, 12.0), damping=RayleighDamping(alpha=ALPHA), load=load, points=4)
    assert curve.frequencies[-1] == pytest.approx(12.0)
    assert curve.amplitude(0.5).max() < 1e-13 * LENGTH
    assert curve.stable.all()


def test_motions_far_below_the_rounding_of_the_forces_of_large_ones_are_found():
    """A picometre of the base, and a load along the beam that stretches it by F L/(E A), less than a nanometre."""
    model, law = strip(4), RayleighDamping(alpha=ALPHA)
    motion = periodic_motion(model, damping=law, base=HarmonicBase(1e-12, 8.0, direction=(0.0, 1.0)))
    linear = linear_frf(model, law, [8.0], kind="relative-transmissibility").amplitude[0, 0, 0]
    assert motion.amplitude() == pytest.approx(1e-12 * linear, rel=1e-3)
    motion = periodic_motion(model, damping=law, load=HarmonicLoad((1e-2, 0.0), 8.0))
    assert motion.amplitude(direction=(1.0, 0.0)) == pytest.approx(1e-2 * LENGTH * RADIUS**2 / EI, rel=1e-3)


def test_a_mode_along_the_beam_has_no_backbone():
    """The amplitude is that across the beam; mode 3 of a thick beam moves along it, and modes 2 and 4 across."""
    thick = Model(Beam.uniform(length=0.5, width=0.005, thickness=0.05, density=8000.0, elastic_modulus=210e9,
                               elements=4, axis=(1.0, 0.0), gravity=(0.0, 0.0)))  # fmt: skip
    with pytest.raises(InputError):
        backbone(thick, mode=3, amplitude=1e-4)
    for mode in (2, 4):
        curve = backbone(thick, mode=mode, amplitude=1e-4, points=2)
        assert curve.frequency(1e-5) == pytest.approx(natural_modes(thick, count=4).frequencies[mode - 1], rel=1e-4)
