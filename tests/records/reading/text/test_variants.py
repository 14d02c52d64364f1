"""One measured decay as many programs and people would write it: read correctly, or refused with the remedy.

The truth is the same for all: 200 samples at 100 1/s, displacements of millimetres.
"""

from datetime import datetime, timedelta

import numpy as np
import pytest

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.reading.text.header import sampling_step

TIME = np.arange(200) / 100.0
MM = 7.5 * np.exp(-0.4 * TIME) * np.cos(2 * np.pi * 3.0 * TIME)
START = datetime(2024, 5, 17, 23, 59, 59, 500_000)  # the record runs over midnight


def table(head="", separator=",", decimal=".", time=TIME, values=MM, form="{:.4f}{}{:.6f}", end="\n", tail=""):
    rows = [
        form.format(t, "|", y).replace(".", decimal).replace("|", separator) for t, y in zip(time, values, strict=True)
    ]
    return head.replace("\n", end) + end.join(rows) + end + tail


def stamped(form, head="time,x_mm\n", separator=","):
    stamps = [START + timedelta(seconds=float(t)) for t in TIME]
    return head + "".join(f"{stamp.strftime(form)}{separator}{y:.6f}\n" for stamp, y in zip(stamps, MM, strict=True))


def lines(row, head=""):
    return head + "".join(row(k, t, y) + "\n" for k, (t, y) in enumerate(zip(TIME.tolist(), MM.tolist(), strict=True)))


