"""``ancf-casadi fit-mode``: one mode from measured decays and response curves together."""

from __future__ import annotations

import argparse
from pathlib import Path

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.inputs import error_prefix
from problems.beam.curves.record import ResponseRecord
from problems.command.fit_decay import add_law_options
from problems.command.output import Output, add_options, add_plot, finite, new_files, option_values, result_output
from problems.command.record_options import RECORD_KEYS, add_record_options, given_options, read_record, releases
from problems.mode.fitting import fit_mode
from problems.spec.records import read_curves


def add_fit_mode(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = "ancf-casadi run --keys lists the keys of [[curves]]"
    about = "record of a free decay, or a file CURVES.toml with response curves in tables [[curves]]"
    parser.add_argument("files", nargs="*", metavar="FILE", help=about)
    about = "files with response curves: frequency, amplitude, level with its unit, and if measured phase"
    parser.add_argument("--curve", nargs="+", default=[], metavar="CURVE", help=about)
    add_law_options(parser, auto=False)
    add_options(
        parser,
        frequency=(str, "NAME", "column of the frequencies in the files of --curve; name or number from 1"),
        modal_constant=(finite, "K", "force per mass and unit level, 1/mass for a force at the sensor, if it is known"),
    )
    add_plot(parser, "draw curves, decays, and frequency and damping ratio against amplitude")
    add_record_options(parser)


def run_fit_mode(options: argparse.Namespace) -> Output:
    """Fit one mode to the decays and response curves of the named files."""
    paths = [*options.files, *options.curve]
    if not paths:
        raise InputError("give the file of a decay, or response curves", "FILE")
    new_files(paths, options.plot)
    curve_tables = [path for path in options.files if Path(path).suffix.lower() == ".toml"]
    decay_files = [path for path in options.files if path not in curve_tables]
    if not decay_files:
        for name, present in given_options(options, *RECORD_KEYS).items():
            if present:
                raise InputError("belongs to the file of a record; give the file of a decay too, or leave it out", name)
    curves = [curve for path in curve_tables for curve in read_curves(path)]
    if options.frequency is not None and not options.curve:
        raise InputError("names a column of --curve; give its files there, or leave it out", "--frequency")
    curves += [
        ResponseRecord.from_file(path, frequency=options.frequency, excitation_unit="", progress=True)
        for path in options.curve
    ]
    decays = [read_record(path, options) for path in decay_files]
    times = releases(options, len(decay_files)) if decay_files else []
    with error_prefix(", ".join(paths)):
        fit = fit_mode(
            [*decays, *curves],
            release_times=[time for time in times if time is not None] or None,
            **option_values(options, ("law", "frequency_law", "modal_constant", "rest", "robust")),
        )
    return result_output(fit, options.plot)
