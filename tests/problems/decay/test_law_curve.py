"""Damping ratio and frequency against amplitude under the fitted law, and the figure of a decay fit."""

import math

import casadi as cs
import numpy as np
import pytest

from ancf_casadi.exceptions import InputError
from problems import fit_decay
from problems.decay.law_curve import law_curve, measured_curve
from problems.decay.laws import DecayModel
from tests.decay.integration import drag_motion

F, ETA2, A0 = 6.9, 0.4, 0.02


def fitted(periods=60.0, seed=0, **options):
    """Quadratic damping alone, and a frequency that falls by 3 % per cm of amplitude."""
    time, ω = np.arange(0.0, periods / F, 1 / (25 * F)), 2 * math.pi * F
    b = 4 * ω * ETA2 / (3 * math.pi)
    amplitude = A0 / (1 + b * A0 * time)
    phase = ω * time - 3.0 * ω * np.log(1 + b * A0 * time) / b
    y = amplitude * np.cos(phase) + 1e-4 * np.random.default_rng(seed).standard_normal(len(time))
    return fit_decay(time, y, **({"law": "quadratic", "frequency_law": "linear"} | options))


@pytest.mark.slow
def test_the_band_holds_the_truth_and_starts_at_the_reported_values():
    inside = []
    for seed in range(20):
        fit = fitted(seed=seed)
        curve = law_curve(fit, np.append(np.linspace(0.005, 0.018, 5), fit.amplitude))
        assert curve.damping_ratio[-1] == pytest.approx(fit.damping_ratio, rel=1e-9)
        low, high = curve.damping_ratio_band[2]
        inside.append(low <= 4 * ETA2 * curve.amplitude[2] / (3 * math.pi) <= high)
        low, high = curve.frequency_band[2]
        inside.append(low <= F * (1 - 3.0 * curve.amplitude[2]) <= high)
    assert np.mean(inside) >= 0.85


@pytest.mark.slow
def test_the_band_of_a_logarithmic_frequency_holds_the_truth_where_the_record_hardly_shows_the_corner():
    """Friction stops the mode soon after its amplitude falls below the corner; to first order, 30 and 36 of 40 hold."""
    model = DecayModel("friction", "zero", "logarithmic", reference=0.05)
    values = (43.35, 0.43, 0.19, 0.15, -0.004, -3.0, 0.05)
    time, inside = np.arange(0.0, 10.0, 1 / 200), []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        x = [*map(cs.MX, (*values, rng.uniform(0.0, 2 * math.pi)))]
        truth = [
            cs.evalf(part).full().item()
            for part in (model.against_amplitude(np.array([1e-3]), *x)[1], model.quantities(*x)[0])
        ]
        y = cs.evalf(model.curve(time, *x)).full().ravel() + 1e-3 * rng.standard_normal(len(time))
        fit = fit_decay(time, y, law="friction", frequency_law="logarithmic", release_time=0.0)
        bands = law_curve(fit, [1e-3]).frequency_band[0], fit.intervals()["frequency"]
        inside.append([low <= value <= high for value, (low, high) in zip(truth, bands, strict=True)])
    assert np.sum(inside, axis=0).min() >= 18


def test_amplitudes_lie_between_the_release_and_the_end_of_the_record():
    fit = fitted()
    amplitude = law_curve(fit).amplitude
    assert amplitude[-1] == pytest.approx(fit.amplitude)
    assert amplitude[0] == pytest.approx(A0 / (1 + 8 * F * ETA2 / 3 * A0 * fit.time[-1]), rel=0.2)
    with pytest.raises(InputError, match="amplitudes: must be positive"):
        law_curve(fit, [0.0, 0.01])


@pytest.mark.slow
@pytest.mark.parametrize("periods", [5.0, 120.0])
def test_the_figure_shows_record_residuals_and_both_curves(periods):
    fit = fitted(periods, frequency_law="constant" if periods < 10 else "linear")
    figure = fit.figure()
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert "record, mm" in labels
    assert {"autocorrelation", "damping ratio, %", "frequency, Hz"} <= set(labels)
    assert len(figure.axes) == (5 if periods < 10 else 6)  # the first periods beside a long record
    assert "frequency (" in figure.subfigs[0].get_suptitle()
    windows = figure.axes[-2].containers[0].lines[0].get_xdata()
    assert 0 < len(np.asarray(windows)) <= 41
    figure.draw_without_rendering()


def exact_motion(η1, η2, time):
    """Return the displacement by Eq. (26) itself, released from 0.02 m at 2 Hz."""
    return drag_motion(η1, η2, 4 * math.pi, [0.02, 0.0], time)[0]


@pytest.mark.parametrize(("η1", "η2"), [(0.0, 2.0), (0.5, 1.0), (0.5, 0.0)])
def test_windows_show_the_frequency_of_the_law_under_drag(η1, η2):
    time = np.arange(0.0, 20.0, 0.01)
    noise = 1e-5 * np.random.default_rng(0).standard_normal(time.size)
    fit = fit_decay(time, exact_motion(η1, η2, time) + noise, law="quadratic")
    windows = measured_curve(fit)
    difference = windows.frequency - law_curve(fit, windows.amplitude).frequency
    assert abs(difference / windows.frequency_errors).max() < 3.0


@pytest.mark.parametrize(("η1", "η2"), [(0.0, 4.0), (0.5, 1.0), (0.2, 3.0)])
def test_the_oscillation_is_slower_than_omega_in_the_second_order_of_the_damping(η1, η2):
    """The line through the phase lag, weighted by the amplitude as in a fit, gives the frequency of the fit."""
    time, ω = np.arange(0.0, 20.0, 0.01), 4 * math.pi
    fit = fit_decay(time, exact_motion(η1, η2, time), law="quadratic", rest="zero")
    drag = 4 * η2 / (3 * math.pi) * fit.decay.modes[0].model.amplitude(time, *map(cs.MX, fit.fit.values.tolist()))
    drag = cs.evalf(drag).full().ravel()
    slower = η1 / (4 * ω) * (η1 / (2 * ω) + drag) + 0.092 * drag**2
    lag = ω * np.concatenate([[0.0], np.cumsum((slower[1:] + slower[:-1]) / 2 * np.diff(time))])
    slope = np.polyfit(time, lag, 1, w=drag)[0]
    assert 1 - fit.frequency / 2.0 == pytest.approx(slope / ω, rel=0.02)
