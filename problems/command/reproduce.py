"""``ancf-casadi reproduce``: the study of the paper on its embedded data."""

from __future__ import annotations

import argparse
import os
from functools import partial
from pathlib import Path

from ancf_casadi.support.files import check_folder
from problems.command.output import Output, Subcommands, json_text, positive_count


def add_reproduce(commands: Subcommands) -> None:
    """Add the subcommand."""
    parser = commands.add("reproduce", _run, "reproduce the study of the paper: tables, figures and results.json")
    parser.add_argument(
        "--out", type=Path, default=Path("results"), metavar="DIR", help="folder of the results (default: results)"
    )
    parser.add_argument("--quick", action="store_true", help="short excitations and loose tolerances, for a first look")
    parser.add_argument(
        "--jobs", type=positive_count, default=os.cpu_count() or 1, metavar="N", help="processes (default: all cores)"
    )


def _run(options: argparse.Namespace) -> Output:
    from problems.study import report, reproduction, tables, transients  # slow to import, and only needed here

    folder = check_folder(options.out)
    effort = transients.QUICK if options.quick else transients.FULL
    study = reproduction.reproduce(effort=effort, jobs=options.jobs, progress=True)
    files = [partial(report.write_study, study, folder)]
    if options.json:
        return Output(json_text(report.results(study)), files)
    texts = [table.text() for table in tables.tables(study)]
    if options.quick:
        texts.append(
            "Quick look: the excitations last a tenth as long and the tolerances are looser, so Table 11 is off by a "
            "few percent."
        )
    return Output("\n\n".join(texts), files, f"\n\nfiles written to {folder}")
