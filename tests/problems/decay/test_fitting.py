"""Fits of free decays: recovery of known truth, Cramer-Rao bounds, a real record, and refusals."""

import json
import math
import pickle
import re
from pathlib import Path

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import HarmonicBase, ModalDamping, Model, natural_modes, reduce_model, simulate_reduced
from ancf_casadi.decay.closed_forms import equivalent_damping_ratio, friction_decay, linear_decay, quadratic_decay
from ancf_casadi.estimation.solver.least_squares import least_squares
from ancf_casadi.estimation.solver.unknown import Unknown
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from problems.decay.comparison import compare_decay_laws
from problems.decay.fitting import fit_decay, fit_decays
from tests.coverage import covers

TIME = np.arange(0.0, 5.0, 1 / 500)
TABLE_2 = [(1.85, 0.0100), (10.19, 0.0028), (26.84, 0.0028), (53.20, 0.0023), (88.60, 0.0030)]  # Hz, 1
AMPLITUDES = (0.050, 0.015, 0.008, 0.005, 0.005)
# Standard deviations of frequency (Hz) and damping ratio for those amplitudes, per 1 mm of white noise, 500 frames/s
# for 5 s, unknowns omega, zeta, r0, v0: Cramer-Rao bounds from the Fisher information in 40 digits.
CRAMER_RAO = [
    (8.4060e-5, 4.5321e-5),
    (3.2897e-4, 3.2328e-5),
    (1.2988e-3, 4.8318e-5),
    (3.8925e-3, 7.3053e-5),
    (1.2290e-2, 1.3824e-4),
]
MODES = [(f, z, r0) for (f, z), r0 in zip(TABLE_2, AMPLITUDES, strict=True)]
TABLE_4 = [  # Hz, 1/s, 1/m, amplitude in m, and the standard error of eta2 relative to it with 0.2 mm of noise
    (1.85, 0.15, 0.11, 0.0760, 0.03),
    (10.19, 0.31, 0.06, 0.0149, 0.22),
    (26.84, 0.89, 0.05, 0.0076, 0.47),
    (53.20, 1.46, 0.05, 0.0055, 0.73),
    (88.60, 3.00, 0.05, 0.0144, 0.18),
]
TRUTHS = {"linear": (0.0, 0.25, 0.0), "quadratic": (0.0, 0.15, 0.5), "friction": (0.1, 0.15, 0.5)}  # eta0, eta1, eta2
SILICONE = Path(__file__).parents[4] / "shared" / "data" / "silicone_beam"


def swing(frequency, ratio, r0, v0=0.0, time=TIME):
    return np.asarray(linear_decay(cs.DM(time), 2 * math.pi * frequency, ratio, r0, v0)).ravel()


def drag(frequency, η1, η2, e0, φ=0.0, time=TIME):
    return np.asarray(quadratic_decay(cs.DM(time), 2 * math.pi * frequency, η1, η2, e0, φ)).ravel()


def rub(frequency, η0, η1, η2, e0, φ=0.0, time=TIME):
    return np.asarray(friction_decay(cs.DM(time), 2 * math.pi * frequency, η0, η1, η2, e0, φ)).ravel()


def noise(seed, samples=2500):
    return np.random.default_rng(seed).standard_normal(samples)


@pytest.mark.parametrize("rate", [500, 1000])
@pytest.mark.parametrize(("frequency", "ratio", "r0"), [*MODES, *((2.0, ratio, 0.05) for ratio in (0.1, 0.2, 0.35))])
def test_a_decay_without_noise_gives_back_the_truth(frequency, ratio, r0, rate):
    time = np.arange(0.0, 5.0, 1 / rate)
    values = swing(frequency, ratio, r0, time=time) - 0.02
    fit = fit_decay(time + 3.0, values)
    assert fit.frequency == pytest.approx(frequency, rel=1e-9)
    assert fit.damping_ratio == pytest.approx(ratio, rel=1e-9)
    assert fit.amplitude == pytest.approx(r0 / math.sqrt(1 - ratio**2), rel=1e-9)  # of the envelope, released at rest
    assert fit.offset == pytest.approx(-0.02, rel=1e-9)
    np.testing.assert_allclose(fit.displacement(time + 3.0), values, atol=1e-9 * r0)
    assert fit.residual_rms < 1e-12
    assert fit.release_time == 3.0
    assert fit.eta1 == pytest.approx(4 * math.pi * ratio * frequency)
    assert fit.eta2 == 0.0 and math.isnan(fit.correlation) and "eta2" not in fit.standard_errors


