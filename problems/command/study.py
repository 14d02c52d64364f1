"""``ancf-casadi study`` and ``ancf-casadi reproduce``: a whole study as one document."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from problems.command.output import Output, json_text, positive_count


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    from problems.study.study import study_help

    if parser.get_default("title") == "study":
        parser.epilog = study_help()
        parser.add_argument("file", metavar="STUDY.toml", help="the study; init writes a file to start from")
    parser.set_defaults(unfinished="finished computations are kept, and the same command continues from there")
    parser.add_argument(
        "--out", type=Path, default=Path("results"), metavar="DIR", help="folder of the results (default: results)"
    )
    parser.add_argument("--quick", action="store_true", help="short excitations and long steps, for a first look")
    parser.add_argument(
        "--jobs", type=positive_count, default=os.cpu_count() or 1, metavar="N", help="processes (default: all cores)"
    )


def run(options: argparse.Namespace) -> Output:
    """Run a study, which may be an edited copy of that of the paper, or that of the paper."""
    from problems.paper.reproduce import ALL_KINDS, PAPER_FILE  # slow to import, and only needed here
    from problems.study.study import write_study

    given = options.title == "study"
    words = ["ancf-casadi", options.title, *([options.file] if given else []), *(["--quick"] if options.quick else [])]
    report = write_study(
        options.file if given else PAPER_FILE,
        ALL_KINDS,
        options.out,
        quick=options.quick,
        executor=None,
        jobs=options.jobs,
        progress=sys.stderr.isatty(),
        command=" ".join(words),
    )
    if options.json:
        return Output(json_text(report.results))
    return Output(f"{report.report()}\n\n{report.page}")
