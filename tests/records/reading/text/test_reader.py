"""Tables in text: right numbers, or a refusal that names the line."""

import numpy as np
import pytest

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.reading.text import reader
from ancf_casadi.records.recording import read_recording


@pytest.fixture
def csv(tmp_path):
    """Write a file and return its path."""

    def write(text):
        path = tmp_path / "record.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


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
    record = Measurement.from_file(csv(text))
    np.testing.assert_allclose(record.time, [0.0, 0.1])
    np.testing.assert_allclose(record.values, [1.5, -2.0])
    assert record.name == "record.csv"


def test_a_column_is_chosen_by_name_or_number_and_the_others_need_not_be_numbers(csv):
    path = csv("time_s,marker,x_m,y_mm\n0,a,1,2\n1,b,3,4\n")
    for column in ("x_m", "X_M", 3, "3"):
        np.testing.assert_allclose(Measurement.from_file(path, column).values, [1.0, 3.0])
    np.testing.assert_allclose(Measurement.from_file(path, "y_mm").values, [2e-3, 4e-3])
    with pytest.raises(InputError, match="column 2 'marker': has words, such as 'a' in line 2, not numbers"):
        Measurement.from_file(path, "marker")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "record.csv: is empty"),
        ("\n\n", "record.csv: has no rows of numbers"),
        ("time_s,tip_m\n", "record.csv: has no rows of numbers"),
        ("t,x\n0,1\n1,two\n2,3\n", "record.csv: column 2 'x': line 3: 'two' is not a finite number"),
        ("0,1\n\n1,1e999\n2,1\n", "record.csv: column 2 'column 2': line 3: '1e999' is not a finite number"),
        ("0,1\n1,2,3\n2,3\n", "record.csv, line 2: has 3 columns where the table has 2; complete or remove the line"),
        ("0,1\n1\n", "record.csv, line 2: has 1 column where the table has 2"),
        ("Dear reader,\nthis is a letter\n", "record.csv: has no rows of numbers"),
        ("t,x\n0,1\n", "record.csv: column 2 'x': time: needs at least 2 samples"),
        (bytes(range(256)) * 4, "record.csv: is not text"),
    ],
)
def test_unusable_files_are_refused_with_their_line(csv, text, message):
    with pytest.raises(InputError, match=message) as caught:
        Measurement.from_file(csv(text))
    assert len(str(caught.value)) < 400
    assert caught.value.__suppress_context__ or caught.value.__context__ is None


def test_a_column_that_is_not_there_is_refused_with_those_that_are(csv):
    path = csv("time_s,x_m,y_m\n0,1,2\n1,3,4\n")
    with pytest.raises(InputError, match="--column 'z_m': there is no such column; there are 2 'x_m', 3 'y_m'"):
        Measurement.from_file(path, "z_m")
    with pytest.raises(InputError, match="--time 7: there is no such column; there are 1 'time_s', 2 'x_m', 3 'y_m'"):
        Measurement.from_file(path, "x_m", time=7)


def test_a_path_that_is_no_file_is_refused(tmp_path):
    for path in (tmp_path, tmp_path / "missing.csv"):
        with pytest.raises(InputError, match=r"cannot be read \((Is a|No such file or) directory\)"):
            Measurement.from_file(path)


