"""Records of several sensors: what is refused, and with which advice."""

import numpy as np
import pytest

from ancf_casadi import Beam, HarmonicBase, InputError, Measurement, Model, RayleighDamping, State, simulate
from ancf_casadi.records.sensor import Sensor
from problems import Camera, Channel, MarkerRecord, MotionRecord, fit_beam
from problems.beam.motions.weights import first_weights

TIME = np.arange(40) / 100
ONE = Measurement(TIME, np.sin(9 * TIME), sensor=Sensor("velocity"))
SEEN = Measurement(TIME, np.sin(9 * TIME), sensor=Sensor("position"))
MODEL = Model(Beam.uniform(length=0.2, width=0.01, thickness=2e-3, density=1070.0, elastic_modulus=264e3, elements=2))
LAW = RayleighDamping(alpha=0.5)
MOVING = State(MODEL.straight, np.zeros(MODEL.size))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Channel(TIME), "measurement: must be a Measurement, got an array"),
        (lambda: Channel(ONE, std=0.0), "std: must be positive"),
        (lambda: Channel(ONE, offset=(0.1, -0.1)), "offset: the lower bound 0.1 is not below the upper -0.1"),
        (lambda: Channel(ONE, zero=3.0), r"zero: must be a pair \(lower, upper\), got 3.0"),
        (lambda: Camera(scale=(0.0, 1.0)), "scale: must be positive"),
        (lambda: Camera(rotation=(0.1,)), "rotation: must be a pair"),
        (lambda: Camera(origin=(0.0, 0.1)), "origin: must be a pair"),
        (lambda: MotionRecord(ONE), "channels: must be a sequence of Channel or Measurement; put it in a list"),
        (lambda: MotionRecord([]), "channels: must be a sequence"),
        (lambda: MotionRecord([TIME]), "channels: must be a Channel or a Measurement, got an array"),
        (lambda: MotionRecord([ONE], base=1.0), "base: must be a BaseMotion"),
        (lambda: MotionRecord([ONE], camera=1.0), "camera: must be a Camera"),
        (lambda: MotionRecord([ONE], camera=Camera(scale=(0.9, 1.1))), "camera: there are no positions for it"),
        (lambda: MotionRecord([ONE], release_time=0.4), "release_time: must be before the last sample"),
        (lambda: MotionRecord([ONE], release_time=(0.1, 0.0)), "release_time: the lower bound 0.1 is not below"),
        (lambda: MotionRecord([SEEN], release_time=(0.0, 0.1), start=MOVING), "start: a State has no rest before it"),
        (lambda: MotionRecord([Measurement(TIME, 0 * TIME)]), "channels: are constant; nothing moves"),
        (lambda: MotionRecord([Measurement(TIME[:5], TIME[:5])]), "channels: needs at least 10 samples, got 5"),
    ],
)
def test_a_record_that_makes_no_sense_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.parametrize(
    ("record", "settings", "message"),
    [
        (MotionRecord([ONE, Measurement(TIME[:5], TIME[:5])]), {}, "channels: displacement x, tip has fewer than 10"),
        (MotionRecord([ONE, Measurement(TIME, 0 * TIME)]), {}, "channels: displacement x, tip is constant; leave it"),
        (MotionRecord([SEEN], release_time=0.1), {"unknowns": ("start_force_x_rate",)}, "load: samples are"),
        (MotionRecord([ONE]), {"bounds": {"release_1": (0.0, 1.0)}}, "bounds: unknown key 'release_1'; known are "),
        (Measurement(TIME, TIME, sensor=Sensor("slope", 0.3)), {}, "the point must be on the beam, 0 to 0.2 m"),
    ],
)
def test_a_fit_that_makes_no_sense_is_refused(record, settings, message):
    with pytest.raises(InputError, match=message):
        fit_beam(MODEL, record, LAW, **settings)


