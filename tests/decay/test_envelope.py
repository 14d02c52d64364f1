"""Damping against amplitude: all three laws recovered without a given law, coverage of the errors, refusals."""

import math

import casadi as cs
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from ancf_casadi.decay.closed_forms import equivalent_damping_ratio, friction_decay, friction_envelope
from ancf_casadi.decay.envelope import damping_curve
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from tests.decay.integration import drag_motion

TIME = np.arange(0.0, 15.0, 1 / 500)
ω, E0 = 2 * math.pi * 1.85, 0.076
TERMS = [(0.0, 0.25, 0.0), (0.0, 0.05, 0.5), (0.02, 0.05, 0.1)]


def numbers(value):
    return np.asarray(value).ravel()


def record(η0, η1, η2, noise=0.0, seed=0, rest=0.3):
    y = numbers(friction_decay(cs.DM(TIME), ω, η0, η1, η2, E0, 0.2)) + rest
    return Measurement(TIME + 2.0, y + noise * np.random.default_rng(seed).standard_normal(len(TIME)))


@pytest.mark.parametrize("terms", TERMS)
def test_the_curve_is_the_equivalent_damping_ratio_at_each_amplitude(terms):
    η0, η1, η2 = terms
    curve = damping_curve(record(*terms))
    assert len(curve.time) == 13
    np.testing.assert_allclose(
        curve.amplitude, numbers(friction_envelope(cs.DM(curve.time - 2.0), ω, η0, η1, η2, E0)), rtol=2e-3
    )
    expected = equivalent_damping_ratio(η1, η2, ω, curve.amplitude, η0)
    np.testing.assert_allclose(curve.damping_ratio, expected, rtol=1e-2)
    np.testing.assert_allclose(curve.frequency, 1.85, rtol=5e-4)


@pytest.mark.slow
def test_the_equation_of_motion_shows_its_terms():
    """A line through the curve of a numerical solution of Eq. (26) has eta1/(2 omega) and 4 eta2/(3 pi)."""
    η1, η2 = 0.1, 0.3
    displacement, _ = drag_motion(η1, η2, ω, [E0, 0.0], TIME)
    curve = damping_curve(Measurement(TIME, displacement))
    slope, intercept = np.polyfit(curve.amplitude, curve.damping_ratio, 1)
    assert slope == pytest.approx(4 * η2 / (3 * math.pi), rel=0.01)
    assert intercept == pytest.approx(η1 / (2 * ω), rel=0.02)


def test_strong_damping_is_not_biased():
    time = np.arange(0.0, 3.0, 1 / 500)
    y = np.exp(-0.1 * ω * time) * np.cos(ω * math.sqrt(1 - 0.1**2) * time)
    np.testing.assert_allclose(damping_curve(Measurement(time, y)).damping_ratio, 0.1, rtol=1e-6)


def test_the_curve_ends_in_the_noise():
    curve = damping_curve(record(0.0, 1.5, 0.0, noise=5e-4))
    assert 2.0 < curve.time[-1] < 10.0
    assert curve.amplitude[-1] > 1e-4
    inside = np.abs(curve.damping_ratio - 0.75 / ω) < 4 * curve.damping_ratio_errors
    assert inside.all()


def test_three_other_oscillations_are_fitted_beside_the_mode():
    tones = sum(0.002 * np.cos(ratio * ω * TIME + ratio) for ratio in (3.3, 5.1, 7.4))
    one = record(0.0, 0.05, 0.5, noise=1e-5)
    clean, curve = damping_curve(one), damping_curve(Measurement(one.time, one.values + tones))
    np.testing.assert_allclose(curve.damping_ratio, clean.damping_ratio, atol=1e-4)


def test_windows_of_more_periods_are_fewer_and_less_noisy():
    short, long = (damping_curve(record(*TERMS[0], noise=2e-4), periods=n) for n in (1.5, 6.0))
    assert len(short.time) > 3 * len(long.time)
    assert long.damping_ratio_errors[0] < 0.2 * short.damping_ratio_errors[0]


def test_the_curve_is_a_table():
    curve = damping_curve(record(*TERMS[1]))
    header, first, *_ = curve.table().csv().splitlines()
    assert header == "time_s,amplitude_m,damping_ratio,damping_ratio_stderr,frequency_hz,frequency_stderr_hz"
    assert [float(cell) for cell in first.split(",")][:3] == [curve.time[0], curve.amplitude[0], curve.damping_ratio[0]]


def test_the_curve_is_drawn_with_its_errors():
    curve = damping_curve(record(*TERMS[1], noise=2e-4))
    ratio, frequency = curve.figure().axes
    assert (ratio.get_xlabel(), ratio.get_ylabel()) == ("amplitude, mm", "damping ratio, %")
    assert frequency.get_ylabel() == "frequency, Hz"
    np.testing.assert_allclose(np.asarray(ratio.lines[0].get_ydata()), 100 * curve.damping_ratio)


