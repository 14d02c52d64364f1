"""Selection of a damping law: criteria by hand, the true law found, and warnings of what spoils the choice."""

import json
import math
from dataclasses import replace

import casadi as cs
import numpy as np
import pytest
from scipy.stats import chi2, ncx2, norm

from ancf_casadi.decay.closed_forms import friction_decay
from ancf_casadi.decay.first_guess import first_guess
from ancf_casadi.estimation.comparison import mixed_ends
from ancf_casadi.estimation.criteria import Candidate, Expectation, expectation, judge
from ancf_casadi.estimation.determination import check_determination
from ancf_casadi.estimation.noise.stated import AssumedNoise
from ancf_casadi.estimation.solver.least_squares import least_squares
from ancf_casadi.estimation.solver.unknown import Unknown
from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.records.measurement import Measurement
from problems import compare_decay_laws, fit_decay, law_curve
from problems.decay.laws import DecayModel

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
    # where nothing creeps, the rate may end at its bound
    assert (*comparison.names[4:], *comparison.failed) == (*bent, f"{law} + drift", f"{law} + creep")


def test_the_criteria_are_those_of_the_residuals():
    comparison = compare_decay_laws(TIME, record("quadratic"), laws=("linear", "quadratic"), **CONSTANT)
    for fit, aicc, bic, K in zip(comparison.fits, comparison.verdict.aicc, comparison.verdict.bic, (6, 7), strict=True):
        misfit = 2500 * math.log(np.mean(fit.residuals**2))
        assert aicc == pytest.approx(misfit + 2 * K + 2 * K * (K + 1) / (2500 - K - 1), rel=1e-12)
        assert bic == pytest.approx(misfit + K * math.log(2500), rel=1e-12)
    assert comparison.verdict.bic[0] - comparison.verdict.bic[1] > 10


@pytest.mark.slow
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
    (warning,) = [w for w in comparison.verdict.warnings if "correlate at" in w]
    assert comparison.best.fit.autocorrelation == pytest.approx(rho, abs=0.06)
    assert comparison.verdict.effective_samples == pytest.approx(2500 * (1 - rho) / (1 + rho), rel=0.1)
    assert f"count 2500 samples as {comparison.verdict.effective_samples:.0f} independent ones" in warning
    assert not any("correlate at" in w for w in compare_decay_laws(TIME, record("quadratic")).verdict.warnings)


@pytest.mark.slow
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
    more = np.eye(1)  # information of the further term
    white, coloured = (
        judge([Candidate(name, 5000, n, rms, rank, 0.0, (rank - 3) * more) for name, rms, rank in fitted])
        for n in (5000.0, 250.0)
    )
    assert white.settled and white.best == 1
    assert not coloured.settled and coloured.best == 0
    odds = math.log(250 + 1) / 2 + 250 * math.log(0.99)
    assert coloured.probabilities[0] == pytest.approx(1 / (1 + math.exp(-odds)))
    for n, verdict in ((5000, white), (250, coloured)):
        assert verdict.bic[1] - verdict.bic[0] == pytest.approx(2 * n * math.log(0.99) + math.log(n))
        aicc = 2 * n * math.log(0.99) + 2 + 60 / (n - 6) - 40 / (n - 5)
        assert verdict.aicc[1] - verdict.aicc[0] == pytest.approx(aicc)
    nothing = judge([Candidate(name, 5000, 4.0, rms, rank, 0.9) for name, rms, rank in fitted])
    assert not nothing.settled
    assert "5000 residuals, worth 4 independent ones, are too few" in nothing.warnings[0]


@pytest.mark.slow
def test_a_long_linear_decay_is_a_linear_one():
    time, ω = np.arange(0.0, 12.0, 1e-3), 100 * math.pi
    y = 1e-2 * np.exp(-3e-3 * ω * time) * np.cos(ω * time) + np.random.default_rng(4).normal(0.0, 1e-4, len(time))
    comparison = compare_decay_laws(time, y)
    assert comparison.best.law == "linear"
    assert comparison.verdict.effective_samples == comparison.best.fitted_samples


@pytest.mark.slow
@pytest.mark.parametrize("phase", [0.0, 0.75, 2.25])
def test_rounding_errors_choose_no_law(phase):
    time = np.linspace(0.0, 10.0, 1000)
    fit = fit_decay(time, 0.02 * np.exp(-0.1 * time) * np.cos(12.0 * time + phase), law="auto")
    assert (fit.law, fit.frequency_law, fit.model.rest) == ("linear", "constant", "constant")