@pytest.mark.parametrize("start", [(0.995, 0.3, 0.5), (1.004, 4.0, 2.0)])
@pytest.mark.parametrize(("frequency", "ratio", "r0"), MODES)
def test_both_starts_lead_to_the_truth(frequency, ratio, r0, start):
    ω, T = 2 * math.pi * frequency, min(5.0, 1 / (2 * math.pi * frequency * ratio))
    unknowns = [
        Unknown("omega", ω + (start[0] - 1) * 100 / T, 1 / T),
        Unknown("zeta", ratio * start[1], 1 / (ω * T), lower=0.0, upper=0.999),
        Unknown("r0", r0 * start[2], r0),
        Unknown("v0", 0.1 * r0 * ω, r0 * ω),
    ]
    t, y = cs.MX(cs.DM(TIME)), cs.DM(swing(frequency, ratio, r0))
    fit = least_squares(lambda *x: linear_decay(t, *x) - y, unknowns)
    np.testing.assert_allclose(fit.values[:3], [ω, ratio, r0], rtol=1e-9)
    assert fit["v0"] == pytest.approx(0.0, abs=1e-9 * r0 * ω)


@pytest.mark.parametrize(("mode", "bounds"), list(zip(MODES, CRAMER_RAO, strict=True)))
def test_standard_errors_are_the_cramer_rao_bounds(mode, bounds):
    frequency, ratio, r0 = mode
    fit = fit_decay(TIME, swing(frequency, ratio, r0) + 1e-4 * noise(10), rest="zero")
    errors = fit.standard_errors
    assert errors["frequency"] / (0.1 * bounds[0]) == pytest.approx(1.0, abs=0.05)
    assert errors["damping_ratio"] / (0.1 * bounds[1]) == pytest.approx(1.0, abs=0.05)
    assert abs(fit.frequency - frequency) < 4 * errors["frequency"]
    assert abs(fit.damping_ratio - ratio) < 4 * errors["damping_ratio"]
    assert fit.residual_rms == pytest.approx(1e-4, rel=0.05)
    assert fit.warnings == ()


@pytest.mark.slow
@pytest.mark.parametrize("k", [1, 3])
def test_the_scatter_of_many_fits_is_the_cramer_rao_bound_and_their_intervals_cover_the_truth(k):
    """A standard deviation of 100 fits is known to 7 %, a mean to 10 % of one; four of these are allowed."""
    efficiency, bias, hits = many_fits(MODES[k], CRAMER_RAO[k], 100)
    np.testing.assert_allclose(efficiency, 1.0, atol=0.28)
    assert (np.abs(bias) < 0.4).all()
    assert all(covers(held, 100) for held in hits)


def many_fits(mode, bounds, count):
    """Return deviations and means over the bounds, and numbers of intervals that hold the truth; frequency, ratio."""
    frequency, ratio, r0 = mode
    clean = swing(frequency, ratio, r0)
    fits = [fit_decay(TIME, clean + 2e-4 * noise(100 + seed), rest="zero") for seed in range(count)]
    deviation = np.array([(fit.frequency - frequency, fit.damping_ratio - ratio) for fit in fits])
    bound = 0.2 * np.array(bounds)
    intervals = np.array([(fit.intervals()["frequency"], fit.intervals()["damping_ratio"]) for fit in fits])
    truth = np.array([frequency, ratio])
    hits = np.sum((intervals[:, :, 0] < truth) & (truth < intervals[:, :, 1]), axis=0)
    return deviation.std(axis=0, ddof=1) / bound, deviation.mean(axis=0) / bound, hits


@pytest.mark.parametrize(("frequency", "ratio", "r0"), MODES)
def test_no_damping_is_found_where_there_is_none(frequency, ratio, r0):
    fit = fit_decay(TIME, swing(frequency, 0.0, r0))
    assert fit.damping_ratio == 0.0
    assert math.isnan(fit.standard_errors["damping_ratio"])
    (warning,) = fit.warnings
    assert "damping_ratio is at its bound 0" in warning
    assert fit.frequency == pytest.approx(frequency, rel=1e-9)
    assert fit.amplitude == pytest.approx(r0, rel=1e-6)


@pytest.mark.parametrize("ratio", [2e-5, 1e-6, 0.0, -1e-5])
def test_tiny_and_negative_damping_is_resolved(ratio):
    fit = fit_decay(TIME, swing(88.6, ratio, 0.005), ratio_bounds=(-0.1, 0.5))
    assert fit.damping_ratio == pytest.approx(ratio, rel=1e-8, abs=1e-13)
    assert fit.warnings == ()


def test_uneven_times_and_any_start_of_the_clock_do_not_matter():
    time = np.sort(np.random.default_rng(11).uniform(0.0, 5.0, 2000))
    fit = fit_decay(time + 1000.0, swing(1.85, 0.01, -0.05, 0.3, time - time[0]) + 0.4)
    assert fit.frequency == pytest.approx(1.85, rel=1e-9)
    assert fit.damping_ratio == pytest.approx(0.01, rel=1e-7)
    assert fit.amplitude * math.cos(fit.fit["phase"]) == pytest.approx(-0.05, rel=1e-7)
    ω, ω_d = 2 * math.pi * 1.85, 2 * math.pi * 1.85 * math.sqrt(1 - 0.01**2)
    assert fit.amplitude == pytest.approx(math.hypot(0.05, (0.3 - 0.01 * ω * 0.05) / ω_d), rel=1e-7)
    assert fit.offset == pytest.approx(0.4, rel=1e-9)
    assert fit.release_time == time[0] + 1000.0


