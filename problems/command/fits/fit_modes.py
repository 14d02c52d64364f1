"""``ancf-casadi fit-modes``: several modes from one measured decay."""

from __future__ import annotations

import argparse

from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.inputs import located
from problems.command.output import Output, add_plot, new_files, positive_count, result_output
from problems.command.record_options import add_part_options, add_record_options, read_record, releases
from problems.decay.mode_separation import MOST_DECAY_MODES, fit_modes


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("file", metavar="FILE", help="the record; inspect FILE shows its columns and units")
    parser.add_argument(
        "--modes",
        type=positive_count,
        metavar="N",
        help=f"largest number of modes (default: as many as the record supports, up to {MOST_DECAY_MODES})",
    )
    add_plot(parser, "draw the record, the sum of the modes, and what remains")
    add_record_options(parser)
    add_part_options(parser)


def run(options: argparse.Namespace) -> Output:
    """Run the command."""
    new_files([options.file], options.plot)
    (release,) = releases(options, 1)
    record = read_record(options.file, options)
    return modes_output(options, options.file, record, release)


def modes_output(options: argparse.Namespace, file: str, record: Measurement, release: float | None) -> Output:
    """Return the output of a fit of several modes to the record of a file."""
    with located(file):
        fits = fit_modes(record, modes=options.modes, release_time=release)
    return result_output(options, fits, options.plot)
