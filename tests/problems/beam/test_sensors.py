"""Damping and properties from sensors of every kind, with known truth: readings that follow from a trajectory."""

import json
from dataclasses import replace

import numpy as np
import pytest

from ancf_casadi import (
    FitError,
    InputError,
    Measurement,
    Model,
    RayleighDamping,
    SampledLoad,
    State,
    simulate,
    static_equilibrium,
)
from ancf_casadi.figures.files import figure_bytes
from ancf_casadi.mechanics.loads import PointLoad
from ancf_casadi.records.sensor import Sensor
from problems import Camera, Channel, MarkerRecord, MotionRecord, StaticRecord, fit_beam
from problems.beam.motions.weights import first_weights
from tests.problems.beam.conftest import EVERY, SENSORS
from tests.problems.beam.truth import scores

pytestmark = pytest.mark.filterwarnings("ignore:an element bends")  # of the three elements

TRUTH = 0.5  # alpha, 1/s
GUESS = RayleighDamping(alpha=0.3, beta=1e-3)
X = Sensor("position")


def relative(fit):
    """Return the relative standard errors of modulus and density."""
    return np.array([fit.standard_errors[name] / fit.estimates[name] for name in ("elastic_modulus", "density")])


def fitted(swing, record, **settings):
    return fit_beam(swing.model, record, GUESS, fixed=("beta",), **settings)


@pytest.mark.slow
@pytest.mark.parametrize(
    "sensor", [SENSORS[k] for k in (0, 3, 5, 6, 8, 9, 10)], ids=lambda sensor: f"{sensor.quantity} {sensor.label}"
)
def test_the_damping_is_found_from_one_sensor_of_each_quantity(swing, sensor):
    fit = fitted(swing, MotionRecord([swing.measurement(sensor, 0.01)], start=swing.start))
    assert abs(fit.fit["alpha"] - TRUTH) < 3.0 * fit.standard_errors["alpha"] < 0.03
    noise = 0.01 * swing.truth(sensor).std()
    assert fit.fit.residual_rms == pytest.approx(noise, rel=0.25)


@pytest.mark.slow
def test_exact_readings_of_all_sensors_leave_no_residual(swing):
    record = MotionRecord([swing.measurement(sensor) for sensor in SENSORS], start=swing.start)
    exact = fitted(swing, record, tolerance=1e-8)
    assert exact.fit["alpha"] == pytest.approx(TRUTH, rel=1e-4)
    for sensor, residuals in zip(SENSORS, exact.predict(record).residuals, strict=True):
        assert np.std(residuals) < 3e-4 * swing.truth(sensor).std()


@pytest.mark.slow
def test_sensors_of_all_units_share_one_fit_and_fix_modulus_and_density(swing):
    """Channels with their own rates, a gap, uneven times and a weight that the user gives."""
    rng = np.random.default_rng(2)
    records = [swing.measurement(sensor, 0.01, seed) for seed, sensor in enumerate(SENSORS)]
    records[0] = Measurement(records[0].time[::2], records[0].values[::2], sensor=records[0].sensor)
    uneven = np.sort(rng.choice(records[4].time.size, 50, replace=False))
    records[4] = Measurement(records[4].time[uneven], records[4].values[uneven], sensor=records[4].sensor)
    gap = np.where((records[6].time > 0.2) & (records[6].time < 0.4), np.nan, records[6].values)
    records[6] = Measurement(records[6].time, gap, sensor=records[6].sensor)
    noise = 0.01 * swing.truth(SENSORS[2]).std()
    channels = [Channel(record, std=noise if k == 2 else None) for k, record in enumerate(records)]
    guess = Model(swing.model.beam.with_(elastic_modulus=1.05 * 264e3, density=0.97 * 1070.0))
    fit = fit_beam(
        guess,
        MotionRecord(channels, start=swing.start),
        GUESS,
        fixed=("beta",),
        unknowns=("elastic_modulus", "density"),
    )
    assert abs(scores(fit, [TRUTH, 264e3, 1070.0])).max() < 3.0 and relative(fit).max() < 2e-3
    deviations = fit.solution.problem.blocks[0].weights.deviations
    truth = [0.01 * swing.truth(sensor).std() for sensor in SENSORS]
    assert deviations == pytest.approx(truth, rel=0.3) and deviations[2] == noise
    assert [channel["channel"] for channel in fit.to_dict()["records"][0]["channels"]][3] == "velocity normal, tip"
    assert "weighted by 1/" in fit.report()
    json.dumps(fit.to_dict(), allow_nan=False)
    assert len(fit.figure().axes) == 2 * 8 and figure_bytes(fit.figure()).startswith(b"\x89PNG")
    assert [residuals.size for residuals in fit.residuals] == [record.time.size for record in records]