def test_all_laws_are_fitted_from_the_same_release():
    rest = np.arange(0.0, 5.5, 1 / 500)
    y = np.concatenate([np.full(250, record("linear")[0]), record("linear")])
    comparison = compare_decay_laws(rest, y)
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
    assert "the record leaves the choice of the law open; probabilities: " in comparison.report()
    assert not comparison.to_dict()["settled"]


@pytest.mark.slow
def test_a_law_without_a_term_does_not_win_where_the_term_may_be_large():
    """The drag is 70 % of the damping, but the record is too short to show it: the law without drag is preferred."""
    time = TIME[:400]
    verdicts = [
        compare_decay_laws(time, record("quadratic", seed, noise=4e-3, time=time), laws=("linear", "quadratic"))
        for seed in range(6)
    ]
    preferred = [comparison for comparison in verdicts if comparison.best.law == "linear"]
    assert preferred
    for comparison in preferred:
        assert not comparison.verdict.settled
        assert sum(p for name, p in comparison.probabilities.items() if name.startswith("quadratic")) > 0.2


def test_the_result_reads_as_text_and_as_json():
    comparison = compare_decay_laws(TIME, record("friction"), laws=("linear", "friction"), **CONSTANT)
    table = json.loads(json.dumps(comparison.to_dict(), allow_nan=False))
    assert table["best"] == "friction"
    assert table["best"] in [law["law"] for law in table["laws"]]
    assert [law["bic"] for law in table["laws"]] == list(comparison.verdict.bic)
    text = comparison.report()
    assert "most probable: friction" in text
    assert "friction decay, 2500 samples" in text


@pytest.mark.parametrize(
    ("laws", "message"), [((), "laws: is empty"), ("linear", "laws: "), (("cubic",), "laws: .*'cubic'")]
)
def test_unusable_laws_are_refused(laws, message):
    with pytest.raises(InputError, match=message):
        compare_decay_laws(TIME, record("linear"), laws=laws)


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
    assert comparison.best.law == "friction"


LINE_TIME = np.linspace(-1.0, 1.0, 400)


def line(slope, *, sloping):
    """Fit of a constant to a line of height 1 without noise, with or without a slope that is not negative."""
    unknowns = [Unknown("a", 1.0), *([Unknown("b", slope, lower=0.0)] if sloping else [])]
    return least_squares(
        lambda a, b=0.0: a + b * cs.DM(LINE_TIME) - cs.DM(1.0 + slope * LINE_TIME),
        unknowns,
        noise=AssumedNoise(times=LINE_TIME),
    )


@pytest.mark.parametrize(("slope", "growth", "count"), [(0.4, 1.0, 1), (0.4, 4.0, 2), (0.0, 1.0, 1)])
def test_the_chance_of_the_right_choice_of_a_linear_model_is_noncentral_chi_squared(slope, growth, count):
    std, n = 1.5, 400 * count / growth
    constant, sloping = line(slope, sloping=False), line(slope, sloping=True)
    pair = (sloping, constant) if slope else (constant, sloping)
    terms = [fit.names for fit in pair]
    found = expectation(pair, terms, pair[1].residuals, std, growth, count)
    # widths by hand: the terms share the length of their sum of effects
    lengths = np.array([20.0, np.linalg.norm(LINE_TIME)])
    total = 20.0 + slope * lengths[1]
    penalty = 2 * math.log1p(n * total**2 / (2 * math.pi * 400 * std**2))
    other = 400 * std**2 + slope**2 * lengths[1] ** 2
    penalty -= math.log1p(n * 20.0**2 / (2 * math.pi * (other if slope else 400 * std**2)))
    needed = n * math.expm1(penalty / n)
    shift = slope**2 * lengths[1] ** 2 * count / (growth * std**2)
    right = ncx2.sf(needed, 1, shift) if slope else 0.5 + 0.5 * chi2.cdf(needed, 1)
    assert 0.1 < right
    assert found.right == pytest.approx(right, abs=0.012)


