"""Measured records: accepted input, and refusals."""

import numpy as np
import pytest

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement


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
        ([], [], "time: needs at least 2 samples, got 0"),
        ([0, 1, 1], [0, 1, 2], r"time: must increase, but sample 3 \(1 s\) follows 1 s"),
        ([0, 2, 1], [0, 1, 2], r"time: must increase, but sample 3 \(1 s\) follows 2 s"),
        ([0, 1, 2], [0, float("inf"), 2], "values: must be finite; sample 2 is inf"),
        ([0, 1, float("inf")], [0, 1, 2], "time: must be finite; sample 3 is inf"),
        ([[0, 1], [2, 3]], [0, 1], r"time: must be a vector, got an array of shape \(2, 2\)"),
        (3.0, [0, 1], r"time: must be a vector, got an array of shape \(\)"),
        ([0, 1], ["a", "b"], "values: must be a vector of numbers"),
        ([0, 1], [0, 1j], "values: must be a vector of numbers"),
        ([0, [1, 2]], [0, 1], "time: must be a vector of numbers"),
        ([0, 1], None, "values: must be a vector"),
    ],
)
def test_unusable_arrays_are_refused(time, displacement, message):
    with pytest.raises(InputError, match=message):
        Measurement(time, displacement)
