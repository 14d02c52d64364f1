"""Agreement of estimates: closed forms, published values, coverage, and the estimates of parts of a fit."""

import math

import casadi as cs
import numpy as np
import pytest
from scipy import stats

from ancf_casadi.estimation.agreement import Agreement, agreements, subset_estimates
from ancf_casadi.estimation.solver.least_squares import least_squares
from ancf_casadi.estimation.solver.unknown import Unknown


def test_estimates_that_agree_have_their_weighted_mean():
    values, errors = np.array([1.0, 1.2, 0.9]), np.array([0.2, 0.1, 0.4])
    found = Agreement("x", "m", values, errors)
    weights = 1 / errors**2
    assert found.agrees and found.scatter == 0.0
    assert found.mean == pytest.approx(np.average(values, weights=weights))
    assert found.error == pytest.approx(1 / math.sqrt(weights.sum()))
    reach = stats.t.ppf(0.975, 3 * (len(values) - 1))
    assert found.interval == pytest.approx((found.mean - reach * found.error, found.mean + reach * found.error))
    Q = float(weights @ (values - found.mean) ** 2)
    assert found.probability == pytest.approx(stats.chi2.sf(Q, 2))


def test_estimates_with_equal_errors_that_differ_have_the_interval_of_their_scatter():
    """Then the mean, its error and its interval are those of the bare values."""
    values = np.array([1.063, 0.988, 0.936])
    found = Agreement("elastic_modulus", "", values, np.full(3, 0.002))
    assert not found.agrees
    assert found.scatter**2 == pytest.approx(values.var(ddof=1) - 0.002**2)
    assert found.interval == pytest.approx(stats.t.interval(0.95, 2, values.mean(), stats.sem(values)))
    assert "the 3 records do not agree" in found.text()


def test_the_interval_of_a_positive_quantity_is_positive_and_multiplies():
    """Damping ratios of three takes, as far apart as 1, 0.4 and 0.2 %: an additive interval reaches below zero."""
    values, errors = np.array([0.010, 0.004, 0.002]), np.full(3, 1e-5)
    free, positive = Agreement("x", "", values, errors), Agreement("x", "", values, errors, lower=0.0)
    assert free.interval[0] < 0.0 < positive.interval[0] < positive.mean == free.mean < positive.interval[1]
    low, high = positive.interval
    assert low * high == pytest.approx(positive.mean**2)
    assert math.log(high / positive.mean) == pytest.approx((free.interval[1] - free.mean) / free.mean)


def test_mean_and_interval_stay_within_the_bounds():
    """First-order estimates of parts may leave them: a damping ratio of -0.045 was recommended."""
    found = Agreement("x", "", np.array([-0.06, -0.03]), np.array([0.01, 0.01]), lower=0.0, upper=1.0)
    assert (found.mean, found.interval[0]) == (0.0, 0.0) and 0.0 < found.interval[1] <= 1.0
    assert Agreement("x", "", np.array([0.9, 1.0]), np.array([0.1, 0.1]), upper=1.0).interval[1] == 1.0


@pytest.mark.parametrize(("errors", "decisive"), [((0.3, 1.0), 0), ((1.0, 1.0, 0.2), 2), ((0.5, 1.0), None)])
def test_a_record_that_decides_alone_is_named(errors, decisive):
    agreement = Agreement("x", "", np.zeros(len(errors)), np.array(errors))
    assert agreement.decisive == decisive
    assert ("hardly test it" in agreement.text()) == (decisive is not None)


def test_values_that_differ_by_rounding_alone_have_a_scatter():
    values = np.array([0.01, np.nextafter(0.01, 1.0)])
    assert Agreement("x", "", values, np.full(2, 1e-20)).scatter < 1e-17


def test_records_hardly_agree_between_one_and_five_per_cent():
    """Two estimates that differ by 1.5, 2.2 and 3 standard errors of their difference."""
    for distance, verdict, warns in ((1.5, "agree", False), (2.2, "hardly agree", False), (3.0, "do not agree", True)):
        found = Agreement("x", "", np.array([1.0, 1.0 + 0.1 * math.sqrt(2) * distance]), np.array([0.1, 0.1]))
        assert found.probability == pytest.approx(2 * stats.norm.sf(distance))
        assert f"the 2 records {verdict} (p" in found.text()
        assert (found.warning is not None, found.agrees) == (warns, verdict == "agree")


@pytest.mark.slow
def test_the_interval_covers_a_positive_mean():
    """1000 sets of 4 takes that scatter by 30 % and by 80 %: 95 %, and 92 % where the bare values give 88 %."""
    rng = np.random.default_rng(2)
    for scatter, least in ((0.3, 930), (0.8, 910)):
        hits = {0.0: 0, -math.inf: 0}
        for _ in range(1000):
            values = np.exp(scatter * rng.standard_normal(4) - scatter**2 / 2)
            for lower in hits:
                low, high = Agreement("x", "", values, np.full(4, 1e-3), lower=lower).interval
                hits[lower] += low < 1.0 < high
        assert hits[0.0] > least
    assert hits[0.0] > hits[-math.inf] + 10, hits


@pytest.mark.slow
def test_the_interval_covers_the_mean_over_all_takes():
    """2000 sets of 5 takes with scatter of twice the errors: 95 % are known to 0.5 %."""
    rng = np.random.default_rng(1)
    errors = np.array([0.5, 1.0, 1.0, 1.5, 1.0])
    hits = 0
    for _ in range(2000):
        low, high = Agreement("x", "", 2.0 * rng.standard_normal(5) + errors * rng.standard_normal(5), errors).interval
        hits += low < 0.0 < high
    assert 0.93 < hits / 2000 < 0.97


