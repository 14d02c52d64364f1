"""Curves of steady states: folds, jumps, closed curves, other parameters, and what cannot be followed."""

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import (
    ContinuationError,
    HarmonicBase,
    HarmonicForce,
    HarmonicLoad,
    InputError,
    ModalDamping,
    Model,
    NumericsError,
    Parameter,
    QuadraticDamping,
    RayleighDamping,
    SecondOrderSystem,
    amplitude_response,
    frequency_response,
    motion_function,
    natural_modes,
    parameter_response,
    periodic_motion,
    reduce_model,
)

q, v, a, u, mu = (cs.SX.sym(name) for name in ("q", "v", "a", "u", "mu"))
CUBIC = Parameter("mu", 0.5, "1", "cubic stiffness")


@pytest.fixture(scope="module")
def duffing():
    return SecondOrderSystem.of(
        q, v, a, u, mu, conservative=a + q + mu * q**3, damping=0.05 * v, excitation=u, parameters=[CUBIC]
    )


@pytest.fixture(scope="module")
def reduced(hanging):
    modes = natural_modes(hanging, count=8)
    law = ModalDamping(modes, ratios=(0.01, 0.003, 0.003, 0.003, 0.003)) + QuadraticDamping(eta2=0.1)
    return reduce_model(hanging, modes=modes, damping=law)


@pytest.fixture(scope="module")
def second_mode(reduced):
    return frequency_response(reduced, (10.0, 10.8), base=HarmonicBase(amplitude=5e-4, frequency=10.0))


@pytest.mark.slow
def test_the_second_mode_of_the_beam_softens_and_jumps(second_mode):
    kinds = [point.kind for point in second_mode.bifurcations]
    assert kinds == ["fold", "fold"]
    first, second = (point.motion for point in second_mode.bifurcations)
    assert second_mode.jumps.up == (first.frequency,)
    assert second_mode.jumps.down == (second.frequency,)
    assert second.frequency < first.frequency < 10.57
    assert second.amplitude() > 2 * first.amplitude()
    between = slice(second_mode.bifurcations[0].index + 1, second_mode.bifurcations[1].index)
    assert not second_mode.stable[between].any()
    assert second_mode.stable[: second_mode.bifurcations[0].index].all()
    assert second_mode.stable[second_mode.bifurcations[1].index + 1 :].all()


@pytest.mark.slow
def test_the_tangent_is_vertical_at_a_fold(second_mode):
    for point in second_mode.bifurcations:
        nearest = min(abs(point.motion.multipliers - 1.0))
        assert nearest < 1e-4
        at, frequencies = point.index, second_mode.frequencies
        assert (frequencies[at] - frequencies[at - 1]) * (frequencies[at] - frequencies[at + 1]) > 0.0


def test_each_motion_of_a_curve_balances_its_energy(second_mode):
    for motion in second_mode.motions[::8]:
        assert motion.supplied_energy == pytest.approx(motion.dissipated_energy, rel=1e-9)
        assert motion.dissipated_energy > 0.0


def test_the_ends_of_a_curve_are_those_of_the_range(second_mode):
    assert second_mode.frequencies[[0, -1]] == pytest.approx([10.0, 10.8], rel=1e-12)
    assert second_mode.drive_amplitudes == pytest.approx(np.full(len(second_mode.motions), 5e-4), rel=1e-12)


@pytest.mark.slow
def test_a_curve_in_the_amplitude_passes_the_same_motions(reduced, second_mode):
    frequency = sum(point.motion.frequency for point in second_mode.bifurcations) / 2
    sheet = amplitude_response(reduced, (1e-4, 2e-3), base=HarmonicBase(amplitude=1.0, frequency=frequency))
    crossings = np.flatnonzero(np.diff(np.sign(sheet.drive_amplitudes - 5e-4)))
    assert len(crossings) == 3  # between the folds, three motions belong to one excitation
    in_frequency = np.flatnonzero(np.diff(np.sign(second_mode.frequencies - frequency)))
    assert len(in_frequency) == 3
    for k, j in zip(crossings, in_frequency, strict=True):
        low, high = sorted(second_mode.amplitude()[[j, j + 1]])
        weights = np.abs(sheet.drive_amplitudes[[k + 1, k]] - 5e-4)
        mean = sheet.amplitude()[[k, k + 1]] @ weights / weights.sum()
        assert 0.97 * low < mean < 1.03 * high


