"""Both integrators against exact solutions, energy balances, reference values, and each other."""

from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse.linalg

from ancf_casadi import (
    FrictionDamping,
    HarmonicBase,
    ModalDamping,
    Model,
    QuadraticDamping,
    RayleighDamping,
    SampledBase,
    State,
    natural_modes,
    simulate,
    static_equilibrium,
)

LENGTH = 0.5
WEIGHTLESS = {"gravity": (0.0, 0.0), "axis": (1.0, 0.0)}
CUBIC_ELEMENTS = np.array([1.6552932, 10.3735667, 29.0467016, 56.9225661, 94.1071423])  # Hz, 20 of them, linear
BOTH = pytest.mark.parametrize("method", ["idas", "radau"])


@pytest.fixture(scope="module")
def thick(rubber_beam):
    """A horizontal beam with slow axial waves, so that an undamped run need not resolve 100 kHz."""
    return Model(rubber_beam(6, axis=(1.0, 0.0)))


def bent(modes, amplitudes):
    """Return the state under the load that bends the linear beam like sum A_k phi_k, without stretching it."""
    model, free = modes.model, slice(4, modes.model.size)
    weights = np.array(amplitudes) * modes.angular_frequencies**2 / modes.tip_amplitudes()
    load = model.mass(model.properties).sparse() @ modes.shapes @ weights
    load_at_rest = model.elastic_force(modes.equilibrium.coordinates, model.properties).full().ravel()
    e = modes.equilibrium.coordinates.copy()
    for factor in np.linspace(0.2, 1.0, 5):
        for _ in range(12):
            off = model.elastic_force(e, model.properties).full().ravel() - load_at_rest - factor * load
            stiffness = model.tangent_stiffness(e, model.properties).sparse()[free, free]
            correction = scipy.sparse.linalg.spsolve(stiffness.tocsc(), off[free])
            e[free] -= correction
    assert abs(correction).max() < 1e-11
    return State(e, np.zeros(model.size))


def phasor(run, modes, mode):
    """Phasor q - i q_t/omega of a mode: its phase grows by omega, its logarithm falls by zeta omega, per second."""
    rest = modes.equilibrium.coordinates
    velocity = modes.modal_coordinate(run.velocities + rest, mode)
    return modes.modal_coordinate(run.coordinates, mode) - 1j * velocity / modes.angular_frequencies[mode]


def decay_and_frequency(run, modes, mode):
    """Damping ratio and frequency (Hz) of a mode."""
    q = phasor(run, modes, mode)
    omega = np.polyfit(run.time, np.unwrap(np.angle(q)), 1)[0]
    return -np.polyfit(run.time, np.log(abs(q)), 1)[0] / omega, omega / (2 * np.pi)


def released(model, load, **settings):
    """Return the motion of a weightless beam released from a transverse tip force of load E I/L^2."""
    stiffness = model.beam.elastic_modulus[0] * model.beam.sections[0].second_moment
    start = static_equilibrium(model, tip_force=(0.0, load * stiffness / LENGTH**2))
    return simulate(model, start=start, **settings)


# ---------------------------------------------------------------------------------------------------- small motion


@pytest.mark.parametrize(
    ("method", "tolerance", "mode", "size", "duration", "damping", "shift"),
    [
        ("radau", 1e-8, 0, 1e-3, 2.4, 1e-6, 3e-6),
        ("radau", 1e-8, 4, 3e-4, 0.1, 1e-6, 8e-5),  # of which 6e-5 is the amplitude
        ("idas", 1e-9, 0, 1e-3, 2.4, 2e-4, 3e-4),
        ("idas", 1e-9, 4, 3e-4, 0.1, 1e-5, 4e-4),
    ],
)
def test_an_undamped_mode_keeps_amplitude_and_frequency(
    weightless, method, tolerance, mode, size, duration, damping, shift
):
    modes = natural_modes(weightless)
    start = bent(modes, size * LENGTH * (np.arange(5) == mode))
    rate = 30 * CUBIC_ELEMENTS[mode]
    run = simulate(weightless, start=start, duration=duration, sample_rate=rate, method=method, tolerance=tolerance)
    ratio, frequency = decay_and_frequency(run, modes, mode)
    assert abs(ratio) < damping
    assert abs(frequency / CUBIC_ELEMENTS[mode] - 1) < shift