def test_rest_before_the_release_is_left_out():
    time = np.arange(0.0, 8.0, 0.002)
    y = swing(1.85, 0.01, 0.05, time=np.maximum(time - 2.0, 0.0))
    detected = fit_decay(time, y + 1e-5 * noise(12, len(time)))
    assert detected.release_time == pytest.approx(2.0, abs=0.03)
    assert detected.damping_ratio == pytest.approx(0.01, rel=0.01)
    stated = fit_decay(time, y, release_time=2.0)
    assert stated.release_time == pytest.approx(2.0)
    assert stated.damping_ratio == pytest.approx(0.01, rel=1e-9)


@pytest.mark.parametrize(("frequency", "η1", "η2", "e0", "_"), TABLE_4)
def test_a_quadratic_decay_without_noise_gives_back_the_truth(frequency, η1, η2, e0, _):
    fit = fit_decay(TIME, drag(frequency, η1, η2, e0, 0.3) + 0.01, law="quadratic")
    assert fit.frequency == pytest.approx(frequency, rel=1e-10)
    assert fit.eta1 == pytest.approx(η1, rel=1e-7)
    assert fit.eta2 == pytest.approx(η2, rel=1e-7)
    assert fit.amplitude == pytest.approx(e0, rel=1e-8)
    assert fit.offset == pytest.approx(0.01, rel=1e-8)
    assert fit.damping_ratio == pytest.approx(equivalent_damping_ratio(η1, η2, 2 * math.pi * frequency, e0), rel=1e-8)


@pytest.mark.parametrize(("frequency", "η1", "η2", "e0", "uncertainty"), TABLE_4)
def test_a_noisy_quadratic_decay_says_how_little_it_tells_of_eta2(frequency, η1, η2, e0, uncertainty):
    """The relative standard errors 3, 22, 47, 73, 18 % are from an independently computed Fisher information."""
    fit = fit_decay(TIME, drag(frequency, η1, η2, e0) + 2e-4 * noise(13), law="quadratic")
    assert fit.standard_errors["eta2"] / η2 == pytest.approx(uncertainty, rel=0.1)
    assert -0.999 < fit.correlation < -0.93
    assert abs(fit.eta1 - η1) < 4 * fit.standard_errors["eta1"]
    assert abs(fit.eta2 - η2) < 4 * fit.standard_errors["eta2"]
    hardly_separate = uncertainty > 0.05 and abs(fit.correlation) > 0.95
    assert any("eta1 and eta2 (" in warning for warning in fit.warnings) == hardly_separate
    uncertain = 1.961 * fit.standard_errors["eta2"] > fit.eta2
    assert any("eta2 does not differ significantly from zero" in warning for warning in fit.warnings) == uncertain
    assert (fit.intervals()["eta2"][0] == 0.0) == uncertain


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("periods", "rate", "life", "share"), [(600, 5, 600 / 11.3, 0.0), (600, 6, 60.0, 0.0), (800, 6, 800 / 14, 0.5)]
)
def test_a_long_decay_is_fitted_from_its_first_guess(periods, rate, life, share, seed):
    """Periods, samples per period, periods in which the amplitude falls to 1/e, and share of drag."""
    time, e0, ratio = np.arange(periods * rate) / rate, 0.01, 1 / (2 * math.pi * life)
    η1, η2 = 4 * math.pi * ratio * (1 - share), ratio * share * 3 * math.pi / (4 * e0)
    fit = fit_decay(time, drag(1.0, η1, η2, e0, time=time) + 1e-4 * noise(seed, len(time)), law="quadratic")
    assert abs(fit.frequency - 1.0) < 4 * fit.standard_errors["frequency"]
    assert abs(fit.offset) < 4 * fit.standard_errors["offset"]
    for name, truth in (("damping_ratio", ratio), ("eta1", η1), ("eta2", η2), ("amplitude", e0)):
        low, high = fit.intervals()[name]
        assert low - (high - low) / 2 <= truth <= high + (high - low) / 2
    assert fit.residual_rms == pytest.approx(1e-4, rel=0.05)


@pytest.mark.parametrize("bounded", ["eta2", "eta1"])
def test_intervals_allow_for_a_term_at_its_bound(bounded):
    """Seven periods do not separate drag from viscous damping: either term may be all of the damping, or none."""
    time = np.linspace(0.0, 7.0, 73)
    η1, η2, e0 = 0.0, 0.43, 0.05374
    records = (drag(1.0, η1, η2, e0, time=time) + 1e-3 * noise(seed, len(time)) for seed in range(100))
    fits = (fit_decay(time, record, law="quadratic") for record in records)
    fit = next(fit for fit in fits if fit.at_bound == (bounded,))
    ratio = float(equivalent_damping_ratio(η1, η2, 2 * math.pi, e0))
    truth = {"frequency": 1.0, "damping_ratio": ratio, "eta1": η1, "eta2": η2, "amplitude": e0}
    for name, value in truth.items():
        low, high = fit.intervals()[name]
        assert fit.profile(name) == pytest.approx((low, high), abs=0.25 * (high - low))
        assert low - (high - low) / 2 <= value <= high + (high - low) / 2
    assert fit.intervals()[bounded][0] == 0.0


