"""Fits of Eq. (27) to numerical solutions of the equation of motion of one mode, Eq. (26)."""

import math

import numpy as np
import pytest

from problems import fit_decay
from tests.decay.integration import drag_motion

FREQUENCY, NOISE = 1.85, 2e-5  # Hz, m
TIME = np.arange(0.0, 5.0, 1 / 200)


def solution(η1, η2, r0=0.076, v0=-0.1):
    """Return the displacement of the mode with white noise."""
    displacement, _ = drag_motion(η1, η2, 2 * math.pi * FREQUENCY, [r0, v0], TIME)
    return displacement + NOISE * np.random.default_rng(2).standard_normal(len(TIME))


@pytest.mark.parametrize(("η1", "η2"), [(0.03, 0.1), (0.15, 0.11), (0.0, 0.25)])
def test_the_closed_form_recovers_the_coefficients_of_the_equation(η1, η2):
    """Errors are of first order in the equivalent damping ratio, which is 0.4 to 1 % at the release."""
    fit = fit_decay(TIME, solution(η1, η2), law="quadratic", release_time=0.0)
    assert 0.004 < fit.damping_ratio < 0.011
    for name, truth in (("frequency", FREQUENCY), ("eta1", η1), ("eta2", η2)):
        error = 4 * fit.standard_errors.get(name, 0.0) + fit.damping_ratio * truth
        assert getattr(fit, name) == pytest.approx(truth, abs=error)


def test_a_fit_warns_if_the_damping_is_too_strong_for_the_closed_form():
    """The equivalent ratio is 15 % at the release."""
    fit = fit_decay(TIME, solution(0.5, 4.0), law="quadratic")
    assert fit.residual_rms > 3 * NOISE
    assert any("not noise" in text for text in fit.warnings)
