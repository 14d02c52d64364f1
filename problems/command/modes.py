"""``ancf-casadi modes``: natural frequencies and mode shapes of a beam about its equilibrium."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from ancf_casadi.support.tables import Table
from ancf_casadi.vibration.modes import STATIONS, Modes, natural_modes
from problems.command.output import Output, add_plot, file_writers, new_files, positive_count, result_output
from problems.schema.beam import BEAM_HELP, read_beam


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = BEAM_HELP
    parser.add_argument("file", metavar="BEAM.toml", help="a file with the table [beam], or a JSON document")
    parser.add_argument("--modes", type=positive_count, default=5, metavar="N", help="number of modes (default: 5)")
    parser.add_argument(
        "--out", type=Path, metavar="FILE.csv", help="write the shapes along the beam; the tip moves by 1 in each"
    )
    add_plot(parser, "draw the shapes")


def run(options: argparse.Namespace) -> Output:
    """Run the command."""
    model = read_beam(options.file).model
    out, plot = new_files([options.file], options.out, options.plot)
    modes = natural_modes(model, count=options.modes)
    return result_output(options, modes, plot, file_writers(out, lambda: _shapes(modes).csv()))


def _shapes(modes: Modes) -> Table:
    arc = np.linspace(0.0, modes.model.beam.length, STATIONS)
    names = [f"mode{k}_{axis}" for k in range(1, modes.count + 1) for axis in "xy"]
    rows = np.column_stack([arc, np.moveaxis(modes.along(arc), 0, 1).reshape(len(arc), -1)])
    return Table("shapes", "Mode shapes", ("arc_length_m", *names), rows.tolist())
