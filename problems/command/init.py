"""``ancf-casadi init``: a commented TOML file that runs as it is."""

from __future__ import annotations

import argparse
from functools import partial
from importlib.resources import files
from pathlib import Path

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.files import check_file, write_file
from problems.command.output import Output, json_text

STUDY = files("problems.command").joinpath("study.toml").read_text(encoding="utf-8")  # runs as it is


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "file",
        nargs="?",
        type=Path,
        default=Path("study.toml"),
        metavar="STUDY.toml",
        help="file to write, which must not exist yet (default: study.toml)",
    )


def run(options: argparse.Namespace) -> Output:
    """Run the command."""
    path: Path = options.file
    if path.suffix.lower() != ".toml":
        raise InputError("must end in .toml", str(path))
    if path.exists() or path.is_symlink():
        raise InputError("exists already; choose another name", str(path))
    check_file(path)
    name = path.name if path.name.isprintable() else "study.toml"  # in comments, which a line break would end
    write = partial(write_file, path, STUDY.replace("study.toml", name))
    if options.json:
        return Output(json_text({"file": str(path)}), [write])
    return Output("", [write], f"wrote {path}; try: ancf-casadi simulate {path} --out motion.csv")