@pytest.mark.slow
@pytest.mark.parametrize(("method", "tolerance", "limit"), [("idas", 1e-9, 5e-3), ("radau", 1e-9, 1e-3)])
def test_five_modes_at_once_swing_independently(weightless, method, tolerance, limit):
    """Tip = sum A_k cos omega_k t, with omega_k of 20 cubic elements."""
    sizes = 1e-3 * LENGTH / np.arange(1, 6) ** 2
    start = bent(natural_modes(weightless), sizes)
    run = simulate(weightless, start=start, duration=0.24, sample_rate=1000.0, method=method, tolerance=tolerance)
    exact = np.cos(2 * np.pi * np.outer(run.time, CUBIC_ELEMENTS)) @ sizes
    assert abs(run.tip[:, 1] - exact).max() < limit * sizes.sum()


# ---------------------------------------------------------------------------------------------------- large motion


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "tolerance", "amplitude", "ratio"),
    [
        ("radau", 1e-8, 0.1, 1.000194484),
        ("radau", 1e-8, 0.2, 1.000785941),
        ("idas", 6e-10, 0.1, 1.000194484),
        ("idas", 6e-10, 0.2, 1.000785941),
    ],
)
def test_the_frequency_of_a_large_swing_is_that_of_harmonic_balance(paper_beam, method, tolerance, amplitude, ratio):
    shift, reached = backbone(Model(paper_beam(8, **WEIGHTLESS)), amplitude, 1, method, tolerance)
    assert reached == pytest.approx(amplitude, rel=0.05)
    assert shift == pytest.approx((ratio - 1) * (reached / amplitude) ** 2, abs=2e-5)


@pytest.mark.slow
@pytest.mark.parametrize("amplitude", [0.1, 0.2])
def test_the_frequency_of_a_hanging_beam_hardly_depends_on_its_amplitude(paper_beam, amplitude):
    shift, reached = backbone(Model(paper_beam(8)), amplitude, 0, "radau", 1e-8)
    assert shift == pytest.approx(0.0014 * reached**2, abs=3e-6)


def backbone(model, amplitude, across, method, tolerance):
    """Return the frequency shift and mean tip amplitude/L of mode 1, from upward crossings; other modes are damped."""
    modes = natural_modes(model, count=6)
    others = ModalDamping(modes, (0.0, 0.1, 0.1, 0.1, 0.1, 0.1)) + RayleighDamping(beta=3e-5)
    run = simulate(
        model,
        damping=others,
        start=bent(modes, amplitude * LENGTH * (np.arange(6) == 0)),
        duration=2.3,
        sample_rate=1000.0,
        method=method,
        tolerance=tolerance,
    )
    x = run.tip[:, across]
    (before,) = np.nonzero((x[:-1] < 0) & (x[1:] >= 0))
    crossings = run.time[before] - x[before] / (x[before + 1] - x[before]) / 1000.0
    frequency = (len(crossings) - 2) / (crossings[-1] - crossings[1])  # the first swing still contains the other modes
    swings = [abs(x[i:j]).max() for i, j in pairwise(before[1:])]
    return frequency / modes.frequencies[0] - 1, np.mean(swings) / LENGTH


