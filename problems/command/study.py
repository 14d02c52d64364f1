"""``ancf-casadi study`` and ``ancf-casadi reproduce``: a whole study as one document."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from problems.command.output import Output, json_text, positive_count


def add_study(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    from problems.study.reading import study_help

    parser.set_defaults(run=_study)
    parser.epilog = study_help()
    parser.add_argument("file", metavar="STUDY.toml", help="the study; init writes a file to start from")
    _add_options(parser)


def add_reproduce(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    from problems.study.reading import paper_help

    parser.set_defaults(run=_reproduce)
    parser.epilog = paper_help()
    _add_options(parser)


def _add_options(parser: argparse.ArgumentParser) -> None:
    parser.set_defaults(unfinished="finished computations are kept, and the same command continues from there")
    parser.add_argument(
        "--out", type=Path, default=Path("results"), metavar="DIR", help="folder of the results (default: results)"
    )
    parser.add_argument("--quick", action="store_true", help="short excitations and long steps, for a first look")
    parser.add_argument(
        "--jobs", type=positive_count, default=os.cpu_count() or 1, metavar="N", help="processes (default: all cores)"
    )


def _study(options: argparse.Namespace) -> Output:
    return _run(options, Path(options.file), f"ancf-casadi study {options.file}")


def _reproduce(options: argparse.Namespace) -> Output:
    return _run(options, None, "ancf-casadi reproduce")


def _run(options: argparse.Namespace, path: Path | None, command: str) -> Output:
    from problems.study.study import run_study  # slow to import, and only needed here

    report = run_study(
        path,
        options.out,
        quick=options.quick,
        jobs=options.jobs,
        progress=sys.stderr.isatty(),
        command=f"{command}{' --quick' if options.quick else ''}",
    )
    if options.json:
        return Output(json_text(report.results))
    return Output(f"{report.report()}\n\n{report.page}")