@pytest.mark.slow
def test_a_motion_without_force_determines_ratios_only(swing):
    record = MotionRecord([swing.measurement(X, 0.01)])
    unknown = {"unknowns": ("elastic_modulus", "density", "start_force_x")}
    message = "determine density/elastic_modulus, start_force_x_1/elastic_modulus, but not elastic_modulus, density, "
    with pytest.raises(FitError, match=message):
        fitted(swing, record, **unknown)
    with pytest.raises(FitError, match=r"do not depend on width; fix it.*but not elastic_modulus and density each"):
        shaken = MarkerRecord(np.arange(80) / 100, swing.run.tip[: 80 * EVERY : EVERY], start=State(*_state(swing)))
        fitted(swing, shaken, unknowns=("width", "elastic_modulus", "density"))
    force = swing.measurement(Sensor("force"), 0.01)
    fit = fitted(swing, MotionRecord([swing.measurement(X, 0.01), force]), **unknown)
    assert abs(scores(fit, [TRUTH, 264e3, 1070.0, 0.004])).max() < 3.0 and relative(fit).max() < 0.02


def _state(swing):
    state = swing.run.state(0)
    return state.coordinates, state.velocities


@pytest.mark.slow
def test_an_offset_of_a_sensor_and_the_release_are_found_with_rest_before_it(swing):
    """The record begins 0.2 s before the release, and the clock of the velocity is 13 ms ahead."""
    rest = np.arange(-20, 0) / 100
    held = {X: swing.start.tip[0], Sensor("velocity"): 0.0}
    channels = []
    for (sensor, value), late in zip(held.items(), (0.0, 0.013), strict=True):
        moving = swing.measurement(sensor, 0.005)
        noise = 0.005 * moving.values.std() * np.random.default_rng(3).normal(size=rest.size)
        time, values = np.concatenate([rest, moving.time]), np.concatenate([value + noise, moving.values])
        record = Measurement(time + 0.25 + late, values, sensor=sensor)
        channels.append(Channel(record, offset=(0.0, 0.03) if late else None))
    fit = fitted(swing, MotionRecord(channels, start=swing.start, release_time=(0.23, 0.26)))
    assert fit.fit.names == ("alpha", "release_1", "offset_1_2")
    score = (fit.fit.values - [TRUTH, 0.25, 0.013]) / fit.fit.errors
    assert abs(score).max() < 3.0 and fit.fit.errors[1:].max() < 3e-4


@pytest.mark.slow
def test_a_release_at_a_sample_of_a_force_is_found_although_the_force_jumps_there(swing):
    early = [swing.measurement(sensor, 0.02, seed) for seed, sensor in enumerate((X, Sensor("force")))]
    time = early[0].time - early[0].time[0]
    late = [Measurement(time + 0.1, record.values, sensor=record.sensor) for record in early]
    fit = fitted(swing, MotionRecord(late, start=swing.start, release_time=(0.081, 0.119)))
    assert fit.solution.problem.blocks[0].sensors[1].measurement.time[0] == pytest.approx(0.12)
    score = (fit.fit.values - [TRUTH, 0.1 - early[0].time[0]]) / fit.fit.errors
    assert abs(score).max() < 3.0