def test_the_parts_of_a_linear_fit_are_the_fits_to_the_parts():
    x = np.linspace(0.0, 1.0, 60)
    y = 1 + 2 * x + 0.1 * np.random.default_rng(2).standard_normal(60)

    def fit(rows):
        return least_squares(
            lambda a, b: a + b * cs.DM(x[rows]) - cs.DM(y[rows]), [Unknown("a", 0.0, 10.0), Unknown("b", 0.0, 0.1)]
        )

    early = np.arange(60) < 25
    whole = fit(np.full(60, True))
    for mask in (early, ~early):
        alone, (values, covariance) = fit(mask), subset_estimates(whole, mask)
        np.testing.assert_allclose(values, alone.values, rtol=1e-9)
        np.testing.assert_allclose(covariance, alone.covariance, rtol=1e-9)


def test_a_part_leaves_out_unknowns_that_it_does_not_determine():
    x = np.linspace(0.0, 1.0, 40)
    late = x > 0.5
    step = cs.DM(late.astype(float))
    y = cs.DM(x + 0.1 * np.random.default_rng(3).standard_normal(40))
    fit = least_squares(lambda a, b: a * cs.DM(x) + b * step - y, [Unknown("a", 0.0), Unknown("b", 0.0)])
    first, second, little = (subset_estimates(fit, mask)[0] for mask in (~late, late, x < 0.01))
    assert math.isfinite(first[0]) and math.isnan(first[1])
    assert np.isfinite(second).all()
    assert np.isnan(little).all()


def test_the_parts_of_a_fit_agree_or_not_on_what_several_of_them_determine():
    """The slope is shared; in the second part it is another, or the same.  Each part has its own level."""
    x = np.tile(np.linspace(0.0, 1.0, 50), 2)
    second = np.arange(100) >= 50
    noise = 0.05 * np.random.default_rng(4).standard_normal(100)

    def compared(slope):
        y = cs.DM(np.where(second, 3 + slope * x, 1 + 2 * x) + noise)
        levels = cs.DM(np.column_stack([~second, second]).astype(float))
        unknowns = [Unknown("slope", 0.0), Unknown("first", 0.0), Unknown("second", 0.0)]
        fit = least_squares(lambda a, b, c: a * cs.DM(x) + levels @ cs.vertcat(b, c) - y, unknowns)
        return agreements(fit, [~second, second])

    (same,), (other,) = compared(2.0), compared(2.4)
    assert same.name == "slope" and same.agrees and same.warning is None
    assert not other.agrees and other.values == pytest.approx([2.0, 2.4], abs=0.1)
    assert other.warning.startswith("the records do not agree on slope: ")


def test_values_are_shown_to_the_digits_of_their_errors():
    """To four digits, 10.00069 and 10.00385 look the same."""
    frequency = Agreement("frequency", "Hz", np.array([10.00069, 10.00385]), np.array([2.2e-4, 2.5e-4]))
    assert frequency.warning is not None and "10.00069 +- 0.00022, 10.00385 +- 0.00025; " in frequency.warning
    assert frequency.text().startswith("frequency: 10.0023 +- 0.0016 Hz, 95 % interval [9.98")


def test_a_few_values_that_are_on_their_line_by_chance_agree():
    """The mean of 40 values and of two, which are equal, and off by a standard deviation."""
    noise = np.random.default_rng(5).standard_normal(40)
    y = cs.DM(np.append(noise - noise.mean(), [1.0, 1.0]))
    fit = least_squares(lambda a: cs.repmat(a, 42, 1) - y, [Unknown("a", 0.0)])
    (found,) = agreements(fit, [np.arange(42) < 40, np.arange(42) >= 40])
    assert found.agrees and found.errors[1] == pytest.approx(0.7, abs=0.15)


def test_parts_allow_for_a_systematic_error_as_the_whole_fit_does():
    """Without noise, the errors of a part are those of the systematic error alone."""
    x = np.linspace(0.0, 1.0, 60)
    unknowns = [Unknown("a", 0.0), Unknown("b", 0.0)]
    fit = least_squares(lambda a, b: a + b * cs.DM(x) - cs.DM(1 + 2 * x), unknowns, systematic=1e-3)
    half = x < 0.5
    columns = np.column_stack([np.ones(30), x[half]])
    np.testing.assert_allclose(
        subset_estimates(fit, half)[1], 30 * 1e-6 * np.linalg.inv(columns.T @ columns), rtol=1e-6
    )


def test_two_records_may_agree_by_chance():
    """If they scatter by twice their errors, the mean of two is covered in about 93 %; by a normal quantile in 85 %."""
    rng, covered = np.random.default_rng(0), 0
    for _ in range(400):
        low, high = Agreement("x", "", math.sqrt(5) * rng.standard_normal(2), np.ones(2)).interval
        covered += low <= 0.0 <= high
    assert covered >= stats.binom.ppf(0.003, 400, 0.93)


@pytest.mark.parametrize("values, outlier", [
    ([1.0, 1.1, 3.0, 0.9, 1.0], 2),
    ([1.0, 1.1, 0.9, 1.0], None),  # all agree
    ([1.0, 3.0, 1.1], None),  # two of three agree soon by chance
    ([1.0, 3.0, -1.0, 1.1], None),  # no three of them agree
    ([1.0, 1.0, 3.0, 3.0], None),  # either pair may be right
])  # fmt: skip
def test_an_estimate_is_an_outlier_if_all_others_agree_without_it(values, outlier):
    agreement = Agreement("x", "", np.array(values), np.full(len(values), 0.1))
    assert agreement.outlier == outlier
    assert ("all but number 3, 3 +- 0.1" in (agreement.warning or "")) == (outlier == 2)