def test_a_record_knows_the_span_of_its_motion():
    record = MotionRecord([Channel(ONE, offset=(-0.01, 0.02)), SEEN], release_time=(0.1, 0.12))
    assert record.end == pytest.approx(0.39 + 0.01 - 0.1)
    assert record.earliest == pytest.approx(-0.02 - 0.12)
    assert MotionRecord([ONE]).release_bounds == (0.0, 0.0) and not MotionRecord([ONE]).has_unknown_times
    later = State(MODEL.straight, np.zeros(MODEL.size), 3.0)
    assert MotionRecord([ONE], start=later).end == pytest.approx(3.39)


def test_samples_that_may_be_on_either_side_of_a_jump_are_left_out():
    """Times from 0 to 0.39 s: the start is between 0.1 and 0.12 s, the base stops 0.125 s later."""
    force = Measurement(TIME, np.sin(9 * TIME), sensor=Sensor("force"))
    base = HarmonicBase(0.01, 2.0, stop=0.125)
    left = MotionRecord([force, SEEN], base=base, release_time=(0.095, 0.125)).own_channels
    gone = [0.1, 0.11, 0.12, 0.22, 0.23, 0.24, 0.25]
    assert sorted(set(TIME) - set(left[0].measurement.time)) == pytest.approx(gone)
    assert left[1].measurement is SEEN
    late = MotionRecord([Channel(force, offset=(-0.015, 0.015))], release_time=0.1).own_channels
    assert sorted(set(TIME) - set(late[0].measurement.time)) == pytest.approx([0.09, 0.1, 0.11])
    assert MotionRecord([force], base=base, release_time=0.1).own_channels[0].measurement is force
    with pytest.raises(InputError, match="release_time: leave too few samples of force x, clamp that are certain"):
        MotionRecord([force], release_time=(-0.5, 0.385))


def test_markers_are_channels_of_positions_with_one_std():
    positions = np.random.default_rng(1).normal(size=(40, 2, 2))
    base = HarmonicBase(0.01, 2.0)
    record = MarkerRecord(TIME, positions, (0.1, 0.2), base=base).motion_record
    assert [one.label for one in record.own_channels] == [
        f"position {axis}, {place}" for place in ("100 mm", "200 mm") for axis in "xy"
    ]
    np.testing.assert_array_equal(record.own_channels[3].measurement.values, positions[:, 1, 1])
    assert record.base is base
    assert first_weights([record]).groups == ((0, 1, 2, 3),)
    mixed = MotionRecord([SEEN, ONE, Channel(SEEN, std=0.1), SEEN])
    assert first_weights([mixed]).groups == ((0, 3), (1,), (2,)) and first_weights([mixed]).known == (
        False,
        False,
        True,
    )


def test_named_records_are_told_apart_in_reports():
    """Three members of the kind: named records, numbered ones, and one that is named among others."""
    base, law = HarmonicBase(amplitude=2e-3, frequency=3.0), RayleighDamping(alpha=0.5)
    run = simulate(MODEL, damping=law, base=base, duration=0.3, sample_rate=100.0)

    def labels(*names):
        records = [MarkerRecord(run.time, run.tip, base=base, name=name) for name in names]
        fit = fit_beam(MODEL, records, law)
        assert all(name in fit.channels[2 * k].diagram for k, name in enumerate(names))
        return [channel.name for channel in fit.channels[::2]]

    assert labels("swing A", "swing B") == ["swing A, position x, tip", "swing B, position x, tip"]
    assert labels("", "swing B") == ["record 1, position x, tip", "swing B, position x, tip"]
    assert labels("swing A") == ["swing A, position x, tip"] and labels("") == ["position x, tip"]
    assert "'swing A', 1 point" in repr(MarkerRecord(run.time, run.tip, name="swing A"))
    with pytest.raises(InputError, match="name: must be a text"):
        MarkerRecord(run.time, run.tip, name=1)
