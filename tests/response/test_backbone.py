"""Backbones against the perturbation solution of a cantilever, other formulations and time integration."""

import math

import casadi as cs
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.special import ellipk

from ancf_casadi import (
    ContinuationError,
    FrictionDamping,
    InputError,
    ModalDamping,
    NumericsError,
    QuadraticDamping,
    RayleighDamping,
    SecondOrderSystem,
    State,
    backbone,
    natural_modes,
    reduce_model,
    simulate_reduced,
)

LENGTH = 0.5


@pytest.fixture(scope="module")
def weightless_backbone(weightless):
    return backbone(reduce_model(weightless, modes=8), mode=1, amplitude=0.22 * LENGTH)


def test_the_first_mode_without_gravity_hardens_as_in_the_perturbation_solution(weightless_backbone):
    curve, share = weightless_backbone, 0.02
    shift = curve.frequency(share * LENGTH) / curve.natural_frequency - 1
    assert shift / share**2 == pytest.approx(0.01938, rel=0.01)


@pytest.mark.parametrize(("share", "ratio"), [(0.1, 1.000194484), (0.2, 1.000785941)])
def test_the_first_mode_without_gravity_has_the_reference_frequencies(weightless_backbone, share, ratio):
    curve = weightless_backbone
    assert curve.frequency(share * LENGTH) / curve.natural_frequency == pytest.approx(ratio, abs=2e-6)
    assert np.abs(curve.damping_ratios).max() < 1e-10


@pytest.mark.slow
def test_the_full_beam_has_the_reference_frequencies(weightless):
    curve = backbone(weightless, mode=1, amplitude=0.22 * LENGTH, points=12)
    for share, ratio in ((0.1, 1.000194484), (0.2, 1.000785941)):
        assert curve.frequency(share * LENGTH) / curve.natural_frequency == pytest.approx(ratio, abs=2e-6)


