"""Fits to motions under a measured load at the tip, with known truth."""

import numpy as np
import pytest

from ancf_casadi import InputError, Measurement, Model, RayleighDamping, SampledLoad, simulate
from ancf_casadi.records.sensor import Sensor
from problems import MarkerRecord, MotionRecord, fit_beam
from tests.problems.beam.truth import scores

LAW, GUESS = RayleighDamping(alpha=0.5, beta=1e-3), RayleighDamping(alpha=0.3, beta=1e-3)
BLOW = SampledLoad(
    0.1 + np.array([0.0, 0.005, 0.01, 0.015, 0.02]), np.outer([0.0, 0.07, 0.1, 0.07, 0.0], [1.0, 0.0]), np.full(5, 1e-4)
)


@pytest.fixture(scope="module")
def struck(swing):
    return simulate(
        swing.model, damping=LAW, load=BLOW, duration=0.6, sample_rate=100.0, method="radau", tolerance=1e-8
    )


@pytest.mark.slow
def test_modulus_and_density_follow_from_a_blow_of_known_force(swing, struck):
    """Without the force, a motion fixes the ratio of modulus and density alone."""
    noise = 1e-4 * np.random.default_rng(1).normal(size=struck.tip.shape)
    record = MarkerRecord(struck.time, struck.tip + noise, load=BLOW)
    guess = Model(swing.model.beam.with_(elastic_modulus=1.05 * 264e3, density=0.97 * 1070.0))
    found = fit_beam(guess, record, GUESS, fixed=("beta",), unknowns=("elastic_modulus", "density"))
    assert np.ptp(struck.tip[:, 0]) > 0.02
    assert abs(scores(found, [0.5, 264e3, 1070.0])).max() < 3.0
    assert found.standard_errors["density"] < 0.01 * 1070.0


@pytest.mark.slow
def test_the_force_on_the_clamp_contains_that_at_the_tip(swing, struck):
    """The readings of force and moment at the truth, during the blow and after it."""
    slope, force = struck.coordinates[:, 2:4], struck.clamp_force
    moment = slope[:, 0] * force[:, 3] - slope[:, 1] * force[:, 2]
    channels = [
        Measurement(struck.time, force[:, 0], sensor=Sensor("force")),
        Measurement(struck.time, moment, sensor=Sensor("moment")),
    ]
    record = MotionRecord(channels, load=BLOW)
    found = fit_beam(swing.model, record, GUESS, fixed=("beta",), tolerance=1e-8)
    assert found.fit["alpha"] == pytest.approx(0.5, rel=1e-3)
    assert found.fit.residual_rms < 2e-3 * min(force[:, 0].std(), moment.std())


@pytest.mark.slow
def test_a_load_after_the_record_is_refused(struck):
    late = SampledLoad([100.0, 101.0], np.ones((2, 2)))
    with pytest.raises(InputError, match="load: begins at 100 s, after the end of the motion"):
        MarkerRecord(struck.time, struck.tip, load=late)
