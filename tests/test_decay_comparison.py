"""Selection of a damping law: criteria by hand, the true law found, and what spoils the choice named."""

import json
import math

import casadi as cs
import numpy as np
import pytest

from ancf_casadi.exceptions import InputError
from ancf_casadi.friction import friction_decay
from problems import compare_decay_laws

TIME = np.arange(0.0, 5.0, 1 / 500)
TRUTHS = {"linear": (0.0, 0.25, 0.0), "quadratic": (0.0, 0.15, 0.5), "friction": (0.1, 0.15, 0.5)}


def record(law, seed=0, noise=2e-4, time=TIME):
    η0, η1, η2 = TRUTHS[law]
    y = np.asarray(friction_decay(cs.DM(time), 2 * math.pi * 1.85, η0, η1, η2, 0.076, 0.2)).ravel()
    return y + noise * np.random.default_rng(seed).standard_normal(len(time))


@pytest.mark.parametrize("law", TRUTHS)
def test_the_true_law_is_found(law):
    for seed in range(5):
        comparison = compare_decay_laws(TIME, record(law, seed))
        assert comparison.best.law == law
        assert [fit.law for fit in comparison.fits] == ["linear", "quadratic", "friction"]


def test_the_criteria_are_those_of_the_residuals():
    comparison = compare_decay_laws(TIME, record("quadratic"), laws=("linear", "quadratic"))
    for fit, aicc, bic, K in zip(comparison.fits, comparison.aicc, comparison.bic, (6, 7), strict=True):
        misfit = 2500 * math.log(np.mean(fit.residuals**2))
        assert aicc == pytest.approx(misfit + 2 * K + 2 * K * (K + 1) / (2500 - K - 1), rel=1e-12)
        assert bic == pytest.approx(misfit + K * math.log(2500), rel=1e-12)
    assert comparison.bic[0] - comparison.bic[1] > 10


def test_a_law_with_a_term_at_its_bound_is_the_smaller_law():
    """For these seeds noise would make eta2 negative; Eq. (9) and (27) differ in the second order of the damping."""
    for seed in range(20):
        comparison = compare_decay_laws(TIME, record("linear", seed), laws=("quadratic", "friction"))
        smaller, larger = comparison.fits
        if larger.at_bound == ("eta0",):
            assert comparison.bic[1] == pytest.approx(comparison.bic[0], abs=1e-6)
            assert comparison.best is smaller
            break
    else:
        pytest.fail("no seed has eta0 alone at its bound")


def test_coloured_residuals_are_named():
    coloured = np.convolve(np.random.default_rng(1).standard_normal(2501), [1.0, 0.6], "valid") * 2e-4
    comparison = compare_decay_laws(TIME, record("quadratic", noise=0.0) + coloured)
    (warning,) = [w for w in comparison.warnings if "correlate" in w]
    rho = comparison.best.fit.autocorrelation
    assert rho == pytest.approx(0.6 / 1.36, abs=0.06)
    assert f"2500 samples count as {2500 * (1 - rho) / (1 + rho):.0f}" in warning
    assert not any("correlate" in w for w in compare_decay_laws(TIME, record("quadratic")).warnings)


def test_a_record_that_is_too_short_and_noisy_cannot_tell():
    """None of 9 records of a period and a half."""
    weak = np.arange(0.0, 0.8, 1 / 500)
    for law in TRUTHS:
        for seed in range(3):
            comparison = compare_decay_laws(weak, record(law, seed, noise=4e-3, time=weak))
            assert not comparison.verdict.settled
            assert "the record cannot tell for sure; best by BIC" in comparison.report()
            assert not comparison.to_dict()["settled"]


def test_a_law_without_a_term_does_not_win_where_the_term_may_be_large():
    """The drag is 70 % of the damping, and the record too short to see it: BIC prefers the law without."""
    time = TIME[:400]
    verdicts = [
        compare_decay_laws(time, record("quadratic", seed, noise=4e-3, time=time), laws=("linear", "quadratic"))
        for seed in range(6)
    ]
    preferred = [comparison for comparison in verdicts if comparison.best.law == "linear"]
    assert preferred
    for comparison in preferred:
        assert not comparison.verdict.settled
        assert any("cannot rule out the quadratic law: a term of it may be off by" in w for w in comparison.warnings)


def test_a_short_record_settles_nothing():
    time = TIME[:800]
    warnings = compare_decay_laws(time, record("quadratic", noise=2e-3, time=time)).warnings
    assert any("not clearly worse" in warning or "does not settle" in warning for warning in warnings)


def test_the_result_reads_as_text_and_as_json():
    comparison = compare_decay_laws(TIME, record("friction"))
    table = json.loads(json.dumps(comparison.to_dict(), allow_nan=False))
    assert table["best"] == "friction"
    assert [law["bic"] for law in table["laws"]] == list(comparison.bic)
    text = comparison.report()
    assert "best by BIC: friction" in text
    assert "friction decay, 2500 samples" in text


@pytest.mark.parametrize(
    ("laws", "message"),
    [
        ((), "laws: must be a sequence of laws"),
        ("linear", "laws: must be a sequence of laws, got 'linear'"),
        (("cubic",), "law: must be one of linear, quadratic, friction, one-mode, got 'cubic'"),
    ],
)
def test_unusable_laws_are_refused(laws, message):
    with pytest.raises(InputError, match=message):
        compare_decay_laws(TIME, record("linear"), laws=laws)