@pytest.mark.slow
def test_the_curve_does_not_depend_on_its_direction(duffing):
    force = HarmonicForce(amplitude=0.1, frequency=0.1)
    up, down = (frequency_response(duffing, ends, force=force) for ends in ((0.1, 0.3), (0.3, 0.1)))
    folds = [sorted(point.motion.frequency for point in curve.bifurcations) for curve in (up, down)]
    assert folds[0] == pytest.approx(folds[1], rel=1e-7)
    assert up.jumps.up == pytest.approx(down.jumps.up, rel=1e-7)
    assert up.jumps.down == pytest.approx(down.jumps.down, rel=1e-7)


@pytest.mark.slow
def test_the_response_to_a_parameter_of_the_system_ends_at_the_response_with_that_value(duffing):
    force = HarmonicForce(amplitude=0.05, frequency=0.12)
    curve = parameter_response(duffing, "mu", (0.5, 2.0), force=force)
    for value, motion in ((0.5, curve.motions[0]), (2.0, curve.motions[-1])):
        assert motion.setting.value == value
        direct = periodic_motion(duffing.with_values([value]), force=force)
        assert motion.amplitude() == pytest.approx(direct.amplitude(), rel=1e-6)
    assert curve.amplitude()[0] != pytest.approx(curve.amplitude()[-1], rel=1e-3)


@pytest.mark.slow
def test_a_force_at_the_tip_excites_the_full_and_the_reduced_beam_alike(hanging):
    law, load = RayleighDamping(alpha=0.3), HarmonicLoad(force=(5e-3, 0.0), frequency=1.7)
    reduced = periodic_motion(reduce_model(hanging, modes=5, damping=law), load=load)
    full = periodic_motion(hanging, damping=law, load=load)
    assert full.amplitude() == pytest.approx(reduced.amplitude(), rel=1e-4)
    assert full.phase() == pytest.approx(reduced.phase(), abs=1e-4)
    assert full.amplitude() > 0.02
    trajectory = full.trajectory()
    assert np.abs(trajectory.balance_error).max() < 1e-4 * np.ptp(trajectory.kinetic_energy)
    assert trajectory.load_work[-1] == pytest.approx(full.supplied_energy, rel=1e-9)


@pytest.mark.slow
def test_half_a_period_is_enough_where_the_beam_is_symmetric(paper_beam):
    """An excitation along a tilted direction has no symmetry, but a small part along the axis changes little."""
    reduced = reduce_model(Model(paper_beam(8)), modes=3, damping=RayleighDamping(alpha=0.4))
    straight = periodic_motion(reduced, base=HarmonicBase(amplitude=5e-3, frequency=1.8))
    tilted = periodic_motion(reduced, base=HarmonicBase(amplitude=5e-3, frequency=1.8, direction=(1.0, 1e-8)))
    assert straight.balance.fourier.half
    assert not tilted.balance.fourier.half
    assert tilted.amplitude() == pytest.approx(straight.amplitude(), rel=1e-6)
    assert tilted.multipliers[0] == pytest.approx(straight.multipliers[0], abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["reduced", "full", "own"])
def test_derivatives_of_a_motion_agree_with_differences(paper_beam, duffing, kind):
    if kind == "own":
        motion = periodic_motion(duffing, force=HarmonicForce(0.05, 0.13), tolerance=1e-9)
        values = [np.array([0.5])]
    else:
        model = Model(paper_beam(4))
        modes = natural_modes(model, count=3)
        law = ModalDamping(modes, ratios=(0.01, 0.004)) + QuadraticDamping(eta2=0.3)
        base = HarmonicBase(amplitude=2e-3, frequency=10.2)
        body = reduce_model(model, modes=modes, damping=law) if kind == "reduced" else model
        motion = periodic_motion(body, damping=law, base=base)
        values = [np.array([parameter.value for parameter in law.parameters])]
        values += [model.properties] if kind == "full" else []
    values += [np.array([motion.frequency]), np.array([motion.drive_amplitude])]
    function = motion_function(motion)
    sine, cosine = function(*values)[0].full().ravel()
    assert complex(sine, cosine) == pytest.approx(motion.harmonics()[1], rel=1e-6)
    symbols = [cs.MX.sym(name, *function.size_in(name)) for name in function.name_in()]
    jacobians = cs.Function("J", symbols, [cs.jacobian(function(*symbols)[0], symbol) for symbol in symbols])
    rng = np.random.default_rng(1)
    for k, exact in enumerate(jacobians(*values)):
        change = 3e-6 * values[k] * rng.uniform(0.5, 1.0, values[k].shape)
        moved = [[*values[:k], values[k] + sign * change, *values[k + 1 :]] for sign in (1.0, -1.0)]
        difference = (function(*moved[0])[0] - function(*moved[1])[0]).full().ravel() / 2
        product = exact.full() @ change.ravel(order="F")
        assert np.abs(difference - product).max() < 1e-6 * np.abs(product).max() + 1e-12
        assert np.abs(product).max() > 1e-9