@pytest.mark.slow
def test_the_tip_of_a_large_motion_converges_at_order_four_with_the_elements(paper_beam):
    tips = {
        elements: released(
            Model(paper_beam(elements, **WEIGHTLESS)),
            3.0,
            damping=RayleighDamping(alpha=0.2, beta=3e-5),
            duration=0.15,
            sample_rate=200.0,
            method="radau",
            tolerance=1e-8,
        ).tip
        for elements in (10, 20, 80)
    }
    coarse, fine = (abs(tips[elements] - tips[80]).max() / LENGTH for elements in (10, 20))
    assert abs(tips[80][:, 1] - tips[80][0, 1]).max() > 0.3 * LENGTH
    assert fine < 1e-5
    assert np.log2(coarse / fine) == pytest.approx(4.0, abs=0.4)


# ------------------------------------------------------------------------------------------------------- tolerance


@pytest.mark.slow
@pytest.mark.parametrize(("method", "loose", "factor"), [("idas", 1e-6, 15.0), ("radau", 1e-5, 100.0)])
def test_error_and_loss_of_energy_fall_with_the_tolerance_as_the_order_says(paper_beam, method, loose, factor):
    """Error of order p, step of local error e: tolerance^(p/(e + 1)), 2/3 for IDAS at order 2 and 5/4 for radau."""
    model = Model(paper_beam(6, **WEIGHTLESS))

    def run(method, tolerance):
        law = RayleighDamping(alpha=0.2, beta=3e-5)
        settings = {"duration": 0.2, "sample_rate": 200.0, "method": method, "tolerance": tolerance}
        return released(model, 3.0, damping=law, **settings)

    exact = run("radau", 1e-10)
    errors, losses = [], []
    for tolerance in (loose, loose / 100):
        loosely = run(method, tolerance)
        errors.append(abs(loosely.tip - exact.tip).max() / LENGTH)
        losses.append(abs(loosely.balance_error).max() / exact.strain_energy[0])
    assert errors[0] > factor * errors[1] and losses[0] > factor / 3 * losses[1]
    assert errors[1] < 5e-5 and losses[1] < 5e-5


# ----------------------------------------------------------------------------------------------------- objectivity


@BOTH
def test_a_beam_turned_as_a_whole_is_strained_by_the_centrifugal_force_alone_and_not_damped(paper_beam, method):
    """N = mu Omega^2 (L^2 - s^2)/2, so that U = mu^2 Omega^4 L^5/(15 E A)."""
    model, speed = Model(paper_beam(6, **WEIGHTLESS)), 4 * np.pi
    run = turned(model, RayleighDamping(beta=1e-3), speed, method)
    area = model.beam.sections[0].area
    strained = (model.beam.mass / LENGTH) ** 2 * speed**4 * LENGTH**5 / (15 * 210e9 * area)
    assert run.strain_energy[10:] == pytest.approx(strained, rel=0.02)
    assert run.dissipated_energy[-1] < 2e-6 * run.kinetic_energy[0]
    radius = np.linalg.norm(run.tip, axis=1)
    np.testing.assert_allclose(np.unwrap(np.arctan2(run.tip[:, 1], run.tip[:, 0])), speed * run.time, atol=1e-5)
    np.testing.assert_allclose(radius, LENGTH, rtol=2e-6)


@pytest.mark.slow
@BOTH
def test_damping_by_the_reference_stiffness_resists_the_turn(paper_beam, method):
    model = Model(paper_beam(6, **WEIGHTLESS))
    with pytest.warns(UserWarning, match="not objective"):
        law = RayleighDamping(beta=1e-3, stiffness="reference")
    run = turned(model, law, 4 * np.pi, method)
    assert run.dissipated_energy[-1] > run.kinetic_energy[0]


def turned(model, law, speed, method):
    """Return the motion of a beam whose clamp turns at constant speed, started with that motion."""
    t = np.linspace(0.0, 0.25, 101)
    base = SampledBase(t, np.zeros((101, 2)), speed * t)
    return simulate(model, base=base, damping=law, duration=0.12, sample_rate=500.0, method=method, tolerance=1e-8)


