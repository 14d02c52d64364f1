"""Several modes in one record: recovery, agreement with each mode alone, and refusals."""

import math

import casadi as cs
import numpy as np
import pytest

from ancf_casadi.decay.closed_forms import linear_decay
from ancf_casadi.exceptions import InputError
from problems import fit_decay, fit_modes

TIME = np.arange(0.0, 5.0, 1 / 500)
MODES = [(1.85, 0.0100, 0.050), (10.19, 0.0028, 0.006), (26.84, 0.0028, 0.002)]  # Table 2; Hz, 1, m


def swing(frequency, ratio, r0, v0=0.0):
    return np.asarray(linear_decay(cs.DM(TIME), 2 * math.pi * frequency, ratio, r0, v0)).ravel()


def noise(seed):
    return np.random.default_rng(seed).standard_normal(len(TIME))


def test_modes_without_noise_are_given_back():
    fits = fit_modes(TIME, sum(swing(*mode) for mode in MODES) + 0.1, count=3)
    for fit, (frequency, ratio, r0) in zip(fits, MODES, strict=True):
        assert fit.frequency == pytest.approx(frequency, rel=1e-10)
        assert fit.damping_ratio == pytest.approx(ratio, rel=1e-8)
        assert fit.amplitude == pytest.approx(r0 / math.sqrt(1 - ratio**2), rel=1e-8)
    assert fits[0].offset == pytest.approx(0.1, rel=1e-9)


def test_the_order_of_strength_does_not_matter():
    strong_high = [(1.85, 0.01, 0.004), (10.19, 0.0028, 0.05)]
    low, high = fit_modes(TIME, sum(swing(*mode) for mode in strong_high) - 0.02, count=2)
    assert (low.frequency, high.frequency) == pytest.approx((1.85, 10.19), rel=1e-9)
    assert (low.damping_ratio, high.damping_ratio) == pytest.approx((0.01, 0.0028), rel=1e-7)


def test_each_mode_is_as_sure_as_alone_and_nothing_is_left_but_noise():
    together = sum(swing(*mode) for mode in MODES) + 2e-4 * noise(1)
    fits = fit_modes(TIME, together, count=3)
    for fit, mode in zip(fits, MODES, strict=True):
        alone = fit_decay(TIME, swing(*mode) + 2e-4 * noise(2), offset=False)
        assert fit.standard_errors["damping_ratio"] == pytest.approx(alone.standard_errors["damping_ratio"], rel=0.06)
        assert abs(fit.damping_ratio - mode[1]) < 4 * fit.standard_errors["damping_ratio"]
        assert abs(fit.frequency - mode[0]) < 4 * fit.standard_errors["frequency"]
        assert not any("not noise" in warning for warning in fit.warnings)
    single = fit_decay(TIME, together)
    assert any("not noise" in warning for warning in single.warnings)
    assert single.residual_rms > 10 * fits[0].residual_rms
    parts = sum(fit.displacement(TIME) for fit in fits)
    np.testing.assert_allclose(parts - fits[0].residuals, together, atol=1e-12)
    low, high = fits[1].profile_interval("damping_ratio")
    assert (low, high) == pytest.approx(fits[1].intervals["damping_ratio"], rel=1e-2)


def test_one_mode_is_the_ordinary_fit():
    y = swing(*MODES[0]) + 2e-4 * noise(3)
    np.testing.assert_allclose(fit_modes(TIME, y, count=1)[0].fit.values, fit_decay(TIME, y).fit.values, rtol=1e-6)


@pytest.mark.parametrize("count", [0, 1.5, True, "two"])
def test_an_unusable_count_is_refused(count):
    with pytest.raises(InputError, match="count: must be a whole number, 1 to 500"):
        fit_modes(TIME, swing(*MODES[0]), count=count)


def test_more_modes_than_there_are_is_refused():
    with pytest.raises(InputError, match="record: shows 1 of 2 modes: the rest is noise"):
        fit_modes(TIME, swing(*MODES[0]) + 2e-4 * noise(4), count=2)
