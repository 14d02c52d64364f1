"""Repeated fits to records generated from one fit: their scatter, and the same results on any executor."""

import math
import sys
from dataclasses import replace

import numpy as np
import pytest

from ancf_casadi import Beam, InputError, Measurement, Model, RayleighDamping, simulate
from ancf_casadi.estimation.resampling import _noise, block_length
from ancf_casadi.exceptions import FitError
from problems import MarkerRecord, fit_beam, fit_decay, fit_decays, monte_carlo

TIME = np.arange(0.0, 5.0, 1 / 100)


def swing(ratio=0.01, frequency=1.85):
    ω = 2 * math.pi * frequency
    return 0.05 * np.exp(-ratio * ω * TIME) * np.cos(ω * math.sqrt(1 - ratio**2) * TIME)


def white(seed, size=500):
    return np.random.default_rng(seed).standard_normal(size)


def coloured(seed, rho):
    """Noise of variance 1 whose successive values correlate at rho."""
    noise = white(seed, 2 * len(TIME))
    for k in range(1, len(noise)):
        noise[k] = rho * noise[k - 1] + math.sqrt(1 - rho**2) * noise[k]
    return noise[-len(TIME) :]


@pytest.fixture(scope="module")
def decay():
    return fit_decay(TIME, swing() + 1e-3 * white(1))


@pytest.fixture(scope="module")
def transient():
    strip = {"length": 0.2, "width": 0.01, "thickness": 2e-3, "density": 1070.0, "elastic_modulus": 264e3}
    model = Model(Beam.uniform(**strip, elements=2, axis=(1.0, 0.0), gravity=(0.0, -1.0)))
    law = RayleighDamping(alpha=2.0)
    run = simulate(model, damping=law, start="straight", duration=0.3, sample_rate=40.0, method="radau")
    noise = 2e-4 * np.random.default_rng(1).normal(size=run.tip.shape)
    return fit_beam(model, MarkerRecord(run.time, run.tip + noise, start="straight"), law, tolerance=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["parametric", "bootstrap"])
def test_the_scatter_of_the_runs_is_the_standard_error_where_the_noise_is_white(decay, method):
    """100 runs: a standard deviation is known to 7 %; four of these are allowed."""
    study = monte_carlo(decay, runs=100, method=method)
    assert study.names == ("frequency", "damping_ratio", "eta1", "amplitude", "offset")
    assert study.units == ("Hz", "", "1/s", "m", "m")
    assert study.block == 1 and study.runs == 100 and not study.failures
    assert study.estimates[1] == pytest.approx(decay.damping_ratio)
    assert study.standard_errors["frequency"] == decay.standard_errors["frequency"]
    errors = np.array(list(study.standard_errors.values()))
    np.testing.assert_allclose(study.stds, errors, rtol=0.28)
    assert (abs(study.means - study.estimates) < 4 * errors / math.sqrt(100)).all()
    half = np.diff(study.intervals()).ravel() / 2
    np.testing.assert_allclose(half, 1.96 * errors, rtol=0.4)


@pytest.mark.slow
def test_blocks_keep_what_correlates_together():
    """Over many records, the scatter of the fits is that of the block bootstrap, twice that of single residuals."""
    rho = 0.8
    fits = [fit_decay(TIME, swing() + 1e-3 * coloured(100 + seed, rho), rest="zero") for seed in range(40)]
    scatter = np.std([fit.frequency for fit in fits], ddof=1)
    blocks = monte_carlo(fits[0], runs=60, method="bootstrap")
    singles = monte_carlo(fits[0], runs=30)
    estimated = np.mean([fit.fit.autocorrelation for fit in fits])
    assert estimated == pytest.approx(rho, abs=0.05)
    expected = (2 * estimated / (1 - estimated**2)) ** (2 / 3) * (1.5 * 500) ** (1 / 3)
    assert np.median([block_length(fit.fit) for fit in fits]) == pytest.approx(expected, rel=0.15)
    assert blocks.block == block_length(fits[0].fit)
    assert scatter > 2 * singles.stds[0]
    assert blocks.stds[0] == pytest.approx(scatter, rel=0.4)
    assert f"bootstrap of blocks of {blocks.block} residuals" in blocks.report()


@pytest.mark.slow
def test_a_motion_is_fitted_again_too(transient):
    """40 runs: a standard deviation is known to 11 %, a mean to 16 % of one; three of these are allowed."""
    study = monte_carlo(transient, runs=40, seed=3)
    assert study.names == ("alpha",) and study.units == ("1/s",)
    error = transient.fit.errors[0]
    assert study.stds[0] == pytest.approx(error, rel=0.34)
    assert abs(study.means[0] - transient.fit["alpha"]) < 3 * error / math.sqrt(40)
    assert abs(study.means[0] - 2.0) < 4 * error