@pytest.mark.slow
def test_as_many_choices_are_right_as_expected():
    """Drag of a short decay against linear damping: 60 records."""
    time = TIME[:1000:5]
    exact, noise = record("quadratic", noise=0.0, time=time), 1.6e-3
    laws = {"laws": ("linear", "quadratic"), "release_time": 0.0, **CONSTANT}
    fits = [fit_decay(time, exact, law=law, release_time=0.0).fit for law in laws["laws"]]
    expected = expectation(fits[::-1], [("eta1", "eta2"), ("zeta",)], fits[0].residuals, noise, 1.0).right
    rng = np.random.default_rng(0)
    right = [
        compare_decay_laws(time, exact + noise * rng.standard_normal(200), **laws).best.law == "quadratic"
        for _ in range(60)
    ]
    assert 0.3 < expected < 0.97
    assert abs(np.mean(right) - expected) < 2.6 * math.sqrt(expected * (1 - expected) / 60)


def test_the_interval_of_a_mixture_has_its_quantiles():
    weights, values = np.array([0.3, 0.7]), np.array([[0.0], [2.0]])
    ends = np.array([[[-1.0, 1.0]], [[1.5, 4.0]]])
    (low, high), z = mixed_ends(weights, values, ends, 0.95)[0], norm.ppf(0.975)
    below = 0.3 * norm.cdf(low * z) + 0.7 * norm.cdf((low - 2.0) / 0.5 * z)
    above = 0.3 * norm.sf(high * z) + 0.7 * norm.sf((high - 2.0) / 2.0 * z)
    assert (below, above) == (pytest.approx(0.025), pytest.approx(0.025))
    assert mixed_ends(np.ones(1), values[:1], ends[:1], 0.95) == pytest.approx(ends[0])


@pytest.fixture(scope="module")
def open_choice():
    time = TIME[:400]
    return compare_decay_laws(
        time, record("quadratic", 1, noise=4e-3, time=time), laws=("linear", "quadratic"), **CONSTANT
    )


def test_an_open_choice_averages_its_laws(open_choice):
    assert min(open_choice.probabilities.values()) > 0.1
    assert not open_choice.verdict.settled
    average, *curves = (law_curve(fit, [0.02, 0.07]) for fit in (open_choice, *open_choice.fits))
    for name in ("damping_ratio", "frequency"):
        mean = sum(p * getattr(c, name) for p, c in zip(open_choice.probabilities.values(), curves, strict=True))
        assert getattr(average, name) == pytest.approx(mean)
        ends = np.array([getattr(curve, f"{name}_band") for curve in curves])
        low, high = getattr(average, f"{name}_band").T
        assert (low >= ends[:, :, 0].min(axis=0)).all() and (high <= ends[:, :, 1].max(axis=0)).all()
    other = Measurement(TIME, record("quadratic", 5, noise=4e-3))
    (mean,), (first,), (second,) = (fit.predict(other).channels for fit in (open_choice, *open_choice.fits))
    p = list(open_choice.probabilities.values())
    between = p[0] * p[1] * (first.predicted - second.predicted) ** 2
    assert mean.predicted == pytest.approx(p[0] * first.predicted + p[1] * second.predicted)
    assert mean.errors**2 == pytest.approx(p[0] * first.errors**2 + p[1] * second.errors**2 + between)


@pytest.mark.slow
def test_an_open_choice_names_the_record_that_decides(open_choice):
    chances = open_choice.deciding
    assert chances["twice the amplitude"] > chances["a later start"]
    assert chances["5 records"] > chances["2 records"]
    assert open_choice.to_dict()["deciding"] == chances
    assert "right choice of the two most probable, with other records: 2 records 0." in open_choice.table().text()


def test_a_record_to_which_a_law_cannot_be_fitted_decides_nothing(open_choice):
    half = replace(open_choice, other_records=lambda truth, rival: {"half": Expectation(1.0, 1.0)} if truth else {})
    assert [*half.deciding] == ["2 records", "5 records"]


@pytest.mark.parametrize(
    ("frequency_law", "unseen", "name"),
    [
        ("constant", "zeta", "damping_ratio"),
        ("constant", "omega", "frequency"),
        ("linear", "omega", "frequency_at_zero"),
        ("constant", "e0", "amplitude"),
    ],
)
def test_what_records_do_not_determine_has_the_name_of_reports(frequency_law, unseen, name):
    guess = first_guess(Measurement(TIME, np.exp(-0.1 * TIME) * np.cos(12.0 * TIME)), release_time=0.0)
    model = DecayModel("linear", "zero", frequency_law)
    unknowns = [*model.mode_unknowns(guess), *model.release_unknowns(guess)]
    seen = [float(unknown.name != unseen) for unknown in unknowns]
    with pytest.raises(FitError, match=f"do not depend on {name}"):
        check_determination(lambda *x: cs.vertcat(*x) * cs.DM(seen), unknowns, 1e-9)