SI = 1e-3 * MM
READ = {
    "seconds and metres without a header": (table(values=SI), {}),
    "names without units": (table("time,x\n", values=SI), {}),
    "units in round and square brackets": (table("Time (ms),Disp [mm]\n", time=1e3 * TIME), {}),
    "suffixes": (table("t_us,tip_um\n", time=1e6 * TIME, values=1e3 * MM), {}),
    "units behind a slash": (table("t / ms;s / mm\n", ";", ",", time=1e3 * TIME), {}),
    "units in words": (table("Zeit in ms,Weg in mm\n", time=1e3 * TIME), {}),
    "units within names": (table("time ms rel,Weg (mm) roh\n", time=1e3 * TIME), {}),
    "units behind points": (table("time.ms,disp.mm\n", time=1e3 * TIME), {}),
    "days since 1900": (
        table("Time,x_mm\n", time=45429.5 + TIME / 86400, form="{:.12f}{}{:.6f}"), {"time_unit": "days"},
    ),
    "a row of units": (table("Zeit;Weg\nms;mm\n", ";", ",", time=1e3 * TIME), {}),
    "a row of units in brackets": (table("Time\tDisp\n[s]\t[mm]\n", "\t"), {}),
    "semicolons and decimal commas": (table("time_s;x_mm\n", ";", ","), {}),
    "tabs and decimal commas": (table("time_s\tx_mm\n", "\t", ","), {}),
    "spaces and decimal commas": (table("time_s x_mm\n", " ", ","), {}),
    "aligned by spaces": (table("  Time (s)   Disp (mm)\n", form="  {:8.4f}{}   {:12.6f}", separator=""), {}),
    "quoted cells with decimal commas": (
        lines(lambda k, t, y: f'"{t:.4f}","{y:.6f}"'.replace(".", ","), '"Time (s)","x (mm)"\n'), {},
    ),
    "comments, and the names in the last": (table("# made by a script\n# rig 4\n# time_s x_mm\n", " "), {}),
    "percent signs": (table("% measured on Monday\n% time_s, x_mm\n"), {}),
    "lines of metadata": (
        table("Device: LK-G\nSample rate,100\nDate,2024-05-17\n\nTime [s],Disp [mm]\n"), {},
    ),
    "metadata with semicolons, decimal commas": (
        table("Kunde;Meier\nAbtastrate;100,0\n\nZeit [s];Weg [mm]\n", ";", ","), {},
    ),
    "a comment within the table": (table("t_s,x_mm\n", tail="# stopped by hand\n"), {}),
    "Windows line ends": (table("t_s,x_mm\n", end="\r\n"), {}),
    "old Macintosh line ends": (table("t_s,x_mm\n", end="\r"), {}),
    "UTF-8 with a byte-order mark": ("\ufeff" + table("t_s,x_µm\n", values=1e3 * MM), {}),
    "UTF-16": (table("Zeit (s);Weg (µm)\n", ";", ",", values=1e3 * MM).encode("utf-16"), {}),
    "UTF-16 without a byte-order mark": (table("Zeit (s)\tWeg (mm)\n", "\t").encode("utf-16-le"), {}),
    "Latin-1": (table("Zeit (s);Auslenkung über Ruhelage (µm)\n", ";", ",", values=1e3 * MM).encode("latin-1"), {}),
    "empty cells as gaps": (
        lines(lambda k, t, y: f"{t:.4f},{'' if k % 7 == 3 else f'{y:.6f}'},5", "t_s,x_mm,flag\n"), {"column": "x_mm"},
    ),
    "words for gaps": (
        lines(lambda k, t, y: f"{t:.4f},{('NaN', 'N/A', '-')[k % 3] if k % 7 == 3 else f'{y:.6f}'}", "t_s,x_mm\n"), {},
    ),
    "time in the last column": (lines(lambda k, t, y: f"{k},{y:.6f},{t:.4f}", "frame,x_mm,time_s\n"), {}),
    "the time known by its even steps": (lines(lambda k, t, y: f"{y:.6f},{t:.4f}", ""), {"unit": "mm"}),
    "a separator at the end of each line": (lines(lambda k, t, y: f"{t:.4f};{y:.6f};", "t_s;x_mm;\n"), {}),
    "thousands of columns": (
        lines(
            lambda k, t, y: f"{t:.4f}," + ",".join([f"{y:.6f}" if c == 1234 else "0" for c in range(3000)]),
            "t_s," + ",".join(f"gauge{c}_mm" for c in range(3000)) + "\n",
        ),
        {"column": "gauge1234_mm"},
    ),
    "ISO stamps": (stamped("%Y-%m-%dT%H:%M:%S.%fZ"), {}),
    "ISO stamps with a space and an offset": (stamped("%Y-%m-%d %H:%M:%S.%f+02:00", "when;x_mm\n", ";"), {}),
    "clock times over midnight": (stamped("%H:%M:%S.%f"), {}),
    "date and clock in columns of their own": (stamped("%Y-%m-%d\t%H:%M:%S.%f", "Date\tTime\tx_mm\n", "\t"), {}),
    "whole milliseconds since 1970": (
        lines(lambda k, t, y: f"{1_715_983_199_500 + 10 * k},{y:.6f}", "timestamp_ms,x_mm\n"), {},
    ),
    "no time, but a sampling rate": (lines(lambda k, t, y: f"{y:.6f}", "x_mm\n"), {"sample_rate": 100.0}),
    "frame numbers and a sampling rate": (
        lines(lambda k, t, y: f"{k + 17},{y:.6f}", "frame,x_mm\n"), {"sample_rate": 100.0},
    ),
    "Testlab (Siemens)": (table("Test: 1\nX-axis: Time s\nY-axis: Displacement mm\n\n", "\t"), {}),
    "axes with units in brackets": (table("% X axis: Time (ms)\n% Y axis: tip [mm]\n", time=1e3 * TIME), {}),
    "Pulse (Bruel and Kjaer)": (
        lines(lambda k, t, y: f"{k}\t{t:.4f}\t{y:.6f}",
              "X-axis label:\tTime\nX-axis unit:\ts\nY-axis unit:\tmm\nPoint\tX\tY\n"), {},
    ),
    "LJ-Navigator (Keyence)": (
        lines(lambda k, t, y: f"{k + 1},{y:+.6f}", "Model,LJ-V7000\nSampling cycle,10ms\nUnit,mm\nNo.,OUT1\n"), {},
    ),
    "Motive (OptiTrack)": (
        lines(lambda k, t, y: f"{k},{t:.6f},{1e-3 * y:.9f},0.001,0.5",
              "Format Version,1.23,Capture Frame Rate,100.000000,Length Units,Meters,Coordinate Space,Global\n\n"
              ",,Marker,Marker,Marker\n,,tip,tip,tip\n,,Position,Position,Position\nFrame,Time (Seconds),X,Y,Z\n"),
        {"column": "X"},
    ),
    "Nexus (Vicon)": (
        lines(lambda k, t, y: f"{k + 1},0,500,0.1,0.2,{y:.6f},1.2,20",
              "Trajectories\n100\n,,beam:base,,,beam:tip,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z\n,,mm,mm,mm,mm,mm,mm\n"),
        {"column": "beam:tip X"},
    ),
    "a rate with a decimal comma": (lines(lambda k, t, y: f"{y:.6f}", "Abtastrate: 0,1 kHz\nx_mm\n"), {}),
    "a step with a decimal comma": (lines(lambda k, t, y: f"{y:.6f}", "dt: 10,0 ms\nx_mm\n"), {}),
    "QTM (Qualisys)": (
        lines(lambda k, t, y: f"500\t0\t0\t{y:.6f}\t1.2\t20",
              "NO_OF_FRAMES\t200\nNO_OF_MARKERS\t2\nFREQUENCY\t100\nDATA_INCLUDED\t3D\nMARKER_NAMES\tbase\ttip\n"),
        {"column": "tip X"},
    ),
    "exponents of Fortran": (
        lines(lambda k, t, y: f"{t:.4e},{y:.9e}".replace("e", "D"), "time_s,x_mm\n"), {},
    ),
    "minus signs of a word processor": (table("time_s;x_mm\n", ";", ",").replace("-", "\N{MINUS SIGN}"), {}),
    "units given by hand": (table("a,b\n", time=1e3 * TIME), {"unit": "mm", "time_unit": "ms", "time": "a"}),
    "columns by number": (lines(lambda k, t, y: f"{y:.6f},{-y:.6f},{t:.4f}"), {"column": 1, "time": 3, "unit": "mm"}),
    "a scale": (table("time_s,voltage_V\n", values=0.5 * MM), {"unit": "2 mm"}),
}  # fmt: skip


