"""``ancf-casadi modes``: natural frequencies of a beam about its equilibrium."""

from __future__ import annotations

import argparse

from ancf_casadi.support.tables import Table
from ancf_casadi.vibration.modes import natural_modes
from problems.command.output import Output, Subcommands, json_text
from problems.command.study_file import TABLE_KEYS, read_model


def add_modes(commands: Subcommands) -> None:
    """Add the subcommand."""
    parser = commands.add(
        "modes", _run, "compute the natural frequencies of a beam about its equilibrium", epilog=TABLE_KEYS
    )
    parser.add_argument("file", metavar="BEAM.toml", help="a file with the table [beam], or a JSON document")
    parser.add_argument("--count", type=int, default=5, metavar="N", help="number of modes (default: 5)")


def _run(options: argparse.Namespace) -> Output:
    modes = natural_modes(read_model(options.file), count=options.count)
    x, y = modes.equilibrium.tip.tolist()
    if options.json:
        return Output(json_text({"frequencies_hz": modes.frequencies.tolist(), "equilibrium_tip_m": [x, y]}))
    rows = list(enumerate(modes.frequencies.tolist(), start=1))
    note = f"the tip rests at ({x:.6g}, {y:.6g}) m"
    return Output(Table("modes", "Natural modes", ("mode", "f_Hz"), rows, (note,)).text())
