"""``ancf-casadi plan``: the standard errors that experiments on a beam will have, and the list worth measuring."""

from __future__ import annotations

import argparse

from ancf_casadi.support.inputs import located
from problems.command.output import Output, add_plot, figure_writers, json_text, new_files, positive_count
from problems.planning.experiments import plan
from problems.schema.plan import PLAN_HELP, read_plan


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = PLAN_HELP
    parser.add_argument(
        "file", metavar="STUDY.toml", help="a file with the tables [beam], [damping] and [[candidates]]"
    )
    parser.add_argument("--jobs", type=positive_count, default=1, metavar="N", help="number of processes (default: 1)")
    add_plot(parser, "draw the errors of each candidate, against its duration and the place of its sensor")


def run(options: argparse.Namespace) -> Output:
    """Run the command."""
    task = read_plan(options.file)
    (plot,) = new_files([options.file], options.plot)
    with located(f"{options.file}: [fit]"):
        found = plan(task.model, task.candidates, task.damping, jobs=options.jobs, progress=True, **task.settings)
    table = task.table
    with located(f"{options.file}: [plan]"):
        best = found.best(table.budget, table.goal, table.most_each)
        shares = found.shares(table.budget, table.goal)
    errors, files = found.errors_of(best), figure_writers(plot, found.figure)
    if options.json:
        choice = {"goal": table.goal, "budget": table.budget, "best": best, "standard_errors": errors, "shares": shares}
        return Output(json_text(found.to_dict() | choice), files)
    chosen = ", ".join(f"{count} x {name}" for name, count in best.items() if count)
    lines = [f"best list within the budget {table.budget:g} for {table.goal}: {chosen}"]
    lines += [f"  {name}: standard error {error:.3g} {found.units[name]}".rstrip() for name, error in errors.items()]
    return Output("\n".join([found.report(), "", *lines]), files)
