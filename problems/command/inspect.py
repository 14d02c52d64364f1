"""``ancf-casadi inspect``: the channels of a file, their sampling and spectrum, and the part that a fit would use."""

from __future__ import annotations

import argparse
import csv
import io
import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ancf_casadi.decay.spectrum import peak_frequencies, step_frequency
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import RecordedChannel, Recording, is_counter, is_time, widest_channel
from ancf_casadi.records.layout import TableLayout
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.processing import quality_warnings, sampling
from ancf_casadi.records.reading.formats import read_contents
from ancf_casadi.records.recording import with_times
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import Figure
from ancf_casadi.support.inputs import physical
from ancf_casadi.support.tables import Table, finite_or_none
from problems.command.output import Output, add_plot, figure_writers, new_files
from problems.command.record_options import FILE_KEYS, add_record_options
from problems.decay.amplitudes import is_amplitude_decay
from problems.decay.free_decay import clean_record, cut_at_release

MOST_CHANNELS_SHOWN = 40  # channels in the table
EPILOG = """\
start here with a new file; these can be read:
  text                tables with any separators, names and units, gaps, clock times
  MATLAB              variables and fields of structs, versions 4 to 7.3 (.mat)
  HDF5                data sets, with units and sampling rates in attributes (.h5)
  NumPy               arrays (.npz, .npy)
  universal files     data set 58: responses over time, frequency response functions
  C3D                 markers and analog channels of motion capture
  TDMS, LVM           channels of LabVIEW and DIAdem
  WAV                 channels of a sound, as fractions of full scale
  pose tracks         tables of DeepLabCut, SLEAP and the like, with likelihoods
a table with other rows or columns around it is read with --names-row,
--skip-rows and --leave-out; values over frequency, complex or as amplitude and phase, are fitted by fit-frf
(frequency response functions) and a study with [[curves]] (steady vibration)
"""
AMPLITUDES = "amplitudes of a decay, without the oscillation"
SPECTRUM_SAMPLES = 10  # samples of a spectrum


