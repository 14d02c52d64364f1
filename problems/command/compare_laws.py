"""``ancf-casadi compare-laws``: the damping law that explains a record best."""

from __future__ import annotations

import argparse
import sys
from typing import Any

from ancf_casadi.estimation.comparison import LawComparison
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.inputs import located
from problems.beam.fitting import compare_laws
from problems.command.output import Output, add_plot, new_files, positive_count, result_output
from problems.command.record_options import add_record_options, check_no_record_options, read_record, releases
from problems.decay.comparison import compare_decay_laws
from problems.spec.records import RECORDS_HELP, read_measurements


def add_compare_laws(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = RECORDS_HELP
    parser.add_argument(
        "file",
        metavar="FILE|STUDY.toml",
        help="record of a free decay, to which the closed forms are fitted; or a study, to whose records the nonlinear "
        "beam is fitted with each table [[damping]] alone, and with their sum",
    )
    parser.add_argument(
        "--jobs", type=positive_count, default=1, metavar="N", help="processes for a study (default: 1)"
    )
    add_plot(parser, "draw the criteria")
    add_record_options(parser)


def run_compare_laws(options: argparse.Namespace) -> Output:
    """Compare the laws."""
    new_files([options.file], options.plot)
    found: LawComparison[Any]
    if options.file.lower().endswith(".toml"):
        check_no_record_options(options, "a study has them in [[records]]")
        given = read_measurements(options.file)
        with located(f"{options.file}: [fit]"):
            if "fixed" in given.settings:
                raise InputError("all parameters of the laws are compared; leave it out", "fixed")
            found = compare_laws(
                given.model,
                given.records,
                given.laws,
                jobs=options.jobs,
                progress=sys.stderr.isatty(),
                **given.settings,
            )
    else:
        (release,) = releases(options, 1)
        record = read_record(options.file, options)
        with located(options.file):
            found = compare_decay_laws(record, release_time=release)
    return result_output(found, options.plot)
