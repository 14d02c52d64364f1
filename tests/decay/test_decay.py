"""Closed forms of the free decay against their equations of motion; first guesses against known truth."""

import math

import casadi as cs
import numpy as np
import pytest

from ancf_casadi.decay.closed_forms import (
    equivalent_damping_ratio,
    friction_envelope,
    linear_decay,
    quadratic_decay,
    quadratic_envelope,
)
from ancf_casadi.decay.first_guess import first_guess
from ancf_casadi.decay.release import find_release
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from tests.decay.integration import drag_motion

TIME = np.arange(0.0, 5.0, 1 / 500)
TABLE_4 = [  # Hz, 1/s, 1/m (the paper's are per mm), and the amplitude in m that its equivalent ratio implies
    (1.85, 0.15, 0.11, 0.0760),
    (10.19, 0.31, 0.06, 0.0149),
    (26.84, 0.89, 0.05, 0.0076),
    (53.20, 1.46, 0.05, 0.0055),
    (88.60, 3.00, 0.05, 0.0144),
]
ONE_TERM = [(1.85, 0.0, 0.33, 0.076), (1.85, 0.15, 0.0, 0.076)]
TABLE_4_RATIOS = [0.0100, 0.0028, 0.0028, 0.0023, 0.0030]


def numbers(value):
    return np.asarray(value).ravel()


def swing(frequency, ratio, r0, v0=0.0, time=TIME):
    return numbers(linear_decay(cs.DM(time), 2 * math.pi * frequency, ratio, r0, v0))


@pytest.mark.parametrize("ζ", [0.0, 0.01, 0.3, 0.9, -0.02])
def test_the_linear_decay_obeys_its_equation_of_motion_and_start(ζ):
    t = cs.MX.sym("t")
    ω, r0, v0 = 11.6, 0.05, -0.3
    r = linear_decay(t, ω, ζ, r0, v0)
    velocity = cs.gradient(r, t)
    force = cs.gradient(velocity, t) + 2 * ζ * ω * velocity + ω**2 * r
    evaluate = cs.Function("evaluate", [t], [r, velocity, force])
    assert float(evaluate(0.0)[0]) == pytest.approx(r0)
    assert float(evaluate(0.0)[1]) == pytest.approx(v0)
    for time in (0.0, 0.1, 0.77, 2.0):
        assert float(evaluate(time)[2]) == pytest.approx(0.0, abs=1e-11)


@pytest.mark.parametrize(("frequency", "η1", "η2", "e0"), [*TABLE_4, *ONE_TERM])
def test_the_quadratic_decay_approximates_a_numerical_solution(frequency, η1, η2, e0):
    """Errors of first order in the equivalent damping ratio, 1 % at most, are those of the closed form itself."""
    ω = 2 * math.pi * frequency
    period = 1 / frequency
    times = np.arange(0, 20 * period, period / 100)
    displacement, velocity = drag_motion(η1, η2, ω, [e0, 0.0], times)
    ratio = equivalent_damping_ratio(η1, η2, ω, e0)
    closed = numbers(quadratic_decay(cs.DM(times), ω, η1, η2, e0, 0.0))
    np.testing.assert_allclose(closed, displacement, atol=1.1 * ratio * e0)
    measured = np.hypot(displacement, velocity / ω)[::100]
    envelope = numbers(quadratic_envelope(cs.DM(times[::100]), ω, η1, η2, e0))
    np.testing.assert_allclose(envelope, measured, rtol=2 * ratio**2 + 1e-8)


def test_the_envelope_without_linear_damping_is_a_hyperbola():
    ω, η2, e0 = 11.6, 0.33, 0.076
    limit = e0 / (1 + 4 * ω * η2 * e0 * TIME / (3 * math.pi))
    for η1 in (0.0, 1e-14, 1e-9):
        np.testing.assert_allclose(numbers(quadratic_envelope(cs.DM(TIME), ω, η1, η2, e0)), limit, rtol=1e-8)
    np.testing.assert_allclose(numbers(quadratic_envelope(cs.DM(TIME), ω, 0.0, η2, e0)), limit, rtol=1e-15)


