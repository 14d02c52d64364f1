"""``ancf-casadi match``: the beam with the measured frequencies that is nearest to a given one."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from ancf_casadi.export import Document, Identification, write_document
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.inputs import located
from problems.command.output import Output, add_plot, new_files, result_output
from problems.matching.frequency_matching import match_frequencies
from problems.schema.match import MATCH_HELP, read_match


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = MATCH_HELP
    parser.add_argument("file", metavar="BEAM.toml", help="a file with the tables [beam] and [match]")
    parser.add_argument("--out", type=Path, metavar="FILE.json", help="write the matched beam as a JSON document")
    add_plot(parser, "draw the properties along the beam")


def run(options: argparse.Namespace) -> Output:
    """Run the command."""
    beam, request = read_match(options.file)
    out, plot = new_files([options.file], options.out, options.plot)
    with located(f"{options.file}: [match]"):
        match = match_frequencies(beam, **request)
    if out is None:
        return result_output(options, match, plot)
    document = Document(Model(match.beam), identifications=[Identification.of(match)])
    return result_output(options, match, plot, [partial(write_document, out, document)])