@pytest.mark.filterwarnings("ignore:an element bends")  # of the two elements
def test_blocks_stay_within_a_record_and_a_coordinate(transient):
    """Residuals that encode their origin: their number in the series, times 1 in the first and 1000 in the second."""
    records = [Measurement(TIME[:size], swing()[:size] + 1e-3 * white(size, size)) for size in (300, 200)]
    both = fit_decays(records, release_times=[0.0, 0.0])[0]
    for fit, series in ((transient, (13, 13)), (both, (300, 200))):
        assert fit.fit.series == series
        plural = [np.arange(size) - (size - 1) / 2 for size in series]
        labels = np.concatenate([1.0 * plural[0], 1000.0 * plural[1]])
        labelled = replace(fit, fit=replace(fit.fit, residuals=labels))
        block = block_length(labelled.fit)
        assert block > 2
        noise = _noise(labelled, np.random.default_rng(1), "bootstrap", block)
        drawn = noise / math.sqrt(len(labels) / fit.fit.degrees_of_freedom)
        for part, size, scale in zip(np.split(drawn, [series[0]]), series, (1.0, 1000.0), strict=True):
            numbers = part / scale + (size - 1) / 2
            np.testing.assert_allclose(numbers, numbers.round(), atol=1e-6)
            assert 0 <= numbers.min().round() and numbers.max().round() < size
            follows = np.diff(numbers.round()) % size == 1
            assert follows[np.arange(1, size) % block != 0].all()


@pytest.mark.parametrize(("rho", "method", "named"), [(0.9, "parametric", True), (0.9, "bootstrap", False),
                                                      (0.0, "parametric", False)])  # fmt: skip
def test_white_records_for_a_fit_with_coloured_noise_are_named(rho, method, named):
    fit = fit_decay(TIME, swing() + 1e-3 * coloured(1, rho))
    assert any("bootstrap" in note for note in monte_carlo(fit, runs=2, method=method).warnings) == named


def test_runs_that_fail_are_counted_and_named(decay, monkeypatch):
    module = sys.modules["ancf_casadi.estimation.solver.least_squares"]
    solve, calls = module.least_squares, []

    def sometimes(*arguments, **settings):
        calls.append(1)
        if len(calls) % 4 == 0:
            raise FitError("no minimum was found")
        return solve(*arguments, **settings)

    monkeypatch.setattr(module, "least_squares", sometimes)
    study = monte_carlo(decay, runs=10)
    assert study.runs == 10 and len(study.samples) == 8 and study.failures == ("no minimum was found",) * 2
    assert "2 runs failed: no minimum was found" in study.report()
    assert study.to_dict()["failures"] == ["no minimum was found"] * 2
    monkeypatch.setattr(module, "least_squares", lambda *_, **__: (_ for _ in ()).throw(FitError("never")))
    with pytest.raises(FitError, match="3 of 3 runs failed, the first: never"):
        monte_carlo(decay, runs=3)


@pytest.mark.slow
def test_any_executor_gives_the_same_numbers(decay, transient):
    """In this process, in other processes, and on a dask cluster."""
    distributed = pytest.importorskip("distributed")
    serial = [monte_carlo(fit, runs=4, seed=7) for fit in (decay, transient)]
    assert not np.array_equal(serial[0].samples, monte_carlo(decay, runs=4, seed=8).samples)
    processes = [monte_carlo(fit, runs=4, seed=7, jobs=2) for fit in (decay, transient)]
    cluster = distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None)
    with cluster, distributed.Client(cluster) as client, client.get_executor() as executor:
        dask = [monte_carlo(fit, runs=4, seed=7, executor=executor) for fit in (decay, transient)]
    for here, *others in zip(serial, processes, dask, strict=True):
        for other in others:
            assert here.samples.tobytes() == other.samples.tobytes()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"runs": 1}, "runs: must be a whole number"),
        ({"seed": -1}, "seed: must be a whole number, 0 or more"),
        ({"method": "jackknife"}, "method: must be one of"),
    ],
)
def test_settings_that_make_no_sense_are_refused(decay, settings, message):
    with pytest.raises(InputError, match=message):
        monte_carlo(decay, **settings)


def test_a_level_that_is_no_probability_is_refused(decay):
    with pytest.raises(InputError, match="level: must be between 0 and 1"):
        monte_carlo(decay, runs=2).intervals(1.0)