@pytest.mark.parametrize("name", READ)
def test_a_variant_is_read(tmp_path, name):
    text, options = READ[name]
    path = tmp_path / "record.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    record = Measurement.from_file(path, **options)
    seen = np.arange(len(TIME)) % 7 != 3 if "gaps" in name else np.ones(len(TIME), dtype=bool)
    begin = 86_399.5 if "clock" in name else 0.0
    np.testing.assert_allclose(record.time - begin, TIME[seen], atol=1e-6)
    np.testing.assert_allclose(record.values, SI[seen], atol=6e-7)  # metres are written with six decimals


ROWS = TIME.tolist()
REFUSED = {
    "a unit that is not understood": (table("Time (s),Disp [foo]\n"), {}, "column 2 'Disp .foo.': .*--unit"),
    "a time unit that is not understood": (table("Time [ticks],x_mm\n"), {}, "the unit 'ticks' .*--time-unit"),
    "a rate in thousands or with decimals": (
        lines(lambda k, t, y: f"{y:.6f}", "Abtastrate: 1,000 Hz\nx_mm\n"), {}, "no column is clearly the time",
    ),
    "units that contradict each other": (table("Unit: mm\nUnits: m\ntime,x\n"), {}, "Unit: mm.*--time-unit"),
    "units of two meanings": (table("t_s,v_m_s_2\n"), {}, "the unit 'm_s_2' is not understood; give .*--unit"),
    "units of which only a part is known": (table("t_s,jerk_mm_s3\n"), {}, "the unit 'mm_s3' is not .*--unit"),
    "days since 1900": (
        lines(lambda k, t, y: f"{45429.5 + t / 86400:.9f},{y}", "Time,x_mm\n"), {}, "may count days; .*--time-unit",
    ),
    "units told in a remark": (table("Units: ms and mm\ntime,x\n"), {}, "Units: ms and mm.*--time-unit"),
    "a name that does not fit the columns": (table("Time (ms) of the run; Disp (mm) of the tip\n"), {}, "--time-unit"),
    "large numbers without a unit of time": (
        table("timestamp,x_mm\n", time=1e3 * (TIME + 1_715_983_199)), {}, "too large for s; .*--time-unit",
    ),
    "commas between columns and in decimals": (
        table("Zeit,Weg\n", ",", ",", time=TIME + 1, form="{:.1f}{}{:.2f}"), {}, "semicolons",
    ),
    "the same without names": (table("", ",", ","), {}, "line 1: its commas may separate columns or decimals; write"),
    "thousands or decimals": (
        lines(lambda k, t, y: f"{k};{4000 + y * 100:,.0f}", "n;x_mm\n"), {},
        "'4,750' may separate thousands or decimals",
    ),
    "thousands and decimals": (
        lines(lambda k, t, y: f"{t:.4f};{4000 + y:,.3f}", "t_s;x_mm\n"), {}, "'4,007.500' has a separator of thousands",
    ),
    "spaces after every other comma": (lines(lambda k, t, y: f"{k},5, 1{k},5"), {}, "commas.*ambiguous|--time"),
    "a repeated row": (
        lines(lambda k, t, y: f"{t - 0.01 * (k == 51):.4f},{y:.6f}", "t_s,x_mm\n"), {},
        "line 53: .*that of line 52; remove",
    ),
    "rows out of order": (
        lines(lambda k, t, y: f"{TIME[{90: 91, 91: 90}.get(k, k)]:.4f},{y:.6f}", "t_s,x_mm\n"), {},
        "line 93: the time 0.9 s is earlier than that of line 92; remove the row .--skip-rows 93., or sort the rows",
    ),
    "times rounded until they repeat": (
        table("t_s,x_mm\n", form="{:.1f}{}{:.6f}"), {},
        "line 3: .*; name another column with --time, or .*--sample-rate",
    ),
    "a short row": (
        lines(lambda k, t, y: f"{t:.4f}" + f",{y:.6f}" * (k != 120), "t_s,x_mm\n"), {},
        "line 122: has 1 column where the table has 2; complete or remove the line",
    ),
    "a word among the numbers": (
        lines(lambda k, t, y: f"{t:.4f},{'over' if k == 44 else y}", "t_s,x_mm\n"), {},
        "line 46: 'over' is not a finite",
    ),
    "two columns of time": (
        lines(lambda k, t, y: f"{t},{t},{y}", "time_s,time_2_s,x_mm\n"), {}, "may be column 1 'time_s' or 2 .*--time",
    ),
    "no column of time": (lines(lambda k, t, y: f"{y},{-y}", "a,b\n"), {}, "--time, or give .* --sample-rate"),
    "several columns": (lines(lambda k, t, y: f"{t},{y},{-y}", "time,a,b\n"), {}, "2 'a', 3 'b'; choose with --column"),
    "minutes or hours": (lines(lambda k, t, y: f"12:{k % 60:02d},{y:.6f}", "time,x_mm\n"), {}, "write times as"),
    "a rate for a column of times": (
        table("time_s,x_mm\n"), {"time": "time_s", "sample_rate": 100.0},
        "has times in s; leave out --sample-rate, or --time",
    ),
    "a unit of another quantity": (table("time_s,x_mm\n"), {"unit": "ms"}, "is in ms, a unit of time, which no sensor"),
    "an unknown unit by hand": (table("time_s,x_mm\n"), {"unit": "smoot"}, "'smoot' is not a known unit; write"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_a_variant_is_refused_with_the_remedy(tmp_path, name):
    text, options, message = REFUSED[name]
    path = tmp_path / "record.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        Measurement.from_file(path, **options)
    assert len(str(caught.value)) < 400


def test_frame_numbers_count_from_the_first_that_is_there(tmp_path):
    path = tmp_path / "record.csv"
    path.write_text(lines(lambda k, t, y: f"{'' if k == 0 else k},{y:.6f}", "frame,x_mm\n"))
    record = Measurement.from_file(path, sample_rate=100.0)
    np.testing.assert_allclose(record.time, TIME[:-1], atol=1e-9)
    np.testing.assert_allclose(record.values, SI[1:], atol=6e-7)


@pytest.mark.parametrize(
    ("statement", "step"),
    [
        ("Sample rate: 51.2 kS/s", 1 / 51_200), ("Sampling rate: 1 KHz", 1e-3), ("Data rate: 2 MHz", 5e-7),
        ("Sampling rate: 10 (kHz)", 1e-4), ("Sampling period: 10 [ms]", 0.01), ("Sampling rate,500,Channels,2", 2e-3),
        ("Sample rate: 100 samples per second", 0.01), ("Frequency\t100", 0.01), ("Abtastrate: 2,5 kHz", 4e-4),
        ("fs: 48k", None), ("Abtastrate: 25 600 Hz", None), ("Abtastrate: 25'600 Hz", None), ("dt: 1/1000 s", None),
        ("Sample rate: 600 samples/min", None), ("Sample rate: 0.1 s", 0.1), ("Sample Rate,10,ms", 0.01),
        ("Scan Rate\t100\tms", 0.1), ("Sampling rate;0,01;s", 0.01), ("Sample Interval,10,kHz", 1e-4),
        ("Sample Rate,60,rpm", None), ("Sample Rate,60,1/min", 1.0), ("Sample Rate,60,mm", None),
        ("Sample Interval,1", None), ("Sample Interval,2 s", 2.0), ("X increment: 0.1 mm", None),
        ("Data rate: 9600 baud", None), ("Frequency: 10 Hz", None), ("Sampling rate: 1,000 Hz", None),
    ],
)  # fmt: skip
def test_a_stated_rate_counts_if_number_and_unit_are_certain(statement, step):
    assert sampling_step([statement]) == (step and pytest.approx(step))


def test_the_rate_of_sampling_comes_before_any_other_frequency():
    assert sampling_step(["Frequency: 10", "Sample rate: 1000 Hz"]) == pytest.approx(1e-3)
