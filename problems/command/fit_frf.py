"""``ancf-casadi fit-frf``: the modes of measured frequency response functions."""

from __future__ import annotations

import argparse
from dataclasses import replace

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.layout import LAYOUT_KEYS, TableLayout
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.recording import read_recording
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.response.linear_frf import FrfKind
from ancf_casadi.support.inputs import error_prefix
from problems.command.output import (
    Output,
    add_options,
    add_plot,
    comma_numbers,
    finite,
    new_files,
    option_values,
    positive_count,
    result_output,
)
from problems.command.record_options import add_keys, columns, given_options, refuse_combinations
from problems.frf.estimators import Estimator, Excitation, Window, frf_of
from problems.frf.fitting import fit_frf
from problems.frf.record import FrfRecord
from problems.spec.record_files import ChannelSpec, CurveFileSpec

TIME_KEYS = ("time", "time_unit", "sample_rate")
COLUMN_KEYS = ("column", "frequency", "phase", "unit", "phase_unit")
FIT_OPTIONS = {  # of ``fit_frf``
    "modes": (positive_count, "N", "number of modes (default: as many as show)"),
    "frequencies": (comma_numbers, "HZ,...", "approximate frequencies of the modes, instead"),
    "band": (comma_numbers, "LOW,HIGH", "frequencies to fit (Hz; default: all)"),
}
ESTIMATE_OPTIONS = {  # of ``frf_of``
    "estimator": (Estimator, "NAME", "H1 for noise of the response (default), H2 for noise of the force, Hv for both"),
    "excitation": (Excitation, "NAME", "default: as the force shows"),
    "window": (Window, "NAME", "of the blocks under a shaker (default: hann)"),
    "time_constant": (finite, "S", "time constant of an exponential window after hits (default: none)"),
    "block": (finite, "S", "length of a block (default: to the next hit; 20 blocks under a shaker)"),
    "overlap": (finite, "SHARE", "overlap of the blocks under a shaker (default: 0.5)"),
}


def add_fit_frf(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = (
        "reads universal files (data set 58, function type 4), and columns of MATLAB, HDF5, NPZ and text files: "
        "complex, real and imag, or amplitude and phase; several files have an output each; "
        "with --force and --response, files of these over time, of all formats "
        "that inspect lists: the hits or blocks of all files are averaged"
    )
    parser.add_argument("files", metavar="FILE", nargs="+", help="file of frequency response functions, or over time")
    add_options(parser, kind=(FrfKind, "KIND", "as the unit tells, if not given"), **FIT_OPTIONS)
    add_plot(parser, "draw the functions and the fit")
    add_keys(parser.add_argument_group("reading the file"), CurveFileSpec, *COLUMN_KEYS, *LAYOUT_KEYS)
    group = parser.add_argument_group("force and response over time")
    group.add_argument("--force", metavar="NAME|N", help="column of the force")
    group.add_argument("--response", type=columns, metavar="NAME|N,...", help="columns of the responses")
    add_keys(group, ChannelSpec, *TIME_KEYS)
    add_options(group, **ESTIMATE_OPTIONS)


def run_fit_frf(options: argparse.Namespace) -> Output:
    """Fit the functions."""
    new_files(options.files, options.plot)
    if options.band is not None and len(options.band) != 2:
        raise InputError("must be two frequencies LOW,HIGH", "--band")
    over_frequency = options.force is None
    other_keys = *(key for key in COLUMN_KEYS if key != "unit"), "imaginary"
    over_time = given_options(options, "response", *TIME_KEYS, *ESTIMATE_OPTIONS)
    refuse_combinations({
        "--force": (not over_frequency, "reads records over time", given_options(options, *other_keys)),
        **{option: (present, "belongs to records over time", {"functions over frequency; give --force": over_frequency})
           for option, present in over_time.items()},
    })  # fmt: skip
    record = _read_functions(options) if over_frequency else _estimate_functions(options)
    with error_prefix(", ".join(options.files)):
        fit = fit_frf(record, **option_values(options, FIT_OPTIONS))
    return result_output(fit, options.plot)


def _read_functions(options: argparse.Namespace) -> FrfRecord:
    """Read functions over frequency."""
    reading = {"layout": TableLayout.of(vars(options)), **option_values(options, COLUMN_KEYS)}
    records = [FrfRecord.from_file(path, options.kind, progress=True, **reading) for path in options.files]
    with error_prefix(", ".join(options.files)):
        return records[0] if len(records) == 1 else FrfRecord.stacked(records)


def _estimate_functions(options: argparse.Namespace) -> FrfRecord:
    """Estimate functions from the columns of files over time."""
    if options.response is None:
        raise InputError("is needed beside --force; name the columns of the responses", "--response")
    response_unit, _, force_unit = (options.unit or "").strip("[]").rpartition("/")
    if options.unit and not (response_unit and force_unit):
        raise InputError(f"must be units of response and force, such as g/N, got {options.unit!r}", "--unit")
    forces, responses = [], []
    for path in options.files:
        times = option_values(options, TIME_KEYS)
        recording = read_recording(path, layout=TableLayout.of(vars(options)), progress=True, **times)
        symbol = recording.channel(options.force).symbol
        sensor = None if symbol or force_unit else Sensor("force")
        forces.append(Measurement.from_recording(recording, options.force, unit=force_unit or None, sensor=sensor))
        unit = response_unit.strip("()") or None
        responses.append([Measurement.from_recording(recording, name, unit=unit) for name in options.response])
    with error_prefix(", ".join(options.files)):
        record = frf_of(forces, responses, kind=options.kind, **option_values(options, ESTIMATE_OPTIONS))
        notes = dict.fromkeys(note for takes in (forces, *responses) for take in takes for note in take.notes)
    return replace(record, notes=(*notes, *record.notes))
