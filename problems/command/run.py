"""``ancf-casadi run`` and ``reproduce``: the steps of a study file, printed or written as one document."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from problems.command.output import Output, positive_count


def add_run(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    from problems.study.study import study_keys

    parser.add_argument("--keys", action="version", version=study_keys(), help="list all tables and their keys")
    parser.add_argument("file", metavar="STUDY.toml", help="the study, or a JSON document; init writes a file")
    parser.add_argument(
        "steps",
        nargs="*",
        metavar="STEP",
        help="tables or parts to run, with what they need: decays, modes, match, simulation, response, fit, compare, "
        "plan, or the name of a part (default: all that the file has)",
    )
    _add_options(parser, out=None, files="write report.html, results.json, tables, figures and further files")


def add_reproduce(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.set_defaults(file=None, steps=())
    _add_options(parser, out=Path("results"), files="folder of the results (default: results)")


def _add_options(parser: argparse.ArgumentParser, *, out: Path | None, files: str) -> None:
    kept = "finished computations are kept with --out, and the same command continues from there"
    parser.set_defaults(unfinished=kept)
    parser.add_argument("--out", type=Path, default=out, metavar="DIR", help=files)
    parser.add_argument("--quick", action="store_true", help="short excitations and long steps, for a first look")
    parser.add_argument(
        "--jobs",
        type=positive_count,
        metavar="N",
        help="processes (default: all cores for more than three parts; else this one, which shows progress of fits)",
    )


def run_run(options: argparse.Namespace) -> Output:
    """Run a study, which may be an edited copy of that of the paper, or that of the paper itself."""
    from problems.paper.reproduce import ALL_KINDS, PAPER_FILE  # slow to import, and only needed here
    from problems.study.study import write_study

    words = ("ancf-casadi", options.title, options.file, *options.steps, "--quick" if options.quick else None)
    report = write_study(
        PAPER_FILE if options.file is None else options.file,
        ALL_KINDS,
        options.out,
        steps=options.steps,
        quick=options.quick,
        executor=None,
        jobs=options.jobs,
        progress=sys.stderr.isatty(),
        command=" ".join(word for word in words if word is not None),
    )
    return Output(report.to_dict, lambda: "\n\n".join([report.report(), *([str(report.page)] if report.page else [])]))


run_reproduce = run_run
