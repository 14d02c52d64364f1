"""Measured records: accepted input, and refusals."""

import numpy as np
import pytest

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.sensor import Sensor


def test_arrays_are_copied_and_kept_from_change():
    time = np.array([0.0, 0.1, 0.2])
    record = Measurement(time, [1, 2, 3], "three")
    time[0] = -1.0
    assert record.time.tolist() == [0.0, 0.1, 0.2]
    assert record.values.dtype == float
    assert record.name == "three"
    for array in (record.time, record.values):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 5.0


def test_nan_marks_a_gap_and_its_sample_is_left_out():
    record = Measurement([0.0, 1.0, 2.0, 3.0], [0.5, float("nan"), 2.5, 3.5])
    assert record.time.tolist() == [0.0, 2.0, 3.0]
    assert record.values.tolist() == [0.5, 2.5, 3.5]


@pytest.mark.parametrize(
    ("time", "displacement", "message"),
    [
        ([0, 1, 2], [0, 1], "values: has 2 values for 3 times"),
        ([0.0], [0.0], "time: needs at least 2 samples, got 1"),
        ([0, 1, 1], [0, 1, 2], r"time: must increase, but sample 3 \(1 s\) follows 1 s"),
        ([0, 1, 2], [0, float("inf"), 2], "values: must be finite; sample 2 is inf"),
        ([0, 1, float("inf")], [0, 1, 2], "time: must be finite; sample 3 is inf"),
        ([[0, 1], [2, 3]], [0, 1], r"time: must be a vector, got an array of shape \(2, 2\)"),
        ([0, 1], [0, 1j], "values: must be numbers"),
        ([0, [1, 2]], [0, 1], "time: must be numbers"),
        ([0, 1], None, "values: must be a vector"),
    ],
)
def test_unusable_arrays_are_refused(time, displacement, message):
    with pytest.raises(InputError, match=message):
        Measurement(time, displacement)


def swing(time, frequency):
    return np.cos(2 * np.pi * frequency * time + 0.7)


class TestProcessing:
    def test_a_cut_keeps_the_samples_within_and_the_sensor(self):
        sensor = Sensor("velocity", point=0.2)
        record = Measurement(np.arange(10) / 10, np.arange(10.0), "ten", sensor)
        part = record.cut(0.2, 0.5)
        assert part.time.tolist() == [0.2, 0.3, 0.4, 0.5]
        assert part.values.tolist() == [2.0, 3.0, 4.0, 5.0]
        assert (part.name, part.sensor) == ("ten", sensor)
        assert record.cut(end=0.35).values.tolist() == [0.0, 1.0, 2.0, 3.0]
        with pytest.raises(InputError, match=r"cut: from 0\.21 to 0\.22 s there are 0 samples"):
            record.cut(0.21, 0.22)

    @pytest.mark.parametrize("factor", [2, 5, 20])
    def test_decimation_keeps_low_frequencies_without_phase_shift_and_removes_those_that_would_alias(self, factor):
        time = 3.0 + np.arange(20_000) / 1000.0
        new_rate = 1000.0 / factor
        kept, alias = 0.39 * new_rate, 0.62 * new_rate
        record = Measurement(time, 0.2 + swing(time, kept) + swing(time, alias)).decimated(factor)
        np.testing.assert_array_equal(record.time, time[::factor][13:-13])
        np.testing.assert_allclose(record.values, 0.2 + swing(record.time, kept), atol=4e-4)

    def test_decimation_invents_nothing_at_the_ends(self):
        time = np.arange(5000) / 1000.0
        motion = np.exp(-0.3 * time) * swing(time, 2.0)
        np.testing.assert_allclose(Measurement(time, motion).decimated(10).values, motion[::10][13:-13], atol=1e-4)
        assert Measurement(time[:120], motion[:120]).decimated(4).time.size == 4

    @pytest.mark.parametrize(("low", "high"), [(None, 12.0), (4.0, None), (4.0, 12.0), (4.0, 95.0)])
    def test_a_band_is_kept_without_phase_shift_and_nothing_else(self, low, high):
        time = 3.0 + np.arange(4000) / 200.0
        outside = (swing(time, 1.9) if low else 0.0) + (swing(time, 19.0) if high == 12.0 else 0.0)
        kept = Measurement(time, swing(time, 7.0) + outside, "a", Sensor("velocity")).filtered(low, high)
        np.testing.assert_allclose(kept.values, swing(kept.time, 7.0), atol=5e-4)
        lost = sum(5.0 / limit for limit in (low, high) if limit)
        assert kept.time[0] - 3.0 == pytest.approx(lost, rel=0.1) or high == 95.0
        assert (kept.name, kept.sensor.quantity) == ("a", "velocity")

    @pytest.mark.parametrize(
        ("low", "high", "message"),
        [
            (None, None, "give low, high or both"), (5.0, 4.0, "in order and below half the rate, 100 Hz"),
            (None, 100.0, "below half the rate, 100 Hz"), (-1.0, None, "band: must be positive"),
            (0.4, None, "the record is shorter than the filter"),
        ],
    )  # fmt: skip
    def test_a_band_that_cannot_be_kept_is_refused(self, low, high, message):
        time = np.arange(4000) / 200.0
        with pytest.raises(InputError, match=message):
            Measurement(time, time).filtered(low, high)

    def test_the_spectrum_reads_the_amplitudes_of_sines(self):
        time = np.arange(4000) / 200.0
        f, amplitudes = Measurement(time, 1.0 + 0.3 * swing(time, 7.0) + 0.02 * swing(time, 21.0)).spectrum()
        assert amplitudes[np.argmin(np.abs(f - 7.0))] == pytest.approx(0.3, rel=1e-3)
        assert amplitudes[np.argmin(np.abs(f - 21.0))] == pytest.approx(0.02, rel=1e-2)
        assert f[-1] == pytest.approx(100.0)
        with pytest.raises(InputError, match="is not evenly spaced"):
            Measurement(np.delete(time, 7), np.delete(time, 7)).spectrum()

    def test_decimation_of_uneven_samples_is_refused_with_the_remedy(self):
        time = np.delete(np.arange(1000) / 100, [500, 501])
        for record, factor, message in (
            (Measurement(time, time), 4, "after 4.99 s the step is 0.03 s instead of 0.01 s"),
            (Measurement(time[:50], time[:50]), 4, "factor: 50 samples are too few"),
            (Measurement(time, time), 0, "factor: must be a whole number"),
        ):
            with pytest.raises(InputError, match=message):
                record.decimated(factor)

    def test_a_straight_line_is_removed(self):
        time = np.array([0.0, 0.1, 0.5, 0.6, 1.3])
        np.testing.assert_allclose(Measurement(time, 3.0 - 2.0 * time).detrended().values, 0.0, atol=1e-15)

    def test_the_figure_shows_every_sample_in_the_unit_of_the_sensor(self):
        record = Measurement([0.0, 1.0, 2.0], [4.0, 5.0, 3.0], "three", Sensor("acceleration"))
        (axes,) = record.figure().axes
        assert axes.lines[0].get_ydata().tolist() == [4.0, 5.0, 3.0]
        assert (axes.get_ylabel(), axes.get_title()) == ("acceleration, m/s^2", "three")
