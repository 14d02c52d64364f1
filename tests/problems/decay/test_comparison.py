"""Selection of a damping law: criteria by hand, the true law found, and warnings of what spoils the choice."""

import json
import math
from dataclasses import replace

import casadi as cs
import numpy as np
import pytest

from ancf_casadi.decay.closed_forms import friction_decay
from ancf_casadi.estimation.criteria import Candidate, judge
from ancf_casadi.exceptions import InputError
from problems import compare_decay_laws, fit_decay
from problems.decay import comparison as comparison_module
from problems.decay import fitting

TIME = np.arange(0.0, 5.0, 1 / 500)
CONSTANT = {"frequency_laws": ("constant",), "rests": ("constant",)}
TRUTHS = {"linear": (0.0, 0.25, 0.0), "quadratic": (0.0, 0.15, 0.5), "friction": (0.1, 0.15, 0.5)}


def record(law, seed=0, noise=2e-4, time=TIME):
    η0, η1, η2 = TRUTHS[law]
    y = np.asarray(friction_decay(cs.DM(time), 2 * math.pi * 1.85, η0, η1, η2, 0.076, 0.2)).ravel()
    return y + noise * np.random.default_rng(seed).standard_normal(len(time))


@pytest.mark.slow
@pytest.mark.parametrize("law", TRUTHS)
def test_the_true_law_is_found(law):
    for seed in range(3):
        comparison = compare_decay_laws(TIME, record(law, seed))
        assert (comparison.best.law, comparison.best.frequency_law) == (law, "constant")
    assert comparison.names[:4] == ("linear", "quadratic", "friction", "power")
    bent = tuple(f"{law} + {bend} frequency" for bend in ("linear", "quadratic", "logarithmic"))
    assert comparison.names[4:] == (*bent, f"{law} + drift", f"{law} + creep")


def test_the_criteria_are_those_of_the_residuals():
    comparison = compare_decay_laws(TIME, record("quadratic"), laws=("linear", "quadratic"), **CONSTANT)
    for fit, aicc, bic, K in zip(comparison.fits, comparison.verdict.aicc, comparison.verdict.bic, (6, 7), strict=True):
        misfit = 2500 * math.log(np.mean(fit.residuals**2))
        assert aicc == pytest.approx(misfit + 2 * K + 2 * K * (K + 1) / (2500 - K - 1), rel=1e-12)
        assert bic == pytest.approx(misfit + K * math.log(2500), rel=1e-12)
    assert comparison.verdict.bic[0] - comparison.verdict.bic[1] > 10


def test_a_law_with_a_term_at_its_bound_is_the_smaller_law():
    """For these seeds noise would make eta2 negative; Eq. (9) and (27) differ in the second order of the damping."""
    for seed in range(20):
        comparison = compare_decay_laws(TIME, record("linear", seed), laws=("quadratic", "friction"), **CONSTANT)
        smaller, larger = comparison.fits
        if larger.at_bound == ("eta0",):
            assert comparison.verdict.bic[1] == pytest.approx(comparison.verdict.bic[0], abs=1e-6)
            assert comparison.best is smaller
            break
    else:
        pytest.fail("no seed has eta0 alone at its bound")


@pytest.mark.slow
def test_coloured_residuals_are_named():
    """For an autoregressive process and low frequencies, the effective number is m (1 - rho)/(1 + rho)."""
    rho, coloured = 0.45, 2e-4 * np.random.default_rng(1).standard_normal(2500)
    for k in range(1, 2500):
        coloured[k] += rho * coloured[k - 1]
    comparison = compare_decay_laws(TIME, record("quadratic", noise=0.0) + coloured)
    (warning,) = [w for w in comparison.verdict.warnings if "correlate" in w]
    assert comparison.best.fit.autocorrelation == pytest.approx(rho, abs=0.06)
    assert comparison.verdict.effective_samples == pytest.approx(2500 * (1 - rho) / (1 + rho), rel=0.1)
    assert f"count 2500 samples as {comparison.verdict.effective_samples:.0f} independent ones" in warning
    assert not any("correlate" in w for w in compare_decay_laws(TIME, record("quadratic")).verdict.warnings)


def test_a_misfit_that_none_of_the_laws_explains_settles_nothing():
    """A second mode of 3 % is not noise: it correlates the residuals.  Counting all samples would select a law."""
    second = 2e-3 * np.cos(2 * math.pi * 3.1 * TIME) * np.exp(-TIME)
    comparison = compare_decay_laws(TIME, record("linear", noise=5e-5) + second, **CONSTANT)
    white = [
        2500 * math.log(np.mean(fit.residuals**2)) + (fit.fit.rank + 1) * math.log(2500) for fit in comparison.fits
    ]
    assert sorted(white)[1] - sorted(white)[0] > 10
    assert comparison.best.fit.autocorrelation > 0.95
    assert comparison.verdict.effective_samples < 100
    assert not comparison.verdict.settled
    assert any(warning.endswith("no law explains all of the motion") for warning in comparison.warnings)


def test_the_criteria_count_independent_residuals():
    """With fewer independent residuals, the same misfits no longer give a clear result."""
    fitted = [("first", 1.00e-3, 3), ("second", 0.99e-3, 4)]
    white, coloured = (
        judge([Candidate(name, 5000, n, rms, rank, 0.0) for name, rms, rank in fitted]) for n in (5000.0, 250.0)
    )
    assert white.settled and white.best == 1
    assert not coloured.settled and coloured.best == 0
    for n, verdict in ((5000, white), (250, coloured)):
        assert verdict.bic[1] - verdict.bic[0] == pytest.approx(2 * n * math.log(0.99) + math.log(n))
        aicc = 2 * n * math.log(0.99) + 2 + 60 / (n - 6) - 40 / (n - 5)
        assert verdict.aicc[1] - verdict.aicc[0] == pytest.approx(aicc)
    nothing = judge([Candidate(name, 5000, 4.0, rms, rank, 0.9) for name, rms, rank in fitted])
    assert not nothing.settled
    assert "5000 residuals that carry the information of 4 independent ones are too few" in nothing.warnings[0]


