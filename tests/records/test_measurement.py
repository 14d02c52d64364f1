"""Measured records: accepted input, and refusals that name the place of the error."""

import numpy as np
import pytest

from ancf_casadi.exceptions import InputError
from ancf_casadi.records import measurement
from ancf_casadi.records.measurement import Measurement


@pytest.fixture
def csv(tmp_path):
    """Write a CSV file and return its path."""

    def write(text):
        path = tmp_path / "record.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


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


@pytest.mark.parametrize(
    "text",
    [
        "0.0,1.5\n0.1,-2\n",
        "time_s,tip_m\n0.0,1.5\n0.1,-2\n",
        "\ufefftime_s,tip_m\r\n0.0,1.5\r\n\r\n0.1,-2",
        "t,x\n 0.0 , 1.5\n1e-1, -2.0\n",
        "time_ms,tip_mm\n0,1500\n100,-2000\n",
    ],
)
def test_two_columns_are_read_with_or_without_names_and_units(csv, text):
    record = Measurement.from_csv(csv(text))
    np.testing.assert_allclose(record.time, [0.0, 0.1])
    np.testing.assert_allclose(record.values, [1.5, -2.0])
    assert record.name == "record.csv"


def test_a_column_is_chosen_by_name_and_the_others_need_not_be_numbers(csv):
    path = csv("time_s,marker,x_m,y_mm\n0,a,1,2\n1,b,3,4\n")
    np.testing.assert_allclose(Measurement.from_csv(path, "x_m").values, [1.0, 3.0])
    np.testing.assert_allclose(Measurement.from_csv(path, "y_mm").values, [2e-3, 4e-3])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "record.csv: has no rows"),
        ("\n\n", "record.csv: has no rows"),
        ("time_s,tip_m\n", "record.csv: has no rows below its header"),
        ("t,x\n0,1\n1,two\n", "record.csv, line 3: 'two' is not a finite number"),
        ("0,1\n\n1,two\n", "record.csv, line 3: 'two' is not a finite number"),
        ("0,1\n1,nan\n", "record.csv, line 2: 'nan' is not a finite number"),
        ("0,1\n1,\n", "record.csv, line 2: '' is not a finite number"),
        ("0,1\n1,inf\n", "record.csv, line 2: 'inf' is not a finite number"),
        ("0,1\n1,2,3\n", "record.csv, line 2: has 3 columns where the first line has 2"),
        ("0,1\n1\n", "record.csv, line 2: has 1 columns where the first line has 2"),
        (
            "0,1,2\n1,2,3\n",
            "record.csv: has 3 columns; needs a time and a displacement, or the name of the displacement",
        ),
        ("0\n1\n", "record.csv: has 1 columns; needs a time and a displacement"),
        ("Dear reader,\nthis is a letter\n", "record.csv, line 2: has 1 columns where the first line has 2"),
        ("0,1\n", "record.csv: time: needs at least 2 samples"),
        ("0,1\n2,1\n1,1\n", "record.csv: time: must increase, but sample 3"),
        (bytes(range(256)) * 4, "record.csv: is not a CSV file"),
        (b"\x00" * 200_000, "record.csv: is not a CSV file"),
    ],
)
def test_unusable_files_are_refused_with_their_line(csv, text, message):
    with pytest.raises(InputError, match=message) as caught:
        Measurement.from_csv(csv(text))
    assert len(str(caught.value)) < 400
    assert caught.value.__suppress_context__ or caught.value.__context__ is None


def test_a_column_that_is_not_there_is_refused_with_those_that_are(csv):
    path = csv("time_s,x_m,y_m\n0,1,2\n1,3,4\n")
    with pytest.raises(InputError, match="has 0 displacement columns named 'z_m'; there are x_m, y_m"):
        Measurement.from_csv(path, "z_m")
    with pytest.raises(InputError, match="has 0 displacement columns named 'time_s'; there are x_m, y_m"):
        Measurement.from_csv(path, "time_s")


def test_a_path_that_is_no_file_is_refused(tmp_path):
    for path in (tmp_path, tmp_path / "missing.csv"):
        with pytest.raises(InputError, match="is not a file"):
            Measurement.from_csv(path)


def test_a_file_too_large_is_refused_before_it_is_read(tmp_path):
    path = tmp_path / "huge.csv"
    with open(path, "wb") as file:
        file.truncate(2**31)  # sparse: takes no space
    with pytest.raises(InputError, match=r"huge.csv: is larger than 1024 MB"):
        Measurement.from_csv(path)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize(
    "text",
    [
        "time_ms,x_mm\n0,1.5\n 1 ,-2e-3\n2,.5\n",
        "\ufefft,x\n\n0,1\n   \n1,2\n\n",
        "0,1\n1,2",
        't,"x\n(m)"\n0,1\n1,2\n',
        't,x\n"0",1\n1,2\n',
        "t,x\n0,1\n , \n1,2\n",
        "t,x\n0,1_0\n1,2\n",
        "t,x\n0,1\n1,2,3\n",
        "t,x\n0,1,2\n1,2,3\n",
        "t,x\n0,1\n1,nan\n",
        "t,x\n0,1\n1,1e999\n",
        "t,x\n0,1\n1\n",
        "t,x\n0,1\n1,\x1c2\n",
        "t,x\n0,1\n1,a\n",
        "0,inf\n0,1\n1,a\n",
        "t,x\n\n",
    ],
)
def test_blocks_and_rows_give_the_same_record_or_message(csv, monkeypatch, text, end):
    def read():
        try:
            record = Measurement.from_csv(path)
        except InputError as error:
            return str(error)
        return record.time.tolist(), record.values.tolist()

    path = csv(text.replace("\n", end))
    found = read()
    monkeypatch.setattr(measurement, "_plain_numbers", lambda *_: None)
    assert read() == found


def test_plain_numbers_are_read_in_blocks(csv, monkeypatch, capsys):
    """A row by itself takes about ten times as long."""
    monkeypatch.setattr(measurement, "_pair", None)
    monkeypatch.setattr(measurement, "BLOCK", 10)
    record = Measurement.from_csv(csv("t,x,y\n" + "".join(f"{k},{k / 7!r},1\n" for k in range(95))), "x", progress=True)
    assert record.values.tolist() == [k / 7 for k in range(95)]
    assert capsys.readouterr().err == ""