@pytest.mark.parametrize(("η1", "η2"), [(0.0, 0.33), (0.15, 0.0), (0.0, 0.0)])
def test_a_damping_term_that_is_absent_is_found_absent(η1, η2):
    fit = fit_decay(TIME, drag(1.85, η1, η2, 0.076), law="quadratic")
    assert fit.eta1 == pytest.approx(η1, rel=1e-4, abs=1e-5)
    assert fit.eta2 == pytest.approx(η2, rel=1e-4, abs=1e-5)
    assert fit.amplitude == pytest.approx(0.076, rel=1e-6)


FRICTION = [(1.85, 0.03, 0.15, 0.11, 0.076), (1.85, 0.05, 0.0, 0.0, 0.076), (10.19, 0.2, 0.31, 0.06, 0.0149)]


@pytest.mark.parametrize("truth", FRICTION)
def test_a_decay_with_friction_gives_back_the_truth(truth):
    frequency, η0, η1, η2, e0 = truth
    fit = fit_decay(TIME, rub(*truth, 0.3) + 0.01, law="friction")
    assert fit.frequency == pytest.approx(frequency, rel=1e-8)
    assert fit.eta0 == pytest.approx(η0, rel=1e-5)
    assert fit.eta1 == pytest.approx(η1, rel=1e-4, abs=1e-5)
    assert fit.eta2 == pytest.approx(η2, rel=1e-4, abs=1e-5)
    assert fit.amplitude == pytest.approx(e0, rel=1e-6)
    ω = 2 * math.pi * frequency
    assert fit.damping_ratio == pytest.approx(float(equivalent_damping_ratio(η1, η2, ω, e0, η0)), rel=1e-5)


def test_friction_that_stops_the_mode_within_the_record_is_found():
    y = rub(1.85, 0.5, 0.05, 0.0, 0.076)
    assert np.abs(y[1450:]).max() == 0.0
    fit = fit_decay(TIME, y + 2e-4 * noise(21), law="friction")
    assert fit.eta0 == pytest.approx(0.5, abs=4 * fit.standard_errors["eta0"])
    assert fit.standard_errors["eta0"] < 0.01
    assert fit.intervals()["eta1"][0] < 0.05 < fit.intervals()["eta1"][1]


@pytest.mark.parametrize(("η0", "bounded"), [(0.05, False), (0.0, True)])
def test_friction_is_told_from_none(η0, bounded):
    """The interval of the coefficient excludes zero with friction, and contains zero without."""
    fit = fit_decay(TIME, rub(1.85, η0, 0.15, 0.11, 0.076) + 2e-4 * noise(22), law="friction")
    low, high = fit.intervals()["eta0"]
    assert low <= η0 < high
    assert (low == 0.0) == bounded
    assert any(text.startswith(("eta0 is at its bound", "eta0 does not differ")) for text in fit.warnings) == bounded


def test_the_friction_of_the_exact_motion_is_found_to_first_order():
    """Under friction alone each half swing is harmonic about a centre that is shifted by eta0/omega^2."""
    ω, η0, e0 = 2 * math.pi * 1.85, 0.05, 0.076
    half = np.floor(TIME * ω / math.pi)
    shift = η0 / ω**2
    y = (e0 - (2 * half + 1) * shift) * np.cos(ω * TIME) + (-1) ** half * shift
    fit = fit_decay(TIME, y, law="friction")
    assert fit.eta0 == pytest.approx(η0, rel=0.02)
    assert fit.eta1 == pytest.approx(0.0, abs=2e-3)
    assert fit.frequency == pytest.approx(1.85, rel=1e-4)
    assert fit_decay(TIME, y, law="quadratic").residual_rms > 2 * fit.residual_rms


@pytest.mark.slow
def test_several_records_share_what_belongs_to_the_mode():
    truth = 1.85, 0.15, 0.11
    large, small = (
        Measurement(TIME, drag(*truth, e0, φ) + level + 2e-4 * noise(seed))
        for e0, φ, level, seed in ((0.076, 0.2, 0.01, 23), (0.015, 2.0, -0.02, 24))
    )
    first, second = fit_decays([large, small], law="quadratic")
    assert (first.frequency, first.eta1, first.eta2) == (second.frequency, second.eta1, second.eta2)
    assert first.eta2 == pytest.approx(0.11, abs=4 * first.standard_errors["eta2"])
    assert first.eta1 == pytest.approx(0.15, abs=4 * first.standard_errors["eta1"])
    assert first.standard_errors["eta2"] < 0.9 * fit_decay(large, law="quadratic").standard_errors["eta2"]
    assert (first.amplitude, second.amplitude) == pytest.approx((0.076, 0.015), abs=1e-4)
    assert (first.offset, second.offset) == pytest.approx((0.01, -0.02), abs=1e-4)
    assert first.residual_rms == pytest.approx(2e-4, rel=0.05)
    np.testing.assert_allclose(second.displacement(TIME) - second.residuals, small.values, atol=1e-12)
    assert second.fit.names[3:] == ("e0_1", "phase_1", "offset_1", "e0_2", "phase_2", "offset_2")
    alone = fit_decays([small], law="quadratic")[0]
    np.testing.assert_allclose(alone.fit.values, fit_decay(small, law="quadratic").fit.values)