def test_a_file_too_large_is_refused_before_it_is_read(tmp_path):
    path = tmp_path / "huge.csv"
    with open(path, "wb") as file:
        file.truncate(2**31)  # sparse: takes no space
    with pytest.raises(InputError, match=r"huge.csv: is larger than 1024 MiB"):
        Measurement.from_file(path)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize(
    "text",
    [
        "time_ms,x_mm\n0,1.5\n 1 ,-2e-3\n2,.5\n",
        "\ufefft,x\n\n0,1\n   \n1,2\n\n",
        "t,x\n0,1\n1,2",
        't,"x\n(m)"\n0,1\n1,2\n',
        't,x\n"0",1\n1,2\n',
        "t,x\n0,1\n , \n1,2\n",
        "t,x\n0,1\n3,\n5,2\n",
        "t;x\n0,5;1\n3;\n5;2,25\n",
        "t\tx\ty\n0,5\t1\t\n3\t\t\n5\t2,25\t\n",
        "t x\n0.5 1\n3   nan\n5 \t 2.25\n",
        "t x\n1 2\n   ",
        "t,x\n0,1_0\n1,2\n",
        "t,x\n0,1\n1,2,3\n",
        "t,x\n0,1,2\n1,2,3\n",
        "t,x\n0,1\n1,nan\n2,5\n",
        "t,x\n0,1\n1,1e999\n2,3\n",
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
            record = Measurement.from_file(path)
        except InputError as error:
            return str(error)
        return record.time.tolist(), record.values.tolist()

    path = csv(text.replace("\n", end))
    found = read()
    monkeypatch.setattr(reader._Reader, "_plain", lambda *_: None)
    assert read() == found


@pytest.mark.parametrize("end", ["END\n", "END", "\nOVL;OVL\n\n", "-- end of record --\nTest finished\n", "END;;\n"])
@pytest.mark.parametrize("comma", [",", "."])
def test_words_at_the_end_are_left_out_with_a_note(tmp_path, end, comma):
    path = tmp_path / "a.csv"
    rows = "".join(f"{0.1 * k:.1f};{k:.2f}\n" for k in range(20)).replace(".", comma)
    path.write_text("t_s;x_mm\n" + rows + end)
    recording = read_recording(path)
    assert recording.channel().values.tolist() == [float(k) for k in range(20)]
    (note,) = recording.notes
    first = end.strip().splitlines()[0]
    assert note == f"line {22 + end.startswith(chr(10))}, {first!r}, and the lines below: not numbers, left out"


@pytest.mark.parametrize(
    ("first", "delimiter"),
    [("0;;", ";"), ("0\t\t", "\t"), ("0;0;", ";"), ("-1;;2", ";")],
    ids=["gaps", "tabs", "one gap", "negative"],
)
def test_a_first_row_of_whole_numbers_and_gaps_does_not_hide_decimal_commas(tmp_path, first, delimiter):
    path = tmp_path / "a.csv"
    rows = [delimiter.join((f"{0.1 * k:.1f}", f"{k / 8:.3f}", f"{-k / 8:.3f}")) for k in range(1, 20)]
    head = delimiter.join(("t (s)", "x (m)", "y (m)"))
    path.write_text("\n".join([head, first, *(row.replace(".", ",") for row in rows)]) + "\n")
    recording = read_recording(path)
    assert recording.channels[-1].values.tolist()[-19:] == [-k / 8 for k in range(1, 20)]


def test_words_in_the_middle_and_below_a_single_column(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("t_s;x_mm\n0;1\n1;2\nOVL\n2;3\n3;3\n")
    with pytest.raises(InputError, match="line 4: has 1 column where the table has 2"):
        read_recording(path)
    path.write_text("x_mm\n0\n1\n2\n3\nEND\n")
    assert read_recording(path, sample_rate=10.0).channel().values.tolist() == [0.0, 1.0, 2.0, 3.0]


@pytest.mark.parametrize("name", ["vx", "angle", "acc", "phase", "Rotation X"])
def test_a_unit_of_the_file_counts_only_for_columns_whose_names_denote_no_other_quantity(csv, name):
    path = csv(f"Length units: mm\ntime,x,{name}\n0,1,2\n0.1,2,3\n0.2,3,4\n")
    assert Measurement.from_file(path, "x").values.tolist() == [1e-3, 2e-3, 3e-3]
    with pytest.raises(InputError, match=r"Length units: mm.* --unit"):
        Measurement.from_file(path, name)


def test_a_unit_of_the_file_counts_for_all_columns_if_the_step_is_stated(csv):
    path = csv("Horizontal Units,S\nSample Interval,0.01\nVertical Units,V,V\nCH1,CH2\n1,2\n3,4\n5,6\n")  # of Tektronix
    record = Measurement.from_file(path, "CH2")
    assert (record.values.tolist(), record.sensor.unit) == ([2.0, 4.0, 6.0], "V")
    np.testing.assert_allclose(record.time, [0.0, 0.01, 0.02])
