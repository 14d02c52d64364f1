"""``ancf-casadi fit-frf``: the modes of measured frequency response functions."""

from __future__ import annotations

import argparse
from typing import get_args

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.layout import LAYOUT_KEYS, TableLayout
from ancf_casadi.response.linear_frf import FrfKind
from ancf_casadi.support.inputs import error_prefix
from problems.command.output import (
    Output,
    add_options,
    add_plot,
    comma_numbers,
    new_files,
    positive_count,
    result_output,
)
from problems.command.record_options import add_keys
from problems.frf.fitting import fit_frf
from problems.frf.record import FrfRecord
from problems.spec.record_files import CurveFileSpec

COLUMN_KEYS = ("column", "frequency", "phase", "unit", "phase_unit")


def add_fit_frf(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = (
        "reads universal files (data set 58, function type 4), and columns of MATLAB, HDF5, NPZ and text files: "
        "complex, real and imag, or amplitude and phase"
    )
    parser.add_argument("file", metavar="FILE", help="file of frequency response functions")
    kinds = get_args(FrfKind)
    parser.add_argument(
        "--kind", choices=kinds, metavar="KIND", help=f"{', '.join(kinds)} (default: as the unit tells)"
    )
    add_options(
        parser,
        modes=(positive_count, "N", "number of modes (default: as many as show)"),
        frequencies=(comma_numbers, "HZ,...", "approximate frequencies of the modes, instead"),
        band=(comma_numbers, "LOW,HIGH", "frequencies to fit (Hz; default: all)"),
    )
    add_plot(parser, "draw the functions and the fit")
    add_keys(parser.add_argument_group("reading the file"), CurveFileSpec, *COLUMN_KEYS, *LAYOUT_KEYS)


def run_fit_frf(options: argparse.Namespace) -> Output:
    """Fit the functions."""
    new_files([options.file], options.plot)
    if options.band is not None and len(options.band) != 2:
        raise InputError("must be two frequencies LOW,HIGH", "--band")
    reading = {name: getattr(options, name) for name in COLUMN_KEYS}
    layout = TableLayout.of(vars(options))
    record = FrfRecord.from_file(options.file, options.kind, layout=layout, progress=True, **reading)
    with error_prefix(options.file):
        fit = fit_frf(record, modes=options.modes, frequencies=options.frequencies, band=options.band)
    return result_output(fit, options.plot)