def test_several_records_may_differ_in_length_and_clock():
    late = Measurement(TIME[:900] + 70.0, swing(1.85, 0.01, 0.02, time=TIME[:900]))
    fits = fit_decays([Measurement(TIME, swing(1.85, 0.01, 0.05)), late], release_times=[0.0, 70.0])
    assert [fit.samples for fit in fits] == [2500, 900]
    assert fits[1].release_time == 70.0
    assert fits[1].damping_ratio == pytest.approx(0.01, rel=1e-8)


@pytest.mark.parametrize(
    ("records", "options", "message"),
    [
        ([], {}, "records: is empty"),
        (Measurement(TIME, TIME), {}, "records: must be a sequence"),
        ([TIME], {}, "records: must be a Measurement"),
        ([Measurement(TIME, TIME)], {"release_times": [0.0, 1.0]}, "release_times: has 2 values for 1 records"),
        ([Measurement(TIME, TIME)], {"release_times": ["now"]}, "release_times: must be a finite number"),
    ],
)
def test_unusable_records_are_refused(records, options, message):
    with pytest.raises(InputError, match=message):
        fit_decays(records, **options)


@pytest.mark.parametrize("law", TRUTHS)
@pytest.mark.parametrize("slope", [0.002, -0.02])
def test_a_drift_is_borne(law, slope):
    η0, η1, η2 = TRUTHS[law]
    y = rub(1.85, η0, η1, η2, 0.05) + 0.4 + slope * TIME + 1e-4 * noise(25)
    fit = fit_decay(TIME + 3.0, y, law=law, rest="drift")
    assert fit.drift == pytest.approx(slope, abs=4 * fit.standard_errors["drift"])
    assert fit.offset == pytest.approx(0.4, abs=4 * fit.standard_errors["offset"])
    ratio = float(equivalent_damping_ratio(η1, η2, 2 * math.pi * 1.85, 0.05, η0))
    assert fit.damping_ratio == pytest.approx(ratio, rel=0.01)
    assert fit.residual_rms == pytest.approx(1e-4, rel=0.05)
    np.testing.assert_allclose(fit.displacement([3.0]), [0.45], atol=5e-4)


def test_outliers_are_borne():
    """One sample in twenty has a random value within the amplitude."""
    rng = np.random.default_rng(26)
    y = swing(1.85, 0.01, 0.05) + 2e-4 * noise(26)
    wrong = rng.random(2500) < 0.05
    y[wrong] = rng.uniform(-0.05, 0.05, int(wrong.sum()))
    plain, robust = fit_decay(TIME, y), fit_decay(TIME, y, robust=True)
    assert abs(robust.damping_ratio - 0.01) < 4 * robust.standard_errors["damping_ratio"]
    assert robust.standard_errors["damping_ratio"] < 0.1 * plain.standard_errors["damping_ratio"]
    clean = fit_decay(TIME[~wrong], y[~wrong])
    assert robust.standard_errors["damping_ratio"] < 1.3 * clean.standard_errors["damping_ratio"]


