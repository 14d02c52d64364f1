"""``ancf-casadi modes``: natural frequencies and mode shapes of a beam about its equilibrium."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ancf_casadi.support.arrays import Array
from ancf_casadi.support.tables import Table
from ancf_casadi.vibration.modes import Modes, natural_modes
from problems.command.output import (
    Output,
    add_plot,
    figure_writer,
    file_writer,
    json_text,
    new_files,
    positive_count,
)
from problems.schema.beam import BEAM_HELP, read_beam

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STATIONS = 101  # points along the beam at which shapes are given


def add_modes(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.set_defaults(run=_run)
    parser.epilog = BEAM_HELP
    parser.add_argument("file", metavar="BEAM.toml", help="a file with the table [beam], or a JSON document")
    parser.add_argument("--count", type=positive_count, default=5, metavar="N", help="number of modes (default: 5)")
    parser.add_argument(
        "--out", type=Path, metavar="FILE.csv", help="write the shapes along the beam; the tip moves by 1 in each"
    )
    add_plot(parser, "draw the shapes")


def _run(options: argparse.Namespace) -> Output:
    model = read_beam(options.file).model
    out, plot = new_files([options.file], options.out, options.plot)
    modes = natural_modes(model, count=options.count)
    arc, shapes = _shapes(modes)
    files = []
    if out is not None:
        files.append(file_writer(out, lambda: _table(arc, shapes).csv()))
    if plot is not None:
        files.append(figure_writer(plot, lambda: _figure(modes)))
    x, y = modes.equilibrium.tip.tolist()
    if options.json:
        result = {
            "frequencies_hz": modes.frequencies.tolist(),
            "equilibrium_tip_m": [x, y],
            "arc_length_m": arc.tolist(),
            "shapes": shapes.tolist(),
        }
        return Output(json_text(result), files)
    rows = list(enumerate(modes.frequencies.tolist(), start=1))
    note = f"the tip rests at ({x:.6g}, {y:.6g}) m"
    return Output(Table("modes", "Natural modes", ("mode", "f_Hz"), rows, (note,)).text(), files)


def _shapes(modes: Modes) -> tuple[Array, Array]:
    """Return arc lengths (m) and the displacement (x, y) of each mode there, (modes, stations, 2); 1 at the tip."""
    arc = np.linspace(0.0, modes.model.beam.length, STATIONS)
    rows = np.stack([modes.model.interpolation(s) @ modes.shapes for s in arc.tolist()])
    return arc, np.moveaxis(rows, 2, 0) / modes.tip_amplitudes()[:, None, None]


def _table(arc: Array, shapes: Array) -> Table:
    names = [f"mode{k}_{axis}" for k in range(1, len(shapes) + 1) for axis in "xy"]
    rows = np.column_stack([arc, np.moveaxis(shapes, 0, 1).reshape(len(arc), -1)])
    return Table("shapes", "Mode shapes", ("arc_length_m", *names), rows.tolist())


def _figure(modes: Modes) -> Figure:
    from ancf_casadi.plot import modes_figure  # matplotlib is slow to import

    return modes_figure(modes)