@pytest.mark.slow
def test_a_long_linear_decay_is_a_linear_one():
    """Over 600 periods the fit of the quadratic law, and so the comparison, used to fail."""
    time, ω = np.arange(0.0, 12.0, 1e-3), 100 * math.pi
    y = 1e-2 * np.exp(-3e-3 * ω * time) * np.cos(ω * time) + np.random.default_rng(4).normal(0.0, 1e-4, len(time))
    comparison = compare_decay_laws(time, y)
    assert comparison.best.law == "linear"
    assert comparison.verdict.effective_samples == comparison.best.fitted_samples


@pytest.mark.slow
def test_the_release_is_detected_once(monkeypatch):
    found, first_guess = [], comparison_module.first_guess
    monkeypatch.setattr(comparison_module, "first_guess", lambda *a, **k: found.append(1) or first_guess(*a, **k))
    monkeypatch.setattr(fitting, "first_guess", lambda *a, **k: found.append(1) or first_guess(*a, **k))
    rest = np.arange(0.0, 5.5, 1 / 500)
    y = np.concatenate([np.full(250, record("linear")[0]), record("linear")])
    comparison = compare_decay_laws(rest, y)
    assert found == [1]
    assert {fit.release_reason for fit in comparison.fits} == {"the end of rest"}
    alone = fit_decay(rest, y, law="quadratic")
    assert comparison.fits[1].release_time == alone.release_time
    np.testing.assert_array_equal(comparison.fits[1].fit.values, alone.fit.values)


@pytest.mark.slow
def test_a_record_that_is_too_short_and_noisy_cannot_tell():
    """None of 9 records of one and a half periods settles the choice."""
    weak = np.arange(0.0, 0.8, 1 / 500)
    for law in TRUTHS:
        for seed in range(3):
            comparison = compare_decay_laws(weak, record(law, seed, noise=4e-3, time=weak))
            assert not comparison.verdict.settled
            assert "the record does not settle the choice; best by BIC" in comparison.report()
            assert not comparison.to_dict()["settled"]


@pytest.mark.slow
def test_a_law_without_a_term_does_not_win_where_the_term_may_be_large():
    """The drag is 70 % of the damping, but the record is too short to show it: BIC prefers the law without drag."""
    time = TIME[:400]
    verdicts = [
        compare_decay_laws(time, record("quadratic", seed, noise=4e-3, time=time), laws=("linear", "quadratic"))
        for seed in range(6)
    ]
    preferred = [comparison for comparison in verdicts if comparison.best.law == "linear"]
    assert preferred
    for comparison in preferred:
        assert not comparison.verdict.settled
        assert any(
            "cannot rule out the quadratic law: one of its terms is uncertain by" in w for w in comparison.warnings
        )


def test_a_short_record_settles_nothing():
    time = TIME[:800]
    warnings = compare_decay_laws(time, record("quadratic", noise=2e-3, time=time)).warnings
    assert any("not clearly worse" in warning or "does not settle" in warning for warning in warnings)


@pytest.mark.slow
def test_the_result_reads_as_text_and_as_json():
    comparison = compare_decay_laws(TIME, record("friction"))
    table = json.loads(json.dumps(comparison.to_dict(), allow_nan=False))
    assert table["best"] == "friction"
    assert [law["bic"] for law in table["laws"]] == list(comparison.verdict.bic)
    text = comparison.report()
    assert "best by BIC: friction" in text
    assert "friction decay, 2500 samples" in text


@pytest.mark.parametrize(
    ("laws", "message"),
    [
        ((), "laws: must be a sequence of names"),
        ("linear", "laws: must be a sequence of names, got 'linear'"),
        (("cubic",), "law: must be one of linear, quadratic, friction, power, got 'cubic'"),
    ],
)
def test_unusable_laws_are_refused(laws, message):
    with pytest.raises(InputError, match=message):
        compare_decay_laws(TIME, record("linear"), laws=laws)


def test_an_empirical_law_needs_strong_evidence():
    """Of two laws with as many unknowns, the power law must have a BIC lower by 6."""
    m = 2000
    for better, best in ((5.0, 0), (7.0, 1)):
        smaller = 1e-3 * math.exp(-better / (2 * m))
        physical = Candidate("quadratic", m, m, 1e-3, 5, 0.0)
        power = Candidate("power", m, m, smaller, 5, 0.0, prior=math.exp(-3))
        assert judge([physical, power]).best == best
        assert judge([physical, replace(power, prior=1.0)]).best == 1


def test_a_term_at_its_bound_that_leaves_a_new_law_counts():
    """Without eta1 the friction law is one of friction and drag, which is none of the laws."""
    time = TIME
    y = np.asarray(friction_decay(cs.DM(time), 2 * math.pi * 1.85, 0.1, 0.0, 0.5, 0.076, 0.2)).ravel()
    for seed in range(20):
        noise = 2e-4 * np.random.default_rng(seed).standard_normal(len(time))
        comparison = compare_decay_laws(time, y + noise, laws=("quadratic", "friction"), **CONSTANT)
        if comparison.fits[1].at_bound == ("eta1",):
            break
    else:
        pytest.fail("no seed has eta1 alone at its bound")
    friction = comparison.candidates[1]
    assert friction.rank == comparison.fits[1].fit.rank + 1
    assert comparison.best.law == "friction"
