"""``ancf-casadi response``: the steady vibration of a beam over a range of frequencies."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from ancf_casadi.support.tables import Table
from problems.command.output import Output, add_plot, figure_writers, file_writers, json_text, new_files
from problems.schema.response import RESPONSE_HELP, ResponseTask, read_response
from problems.study.data_table import Column, DataTable
from problems.study.kinds.response import Curve, curve_numbers, level_numbers, level_titles, summary_columns


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = RESPONSE_HELP
    parser.add_argument(
        "file",
        metavar="STUDY.toml",
        help="a file with the tables [beam] and [response], and if wanted [[damping]] and [markers]; init writes one",
    )
    parser.add_argument("--out", type=Path, metavar="FILE.csv", help="write amplitude and phase of tip and markers")
    add_plot(parser, "draw amplitude and phase of the tip")


def run(options: argparse.Namespace) -> Output:
    """Run the command."""
    task = read_response(options.file)
    out, plot = new_files([options.file], options.out, options.plot)
    found = [task.curve(level) for level in task.levels]
    curves = [curve_numbers(task, curve) for curve in found]
    titles = level_titles(task.levels, task.unit)
    files = [
        *file_writers(out, lambda: _points(task, curves).csv()),
        *figure_writers(plot, lambda: found[0].figure(*found[1:], labels=titles)),
    ]
    if options.json:
        levels = level_numbers(task.levels, task.unit, curves)
        return Output(json_text({"modes": task.modes or None, "driven": task.driven, "levels": levels}), files)
    place = "base amplitude" if task.driven == "base" else "force at the tip"
    columns = (Column(place, titles), *summary_columns(curves))
    lines = [DataTable("Peaks and jumps of the response", columns).text()]
    for title, curve in zip(titles, curves, strict=True):
        lines += [
            f"  {title}: {one['name']} at {one['frequency_hz']:.6g} Hz, tip {1e3 * one['amplitude_m']:.4g} mm"
            for one in curve["bifurcations"]
        ]
    return Output("\n".join(lines), files)


def _points(task: ResponseTask, curves: Sequence[Curve]) -> Table:
    """Return the points of all curves, one row each."""
    quantities = ("amplitude_m", "phase_rad")
    columns = [f"level_{task.unit.lower()}", "frequency_hz", "stable"]
    columns += [f"{name}_{quantity}" for name in curves[0]["points"] for quantity in quantities]
    rows = [
        [level, frequency, int(stable), *values]
        for level, curve in zip(task.levels, curves, strict=True)
        for frequency, stable, *values in zip(
            curve["frequency_hz"],
            curve["stable"],
            *(point[quantity] for point in curve["points"].values() for quantity in quantities),
            strict=True,
        )
    ]
    return Table("response", "Steady vibration", columns, rows)