def add_inspect(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = EPILOG
    parser.add_argument("file", metavar="FILE", help="file of measurements")
    add_plot(parser, "draw the channels over time, and their spectra")
    add_record_options(parser, for_fit=False)


@np.errstate(all="ignore")  # a file may hold any numbers
def run_inspect(options: argparse.Namespace) -> Output:
    """Look at the file."""
    new_files([options.file], options.plot)
    if options.sample_rate is not None:
        physical(options.sample_rate, "--sample-rate")
    layout = TableLayout.of(vars(options))
    recording, problem = read_contents(options.file, layout=layout, progress=True), ""
    try:
        recording = with_times(
            recording, time=options.time, time_unit=options.time_unit, sample_rate=options.sample_rate
        )
    except InputError as error:
        problem = str(error)
    recording = replace(recording, notes=(*recording.notes, *_faults(recording)))
    summaries = [_summary(channel) for channel in recording.channels]
    plan = _plan(recording, options, problem)
    files = figure_writers(options.plot, lambda: _figure(recording, plan))
    data = {
        "file": options.file,
        "times": _times(recording),
        "channels": summaries,
        "notes": list(recording.notes),
        "fit": plan,
    }
    text = _report(options, recording, data)
    return Output(lambda: data, lambda: text, files)


def _summary(channel: RecordedChannel) -> dict[str, Any]:
    """Return one line of the table; ``frequency`` (Hz) is that of the highest peak of the spectrum."""
    present = ~np.isnan(channel.values)
    values = channel.values[present]
    usable = bool(len(values)) and not channel.fault
    even = _resample_evenly(channel) if usable and not is_counter(channel) else None
    return {
        "number": channel.number, "name": channel.name, "unit": channel.symbol,
        "quantity": channel.unit.quantity if channel.unit else "", "samples": len(values),
        "gaps": int(len(present) - len(values)), "lowest": float(values.min()) if usable else math.nan,
        "highest": float(values.max()) if usable else math.nan, "frequency": _peak(*even) if even else math.nan,
        "fault": channel.fault,
    }  # fmt: skip


def _faults(recording: Recording) -> list[str]:
    """Return the faults of the records of the channels."""
    faults = []
    for channel in recording.measured:
        present = np.isfinite(channel.values)
        if channel.time is not None and present.any():
            texts = quality_warnings(channel.time[present], channel.values[present])
            faults += [f"column {channel.label}: {text}" for text in texts]
    return faults


def _peak(time: Array, values: Array) -> float:
    """Return the frequency of the highest peak, Hz; of the spectrum of the velocity if a step or a drift prevails."""
    if len(time) < SPECTRUM_SAMPLES or np.ptp(values) == 0.0:
        return math.nan
    swing = values - values.mean()
    frequency = peak_frequencies(time, swing)[0]
    # periods in a record, below which a peak of the spectrum is a step or a drift
    slow = frequency * (time[-1] - time[0]) < 3.0
    return step_frequency(time, swing) if slow else frequency


def _resample_evenly(channel: RecordedChannel) -> tuple[Array, Array] | None:
    """Return the samples of a channel at even times, across gaps by linear interpolation; None if too few."""
    if channel.time is None:
        return None
    present = ~np.isnan(channel.values)
    time, values = channel.time[present], channel.values[present]
    if len(time) < SPECTRUM_SAMPLES or not np.isfinite(values).all():
        return None
    step = float(np.median(np.diff(time)))
    # instants of the even grid per sample, beyond which no spectrum is computed
    if not (time[-1] - time[0]) / step < 4 * len(time):
        return None
    grid = np.linspace(time[0], time[-1], round((time[-1] - time[0]) / step) + 1)
    return grid, np.interp(grid, time, values)


def _plan(recording: Recording, options: argparse.Namespace, problem: str) -> dict[str, Any]:
    """Return the record that a fit would use, or the problem for which there is none."""
    plan: dict[str, Any] = {"column": "", "quantity": "", "samples": 0, "release": math.nan, "reason": "",
                            "periods": math.nan, "problem": ""}  # fmt: skip
    try:
        if problem:
            raise InputError(problem)
        channel = recording.channel(options.column)
        sensor = None if options.sensor is None else Sensor(options.sensor)
        record = Measurement.from_recording(recording, options.column, unit=options.unit, sensor=sensor)
        plan |= {"column": f"{channel.number} '{channel.name}'", "quantity": record.sensor.quantity}
        if is_amplitude_decay(channel.name, record.values):
            return plan | {"samples": len(record.time), "release": float(record.time[0]), "reason": AMPLITUDES}
        decay = cut_at_release(clean_record(record))
    except InputError as error:
        return plan | {"problem": str(error)}
    periods = decay.guess.ω * float(decay.record.time[-1]) / (2 * math.pi)
    return plan | {"samples": len(decay.record.time), "release": decay.release_time, "reason": decay.guess.reason,
                   "periods": periods}  # fmt: skip


def _times(recording: Recording) -> list[dict[str, Any]]:
    """Return the sampling of each distinct time axis, with the numbers of its channels."""
    groups: dict[bytes, tuple[Array, list[int]]] = {}
    for channel in recording.channels:
        if channel.time is not None:
            groups.setdefault(channel.time.tobytes(), (channel.time, []))[1].append(channel.number)
    return [{"columns": _ranges(numbers), **sampling(time)} for time, numbers in groups.values()]


def _ranges(numbers: Sequence[int]) -> str:
    if len(numbers) > 2 and list(numbers) == list(range(numbers[0], numbers[-1] + 1)):
        return f"{numbers[0]} to {numbers[-1]}"
    shown = ", ".join(map(str, numbers[:8]))
    return f"{shown}, ..." if len(numbers) > 8 else shown


def _report(options: argparse.Namespace, recording: Recording, data: Mapping[str, Any]) -> str:
    """Return the table of channels, the sampling of each time axis, and the advice, as text."""
    times, summaries = data["times"], data["channels"]
    lines = []
    for axis in times:
        columns = f" of columns {axis['columns']}" if len(times) > 1 else ""
        lines.append(f"times{columns}: {_sampling(axis)}")
    shown = summaries[:MOST_CHANNELS_SHOWN]
    rows = [
        (
            channel["number"], channel["name"],
            channel["unit"] if channel["quantity"] or not channel["unit"] else f"{channel['unit']} (?)",
            channel["samples"], channel["gaps"] or None,
            *(finite_or_none(channel[key]) for key in ("lowest", "highest", "frequency")),
        )
        for channel in shown
    ]  # fmt: skip
    notes = [f"column {channel['number']}: {channel['fault']}" for channel in shown if channel["fault"]]
    if len(summaries) > MOST_CHANNELS_SHOWN:
        notes.append(f"{len(summaries) - MOST_CHANNELS_SHOWN} more columns are not shown; --json lists them all")
    heads = ("column", "name", "unit", "samples", "gaps", "lowest", "highest", "strongest frequency, Hz")
    table = Table("channels", recording.name, heads, rows, [*notes, *recording.notes])
    return "\n".join([table.text(), *([""] if lines else []), *lines, "", *_advice(options, recording, data["fit"])])


def _sampling(times: Mapping[str, Any]) -> str:
    text = "{samples} from {begin:g} to {end:g} s".format(**times)
    if not math.isfinite(times["rate"]):
        return text
    text += f", {times['rate']:.6g} per second"
    text += f", steps vary by {100 * times['jitter']:.2g} %" if times["jitter"] > 1e-4 else ", evenly spaced"
    if times["gaps"]:
        text += (
            ", {gaps} gaps with {missing} samples missing, the longest {longest_gap:g} s after {longest_gap_at:g} s"
        ).format(**times)
    return text


def _advice(options: argparse.Namespace, recording: Recording, plan: Mapping[str, Any]) -> list[str]:
    """Return what a fit would use, and the next command."""
    if plan["problem"] and plan["column"]:
        return [f"A fit refuses column {plan['column']}: it {plan['problem'].removeprefix('record: ')}"]
    if plan["problem"]:
        lines = [f"A fit needs more: {plan['problem'].removeprefix(f'{recording.path}: ')}"]
        candidates = [channel for channel in recording.measured if channel.time is not None]
        if options.column is None and len(candidates) > 1:
            lines.append(f"See {_command('inspect', options, widest_channel(candidates).name)}")
        return lines
    periods = f", about {plan['periods']:.0f} periods" if math.isfinite(plan["periods"]) else ""
    command = _command("fit-decay", options, options.column)
    if plan["reason"] == AMPLITUDES:
        command += " --quantity amplitude [--frequency HZ]"
    return [
        "A fit would use column {column} as {quantity}, from {release:g} s ({reason}) on: {samples} samples".format(
            **plan
        )
        + periods,
        f"Next: {command}",
    ]


def _command(name: str, options: argparse.Namespace, column: str | int | None) -> str:
    words = ["ancf-casadi", name, options.file]
    values = {key: getattr(options, key) for key in (*FILE_KEYS, "sensor")} | {"column": column}
    for key, value in values.items():
        if value is not None:
            text = io.StringIO(str(value))
            if isinstance(value, tuple):
                text = io.StringIO()
                csv.writer(text, lineterminator="").writerow(value)
            words += [f"--{key.replace('_', '-')}", text.getvalue()]
    return shlex.join(words)


def _figure(recording: Recording, plan: Mapping[str, Any]) -> Figure:
    """Draw the first channels over time, and their spectra."""
    from ancf_casadi.figures.records import spectra_figure  # matplotlib is slow to import

    series: list[tuple[str, Array, Array, tuple[Array, Array]]] = []
    for channel in recording.channels:
        even = None if channel.fault or is_time(channel) else _resample_evenly(channel)
        if even is not None and channel.time is not None and len(series) < 6:  # channels in the figure
            label = f"{channel.name}, {channel.symbol}" if channel.symbol not in channel.name else channel.name
            series.append((label, channel.time, channel.values, even))
    if not series:
        raise InputError(plan["problem"] or "has no channel that can be drawn", recording.path)
    return spectra_figure(series, recording.name, plan["release"])