@pytest.mark.slow
def test_gravity_takes_most_of_the_hardening_away(hanging):
    curve = backbone(reduce_model(hanging, modes=8), mode=1, amplitude=0.05)
    shift = curve.frequency(0.025) / curve.natural_frequency - 1
    assert shift / 0.05**2 == pytest.approx(0.0014, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(("mode", "amplitude"), [(1, 0.1), (2, 0.02), (3, 0.006)])
def test_a_motion_of_an_undamped_mode_repeats_itself_in_a_time_integration(hanging, mode, amplitude):
    reduced = reduce_model(hanging, modes=5)
    curve = backbone(reduced, mode=mode, amplitude=amplitude, points=5, tolerance=1e-9)
    assert np.sign(curve.frequencies[-1] - curve.natural_frequency) == (1.0 if mode == 1 else -1.0)
    motion = curve.motions[-1]
    path = motion.trajectory()
    start = State(path.coordinates[0], path.velocities[0])
    period = 1 / motion.frequency
    run = simulate_reduced(reduced, start=start, duration=period, sample_rate=1 / period, steps_per_period=400)
    scale = np.abs(path.q).max()
    assert np.abs(run.q[-1] - run.q[0]).max() < 1e-6 * scale
    linear = 1 / curve.natural_frequency
    late = simulate_reduced(reduced, start=start, duration=linear, sample_rate=1 / linear, steps_per_period=400)
    assert np.abs(late.q[-1] - late.q[0]).max() > 1e-3 * scale * abs(curve.frequencies[-1] * linear - 1)


@pytest.mark.slow
@pytest.mark.parametrize("mode", [1, 2, 3])
def test_the_damping_ratio_of_small_motion_is_that_of_the_law(hanging, mode):
    modes = natural_modes(hanging, count=5)
    for law in (
        RayleighDamping(alpha=0.2, beta=1e-5),
        ModalDamping(modes, ratios=(0.01, 0.003, 0.004)),
        ModalDamping(modes, ratios=(0.01, 0.003, 0.004)) + QuadraticDamping(eta1=0.01, eta2=0.1),
    ):
        curve = backbone(reduce_model(hanging, modes=modes, damping=law), mode=mode, amplitude=1e-4, points=2)
        amplitudes = np.zeros(modes.count)
        amplitudes[mode - 1] = curve.amplitudes[0]
        expected = law.damping_ratios(modes, amplitudes)[mode - 1]
        assert curve.damping_ratios[0] == pytest.approx(expected, abs=1e-6 * expected)
        assert expected > 1e-3


@pytest.mark.slow
def test_under_quadratic_drag_the_damping_ratio_grows_in_proportion_to_the_amplitude(hanging):
    eta2, modes = 0.2, natural_modes(hanging, count=5)
    law = QuadraticDamping(eta2=eta2)
    curve = backbone(reduce_model(hanging, modes=modes, damping=law), mode=1, amplitude=0.02)
    c = law.damping_ratios(modes, [1.0] * 5)[0] * 3 * math.pi / (4 * eta2)
    assert c == pytest.approx(1.0, abs=0.1)  # 1 for the shape of Eq. (21)
    for amplitude in (0.001, 0.005):
        assert curve.damping_ratio(amplitude) == pytest.approx(4 * c * eta2 * amplitude / (3 * math.pi), rel=2e-4)


@pytest.mark.slow
def test_friction_damps_small_motion_most(hanging):
    law = FrictionDamping(eta0=0.01)
    curve = backbone(reduce_model(hanging, modes=3, damping=law), mode=1, amplitude=0.05)
    assert (np.diff(curve.damping_ratios) < 0.0).all()
    modes = natural_modes(hanging, count=3)
    amplitude = float(curve.amplitudes[-1])
    expected = law.damping_ratios(modes, [amplitude] * 3)[0]
    assert curve.damping_ratios[-1] == pytest.approx(expected, rel=0.01)


@pytest.mark.slow
def test_a_decay_of_large_motion_lies_on_the_curve(hanging):
    modes = natural_modes(hanging, count=4)
    law = ModalDamping(modes, ratios=(0.004, 0.003)) + QuadraticDamping(eta2=0.1)
    reduced = reduce_model(hanging, modes=modes, damping=law)
    curve = backbone(reduced, mode=1, amplitude=0.12)
    path = curve.motions[-1].trajectory()
    start = State(path.coordinates[0], path.velocities[0])
    rate = 1000.0
    run = simulate_reduced(reduced, start=start, duration=6.0, sample_rate=rate)
    x = run.tip[:, 0]
    turns = np.flatnonzero((x[1:-1] - x[:-2]) * (x[2:] - x[1:-1]) < 0.0) + 1
    slope, curvature = (x[turns + 1] - x[turns - 1]) / 2, x[turns + 1] - 2 * x[turns] + x[turns - 1]
    times, peaks = (turns - slope / curvature) / rate, np.abs(x[turns] - slope**2 / (2 * curvature))
    energies = CubicSpline(run.time, run.energy)
    kinetic = energies.antiderivative()
    checked = range(0, len(peaks) - 6, 4)  # over three periods, from extreme to extreme
    for k in checked:
        begin, end = times[k], times[k + 6]
        lost = energies(begin).sum() - energies(end).sum()
        mean = (kinetic(end) - kinetic(begin))[0] / (end - begin)
        frequency, middle = 3 / (end - begin), peaks[k + 3]
        assert lost / (mean * 24 * math.pi) == pytest.approx(curve.damping_ratio(middle), rel=0.01)
        assert frequency == pytest.approx(curve.frequency(middle), rel=1e-4)
    assert peaks[checked[-1]] < 0.75 * peaks[0]


def test_a_duffing_oscillator_has_the_exact_period():
    q, v, a, u = (cs.SX.sym(name) for name in ("q", "v", "a", "u"))
    duffing = SecondOrderSystem.of(q, v, a, u, conservative=a + q + q**3)
    curve = backbone(duffing, amplitude=3.0, tolerance=1e-10)
    for A, frequency in zip(curve.amplitudes, curve.frequencies, strict=True):
        period = 4 / math.sqrt(1 + A**2) * ellipk(A**2 / (2 * (1 + A**2)))
        assert frequency == pytest.approx(1 / period, rel=1e-8)


@pytest.mark.slow
def test_what_has_no_backbone_gives_one_clear_line(hanging):
    q, v, a, u = (cs.SX.sym(name) for name in ("q", "v", "a", "u"))
    upside_down = SecondOrderSystem.of(q, v, a, u, conservative=a - q + q**3)
    with pytest.raises(NumericsError, match="unstable"):
        backbone(upside_down, amplitude=0.1)
    stopped = SecondOrderSystem.of(q, v, a, u, conservative=a + q + 1e6 * cs.fmax(q - 1, 0))
    with pytest.raises(ContinuationError) as caught:
        backbone(stopped, amplitude=2.0, tolerance=0.01)
    assert caught.value.partial.amplitudes[-1] == pytest.approx(1.0, abs=0.1)
    with pytest.raises(InputError, match="mode"):
        backbone(reduce_model(hanging, modes=2), mode=3, amplitude=0.1)
    curve = backbone(duffing_of_two(), amplitude=0.1)
    with pytest.raises(InputError, match="amplitude"):
        curve.frequency(0.5)


def duffing_of_two():
    q, v, a, u = (cs.SX.sym(name, 2) for name in ("q", "v", "a", "u"))
    stiffness = cs.SX(cs.DM([[2.0, -1.0], [-1.0, 2.0]]))
    return SecondOrderSystem.of(q, v, a, u, conservative=a + stiffness @ q + cs.vertcat(q[0] ** 3, 0))


def test_the_backbone_is_reported_drawn_and_written():
    curve = backbone(duffing_of_two(), mode=2, amplitude=0.5)
    assert curve.natural_frequency == pytest.approx(math.sqrt(3) / (2 * math.pi))
    data = curve.to_dict()
    assert len(data["amplitudes"]) == len(data["frequencies_hz"]) == len(data["damping_ratios"])
    assert len(curve.table().rows) == len(curve.motions)
    assert len(curve.figure().axes) == 2
