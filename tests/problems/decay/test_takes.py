"""Several takes of one decay: agreement, scatter, and the coverage of the interval that includes it."""

import json
import math

import numpy as np
import pytest

from ancf_casadi.estimation.result import FitResult
from ancf_casadi.records.measurement import Measurement
from problems.decay.fitting import fit_decay, fit_decays

TIME = np.arange(0.0, 5.0, 0.005)


def take(ratio, seed, frequency=2.0, noise=5e-4):
    rng = np.random.default_rng(seed)
    ω = 2 * math.pi * frequency
    y = 0.05 * np.exp(-ratio * ω * TIME) * np.cos(ω * math.sqrt(1 - ratio**2) * TIME + rng.uniform(0.0, 6.0))
    return Measurement(TIME, y + noise * rng.standard_normal(len(TIME)))


def fitted(ratios, **settings):
    records = [take(ratio, seed) for seed, ratio in enumerate(ratios)]
    return fit_decays(records, release_times=[0.0] * len(records), **settings)


def test_takes_of_equal_damping_agree_and_their_mean_is_the_joint_fit():
    fits = fitted([0.01, 0.01, 0.01])
    frequency, ratio = fits.agreements
    assert (frequency.name, ratio.name) == ("frequency", "damping_ratio")
    assert ratio.agrees and frequency.agrees
    assert ratio.mean == pytest.approx(fits[0].damping_ratio, abs=0.2 * ratio.error)
    assert ratio.error == pytest.approx(fits[0].standard_errors["damping_ratio"], rel=0.1)
    assert not any("agree" in text for text in fits.warnings)
    assert isinstance(fits, FitResult) and len(fits) == len(fits.alone) == 3
    assert [fit.damping_ratio for fit in fits] == [fits[0].damping_ratio] * 3


@pytest.mark.slow
def test_takes_that_differ_are_told_of_and_their_scatter_is_in_the_error():
    ratios = [0.010, 0.012, 0.011, 0.013]
    fits = fitted(ratios)
    ratio = fits.agreements[1]
    assert not ratio.agrees
    assert ratio.scatter == pytest.approx(np.std(ratios, ddof=1), rel=0.1)
    assert fits.standard_errors["damping_ratio"] > 5 * max(fit.standard_errors["damping_ratio"] for fit in fits.alone)
    assert fits.standard_errors["damping_ratio"] > 2 * fits[0].standard_errors["damping_ratio"]
    assert any("do not agree on damping_ratio" in text for text in fits.warnings)
    assert "4 records do not agree" in fits.report()
    table = json.loads(json.dumps(fits.to_dict(), allow_nan=False))
    assert table["agreements"][1]["values"] == [fit.damping_ratio for fit in fits.alone]
    assert len(fits.figure().axes) == 2


def test_the_parameters_of_a_law_are_compared():
    fits = fitted([0.01, 0.01], law="quadratic")
    assert {"frequency", "eta1"} <= {agreement.name for agreement in fits.agreements} <= {"frequency", "eta1", "eta2"}


def test_one_take_alone_has_nothing_to_agree_with():
    fits = fitted([0.01])
    assert fits.agreements == () and fits.alone == fits.fits
    assert fits.standard_errors == fits[0].standard_errors
    assert fits.report() == fits[0].report()


def test_a_law_that_does_not_hold_over_the_record_is_told_of():
    """Linear damping fitted to a decay by drag: the damping ratio falls with the amplitude."""
    ω = 2 * math.pi * 2.0
    envelope = 0.05 / (1 + 4 * ω * 0.3 * 0.05 * TIME / (3 * math.pi))
    y = envelope * np.cos(ω * TIME) + 2e-4 * np.random.default_rng(1).standard_normal(len(TIME))
    whole, later = (fit_decay(TIME, y, release_time=start) for start in (0.0, 2.5))
    errors = math.hypot(whole.standard_errors["damping_ratio"], later.standard_errors["damping_ratio"])
    assert whole.damping_ratio - later.damping_ratio > 4 * errors
    (warning,) = [text for text in whole.warnings if "does not hold over the record" in text]
    assert "damping_ratio is 0.0" in warning
    right = fit_decay(TIME, y, law="quadratic", release_time=0.0)
    assert not any("does not hold" in text for text in right.warnings)


@pytest.mark.slow
def test_a_law_that_holds_is_rarely_doubted():
    """The test has a level of 1 %: of 100 records, at most 4 (probability 0.3 % of more)."""
    doubted = 0
    for seed in range(100):
        fit = fit_decay(take(0.01, 1000 + seed), release_time=0.0)
        doubted += any("does not hold" in text for text in fit.warnings)
    assert doubted <= 4


@pytest.mark.parametrize("frequency_law", ["linear", "power", "logarithmic", "smooth"])
def test_records_agree_on_the_frequency_at_an_amplitude_that_they_share(frequency_law):
    """Both have 6 (1 - A/0.4 m) Hz: 5.7 Hz at the release of the first one, 5.85 Hz at that of the second."""
    t, rng = np.arange(0.0, 10.0, 0.01), np.random.default_rng(0)
    takes = []
    for amplitude in (0.02, 0.01):
        A = amplitude * np.exp(-0.2 * t)
        phase = 2 * np.pi * 6.0 * (t - 2.5 * (amplitude - A) / 0.2)
        takes.append(Measurement(t, A * np.cos(phase) + 1e-5 * rng.standard_normal(t.size)))
    fits = fit_decays(takes, frequency_law=frequency_law, release_times=[0.0, 0.0])
    assert [fit.frequency for fit in fits] == pytest.approx([5.7, 5.85], rel=2e-3)
    shared = next(agreement for agreement in fits.agreements if agreement.name == "frequency")
    assert shared.mean == pytest.approx(5.85, rel=2e-3)
    assert shared.values == pytest.approx([5.85, 5.85], rel=2e-3)
    assert {"frequency_1", "frequency_2"} <= set(fits.estimates)
    assert f"the frequency is that at {fits[1].amplitude:.4g} m" in fits.table().text()
