"""``ancf-casadi run`` and ``reproduce``: the steps of a study file, printed or written as one document."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from problems.command.output import Output, positive_count

if TYPE_CHECKING:
    from problems.study.step import Study


def add_run(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("--keys", action=_Keys, nargs=0, help="list all tables and their keys")
    parser.add_argument("file", metavar="STUDY.toml", help="the study, or a JSON document; init writes a file")
    parser.add_argument(
        "steps",
        nargs="*",
        metavar="STEP",
        help="steps to run, with what they need: decays, modes, match, simulation, response, fit, compare, "
        "plan, or the name of a step (default: all that the file has)",
    )
    _add_options(parser, out=None, files="write report.html, results.json, tables, figures and further files")


class _Keys(argparse.Action):
    """The option ``--keys``, which prints the keys and exits."""

    def __call__(self, parser: argparse.ArgumentParser, *values: Any) -> None:
        """Print the keys."""
        from problems.spec.help import keys_help
        from problems.study.study import study_schema  # slow to import

        print(keys_help(study_schema()), end="")
        parser.exit()


def add_reproduce(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    _add_options(parser, out=Path("results"), files="folder of the results (default: results)")


def _add_options(parser: argparse.ArgumentParser, *, out: Path | None, files: str) -> None:
    resuming = "finished computations are kept with --out, and the same command continues from there"
    parser.set_defaults(unfinished=resuming)
    parser.add_argument("--out", type=Path, default=out, metavar="DIR", help=files)
    parser.add_argument("--quick", action="store_true", help="short excitations and long steps, for a first look")
    parser.add_argument(
        "--jobs",
        type=positive_count,
        metavar="N",
        help="processes (default: all cores for more than three steps; else this one, which shows progress of fits)",
    )


def run_run(options: argparse.Namespace) -> Output:
    """Run a study."""
    return _run_study(options, options.file, options.file, *options.steps)


def run_reproduce(options: argparse.Namespace) -> Output:
    """Run the study of the paper."""
    from problems.paper.reproduce import PAPER  # slow to import, and only needed here

    return _run_study(options, PAPER)


def _run_study(options: argparse.Namespace, study: str | Study, *words: str) -> Output:
    """Run a study; ``words`` are its file and the names of steps, as they were typed."""
    from problems.study.study import run_study  # slow to import, and only needed here

    report = run_study(
        study,
        options.out,
        steps=words[1:],
        quick=options.quick,
        jobs=options.jobs,
        progress=sys.stderr.isatty(),
        command=" ".join(["ancf-casadi", options.title, *words, *["--quick"] * options.quick]),
    )
    return Output(report.to_dict, lambda: "\n\n".join([report.report(), *([str(report.page)] if report.page else [])]))
