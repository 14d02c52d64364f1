"""``ancf-casadi look``: a page in the browser that shows records and fits them while the user chooses."""

from __future__ import annotations

import argparse

from ancf_casadi.support.files import open_file
from ancf_casadi.support.optional import find_module
from problems.command.output import Output


def add_look(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "files",
        nargs="*",
        metavar="FILE",
        help="file of measurements, several takes of a mode, frequency response functions, film, or study with [beam] "
        "or [[decays]]; files may also be dropped there",
    )
    about = "do not open the page in a browser, only print its address"
    parser.add_argument("--no-browser", action="store_true", help=about)


def run_look(options: argparse.Namespace) -> Output:
    """Serve the page until it closes."""
    from problems.look.choices import has_beam, read_takes  # these two are slow to import

    for take in [] if has_beam(options.files) else read_takes(options.files):
        with open_file(take.file):
            pass
    find_module("nicegui", "shows the page")
    find_module("tomlkit", "changes the study of a beam")
    from problems.look.server import serve

    serve(options.files, open_browser=not options.no_browser)
    return Output(lambda: {}, lambda: "the page has closed")
