"""``ancf-casadi modes`` and ``match``: the modes of a beam, and the nearest beam with the measured frequencies."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

import numpy as np

from ancf_casadi.exceptions import FitError
from ancf_casadi.export import Document, Identification, write_document
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.inputs import located
from ancf_casadi.support.tables import Table
from ancf_casadi.vibration.modes import STATIONS, Modes, natural_modes
from problems.command.output import Output, add_plot, file_writers, new_files, positive_count, result_output
from problems.matching.frequency_matching import match_frequencies
from problems.spec.beam import BEAM_HELP, damping_on, read_beam
from problems.spec.match import MATCH_HELP, read_match


def add_modes(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = BEAM_HELP
    parser.add_argument("file", metavar="BEAM.toml", help="a file with the table [beam], or a JSON document")
    parser.add_argument("--modes", type=positive_count, default=5, metavar="N", help="number of modes (default: 5)")
    parser.add_argument(
        "--out", type=Path, metavar="FILE.csv", help="write the shapes along the beam; the tip moves by 1 in each"
    )
    add_plot(parser, "draw the shapes")


def run_modes(options: argparse.Namespace) -> Output:
    """Compute the modes."""
    model = read_beam(options.file).model
    new_files([options.file], options.out, options.plot)
    modes = natural_modes(model, count=options.modes)
    return result_output(modes, options.plot, file_writers(options.out, lambda: _shapes(modes).csv()))


def _shapes(modes: Modes) -> Table:
    arc = np.linspace(0.0, modes.model.beam.length, STATIONS)
    names = [f"mode{k}_{axis}" for k in range(1, modes.count + 1) for axis in "xy"]
    rows = np.column_stack([arc, np.moveaxis(modes.along(arc), 0, 1).reshape(len(arc), -1)])
    return Table("shapes", "Mode shapes", ("arc_length_m", *names), rows.tolist())


def add_match(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = MATCH_HELP
    parser.add_argument("file", metavar="BEAM.toml", help="a file with the tables [beam] and [match]")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE.json",
        help="write the matched beam, and the damping of the file, as a JSON document",
    )
    add_plot(parser, "draw the properties along the beam")


def run_match(options: argparse.Namespace) -> Output:
    """Match the beam."""
    beam, request = read_match(options.file)
    new_files([options.file], options.out, options.plot)
    with located(f"{options.file}: [match]"):
        match = match_frequencies(beam, **request)
    if match.max_relative_error > 0.5:  # of a frequency; such a beam is not the one that was measured
        raise FitError(f"{options.file}: [match]: {match.warnings[0]}")
    if options.out is None:
        return result_output(match, options.plot)
    model = Model(match.beam)
    document = Document(model, damping_on(options.file, model), [Identification.of(match)])
    return result_output(match, options.plot, [partial(write_document, options.out, document)])