@pytest.mark.slow
def test_the_view_of_a_camera_is_found(swing):
    scale, turn, origin = 1.04, 0.05, (0.012, -0.007)
    tip, middle = swing.run.tip, swing.run.position(0.1)
    turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    seen = origin + scale * np.stack([middle, tip], axis=1)[::EVERY] @ turned.T
    seen += 1e-4 * np.random.default_rng(4).normal(size=seen.shape)
    camera = Camera(scale=(0.9, 1.1), rotation=(-0.2, 0.2), origin=((-0.05, 0.05), (-0.05, 0.05)))
    record = MarkerRecord(swing.run.time[::EVERY], seen, (0.1, 0.2), start=swing.start, camera=camera)
    fit = fitted(swing, record)
    assert fit.fit.names == ("alpha", "camera_scale_1", "camera_rotation_1", "camera_x_1", "camera_y_1")
    score = (fit.fit.values - [TRUTH, scale, turn, *origin]) / fit.fit.errors
    assert abs(score).max() < 3.0 and fit.fit.errors[1:].max() < 1e-3
    assert fit.fit.residual_rms == pytest.approx(1e-4, rel=0.15)


@pytest.mark.slow
def test_a_measurement_is_a_record_of_a_free_beam_that_is_released_from_an_estimated_load(swing):
    fit = fitted(swing, swing.measurement(X, 0.01), unknowns=("start_force_x",))
    score = (fit.fit.values - [TRUTH, 0.004]) / fit.fit.errors
    assert abs(score).max() < 3.0


@pytest.mark.slow
def test_the_zero_of_an_accelerometer_is_found_within_its_bounds(swing):
    exact = swing.measurement(Sensor("acceleration"), 0.01)
    biased = Measurement(exact.time, exact.values + 0.3, sensor=exact.sensor)
    fit = fitted(swing, MotionRecord([Channel(biased, zero=(-1.0, 1.0))], start=swing.start))
    score = (fit.fit.values - [TRUTH, 0.3]) / fit.fit.errors
    assert fit.fit.units == ("1/s", "m/s^2") and abs(score).max() < 3.0


@pytest.mark.slow
def test_markers_that_are_lost_for_a_while_are_gaps(swing):
    seen = swing.run.tip[::EVERY] + 1e-4 * np.random.default_rng(6).normal(size=(81, 2))
    seen[20:40, 1] = np.nan
    fit = fitted(swing, MarkerRecord(swing.run.time[::EVERY], seen, start=swing.start))
    assert [residuals.size for residuals in fit.residuals] == [81, 61]
    assert abs(fit.fit["alpha"] - TRUTH) < 3.0 * fit.standard_errors["alpha"]


@pytest.mark.slow
def test_deflections_under_known_weights_fix_the_scale_of_a_motion(swing):
    """Two side loads with known deflections of the tip, uncertain by 0.1 mm of up to 40 mm."""
    model, sensor = swing.model, Sensor("displacement")
    rest = static_equilibrium(model).tip[0]
    forces = (0.002, 0.004)
    moved = [static_equilibrium(model, tip_force=(force, 0.0)).tip[0] - rest for force in forces]
    loads = [PointLoad((force, 0.0)) for force in forces]
    table = StaticRecord(model, loads, moved, sensor, std=1e-4)
    record = MotionRecord([swing.measurement(X, 0.01)])
    unknown = {"unknowns": ("elastic_modulus", "density", "start_force_x")}
    fit = fitted(swing, [record, table], **unknown)
    assert abs(scores(fit, [TRUTH, 264e3, 1070.0, 0.004])).max() < 3.0 and relative(fit).max() < 0.02
    assert fit.fit.series == (80, 1, 1) and len(fit.residuals) == 1
    with pytest.raises(InputError, match="records: values need standard deviations"):
        fitted(swing, [record, StaticRecord(model, loads, moved, sensor)], **unknown)