@pytest.mark.parametrize(
    ("periods", "message"),
    [
        (0.0, "positive"),
        (0.5, "1 or more"),
        ("two", "finite number"),
        (1000.0, "are more than the"),
    ],
)
def test_unusable_windows_are_refused(periods, message):
    with pytest.raises(InputError, match=f"periods: .*{message}"):
        damping_curve(record(*TERMS[0]), periods=periods)


def test_unusable_records_are_refused():
    time = np.arange(0.0, 15.0, 0.2)
    with pytest.raises(InputError, match=r"periods: .*5 samples"):
        damping_curve(Measurement(time, np.cos(ω * time)), periods=2.0)
    assert damping_curve(Measurement(time, np.cos(ω * time))).frequency == pytest.approx(1.85, rel=1e-6)
    with pytest.raises(InputError, match="record: is constant"):
        damping_curve(Measurement(TIME, np.ones(len(TIME))))


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", ["white", "autoregressive", "second mode", "frequency falls with amplitude", "dropped"]
)
def test_stated_errors_are_the_scatter_between_records(kind):
    """Ratio of scatter to error over 30 records; a drifting frequency or another mode is not noise, colour is."""
    t, Ω, rate = np.arange(0.0, 6.0, 1 / 200), 14 * math.pi, 0.35
    A = 0.02 * np.exp(-rate * t)
    curves = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        phase, noise, keep = rng.uniform(0.0, 6.0), rng.standard_normal(len(t)), np.ones(len(t), dtype=bool)
        turned = Ω * t
        if kind == "autoregressive":
            noise = lfilter([math.sqrt(1 - 0.9**2)], [1.0, -0.9], rng.standard_normal(len(t) + 200))[200:]
        if kind == "frequency falls with amplitude":
            turned = turned - 0.3 * Ω * (0.02 - A) / rate
        if kind == "dropped":
            keep = rng.random(len(t)) > 0.3
        y = A * np.cos(turned + phase) + 2e-4 * noise
        if kind == "second mode":
            y += 0.001 * np.exp(-0.8 * t) * np.cos(6.27 * Ω * t + rng.uniform(0.0, 6.0))
        curves.append(damping_curve(Measurement(t[keep], y[keep])))
    count = min(len(curve.time) for curve in curves)
    for name in ("damping_ratio", "frequency"):
        values = np.array([getattr(curve, name)[:count] for curve in curves])
        errors = np.array([getattr(curve, f"{name}_errors")[:count] for curve in curves])
        ratio = math.sqrt(np.mean(np.var(values, axis=0, ddof=1) / np.mean(errors**2, axis=0)))
        assert 0.8 < ratio < 1.25


def test_interpolating_a_record_does_not_change_its_errors():
    rng, t = np.random.default_rng(0), np.arange(0.0, 6.0, 1 / 100)
    record = Measurement(t, 0.02 * np.exp(-0.35 * t) * np.cos(14 * math.pi * t) + 2e-4 * rng.standard_normal(len(t)))
    fine = np.arange(0.0, t[-1], 1 / 1000)
    dense = Measurement(fine, CubicSpline(t, record.values)(fine))
    one, ten = damping_curve(record), damping_curve(dense)
    count = min(len(one.time), len(ten.time)) - 1
    np.testing.assert_allclose(ten.damping_ratio_errors[:count], one.damping_ratio_errors[:count], rtol=0.3)


def test_a_fast_change_at_the_release_leaves_the_errors_of_the_other_windows():
    """A hardening mode, f (1 + k A^2), falls from 2 % above f within its first windows; the noise is 0.2 % of A."""
    t, ω, λ, k = np.arange(0.0, 16.0, 1 / 1000), 2 * math.pi * 37.0, 2.0, 0.02
    phase = ω * (t + k * (1 - np.exp(-2 * λ * t)) / (2 * λ))
    y = np.exp(-λ * t) * np.cos(phase) + 2e-3 * np.random.default_rng(0).standard_normal(len(t))
    curve = damping_curve(Measurement(t, y), periods=8.0, release_time=0.0)
    expected = ω / (2 * math.pi) * (1 + k * curve.amplitude**2)
    score = ((curve.frequency - expected) / curve.frequency_errors)[2:]
    assert 0.6 < math.sqrt(np.mean(score**2)) < 1.5


def test_windows_follow_the_decay():
    """By default 40 windows share a long record, or 8 a fall by a factor of e, with two periods or more."""
    t = np.arange(0.0, 40.0, 0.01)
    for rate, width in ((0.01, 1.0), (0.4, 2.5 / 8), (4.0, 0.2)):
        noise = 1e-4 * np.random.default_rng(0).standard_normal(len(t))
        found = damping_curve(Measurement(t, np.exp(-rate * t) * np.cos(20 * math.pi * t) + noise), release_time=0.0)
        assert np.diff(found.time).min() == pytest.approx(width, rel=0.35)