def test_without_outliers_a_robust_fit_costs_little():
    y = swing(1.85, 0.01, 0.05) + 2e-4 * noise(27)
    plain, robust = fit_decay(TIME, y), fit_decay(TIME, y, robust=True)
    assert robust.standard_errors["frequency"] == pytest.approx(plain.standard_errors["frequency"], rel=0.06)
    assert robust.frequency == pytest.approx(plain.frequency, abs=plain.standard_errors["frequency"])
    assert fit_decay(TIME, swing(1.85, 0.01, 0.05), robust=True).damping_ratio == pytest.approx(0.01, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("law", TRUTHS)
def test_both_kinds_of_intervals_agree_where_the_record_is_good(law):
    fit = fit_decay(TIME, rub(1.85, *TRUTHS[law], 0.076) + 1e-4 * noise(28), law=law)
    for name in ("frequency", "damping_ratio", "eta1", "amplitude", "offset"):
        low, high = fit.intervals()[name]
        half = (high - low) / 2
        assert fit.profile(name) == pytest.approx((low, high), abs=0.05 * half)
        assert half == pytest.approx(1.961 * fit.standard_errors[name], rel=1e-3)


def test_an_interval_at_a_bound_is_one_sided_either_way():
    """For some noise, the best estimate of the drag of a record without drag is zero."""
    records = (drag(1.85, 0.15, 0.0, 0.076) + 2e-4 * noise(seed) for seed in range(30))
    fits = (fit_decay(TIME, record, law="quadratic", rest="zero") for record in records)
    fit = next(fit for fit in fits if "eta2" in fit.at_bound)
    low, high = fit.intervals()["eta2"]
    assert low == fit.eta2 == 0.0
    assert 0.0 < high < 0.02
    assert fit.profile("eta2") == pytest.approx((0.0, high), rel=0.02, abs=1e-9)
    assert any("eta2 is at its bound 0" in warning for warning in fit.warnings)
    assert re.search(r"eta2 .*\(at its bound\)\n", fit.report()) and re.search(r"offset .*\(fixed\)", fit.report())
    assert "nan" not in fit.report()


@pytest.mark.slow
def test_intervals_next_to_a_bound_cover_the_truth():
    """The true eta2 is one or two standard errors from zero; some estimates are at the bound."""
    truth, covered, bounded = 0.005, [], 0
    for seed in range(60):
        fit = fit_decay(TIME, drag(1.85, 0.15, truth, 0.076) + 2e-4 * noise(500 + seed), law="quadratic")
        covered.append(fit.intervals()["eta2"][0] <= truth <= fit.intervals()["eta2"][1])
        bounded += "eta2" in fit.at_bound
    assert 1 <= bounded <= 12
    assert np.mean(covered) >= 0.92


def test_a_quantity_the_law_does_not_estimate_has_no_interval():
    fit = fit_decay(TIME, swing(1.85, 0.01, 0.05) + 1e-4 * noise(29))
    for arguments, message in ((("eta2",), "eta2: .*not estimated"), (("eta1", 2.0), "level: ")):
        with pytest.raises(InputError, match=message):
            fit.profile(*arguments)


def test_a_short_record_says_so():
    fit = fit_decay(TIME[:1100], swing(1.85, 0.01, 0.05, time=TIME[:1100]) + 1e-3 * noise(30, 1100))
    assert any("the record is short: 4.1 periods" in w for w in fit.warnings)
    vague = fit_decay(TIME[:1500], swing(1.85, 0.003, 0.05, time=TIME[:1500]) + 5e-3 * noise(31, 1500))
    (warning,) = [w for w in vague.warnings if "would give 10%" in w]
    needed = float(warning.split("too short; ")[1].split(" s would give 10%")[0])
    time = np.arange(0.0, needed, 0.002)
    longer = fit_decay(time, swing(1.85, 0.003, 0.05, time=time) + 5e-3 * noise(32, len(time)))
    assert longer.standard_errors["damping_ratio"] == pytest.approx(0.1 * vague.damping_ratio, rel=0.2)


@pytest.fixture(scope="module")
def driven_in_mode_5(paper_beam):
    """The tip after a drive of mode 5 by 0.1 mm for half a second, with noise; by the ramp of the drive."""
    modes = natural_modes(Model(paper_beam(6)), count=5)
    law = ModalDamping(modes, ratios=(0.0100, 0.0028, 0.0028, 0.0023, 0.0030))
    reduced = reduce_model(modes.model, modes=modes, damping=law)

    def record(ramp):
        base = HarmonicBase(1e-4, modes.frequencies[4], stop=0.5, ramp=ramp)
        run = simulate_reduced(reduced, base=base, duration=3.5, sample_rate=1000.0)
        scatter = 2e-5 * np.random.default_rng(5).standard_normal(len(run.time))
        return Measurement(run.time, run.tip[:, 0] + scatter), base.stop_time

    return record


@pytest.mark.slow
@pytest.mark.parametrize("known", [True, False], ids=["release given", "release detected"])
def test_a_decay_that_holds_mostly_another_mode_than_the_driven_one_says_so(driven_in_mode_5, known):
    record, stop = driven_in_mode_5(ramp=0.0)
    fit = fit_decay(record, release_time=stop if known else None)
    assert fit.frequency == pytest.approx(1.88, abs=0.02)
    (warning,) = [text for text in fit.warnings if "excitation" in text]
    assert re.match(r"the excitation had 9\d\.\d Hz, and the decay has 1\.\d+ Hz", warning)
    record, stop = driven_in_mode_5(ramp=5.0)
    fit = fit_decay(record, release_time=stop if known else None)
    assert 90.0 < fit.frequency < 100.0
    assert not any("excitation" in text for text in fit.warnings)


@pytest.mark.slow
@pytest.mark.parametrize("rest", [0.0, 0.5])
def test_a_release_or_a_blow_that_sets_several_modes_in_motion_is_no_excitation(rest):
    time = np.arange(0.0, 8.0, 1e-3)
    since = np.maximum(time - rest, 0.0)
    modes = [(1.9, 0.01, 1.0), (11.9, 0.005, 0.3), (33.0, 0.003, 0.2)]
    parts = [a * np.exp(-2 * np.pi * f * ζ * since) * np.sin(2 * np.pi * f * since) for f, ζ, a in modes]
    record = Measurement(time, 1e-2 * sum(parts) + 1e-5 * np.random.default_rng(6).standard_normal(len(time)))
    for release in (None, rest, rest + 0.3):
        fit = fit_decay(record, release_time=release)
        assert fit.frequency == pytest.approx(1.9, rel=1e-3)
        assert not any("excitation" in text for text in fit.warnings)


def test_a_noisy_record_says_so():
    """The record is longer than the decay: a longer one would only add noise."""
    fit = fit_decay(TIME, swing(8.0, 0.05, 0.005) + 2e-3 * noise(34))
    assert fit.standard_errors["damping_ratio"] > 0.1 * fit.damping_ratio
    assert any("less noise" in w for w in fit.warnings)
    lost = fit_decay(TIME, swing(8.0, 1e-4, 0.005) + 2e-3 * noise(35), ratio_bounds=(-0.1, 0.5))
    assert any("the damping ratio does not differ significantly" in w for w in lost.warnings)


@pytest.mark.parametrize("floor", [0.0, 1e-9])
def test_the_misfit_of_an_almost_exact_record_makes_no_error_smaller_than_white_noise_would(floor):
    """Damping and frequency depend on the amplitude, and another mode remains, as after a simulated excitation.

    The damping ratio is zeta (1 - c A^2) with c A^2 = 1e-3 at the release, so that the fit deviates from zeta.
    """
    ω, ζ, A, c = 2 * math.pi * 1.85, 0.01, 0.03, 1e-3
    fade = np.exp(-2 * ζ * ω * TIME)
    envelope = A * np.sqrt(fade / (1 - c * (1 - fade)))
    turned = ω * TIME + 1e-4 * (1 - fade)
    record = envelope * np.cos(turned) + 1e-3 * A * (envelope / A) ** 3 * np.cos(3 * turned)
    record += swing(10.19, 0.0028, 1.7e-5) + floor * noise(5)
    fit = fit_decay(TIME, record)
    assert fit.residual_rms < 1e-3 * A
    assert (fit.fit.errors > 0.95 * fit.fit.white_errors).all()


@pytest.mark.parametrize("law", ["linear", "quadratic"])
def test_hum_that_is_larger_than_the_decay_is_said_to_hide_it(law):
    hum = 1.5e-3 * np.cos(2 * math.pi * 50.0 * TIME + 0.3) + 1e-5 * noise(3)
    fit = fit_decay(TIME, hum + swing(2.0, 0.05, 1e-3), law=law)
    (warning,) = [text for text in fit.warnings if "hardly decays" in text]
    assert fit.frequency == pytest.approx(50.0, rel=1e-4)
    hidden = re.search(r"oscillation of 50 Hz hardly decays.* of (\S+) Hz.*--band", warning)
    assert float(hidden[1]) == pytest.approx(2.0, rel=0.02)


@pytest.mark.parametrize("hum", [0.0, 0.2e-3])
@pytest.mark.parametrize("ratio", [0.05, 0.0])
def test_weak_hum_and_a_mode_without_damping_hide_no_decay(ratio, hum):
    lasting = hum * np.cos(2 * math.pi * 50.0 * TIME + 0.3) + 1e-5 * noise(3)
    fit = fit_decay(TIME, lasting + swing(2.0, ratio, 1e-3))
    assert fit.frequency == pytest.approx(2.0, rel=1e-2)
    assert not any("hardly decays" in text for text in fit.warnings)


@pytest.mark.slow
def test_a_fit_survives_the_way_to_another_process():
    fit = fit_decay(TIME, swing(1.85, 0.01, 0.05) + 1e-3 * noise(36))
    copy = pickle.loads(pickle.dumps(fit))
    assert copy.to_dict() == fit.to_dict()
    assert copy.profile("damping_ratio") == pytest.approx(fit.profile("damping_ratio"), rel=1e-12)


def test_the_figure_shows_record_residuals_their_autocorrelation_and_the_law():
    y = (swing(1.85, 0.01, 0.05) + 1e-3 * noise(33))[:800]
    fit = fit_decay(TIME[:800], y)
    record, left, repeated, ratio, frequency = fit.figure().axes
    np.testing.assert_allclose(np.asarray(record.lines[0].get_ydata()), 1e3 * y, atol=1e-9)
    np.testing.assert_allclose(np.asarray(left.lines[0].get_ydata()), -1e3 * fit.residuals, atol=1e-9)
    assert "damping ratio" in ratio.get_ylabel() and "frequency" in frequency.get_ylabel()
    correlation = np.asarray(repeated.lines[0].get_ydata())
    assert correlation[:2] == pytest.approx([1.0, fit.fit.autocorrelation])
    assert np.mean(np.abs(correlation[1:]) < repeated.lines[2].get_ydata()[0]) > 0.9


def test_a_law_that_does_not_tell_all_is_noticed():
    record = swing(2.0, 0.01, 0.05) + swing(12.5, 0.005, 0.004) + 1e-6 * noise(14)
    fit = fit_decay(TIME, record)
    assert fit.frequency == pytest.approx(2.0, rel=1e-3)
    assert any("are not noise: they oscillate" in warning for warning in fit.warnings)


@pytest.mark.slow
def test_the_result_reads_as_text_and_as_json():
    fit = fit_decay(TIME, drag(26.84, 0.89, 0.05, 0.0076) + 2e-4 * noise(15), law="quadratic")
    table = json.loads(json.dumps(fit.to_dict(), allow_nan=False))
    assert table["frequency_hz"] == fit.frequency
    assert table["eta2_per_m"] == fit.eta2
    assert table["damping_ratio_stderr"] == fit.standard_errors["damping_ratio"]
    assert table["warnings"] == list(fit.warnings)
    text = fit.report()
    assert text.startswith("quadratic decay, 2500 samples from 0 s on")
    assert f"{fit.frequency:.6g} +- {fit.standard_errors['frequency']:.2g} Hz" in text
    assert all(f"note: {warning}" in text for warning in fit.warnings)
    assert fit_decay(TIME, swing(1.85, 0.0, 0.05)).to_dict()["damping_ratio_stderr"] is None


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((TIME, TIME[:-1]), {}, "values: has 2499 values for 2500 times"),
        ((TIME, None), {}, "displacement: is missing"),
        ((Measurement(TIME, TIME), TIME), {}, "displacement: is part of the record"),
        ((TIME[::-1], TIME), {}, "time: must increase"),
        ((TIME, TIME + math.inf), {}, "values: must be finite"),
        ((TIME, np.ones(2500)), {}, "record: is constant"),
        ((TIME, noise(16)), {}, "record: is noise"),
        ((TIME, np.exp(-TIME)), {}, "nothing oscillates"),
        ((TIME[:9], np.cos(TIME[:9])), {}, "record: has 9 samples"),
        ((TIME, np.cos(TIME)), {"law": "cubic"}, "law: must be one of linear, quadratic"),
        ((TIME, np.cos(TIME)), {"ratio_bounds": (0.0, 1.0)}, "ratio_bounds: must be in order"),
        ((TIME, np.cos(TIME)), {"ratio_bounds": (0.5, 0.1)}, "ratio_bounds: must be in order"),
        ((TIME, np.cos(TIME)), {"ratio_bounds": 0.1}, "ratio_bounds: must be a pair"),
        ((TIME, np.cos(TIME)), {"release_time": "now"}, "release_time: must be a finite number"),
        ((TIME, np.cos(TIME)), {"release_time": 9.0}, "record: has 0 samples"),
    ],
)
def test_unusable_input_is_refused(arguments, options, message):
    with pytest.raises(InputError, match=message):
        fit_decay(*arguments, **options)


