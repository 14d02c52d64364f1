"""The time to read text grows as its size, whatever the text is."""

import time

import pytest

from ancf_casadi.exceptions import AncfError, InputError
from ancf_casadi.records.recording import read_recording

SIZES = (4_000, 32_000)  # characters; eight times as many may take twice eight times as long
CELLS = {
    "blanks": lambda n: "x" + " " * n + "y",
    "points": lambda n: "." * n,
    "lines": lambda n: "frame" + "_" * n + "q",
    "blanks and lines": lambda n: " _" * (n // 2) + "y",
    "likelihoods": lambda n: "x" + " _." * (n // 3) + "scor",
    "brackets": lambda n: "(" * n,
    "units": lambda n: "_mm" * (n // 3),
    "words": lambda n: " in" * (n // 3) + " ",
    "digits": lambda n: "1" * n,
    "digits and a letter": lambda n: "1" * n + "x",
    "decimals": lambda n: "0." + "9" * n,
    "thousands": lambda n: "1,111" * (n // 5),
    "exponent": lambda n: "1e" + "9" * n,
    "clock": lambda n: "1:" * (n // 2),
    "quotes": lambda n: '"' * n,
    "comments": lambda n: "#" * n,
}
ROWS = "".join(f"{k / 100};{k % 7}\n" for k in range(30))


def texts(cell):
    return {
        "name": f"t;{cell}\n{ROWS}",
        "name between blanks": f"t {cell}\n{ROWS}".replace(";", " "),
        "metadata": f"{cell}\nt;x\n{ROWS}",
        "unit": f"t;x\ns;{cell}\n{ROWS}",
        "value": f"t;x\n{ROWS}0.5;{cell}\n",
        "time": f"t;x\n{ROWS}{cell};3\n",
    }


def duration(path, text):
    """Processor time to read a file."""
    path.write_text(text)
    begin = time.process_time()
    try:
        read_recording(path)
    except AncfError as error:
        assert len(str(error)) < 1000
    return time.process_time() - begin


@pytest.mark.parametrize("cell", CELLS)
def test_the_time_grows_as_the_size(tmp_path, cell):
    small, large = (texts(CELLS[cell](size)) for size in SIZES)
    for place, text in small.items():  # three trials, because other work disturbs one
        before = min(duration(tmp_path / "a.csv", text) for _ in range(2))
        assert any(duration(tmp_path / "a.csv", large[place]) < 16 * before + 0.01 for _ in range(3)), place


@pytest.mark.parametrize(
    ("head", "options", "step", "note"),
    [
        ("Sample rate: 2000 Hz\ntime,x_mm", {}, None, ""),
        ("Sample rate: 2000 Hz\ntime,x_mm", {"time_unit": "ms"}, 5e-4, ""),
        ("Sample rate: 2.01 Hz\ntime,x_mm", {}, 0.5, ""),
        ("Sample rate: 7 Hz\ntime,x_mm", {}, 0.5, "column 1 'time' has another step than the rate of 7 1/s"),
        ("Sample rate: 2000 Hz\ntime (s),x_mm", {}, 0.5, "has another step"),
        ("time (s),x_mm", {"sample_rate": 50.0}, 0.02, "column 1 'time (s)' has other times, and does not count"),
        ("time (s),x_mm", {"sample_rate": 2.01}, 1 / 2.01, ""),
    ],
)
def test_a_stated_rate_that_contradicts_the_times_is_told_or_asked_about(tmp_path, head, options, step, note):
    path = tmp_path / "a.csv"
    path.write_text(head + "\n" + "".join(f"{0.5 * k},{k % 3}\n" for k in range(40)))
    if step is None:
        with pytest.raises(InputError, match=r"column 1 'time': .*--time-unit"):
            read_recording(path, **options)
    else:
        recording = read_recording(path, **options)
        assert recording.time[1] == pytest.approx(step)
        told = [text for text in recording.notes if "another step" in text or "other times" in text]
        assert len(told) == bool(note) and all(note in text for text in told)


@pytest.mark.parametrize("missing", [False, True])
def test_frames_never_count_as_seconds(tmp_path, missing):
    path = tmp_path / "a.csv"
    path.write_text("frame,x_mm\n" + "".join(f"{'' if missing and k == 7 else k},{k % 3}\n" for k in range(40)))
    for column in (None, "frame"):
        with pytest.raises(InputError, match="--sample-rate"):
            read_recording(path, time=column)
    found = read_recording(path, sample_rate=10.0)
    assert found.time.tolist() == pytest.approx([0.1 * k for k in range(40) if not (missing and k == 7)])
    assert read_recording(path, time="frame", time_unit="ms").time[1] == pytest.approx(1e-3)  # as the user says
