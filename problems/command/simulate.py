"""``ancf-casadi simulate`` and ``response``: the large motion of a beam, and its steady vibration over frequency."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ancf_casadi.dynamics.simulation import simulate
from ancf_casadi.dynamics.trajectory import Trajectory
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.inputs import located, physical
from ancf_casadi.support.tables import Table
from problems.command.output import Output, add_plot, figure_writers, file_writers, finite, new_files
from problems.spec.motion import RESPONSE_HELP, SIMULATION_HELP, ResponseTask, read_response, read_simulation
from problems.study.formatting import formatted_table
from problems.study.kinds.response import SUMMARY_HEADS, Curve, curve_numbers, level_numbers, level_titles, summary_rows


def add_simulate(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = SIMULATION_HELP
    parser.add_argument(
        "file",
        metavar="STUDY.toml",
        help="a file with the tables [beam] and [simulation], and if wanted the others below; init writes one",
    )
    parser.add_argument("--out", type=Path, metavar="FILE.csv", help="write positions of tip, base and markers")
    add_plot(parser, "draw the tip over time, and shapes of the beam")
    parser.add_argument(
        "--animate", type=Path, metavar="FILE", help="write moving pictures as .gif, .mp4 (needs ffmpeg) or .html"
    )
    parser.add_argument(
        "--slower", type=finite, metavar="N", help="show them N times slower than the motion was (default: as needed)"
    )


def run_simulate(options: argparse.Namespace) -> Output:
    """Simulate the motion."""
    given, markers = read_simulation(options.file)
    moving: Path | None = options.animate
    new_files([options.file], options.out, options.plot, moving)
    if moving is not None:
        from ancf_casadi.animation.motions import check_animation  # matplotlib is slow to import

        check_animation(moving)
    elif options.slower is not None:
        raise InputError("needs --animate FILE", "--slower")
    slower = None if options.slower is None else physical(options.slower, "--slower")
    with located(f"{options.file}: [simulation]"):
        run = simulate(progress=True, **given)
    files = [*file_writers(options.out, lambda: _motion(run, markers).csv()), *figure_writers(options.plot, run.figure)]
    if moving is not None:
        files.append(partial(run.animate, moving, slower=slower))
    return Output(partial(_numbers, run), run.report, files)


def _numbers(run: Trajectory) -> dict[str, Any]:
    data = run.to_dict()
    ends = {"samples": len(run.time), "duration_s": data["time_s"][-1], "tip_at_end_m": data["tip_m"][-1]}
    return ends | {name: data[name] for name in ("kind", "tip_travel_m", "steps", "seconds", "integrators")}


def _motion(run: Trajectory, markers: Mapping[str, float]) -> Table:
    places = {"tip": run.tip, "base": run.base} | {name: run.position(s) for name, s in markers.items()}
    columns = ("time_s", *(f"{name}_{axis}_m" for name in places for axis in "xy"))
    return Table("motion", "Motion of the beam", columns, np.column_stack([run.time, *places.values()]).tolist())


def add_response(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = RESPONSE_HELP
    parser.add_argument(
        "file",
        metavar="STUDY.toml",
        help="a file with the tables [beam] and [response], and if wanted [[damping]] and [markers]; init writes one",
    )
    parser.add_argument("--out", type=Path, metavar="FILE.csv", help="write amplitude and phase of tip and markers")
    add_plot(parser, "draw amplitude and phase of the tip")


def run_response(options: argparse.Namespace) -> Output:
    """Follow the steady vibration."""
    task = read_response(options.file)
    new_files([options.file], options.out, options.plot)
    found = [task.curve(level) for level in task.levels]
    curves = [curve_numbers(task, curve) for curve in found]
    titles = level_titles(task.levels, task.unit)
    files = [
        *file_writers(options.out, lambda: _points(task, curves).csv()),
        *figure_writers(options.plot, lambda: found[0].figure(*found[1:], labels=titles)),
    ]
    levels = level_numbers(task.levels, task.unit, curves)
    data = {"modes": task.modes or None, "driven": task.driven, "levels": levels}
    place = "base amplitude" if task.driven == "base" else "force at the tip"
    rows = [(title, *row) for title, row in zip(titles, summary_rows(curves), strict=True)]
    table = formatted_table(Table("response", "Peaks and jumps of the response", (place, *SUMMARY_HEADS), rows))
    lines = [
        f"  {title}: {one['name']} at {one['frequency_hz']:.6g} Hz, tip {1e3 * one['amplitude_m']:.4g} mm"
        for title, curve in zip(titles, curves, strict=True)
        for one in curve["bifurcations"]
    ]
    return Output(lambda: data, lambda: "\n".join([table.text(), *lines]), files)


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
