"""A released soft strip with light damping: where its fit starts, and how finely its motion is integrated."""

import numpy as np
import pytest
import scipy.optimize

from ancf_casadi import Beam, FitError, Measurement, Model, RayleighDamping, Sensor, simulate, static_equilibrium
from problems import Channel, MarkerRecord, MotionRecord, fit_beam
from problems.beam.fitting import FitSettings, beam_problem
from problems.beam.motions.block import MotionBlock
from problems.beam.unknowns import starts

STRIP = {"length": 0.2, "width": 0.01, "thickness": 2e-3, "density": 1070.0, "elastic_modulus": 264e3}
MODEL = Model(Beam.uniform(**STRIP, elements=2))
LAW = RayleighDamping(alpha=0.8)
UNKNOWN = {"unknowns": ["elastic_modulus"]}


@pytest.fixture(scope="module")
def start():
    return static_equilibrium(MODEL, tip_force=(2e-3, 0.0))


def released(start, rate, samples):
    return simulate(
        MODEL, damping=RayleighDamping(alpha=1.0), start=start, sample_rate=rate, duration=samples / rate,
        tolerance=1e-10,
    )  # fmt: skip


@pytest.mark.slow
def test_a_doubled_frequency_along_the_beam_is_no_mode(start):
    run = released(start, 60.0, 100)
    record = MarkerRecord(run.time, run.tip + 5e-4 * np.random.default_rng(0).normal(size=run.tip.shape), start=start)
    problem, _, first = beam_problem(MODEL, record, LAW, FitSettings(**UNKNOWN))
    motions = [(one.model, one.numbered) for one in problem.blocks if isinstance(one, MotionBlock)]
    found = starts(problem.unknowns, first, motions, only_values=False)
    assert all(0.9 < one.get("elastic_modulus", 264e3) / 264e3 < 1.1 for one in found)


@pytest.mark.slow
def test_the_first_tolerance_shifts_no_frequency_by_a_tenth_of_a_standard_error(start):
    """At 1e-5, the integration error jumps with the modulus: the fit ends 0.2 standard errors away, and says 0.003."""
    run, rng = released(start, 120.0, 96), np.random.default_rng(0)
    exact = [(Sensor("displacement"), run.tip[:, 0], 5e-4), (Sensor("velocity"), run.velocity(0.2)[:, 0], 1e-2)]
    channels = [
        Channel(Measurement(run.time, y + size * rng.normal(size=y.size), sensor=one), std=size)
        for one, y, size in exact
    ]
    record = MotionRecord(channels, start=start)
    usual, fine = fit_beam(MODEL, record, LAW, **UNKNOWN), fit_beam(MODEL, record, LAW, **UNKNOWN, tolerance=1e-8)
    away = [abs(usual.estimates[name] - fine.estimates[name]) / fine.standard_errors[name] for name in fine.estimates]
    assert max(away) < 0.1


@pytest.mark.slow
def test_a_motion_that_no_unknowns_explain_is_refused_and_a_late_clock_named(start):
    run, rng = released(start, 60.0, 100), np.random.default_rng(0)
    values = run.tip[:, 0] + 5e-4 * rng.normal(size=run.time.size)
    for sign, late, message in ((-1.0, 0.0, "unexplained"), (1.0, 2.0, "begins 2 s after .* release_time")):
        record = MotionRecord([Measurement(run.time + late, sign * values)], start=start)
        with pytest.raises(FitError, match=rf"motion of record 1 .*{message}"):
            fit_beam(MODEL, record, LAW)
    fit = fit_beam(MODEL, MotionRecord([Measurement(run.time + 2.0, values)], start=start, release_time=2.0), LAW)
    assert fit.estimates["alpha"] == pytest.approx(1.0, abs=4 * fit.standard_errors["alpha"])
    assert fit.to_dict()["records"][0]["records"][0]["explained_share"] > 0.99


@pytest.mark.slow
def test_a_motion_as_small_as_its_noise_is_explained_at_the_least_squares(start):
    """Steps of three standard deviations went to and fro across the minimum, and ended one standard error away."""
    run, rng = released(start, 60.0, 100), np.random.default_rng(0)
    noise = run.tip[:, 0].std() * rng.normal(size=run.time.size)
    record = MotionRecord([Measurement(run.time, run.tip[:, 0] + noise)], start=start)
    fit = fit_beam(MODEL, record, LAW, **UNKNOWN)
    problem, *_ = beam_problem(MODEL, record, LAW, FitSettings(**UNKNOWN, tolerance=1e-6))
    sizes = np.array([unknown.scale for unknown in problem.unknowns])

    def residuals(x):
        return problem.blocks[0].residuals_at(dict(zip(fit.estimates, x * sizes, strict=True)))

    least = scipy.optimize.least_squares(residuals, np.array([*fit.estimates.values()]) / sizes, diff_step=1e-3).x
    apart = np.abs([*fit.estimates.values()] - least * sizes) / [*fit.standard_errors.values()]
    assert apart.max() < 0.3
