"""``ancf-casadi fit-decay``: frequency and damping from one measured decay."""

from __future__ import annotations

import argparse
from pathlib import Path

from ancf_casadi.decay.envelope import damping_curve
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.inputs import located
from problems.command.output import Output, Subcommands, file_writer, json_text, new_files
from problems.decay.comparison import compare_decay_laws
from problems.decay.fitting import fit_decay

LAWS = ("linear", "quadratic", "friction", "one-mode", "auto")


def add_fit_decay(commands: Subcommands) -> None:
    """Add the subcommand."""
    parser = commands.add("fit-decay", _run, "estimate frequency and damping from one measured decay")
    parser.add_argument("file", metavar="FILE.csv", help="columns with time (s) and displacement (m)")
    parser.add_argument(
        "--law", choices=LAWS, default="linear", help="damping law, or auto to compare all (default: linear)"
    )
    parser.add_argument("--drift", action="store_true", help="let the rest position drift at constant velocity")
    parser.add_argument("--robust", action="store_true", help="limit the influence of outliers")
    parser.add_argument("--column", help="name of the displacement column (default: the second column)")
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="draw the record and the fit")
    parser.add_argument(
        "--curve", type=Path, metavar="FILE.csv", help="write damping ratio against amplitude, without assuming a law"
    )


def _run(options: argparse.Namespace) -> Output:
    plot, curve = new_files([options.file], options.plot, options.curve)
    record = Measurement.from_file(options.file, column=options.column, progress=True)
    comparison = None
    with located(options.file):
        if options.law == "auto":
            if options.robust:
                raise InputError("compares sums of squares; leave out --robust", "--law auto")
            comparison = compare_decay_laws(record, drift=options.drift)
            fit = comparison.best
        else:
            fit = fit_decay(record, law=options.law, drift=options.drift, robust=options.robust)
        damping = None if curve is None else damping_curve(record).table()
    files = []
    if curve is not None and damping is not None:
        files.append(file_writer(curve, damping.csv))
    if plot is not None:
        from ancf_casadi.plot import decay_figure, png  # matplotlib is slow to import

        files.append(file_writer(plot, lambda: png(decay_figure(record, fit.displacement, fit.release_time))))
    if options.json:
        return Output(json_text(fit.to_dict() | ({"comparison": comparison.to_dict()} if comparison else {})), files)
    return Output(comparison.report() if comparison else fit.report(), files)
