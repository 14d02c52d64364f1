"""Priors of a decay fit: further measurements of an unknown, as in fits of beams."""

import numpy as np
import pytest

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from problems import fit_decay

TIME = np.linspace(0.0, 5.0, 501)
NOISE = 1e-4 * np.random.default_rng(0).standard_normal(len(TIME))
RECORD = Measurement(TIME, 0.02 * np.exp(-0.1 * TIME) * np.cos(12.0 * TIME) + NOISE)


@pytest.mark.parametrize("logarithmic", [False, True])
def test_a_prior_one_standard_error_away_moves_the_estimates_as_one_more_measurement_would(logarithmic):
    """To first order x + C_k (m - x_k)/(C_kk + s^2) and C - C_k C_k'/(C_kk + s^2), here of the damping ratio."""
    free = fit_decay(RECORD)
    C, k, x = free.fit.covariance, free.fit.names.index("zeta"), free.fit.values
    error, mean = free.fit.errors[k], x[k] + free.fit.errors[k]
    prior = (mean, error / mean, "log-normal") if logarithmic else (mean, error)
    held = fit_decay(RECORD, priors={"damping_ratio": prior})
    assert held.fit.values - x == pytest.approx(C[k] / 2 / error, abs=0.01 * error)
    assert held.fit.covariance == pytest.approx(C - np.outer(C[k], C[k]) / 2 / error**2, rel=0.02, abs=0.02 * error**2)
    assert held.fit.data_shares["zeta"] == pytest.approx(0.5, abs=0.02)
    assert "damping_ratio: the data determine 50%, the prior 50%" in held.report()
    (unknown,) = (item for item in held.to_dict()["fit"]["unknowns"] if item["name"] == "zeta")
    assert unknown["prior"] == pytest.approx((mean, error)) and unknown["data_share"] == pytest.approx(0.5, abs=0.02)
    assert held.refit(RECORD).estimates == held.estimates


def test_a_prior_that_says_nothing_changes_neither_errors_nor_intervals():
    """Also where the errors allow for a law that does not hold."""
    y = 0.02 * np.exp(-0.1 * TIME) * np.cos(12.0 * TIME + 0.3 * np.exp(-2 * TIME)) + NOISE
    free, held = (fit_decay(TIME, y, priors=priors) for priors in (None, {"frequency": (1.9, 10.0)}))
    assert free.fit.effective_samples < len(TIME)
    assert held.standard_errors == pytest.approx(free.standard_errors, rel=1e-2)
    assert held.profile("frequency") == pytest.approx(free.profile("frequency"), rel=1e-6)
    assert held.fit.data_shares["omega"] == pytest.approx(1.0)


def test_a_prior_determines_what_the_record_leaves_open():
    """Three periods hardly tell the exponent, on which the rate of decay depends."""
    short = RECORD.cut(0.0, 1.5)
    free, held = (fit_decay(short, law="power", priors=priors) for priors in (None, {"exponent": (1.0, 0.02)}))
    assert free.standard_errors["exponent"] > 10 * held.standard_errors["exponent"]
    assert abs(held.damping_ratio - 0.1 / 12) < 3 * held.standard_errors["damping_ratio"]


def test_priors_that_cannot_be_used_are_refused():
    for priors, message in (
        ({"omega": (12.0, 0.1)}, "priors: unknown key 'omega'; known are damping_ratio, e0, frequency"),
        ({"frequency": (1.9, 0.0)}, "priors: frequency: must be positive"),
        (["frequency"], "priors: must be a mapping, got a list"),
    ):
        with pytest.raises(InputError, match=message):
            fit_decay(RECORD, priors=priors)
    with pytest.raises(InputError, match="name a law, or leave out priors"):
        fit_decay(RECORD, law="auto", priors={"frequency": (1.9, 0.1)})
