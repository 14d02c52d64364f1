"""One decay of 4 Hz and 1 % in the styles of instruments and programs: read at once, or after the option named."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from ancf_casadi import Measurement, TableLayout
from ancf_casadi.exceptions import InputError
from problems import fit_decay
from problems.cli import main

EXPORTS = Path(__file__).parents[4] / "shared" / "data" / "exports"
TIME = np.arange(600) / 500.0
OMEGA = 2.0 * np.pi * 4.0
DECAY = np.exp(-0.01 * OMEGA * TIME) * np.cos(np.sqrt(1.0 - 1e-4) * OMEGA * TIME)
DECAY = DECAY + 0.002 * np.random.default_rng(5).normal(size=600)
COUNTS = np.arange(600)


def rows(form, *columns):
    return "".join(form.format(*cells) + "\n" for cells in zip(*columns, strict=True))


def seconds_and_fractions(digits):
    return np.floor(TIME), np.round((TIME % 1.0) * 10**digits).astype(int)


STYLES = {  # text of the file, options that the message names, and unit of the values
    "scope, start and increment": (
        "X,CH1,Start,Increment,\nSequence,Volt,0.0e+00,2.0e-03\n" + rows("{},{:.6e},,", COUNTS, DECAY), {}, "V",
    ),
    "scope, units in a row": ("x-axis,2\nsecond,Volt\n" + rows("{:.4f},{:.6f}", TIME, DECAY), {}, "V"),
    "scope, units and interval in metadata": (
        "Record Length,600\nSample Interval,2.0E-03\nVertical Units,V\nHorizontal Units,s\nSource,CH1\nSecond,Value\n"
        + rows("{:.4f},{:.6f}", TIME, DECAY), {}, "V",
    ),
    "scope, infinities beyond the range": (
        "Time,Channel A\n(ms),(mV)\n\n"
        + rows("{:.1f},{}", 1e3 * TIME, ["∞" if y > 0.97 else "-∞" if y < -0.96 else f"{1e3 * y:.4f}" for y in DECAY]),
        {}, "V",
    ),
    "sound editor, rate in a sentence": (
        "Sample Rate: 500 Hz. Values on a linear scale.\nLength processed: 600 samples 1.2 seconds.\n\n"
        + rows("{:.6f}", DECAY), {}, "m",
    ),
    "waveform file, rate by hand": ("Untitled,0,2.0E-3\n" + rows("{:.6f}", DECAY), {"sample_rate": 500.0}, "m"),
    "microcontroller, microseconds": ("micros,acc\n" + rows("{},{:.6f}", 2000 * COUNTS, DECAY), {}, "m/s^2"),
    "microcontroller, milliseconds": ("millis,raw\n" + rows("{},{:.6f}", 2 * COUNTS, DECAY), {}, "m"),
    "phone, nanoseconds": (
        "timestamp,ax\n" + rows("{},{:.6f}", 1_700_000_000_000_000_000 + 2_000_000 * COUNTS, DECAY),
        {"time_unit": "ns"}, "m/s^2",
    ),
    "logger, seconds and microseconds": (
        "sec,usec,strain\n" + rows("{:.0f},{},{:.6f}", *seconds_and_fractions(6), DECAY), {}, "",
    ),
    "logger, epoch and milliseconds": (
        "epoch,ms,x\n" + rows("{:.0f},{},{:.6f}", 1.7e9 + np.floor(TIME), seconds_and_fractions(3)[1], DECAY), {}, "m",
    ),
    "logger, overload words and counts": (
        "Sampling frequency: 500\nReading [counts]\n" + rows("{:.4f}", 1e3 * DECAY), {}, "count",
    ),
    "tracker, pixels": ("t (s),tip_px\n" + rows("{:.4f},{:.4f}", TIME, 200.0 * DECAY), {}, "px"),
    "motion capture, markers, axes and units": (
        "Trajectories\n500\n,,rig:tip,,,rig:base,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z\n,,mm,mm,mm,mm,mm,mm\n"
        + rows("{},0,{:.5f},1.0,2.0,0.5,0.25,0.125", COUNTS + 1, DECAY),
        {"column": "rig:tip X"}, "m",
    ),
    "motion capture, names above axes": (
        "PathFileType\t4\t(X/Y/Z)\ttip.trc\nDataRate\tCameraRate\tNumFrames\tUnits\n500\t500\t600\tmm\n"
        "Frame#\tTime\ttip\t\t\n\t\tX1\tY1\tZ1\n\n" + rows("{}\t{:.4f}\t{:.5f}\t1.5\t2.5", COUNTS + 1, TIME, DECAY),
        {"column": "tip X1"}, "m",
    ),
    "motion capture, rate in the header": (
        "NO_OF_FRAMES\t600\nFREQUENCY\t500\nMARKER_NAMES\ttip\n" + rows("{:.5f}\t1.5\t2.5", DECAY), {"column": 1}, "m",
    ),
    "a calibration row above the numbers": (
        "time_s,x_mm,y_mm\n0.1,2.0\n" + rows("{:.4f},{:.5f},{:.5f}", TIME, DECAY, 3.0 * DECAY),
        {"skip_rows": (2,), "column": "x_mm"}, "m",
    ),
    "rows of numbers above and below the names": (
        "1,2,3\ntime_s,x_mm,y_mm\n9,9,9\n" + rows("{:.4f},{:.5f},{:.5f}", TIME, DECAY, 3.0 * DECAY),
        {"names_row": 2, "skip_rows": (3,), "leave_out": ("y_mm",)}, "m",
    ),
}  # fmt: skip
LAYOUT = ("names_row", "skip_rows", "leave_out")


def read(path, options):
    layout = TableLayout(**{key: options[key] for key in LAYOUT if key in options})
    others = {key: value for key, value in options.items() if key not in LAYOUT}
    return Measurement.from_file(path, layout=layout, **others)


def check(fit):
    assert fit.frequency == pytest.approx(4.0, abs=4.0 * fit.standard_errors["frequency"])
    assert fit.frequency == pytest.approx(4.0, abs=1e-3)
    assert fit.damping_ratio == pytest.approx(0.01, abs=4.0 * fit.standard_errors["damping_ratio"])
    assert fit.damping_ratio == pytest.approx(0.01, abs=1e-4)


@pytest.mark.parametrize("style", STYLES)
def test_a_style_is_read_and_fitted(tmp_path, style):
    text, options, unit = STYLES[style]
    path = tmp_path / "record.csv"
    path.write_text(text)
    record = read(path, options)
    assert record.sensor.unit == unit
    check(fit_decay(record))


@pytest.mark.parametrize("style", [style for style, (_, options, _) in STYLES.items() if "names_row" not in options])
def test_a_message_names_each_option_that_is_needed(tmp_path, style):
    text, options, _ = STYLES[style]
    path = tmp_path / "record.csv"
    path.write_text(text)
    used = {}
    for _ in options:
        with pytest.raises(InputError) as caught:
            read(path, used)
        named = {key for key in options.keys() - used if f"--{key.replace('_', '-')}" in str(caught.value)}
        assert named, str(caught.value)
        used |= {key: options[key] for key in named}
    read(path, used)


ONE_OPTION = {
    "arduino_plain.txt": {"column": "x"}, "arduino_serial.log": {"column": 4}, "labquest.csv": {"column": 2},
    "ni_express.csv": {"sample_rate": 500.0}, "rigol_two.csv": {"column": "CH1"}, "tracker.txt": {"column": "x"},
    "dltdv_xypts.csv": {"sample_rate": 500.0, "column": 1},
}  # fmt: skip
EXPORT_FILES = (
    "arduino_plain.txt arduino_serial.log audacity.txt catman.txt dewesoft.txt digilent.csv dltdv_xypts.csv "
    "keysight.csv labquest.csv lecroy.csv lms_testlab.txt ni_express.csv pico.csv pico_inf.csv rigol_ds1000z.csv "
    "rigol_mso5000.csv rigol_two.csv scipy_comment.txt siglent.csv sound.wav tek_tds.csv tracker.txt"
).split()


@pytest.mark.skipif(not EXPORTS.is_dir(), reason="needs ../shared")
@pytest.mark.parametrize("name", EXPORT_FILES)
def test_an_export_is_read_and_fitted(name):
    fit = fit_decay(read(EXPORTS / name, ONE_OPTION.get(name, {})))
    assert fit.frequency == pytest.approx(4.0, abs=1e-3)
    assert fit.damping_ratio == pytest.approx(0.01, abs=1e-4)


def test_a_signal_says_what_cannot_be_told_and_no_beam_reads_it(tmp_path):
    path = tmp_path / "record.csv"
    path.write_text("t_s,laser (V)\n" + rows("{:.4f},{:.5f}", TIME, DECAY))
    fit = fit_decay(Measurement.from_file(path), law="quadratic")
    assert fit.units["eta2"] == "1/V"
    assert any("in V, without a scale: sizes hold for this sensor only" in note for note in fit.warnings)
    assert Measurement.from_file(path, unit="0.25 mm").sensor.unit == "m"


@pytest.mark.parametrize(
    ("name", "quantity"),
    [("Acc", "acceleration"), ("accel_z", "acceleration"), ("strain 1", "strain"), ("v_tip", "displacement"),
     ("Force", "force"), ("Velocity", "velocity")],
)  # fmt: skip
def test_the_name_of_a_column_without_a_unit_tells_its_quantity(tmp_path, name, quantity):
    path = tmp_path / "record.csv"
    path.write_text(f"time_s,{name}\n" + rows("{:.4f},{:.5f}", TIME, DECAY))
    assert Measurement.from_file(path).sensor.quantity == quantity


@pytest.mark.parametrize(("form", "advised"), [("split", False), ("repeated", False), ("unsorted", True)])
def test_sorting_is_advised_only_where_it_keeps_the_record(tmp_path, form, advised):
    fractions = np.round(TIME % 0.25, 4)  # a time that starts anew
    times = {"split": fractions, "repeated": np.round(TIME, 1), "unsorted": np.roll(TIME, 5)}[form]
    path = tmp_path / "record.csv"
    path.write_text("time_s,x_mm\n" + rows("{:.4f},{:.5f}", times, DECAY))
    with pytest.raises(InputError) as caught:
        Measurement.from_file(path)
    assert bool(re.search("sort the rows", str(caught.value))) == advised


@pytest.mark.parametrize(("name", "unit"), [("t", "ms"), ("time", "us"), ("Zeit", "ms"), ("x_value", "us")])
def test_times_that_are_implausible_in_seconds_are_asked_for(tmp_path, name, unit):
    path = tmp_path / "record.csv"
    path.write_text(f"{name},y_mm\n" + rows("{:.0f},{:.5f}", TIME * {"ms": 1e3, "us": 1e6}[unit], DECAY))
    with pytest.raises(InputError, match=r"has no unit, and steps of .* s are long for a vibration; .*--time-unit"):
        Measurement.from_file(path)
    check(fit_decay(Measurement.from_file(path, time_unit=unit)))


@pytest.mark.parametrize(
    "words",
    [["--names-row", "2", "--skip-rows", "3", "--leave-out", "y_mm"], ["--skip-rows", "1,3-3", "--leave-out", "3"],
     ["--skip-rows", "1-1,3", "--column", "x_mm"]],
    ids=["names", "rows", "column"],
)  # fmt: skip
def test_options_name_rows_and_columns(tmp_path, capsys, words):
    path = tmp_path / "record.csv"
    path.write_text(STYLES["rows of numbers above and below the names"][0])
    assert main(["fit-decay", str(path), *words, "--json"]) == 0
    fit = json.loads(capsys.readouterr().out)
    assert fit["frequency_hz"] == pytest.approx(4.0, abs=1e-3)
    assert fit["damping_ratio"] == pytest.approx(0.01, abs=1e-4)
    assert main(["inspect", str(path), *words]) == 0
    assert f"Next: ancf-casadi fit-decay {path} " in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("text", ["0", "5-3", "a", "1-999999999", "1,,2"])
def test_lines_that_are_none_are_refused(tmp_path, capsys, text):
    with pytest.raises(SystemExit):
        main(["fit-decay", "record.csv", "--skip-rows", text])
    assert "--skip-rows: must be lines such as 1-5,17" in capsys.readouterr().err