# ---------------------------------------------------------------------------------------- against each other


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "impact"),
    [
        ("rayleigh", False),
        ("quadratic", True),
        ("modal", False),
        ("friction", False),
        ("sum", True),
    ],
)
def test_both_integrators_find_the_same_motion_forces_and_energies_within_their_steps_too(thick, law, impact):
    """Released horizontally, or driven until the moving clamp stops suddenly between two samples."""
    laws = {
        "rayleigh": RayleighDamping(alpha=0.2, beta=3e-5),
        "quadratic": QuadraticDamping(eta1=0.2, eta2=1.0) + RayleighDamping(beta=3e-5),
        "modal": ModalDamping(natural_modes(thick), (0.02,) * 5) + RayleighDamping(beta=3e-5),
        "friction": FrictionDamping(eta0=0.3) + RayleighDamping(beta=3e-5),
    }
    laws["sum"] = laws["modal"] + laws["quadratic"] + laws["friction"]
    damping = laws[law]
    base = HarmonicBase(0.03, 1.85, stop=0.10003, direction=(0.0, 1.0), stop_at="once") if impact else None
    start = "equilibrium" if impact else "straight"
    settings = {"damping": damping, "base": base, "start": start, "duration": 0.2, "sample_rate": 5000.0}
    idas = simulate(thick, method="idas", tolerance=1e-9, **settings)
    radau = simulate(thick, method="radau", tolerance=1e-8, **settings)
    assert radau.steps < 0.6 * len(radau.time)
    assert np.ptp(radau.tip[:, 1]) > 0.03
    lost = idas.dissipated_energy[-1]
    assert abs(radau.tip - idas.tip).max() < 1e-6
    assert lost > 1e-4 and abs(radau.dissipated_energy - idas.dissipated_energy).max() < 1e-4 * lost
    assert abs(radau.base_work - idas.base_work).max() < 1e-4 * np.ptp(idas.kinetic_energy)
    assert abs(idas.base_work).any() == impact
    for part in (slice(0, 2), slice(2, 4)):
        force = idas.clamp_force[1:, part]
        assert abs(radau.clamp_force[1:, part] - force).max() < 2e-3 * abs(force).max()


@BOTH
def test_the_power_of_the_clamps_force_is_the_work_of_the_base(thick, method):
    """By Simpson's rule, with samples ten times as dense as the steps of Radau."""
    run = simulate(
        thick,
        base=HarmonicBase(0.02, 4.0, direction=(0.6, 0.8)),
        damping=RayleighDamping(beta=1e-3),
        duration=0.2,
        sample_rate=10_000.0,
        method=method,
        tolerance=1e-8,
    )
    power = (run.clamp_force * run.velocities[:, :4]).sum(axis=1)
    work = (power[0] + 4 * power[1:-1:2].sum() + 2 * power[2:-1:2].sum() + power[-1]) / 30_000.0
    assert abs(run.base_work).max() > 1e-3
    assert work == pytest.approx(run.base_work[-1], abs=1e-4 * abs(run.base_work).max())


@pytest.mark.slow
def test_the_force_on_the_clamp_of_a_thin_beam_is_right_within_long_steps_too(paper_beam):
    """A polynomial through the ends of the step would stretch the beam: E A is 1.2e7 times E I/L^2."""
    model = Model(paper_beam(6, **WEIGHTLESS))
    law = RayleighDamping(alpha=0.2, beta=1e-4)
    settings = {"damping": law, "duration": 0.1, "sample_rate": 10_000.0}
    idas = released(model, 3.0, method="idas", tolerance=1e-9, **settings)
    radau = released(model, 3.0, method="radau", tolerance=1e-7, **settings)
    later = idas.time > 0.02
    assert radau.steps < len(radau.time) / 4
    for part in (slice(0, 2), slice(2, 4)):
        force = idas.clamp_force[later, part]
        assert abs(radau.clamp_force[later, part] - force).max() < 5e-3 * abs(force).max()
