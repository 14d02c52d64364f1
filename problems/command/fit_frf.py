"""``ancf-casadi fit-frf``: the modes of measured frequency response functions."""

from __future__ import annotations

import argparse
from typing import get_args

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.layout import TableLayout
from ancf_casadi.response.linear_frf import FrfKind
from ancf_casadi.support.inputs import located
from problems.command.output import Output, add_plot, comma_numbers, new_files, positive_count, result_output
from problems.command.record_options import add_spectral_options
from problems.frf.fitting import fit_frf
from problems.frf.record import FrfRecord


def add_fit_frf(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = (
        "reads universal files (data set 58, function type 4), and columns of MATLAB, HDF5, NPZ and text files: "
        "complex, real and imag, or amplitude and phase"
    )
    parser.add_argument("file", metavar="FILE", help="file of frequency response functions")
    parser.add_argument(
        "--kind",
        choices=get_args(FrfKind),
        metavar="KIND",
        help=f"{', '.join(get_args(FrfKind))} (default: as the unit tells)",
    )
    parser.add_argument("--modes", type=positive_count, metavar="N", help="number of modes (default: as many as show)")
    parser.add_argument(
        "--frequencies", type=comma_numbers, metavar="HZ,...", help="approximate frequencies of the modes, instead"
    )
    parser.add_argument("--band", type=comma_numbers, metavar="LOW,HIGH", help="frequencies to fit (Hz; default: all)")
    add_plot(parser, "draw the functions and the fit")
    add_spectral_options(parser, level=False)


def run_fit_frf(options: argparse.Namespace) -> Output:
    """Fit the functions."""
    new_files([options.file], options.plot)
    if options.band is not None and len(options.band) != 2:
        raise InputError("must be two frequencies LOW,HIGH", "--band")
    names = ("column", "frequency", "phase", "unit", "phase_unit")
    reading = {name: getattr(options, name) for name in names}
    layout = TableLayout.of(vars(options))
    record = FrfRecord.from_file(options.file, options.kind, layout=layout, progress=True, **reading)
    with located(options.file):
        fit = fit_frf(record, modes=options.modes, frequencies=options.frequencies, band=options.band)
    return result_output(fit, options.plot)
