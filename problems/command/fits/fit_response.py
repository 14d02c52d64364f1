"""``ancf-casadi fit-response``: a beam fit of files with response curves.

The curves become tables ``[[curves]]`` beside those of the file of the beam, so that the fit is that of ``fit``.
"""

from __future__ import annotations

import argparse
import os
from typing import get_args

from ancf_casadi.records.sensor import Quantity
from problems.beam.curves.record import Control, Sweep
from problems.command.fits.fit import add_fit_outputs, fit_output
from problems.command.output import Output, new_files
from problems.command.record_options import add_spectral_options
from problems.schema.records import CURVE_READING, RECORDS_HELP, read_measurements
from problems.schema.table import StudyFile


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = RECORDS_HELP
    parser.add_argument(
        "file",
        metavar="BEAM.toml",
        help="a file with the tables [beam] and [[damping]]; [base] or [load] is the excitation at level 1, if the "
        "curves have no levels with a unit",
    )
    parser.add_argument(
        "curves", nargs="+", metavar="CURVE", help="file with frequency, amplitude, and if measured phase and level"
    )
    parser.add_argument(
        "--sensor",
        choices=get_args(Quantity),
        metavar="QUANTITY",
        help="what was measured (default: as the unit tells)",
    )
    parser.add_argument("--sweep", choices=get_args(Sweep), help="direction of the sweep")
    parser.add_argument("--control", choices=get_args(Control), help="quantity that was held (default: excitation)")
    add_spectral_options(parser, level=True)
    add_fit_outputs(parser)


def run(options: argparse.Namespace) -> Output:
    """Run the command."""
    out, plot = new_files([options.file, *options.curves], options.out, options.plot)
    file = StudyFile.of(options.file)
    keys = [*sorted(CURVE_READING - {"file"}), "sensor", "sweep", "control"]
    shared = {key: value for key in keys if (value := getattr(options, key)) is not None}
    curves = [{"file": os.path.abspath(path), **shared} for path in options.curves]
    tables = {**file.tables, "curves": [*file.several("curves"), *curves]}
    return fit_output(options, read_measurements(StudyFile(file.path, tables)), out, plot)
