"""``ancf-casadi plan``: the standard errors that experiments on a beam will have, and the list worth measuring."""

from __future__ import annotations

import argparse

from problems.command.output import Output, add_plot, figure_writers, new_files, positive_count, result_output
from problems.spec.plan import PLAN_HELP, read_plan


def add_plan(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = PLAN_HELP
    parser.add_argument(
        "file", metavar="STUDY.toml", help="a file with the tables [beam], [damping] and [[candidates]]"
    )
    parser.add_argument(
        "--laws",
        action="store_true",
        help="instead of errors, the probabilities that compare-laws will find the true one of the tables [[damping]] "
        "and their sum, or of the laws of [fit]",
    )
    parser.add_argument("--jobs", type=positive_count, default=1, metavar="N", help="number of processes (default: 1)")
    add_plot(
        parser,
        "draw the errors of each candidate, against its duration and the place of its sensor, or the probabilities",
    )


def run_plan(options: argparse.Namespace) -> Output:
    """Plan the experiments."""
    task = read_plan(options.file)
    new_files([options.file], options.plot)
    if options.laws:
        return result_output(task.compared(jobs=options.jobs, progress=True), options.plot)
    found = task.planned(jobs=options.jobs, progress=True)
    choice = task.chosen(found)
    chosen = ", ".join(f"{count} x {name}" for name, count in choice["best"].items() if count)
    lines = [f"best list within the budget {choice['budget']:g} for {choice['goal']}: {chosen}"]
    errors = choice["standard_errors"]
    lines += [f"  {name}: standard error {error:.3g} {found.units[name]}".rstrip() for name, error in errors.items()]
    text = "\n".join([found.report(), "", *lines])
    return Output(lambda: found.to_dict() | choice, lambda: text, figure_writers(options.plot, found.figure))