@pytest.mark.slow
def test_a_motion_without_neighbour_gives_nan_and_not_a_wrong_number(duffing):
    force = HarmonicForce(amplitude=0.1, frequency=0.1)
    curve = frequency_response(duffing, (0.1, 0.3), force=force)
    upper = curve.motions[curve.bifurcations[0].index - 5]
    function = motion_function(upper)
    beyond = function(0.5, 0.29, 0.1)[0].full().ravel()
    low = periodic_motion(duffing, force=HarmonicForce(0.1, 0.29)).harmonics()[1]
    assert np.isnan(beyond).all() or complex(*beyond) == pytest.approx(low, rel=1e-6)


def test_a_resonance_without_damping_gives_one_clear_line(hanging):
    frequency = float(natural_modes(hanging, count=1).frequencies[0])
    linear = SecondOrderSystem.of(q, v, a, u, conservative=a + q, excitation=u)
    with pytest.raises(NumericsError, match="resonance"):
        periodic_motion(linear, force=HarmonicForce(0.1, 1 / (2 * np.pi)))
    reduced = reduce_model(hanging, modes=1)
    motion = periodic_motion(reduced, base=HarmonicBase(amplitude=1e-3, frequency=0.8 * frequency))
    assert motion.supplied_energy == pytest.approx(0.0, abs=1e-12)


@pytest.mark.slow
def test_a_drive_beyond_half_the_length_is_followed_or_refused(hanging):
    reduced = reduce_model(hanging, modes=4, damping=RayleighDamping(alpha=1.0))
    motion = periodic_motion(reduced, base=HarmonicBase(amplitude=0.3, frequency=1.0))
    assert motion.supplied_energy == pytest.approx(motion.dissipated_energy, rel=1e-9)
    assert np.ptp(motion.displacement(relative=False)) > 0.3


def test_friction_with_a_jump_is_refused_in_one_line():
    rough = SecondOrderSystem.of(q, v, a, u, conservative=a + q, damping=0.1 * cs.sign(v), excitation=u)
    with pytest.raises(NumericsError, match="smooth"):
        periodic_motion(rough, force=HarmonicForce(0.5, 0.1), tolerance=1e-9)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "base|load"),
        ({"base": HarmonicBase(1e-3, 2.0), "load": HarmonicLoad((1e-3, 0.0), 2.0)}, "either"),
        ({"load": HarmonicLoad((1e-3, 0.0), 2.0, follower=True)}, "follows the beam"),
        ({"base": HarmonicBase(1e-3, 2.0, stop=1.0)}, "stops"),
        ({"force": HarmonicForce(1.0, 2.0)}, "SecondOrderSystem"),
        ({"base": HarmonicBase(1e-3, 2.0), "tolerance": 0.0}, "tolerance"),
    ],
)
def test_what_cannot_be_used_is_refused(hanging, options, message):
    with pytest.raises(InputError, match=message):
        periodic_motion(hanging, **options)


def test_a_system_checks_its_expressions():
    w = cs.SX.sym("w")
    with pytest.raises(InputError, match="unknown symbols w"):
        SecondOrderSystem.of(q, v, a, u, conservative=a + w * q)
    with pytest.raises(InputError, match="entries"):
        SecondOrderSystem.of(q, v, a, u, conservative=cs.vertcat(a, q))
    with pytest.raises(InputError, match="parameters"):
        SecondOrderSystem.of(q, v, a, u, mu, conservative=a + mu * q)
    with pytest.raises(InputError, match=r"^conservative: .*linear"):
        SecondOrderSystem.of(q, v, a, u, conservative=a**2 + q)
    SecondOrderSystem.of(q, v, a, u, conservative=(1 + q**2) * a + q)


@pytest.mark.slow
def test_a_hard_stop_ends_the_curve_with_the_part_before_it():
    stopped = SecondOrderSystem.of(
        q, v, a, u, conservative=a + q + 1e6 * cs.fmax(q - 1, 0), damping=0.05 * v, excitation=u
    )
    with pytest.raises(ContinuationError) as caught:
        frequency_response(stopped, (0.1, 0.2), force=HarmonicForce(0.1, 0.1))
    assert caught.value.partial.amplitude().max() == pytest.approx(1.0, abs=0.01)


@pytest.mark.slow
def test_a_curve_is_reported_drawn_and_written(second_mode):
    report = second_mode.report()
    assert "fold" in report
    assert "sweeping up" in report
    data = second_mode.to_dict()
    assert data["jumps"]["up"] == list(second_mode.jumps.up)
    assert len(data["values"]) == len(data["amplitudes"]) == len(data["stable"])
    figure = second_mode.figure(point=0.25)
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == ["unstable", "fold"]