def test_the_envelope_is_the_printed_one_where_that_is_finite():
    ω, η1, η2, e0 = 11.6, 0.15, 0.11, 0.076
    falling = np.exp(-η1 * TIME / 2)
    printed = 3 * math.pi * η1 * e0 * falling / (8 * ω * η2 * e0 * (1 - falling) + 3 * math.pi * η1)  # Eq. (27)
    np.testing.assert_allclose(numbers(quadratic_envelope(cs.DM(TIME), ω, η1, η2, e0)), printed, rtol=1e-12)


@pytest.mark.parametrize("η1", [0.0, 1e-6, 0.0399, 0.0401, 3.0])
@pytest.mark.parametrize("symbol", [cs.SX.sym, cs.MX.sym])
def test_derivatives_agree_with_differences(η1, symbol):
    x = symbol("x", 5)
    a = quadratic_decay(5.0, *(x[i] for i in range(5)))
    point = np.array([11.6, η1, 0.33, 0.076, 0.2])
    evaluate = cs.Function("evaluate", [x], [a, cs.gradient(a, x), cs.hessian(a, x)[0]])
    gradient, hessian = (item.full() for item in evaluate(point)[1:])
    for i, h in enumerate((1e-5, 1e-4, 1e-4, 1e-5, 1e-4)):
        step = h * np.eye(5)[i]
        (above, slope_above, _), (below, slope_below, _) = evaluate(point + step), evaluate(point - step)
        assert gradient[i, 0] == pytest.approx(float(above - below) / (2 * h), rel=1e-5, abs=1e-7)
        difference = (slope_above - slope_below).full().ravel() / (2 * h)
        np.testing.assert_allclose(hessian[i], difference, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize(("row", "ratio"), list(zip(TABLE_4, TABLE_4_RATIOS, strict=True)))
def test_the_equivalent_ratio_is_that_of_table_4(row, ratio):
    frequency, η1, η2, amplitude = row
    assert equivalent_damping_ratio(η1, η2, 2 * math.pi * frequency, amplitude) == pytest.approx(ratio, rel=2e-3)


@pytest.mark.parametrize("η0", [0.0, 0.05])
@pytest.mark.parametrize(("frequency", "η1", "η2", "e0"), TABLE_4)
def test_the_equivalent_ratio_is_the_decay_rate_of_the_envelope(frequency, η1, η2, e0, η0):
    t, ω = cs.MX.sym("t"), 2 * math.pi * frequency
    a = friction_envelope(t, ω, η0, η1, η2, e0)
    rate = float(cs.Function("rate", [t], [-cs.gradient(a, t) / (ω * a)])(0.0))
    assert equivalent_damping_ratio(η1, η2, ω, e0, η0) == pytest.approx(rate, rel=1e-12)


@pytest.mark.parametrize("noise", [0.0, 0.02, 0.2])
@pytest.mark.parametrize(("frequency", "ratio"), [(1.85, 0.01), (10.19, 0.0028), (88.6, 0.003), (3.0, 0.3)])
def test_the_first_guess_is_near_the_truth(frequency, ratio, noise):
    y = 0.7 + swing(frequency, ratio, -0.3, 2.0) + 0.3 * noise * np.random.default_rng(3).standard_normal(len(TIME))
    guess = first_guess(Measurement(TIME, y))
    assert guess.release == 0
    assert guess.ω == pytest.approx(2 * math.pi * frequency, abs=0.7 / guess.duration)
    assert ratio / 1.7 < guess.ζ < 1.7 * ratio
    assert guess.rest[0] == pytest.approx(0.7, abs=0.05)
    assert guess.amplitude * math.cos(guess.phase) == pytest.approx(-0.3, abs=0.15)
    ω_d = guess.ω * math.sqrt(1 - guess.ζ**2)
    v0 = -guess.amplitude * (guess.ζ * guess.ω * math.cos(guess.phase) + ω_d * math.sin(guess.phase))
    assert v0 == pytest.approx(2.0, abs=0.7 + 0.7 * 0.3 * guess.ω)


@pytest.mark.parametrize("noise", [0.0, 1e-3, 0.03])
@pytest.mark.parametrize("rest", [0.8, 2.3, 7.7])
@pytest.mark.parametrize("level", [0.05, -0.05])
def test_the_release_after_rest_is_found(level, rest, noise):
    """Within a tenth of a period: the first motion is less than the noise."""
    time = np.arange(0.0, rest + 5.0, 0.01)
    y = swing(2.0, 0.02, level, time=np.maximum(time - rest, 0.0)) - 0.3
    y += noise * 0.05 * np.random.default_rng(5).standard_normal(len(time))
    assert time[find_release(time, y).index] == pytest.approx(rest, abs=0.05)


@pytest.mark.parametrize("phase", np.linspace(0.0, 2 * math.pi, 9))
@pytest.mark.parametrize("ratio", [0.0, 0.01, 0.2])
def test_a_record_without_rest_is_taken_from_its_first_sample(ratio, phase):
    y = swing(2.0, ratio, 0.05 * math.cos(phase), 0.6 * math.sin(phase))
    release = find_release(TIME, y)
    assert (release.index, release.reason, release.notes) == (0, "the first sample", ())


@pytest.mark.parametrize(
    ("displacement", "message"),
    [
        (np.full(500, 0.3), "is constant"),
        (np.zeros(500), "is constant"),
        (np.random.default_rng(6).standard_normal(500), "noise"),
        (np.exp(-TIME), "fewer than two periods"),
        (np.exp(-30 * TIME), "fewer than two periods"),
        (np.exp(-3 * TIME) + 0.01 * np.random.default_rng(7).standard_normal(len(TIME)), "fewer than two periods"),
        (TIME, "straight line"),
        (np.where(TIME < 2.0, 0.0, 1.0), "constant from 2 s on"),
        (np.cos(2 * math.pi * 0.2 * TIME), "fewer than two periods"),
        (np.cos(np.arange(9)), "9 samples"),
    ],
)
def test_a_record_in_which_nothing_oscillates_is_refused(displacement, message):
    with pytest.raises(InputError, match=f"record: .*{message}"):
        first_guess(Measurement(TIME[: len(displacement)], displacement))


@pytest.mark.slow
def test_noise_is_hardly_ever_taken_for_an_oscillation():
    rng = np.random.default_rng(8)
    for _ in range(200):
        samples = int(rng.integers(12, 300))
        with pytest.raises(InputError, match="nothing oscillates"):
            first_guess(Measurement(TIME[:samples], rng.standard_normal(samples)))


def test_noise_that_a_sensor_averages_over_three_samples_is_hardly_ever_taken_for_an_oscillation():
    """The noise is coloured; where half the samples count as independent, 1 of 200 such records passes."""
    rng, taken = np.random.default_rng(9), 0
    for _ in range(60):
        values = np.convolve(rng.standard_normal(int(rng.integers(12, 600)) + 2), np.ones(3), "valid")
        try:
            taken += first_guess(Measurement(TIME[: len(values)], values)).ω > 0.0
        except InputError:
            pass
    assert taken <= 2


def test_an_oscillation_no_larger_than_the_noise_is_found():
    rng, found, time = np.random.default_rng(10), 0, np.arange(0.0, 10.0, 0.01)
    for _ in range(20):
        y = np.exp(-0.2 * time) * np.cos(8 * math.pi * time) + rng.standard_normal(len(time))
        try:
            found += abs(first_guess(Measurement(time, y), release_time=0.0).ω - 8 * math.pi) < 0.2
        except InputError:
            pass
    assert found >= 17


@pytest.mark.parametrize("late", [4.99, 5.0, 100.0])
def test_a_release_too_late_leaves_too_few_samples(late):
    with pytest.raises(InputError, match=r"record: .* samples"):
        first_guess(Measurement(TIME, swing(1.85, 0.01, 0.05)), release_time=late)