@pytest.mark.skipif(not SILICONE.exists(), reason="the measured records are not part of the repository")
class TestSiliconeBeam:
    """Free release of a silicone beam, motion capture at 100 frames/s, with 0.4-0.7 s of rest before it."""

    def test_the_beam_alone(self):
        """Least squares with scipy from the last sample at rest gives 7.7743 Hz and 5.526 %."""
        fit = fit_decay(Measurement.from_file(SILICONE / "beam_gravity_tip.csv"))
        assert fit.release_time == pytest.approx(0.71, abs=0.011)
        assert fit.frequency == pytest.approx(7.77, abs=0.03)
        assert fit.damping_ratio == pytest.approx(0.055, abs=0.004)
        assert fit.offset == pytest.approx(-0.0062, abs=2e-4)
        assert any("are not noise: they oscillate" in warning for warning in fit.warnings)

    @pytest.mark.slow
    @pytest.mark.parametrize("name", ["gravity", "load52", "load101"])
    def test_every_law_converges_and_none_tells_all(self, name):
        record = Measurement.from_file(SILICONE / f"beam_{name}_tip.csv")
        laws = ("linear", "quadratic", "friction")
        comparison = compare_decay_laws(record, laws=laws, frequency_laws=["constant"], rests=["constant"])
        linear, quadratic, friction = comparison.fits
        assert not compare_decay_laws(record).failed
        assert friction.residual_rms <= quadratic.residual_rms * (1 + 1e-6) <= linear.residual_rms * 1.01
        assert any("no law explains all of the motion" in warning for warning in comparison.warnings)

    @pytest.mark.parametrize(("name", "frequency"), [("load52", 4.4), ("load101", 3.4)])
    def test_the_beam_with_a_weight_at_its_tip(self, name, frequency):
        fit = fit_decay(Measurement.from_file(SILICONE / f"beam_{name}_tip.csv"))
        assert fit.frequency == pytest.approx(frequency, abs=0.06)
        assert 0.05 < fit.damping_ratio < 0.08


@pytest.mark.parametrize(("offset", "amplitude"), [(1e9, 1e-2), (1e8, 1e-3), (-1e10, 1.0)])
def test_the_digits_of_a_record_limit_its_errors(offset, amplitude):
    """Rounding to multiples of s adds white noise of s/12^1/2, whose error of a constant is s/(12 m)^1/2."""
    fit = fit_decay(TIME, offset + swing(2.0, 0.01, amplitude))
    least = np.spacing(abs(offset)) / math.sqrt(12 * len(TIME))
    assert least <= 1.05 * fit.standard_errors["offset"] < 3 * least
    assert fit.damping_ratio == pytest.approx(0.01, abs=4 * fit.standard_errors["damping_ratio"])
    assert fit.frequency == pytest.approx(2.0, abs=4 * fit.standard_errors["frequency"])
