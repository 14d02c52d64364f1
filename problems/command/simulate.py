"""``ancf-casadi simulate``: the large motion of a beam."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from ancf_casadi.dynamics.simulation import simulate
from ancf_casadi.dynamics.trajectory import Trajectory
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.inputs import located, physical
from ancf_casadi.support.tables import Table
from problems.command.output import Output, add_plot, figure_writers, file_writers, finite, json_text, new_files
from problems.schema.motion import SIMULATION_HELP, read_simulation


def add_options(parser: argparse.ArgumentParser) -> None:
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


def run(options: argparse.Namespace) -> Output:
    """Run the command."""
    study = read_simulation(options.file)
    out, plot, moving = new_files([options.file], options.out, options.plot, options.animate)
    if moving is not None:
        from ancf_casadi.animation.motions import check_animation  # matplotlib is slow to import

        check_animation(moving)
    elif options.slower is not None:
        raise InputError("needs --animate FILE", "--slower")
    slower = None if options.slower is None else physical(options.slower, "--slower")
    with located(f"{options.file}: [simulation]"):
        run = simulate(study.model, damping=study.damping, base=study.base, progress=True, **study.settings)
    files = [*file_writers(out, lambda: _motion(run, study.markers).csv()), *figure_writers(plot, run.figure)]
    if moving is not None:
        files.append(partial(run.animate, moving, slower=slower))
    if not options.json:
        return Output(run.report(), files)
    data = run.to_dict()
    numbers = {name: data[name] for name in ("kind", "tip_travel_m", "steps", "seconds", "integrators")}
    ends = {"samples": len(run.time), "duration_s": data["time_s"][-1], "tip_at_end_m": data["tip_m"][-1]}
    return Output(json_text(ends | numbers), files)


def _motion(run: Trajectory, markers: Mapping[str, float]) -> Table:
    places = {"tip": run.tip, "base": run.base} | {name: run.position(s) for name, s in markers.items()}
    columns = ("time_s", *(f"{name}_{axis}_m" for name in places for axis in "xy"))
    return Table("motion", "Motion of the beam", columns, np.column_stack([run.time, *places.values()]).tolist())
