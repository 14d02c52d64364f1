"""Rest positions that move: creep of polymers, its choice, and a measured beam of silicone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom

from ancf_casadi import Measurement, Sensor
from problems import compare_decay_laws, fit_decay

SILICONE = Path(__file__).parents[4] / "shared" / "data" / "silicone_beam"
TIME = np.linspace(0.0, 6.0, 900)
OFFSET, DRIFT, CREEP = -6e-3, -1e-3, 1.2  # m, m/s, 1/s
TRUTH = {"frequency": 5.0, "damping_ratio": 0.01, "offset": OFFSET, "drift": DRIFT, "creep": CREEP}


def creeping(seed, rate=CREEP):
    ω, rng = 2 * np.pi * TRUTH["frequency"], np.random.default_rng(seed)
    swing = 5e-3 * np.exp(-0.01 * ω * TIME) * np.cos(ω * np.sqrt(1 - 1e-4) * TIME + 0.3)
    moved = TIME if rate == 0.0 else (1 - np.exp(-rate * TIME)) / rate
    return swing + OFFSET + DRIFT * moved + 5e-5 * rng.standard_normal(len(TIME))


@pytest.mark.slow
def test_intervals_of_creep_cover_the_truth():
    """Of 40 fits, each interval of 95 % covers its truth in 33 or more but for a chance of 0.3 %."""
    fits = [fit_decay(TIME, creeping(seed), rest="creep") for seed in range(40)]
    least = int(binom.ppf(0.003, 40, 0.95))
    for name, truth in TRUTH.items():
        covered = sum(low <= truth <= high for low, high in (fit.intervals()[name] for fit in fits))
        assert covered >= least, name


def test_without_rate_creep_is_a_drift():
    creep, drift = (fit_decay(TIME, creeping(3, rate=0.0), rest=rest) for rest in ("creep", "drift"))
    assert creep.residual_rms <= drift.residual_rms * (1 + 1e-9)
    assert creep.intervals()["creep"][0] == 0.0
    assert creep.frequency == pytest.approx(drift.frequency, abs=drift.standard_errors["frequency"])


@pytest.mark.parametrize(("rate", "rest"), [(CREEP, "creep"), (0.0, "drift")])
def test_the_rest_position_is_chosen_with_the_laws(rate, rest):
    found = compare_decay_laws(TIME, creeping(1, rate), laws=("linear",), frequency_laws=("constant",))
    assert found.best.model.rest == rest
    assert found.names == ("linear", "linear + drift", "linear + creep")


def test_a_law_that_does_not_hold_has_errors_of_its_own_scatter():
    """Under drag, a linear law has another damping ratio in each part; its error allows for both."""
    ω, rng = 30.0, np.random.default_rng(0)
    y = 5e-3 / (1 + 0.5 * TIME) * np.cos(ω * TIME) + 1e-5 * rng.standard_normal(len(TIME))
    whole, late = fit_decay(TIME, y), fit_decay(TIME, y, release_time=0.5)
    error, white = whole.standard_errors["damping_ratio"], whole.fit.white_errors[whole.fit.names.index("zeta")]
    assert abs(late.damping_ratio - whole.damping_ratio) < 2 * error
    assert error > 5 * white
    basis, noise = np.linalg.qr(whole.fit.jacobian * whole.fit.scale)[0], whole.fit.noise
    growth = np.trace(noise.form(basis)) / (basis.shape[1] * noise.variance)  # of the variances, in the mean
    assert growth > 25
    assert whole.fit.effective_samples == pytest.approx(len(TIME) / growth)
    right = fit_decay(TIME, y, law="quadratic", frequency_law="constant")
    assert right.fit.noise.white


@pytest.mark.skipif(not SILICONE.is_dir(), reason="the measured records are not part of the repository")
@pytest.mark.parametrize(("load", "most"), [("gravity", 5e-5), ("load52", 1.7e-4), ("load101", 3.1e-4)])
def test_silicone_creeps(load, most):
    time, tip = np.loadtxt(SILICONE / f"beam_{load}_tip.csv", delimiter=",", skiprows=1).T
    fit = fit_decay(time, tip, rest="creep")
    later = fit_decay(time, tip, rest="creep", release_time=fit.release_time + 0.3)
    assert fit.residual_rms < most
    assert fit_decay(time, tip).residual_rms > 2 * fit.residual_rms
    for name in ("frequency", "damping_ratio", "creep"):
        assert abs(getattr(later, name) - getattr(fit, name)) < 2 * fit.standard_errors[name]
    ends = (fit.offset + fit.drift / fit.creep for fit in (fit, later))
    assert np.ptp(list(ends)) < 5e-5


@pytest.mark.slow
@pytest.mark.skipif(not SILICONE.is_dir(), reason="the measured records are not part of the repository")
def test_laws_of_silicone_that_do_not_hold_over_the_record_are_not_chosen():
    """A frequency quadratic in the amplitude, with the lower misfit, would have another sign after 0.3 s.

    The slow residuals carry the information of eight independent ones, too few to compare laws of the damping.
    """
    time, tip = np.loadtxt(SILICONE / "beam_gravity_tip.csv", delimiter=",", skiprows=1).T
    fit = fit_decay(time, tip, law="auto", rest="creep")
    laws = {"law": fit.law, "frequency_law": fit.frequency_law, "rest": "creep"}
    later = fit_decay(time, tip, release_time=fit.release_time + 0.3, **laws)
    assert fit.frequency_law == "constant"
    assert any("the laws cannot be compared" in warning for warning in fit.warnings)
    for name in {"frequency", *fit.model.terms, "drift", "creep"}:
        assert abs(getattr(later, name) - getattr(fit, name)) < 2 * fit.standard_errors[name]


@pytest.mark.parametrize(("derivatives", "contact"), [(2, 0.004), (2, 0.015), (1, 0.008), (0, 0.015)])
def test_a_blow_is_no_creep(derivatives, contact):
    """A hammer strikes an oscillator of 20 Hz and 1 %; the record begins with the blow."""
    time, omega, ratio = np.arange(0.0, 2.0, 1e-3), 2 * np.pi * 20.0, 0.01
    force = np.where(time < contact, np.sin(np.pi * time / contact), 0.0)
    damped = omega * np.sqrt(1 - ratio**2)
    response = np.convolve(force, np.exp(-ratio * omega * time) * np.sin(damped * time))[: time.size] * 1e-3 / damped
    for _ in range(derivatives):
        response = np.gradient(response, time)
    noise = 2e-3 * np.abs(response).max() * np.random.default_rng(0).standard_normal(time.size)
    sensor = Sensor(("displacement", "velocity", "acceleration")[derivatives])
    record = Measurement(time, response + noise, sensor=sensor)
    found = compare_decay_laws(record, release_time=0.0, laws=["linear"], frequency_laws=["constant"])
    assert found.best.model.rest != "creep"
    assert any("creep law is left out" in text for text in found.warnings)
    late = compare_decay_laws(record, release_time=contact + 0.01, laws=["linear"], frequency_laws=["constant"])
    assert late.best.damping_ratio == pytest.approx(ratio, abs=4 * late.best.standard_errors["damping_ratio"])