@pytest.mark.slow
def test_a_known_force_at_the_tip_fixes_the_scale_and_enters_the_force_at_the_clamp(swing):
    """A push over 0.3 s on a beam at rest, with an unknown start of the record."""
    model, push = swing.model, SampledLoad([0.0, 0.1, 0.3], [[0.0, 0.0], [0.004, 0.001], [0.0, 0.0]])
    run = simulate(model, damping=RayleighDamping(alpha=0.5, beta=1e-3), load=push, duration=0.8, sample_rate=100.0,
                   method="radau", tolerance=1e-9)  # fmt: skip
    rng = np.random.default_rng(9)
    channels = [
        Measurement(run.time + 0.1, values + 0.01 * values.std() * rng.normal(size=values.size), sensor=sensor)
        for sensor, values in ((X, run.tip[:, 0]), (Sensor("force"), run.clamp_force[:, 0]))
    ]
    settings = {"load": push, "release_time": (0.09, 0.12)}
    both = fitted(swing, MotionRecord(channels, **settings))
    assert abs(both.fit.values - [TRUTH, 0.1]).max() < 3.0 * both.fit.errors.max()
    assert [np.sqrt(np.mean(residuals**2)) for residuals in both.residuals] == pytest.approx(
        [0.01 * run.tip[:, 0].std(), 0.01 * run.clamp_force[:, 0].std()], rel=0.25
    )
    alone = fitted(swing, MotionRecord(channels[:1], **settings), unknowns=("elastic_modulus", "density"))
    assert abs(scores(alone, [TRUTH, 264e3, 1070.0, 0.1])).max() < 3.0 and relative(alone).max() < 0.02
    with pytest.raises(InputError, match="load: cannot be estimated for a record whose load is given"):
        fitted(swing, MotionRecord(channels, **settings), unknowns=("start_force_x",))


@pytest.mark.slow
def test_a_prediction_of_another_start_agrees_within_noise_and_shows_a_wrong_model(swing):
    fit = fitted(swing, MotionRecord([swing.measurement(X, 0.01)], start=swing.start))
    other = [swing.measurement(sensor, 0.01, 7) for sensor in (Sensor("displacement"), Sensor("slope"))]
    right = fit.predict(MotionRecord(other, start=swing.start))
    assert set(right.rms_errors) == {"displacement x, tip", "slope tip"}
    assert max(right.relative_errors.values()) == pytest.approx(0.01, rel=0.2)
    assert 0.0 < max(right.standard_errors.values()) < 0.003 and not right.warnings
    weak = static_equilibrium(swing.model, tip_force=(0.003, 0.0))
    wrong = fit.predict(MotionRecord(other, start=weak))
    assert min(wrong.relative_errors.values()) > 0.1 and len(wrong.warnings) == 2
    assert all(warning in wrong.report() for warning in wrong.warnings)
    json.dumps(wrong.to_dict(), allow_nan=False)
    assert figure_bytes(wrong.figure()).startswith(b"\x89PNG")
    loaded = Model(swing.model.beam.with_(tip_mass=1e-3))
    heavy = fit.predict(MotionRecord(other, start=swing.start, model=loaded))
    assert min(heavy.relative_errors.values()) > 0.1


def test_third_differences_find_the_noise_of_uneven_samples(swing):
    rng = np.random.default_rng(8)
    time = np.sort(rng.uniform(0.0, 4.0, 2000))
    swung = 0.02 * np.sin(8 * time)
    for noise in (1e-3, 1e-5):
        record = MotionRecord([Measurement(time, swung + noise * rng.normal(size=time.size), sensor=X)])
        assert first_weights([record]).deviations == pytest.approx(noise, rel=0.15)


def test_weights_keep_the_likelihood_of_the_normal_distribution(swing):
    """G is the geometric mean of the standard deviations; residuals have the unit of these."""
    record = MotionRecord([swing.measurement(X, 0.01), swing.measurement(Sensor("velocity"), 0.01)])
    weights = replace(first_weights([record]), deviations=np.array([2.0, 8.0]), lengths=np.array([30.0, 60.0]))
    assert weights.scale == pytest.approx((2.0 * 8.0**2) ** (1 / 3))
    assert weights.root_mean_square(np.array([2.0, 8.0])) == pytest.approx(1.0)
