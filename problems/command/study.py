"""``ancf-casadi init``, ``study`` and ``reproduce``: a file to start from, and a whole study as one document."""

from __future__ import annotations

import argparse
import os
import sys
from functools import partial
from importlib.resources import files
from pathlib import Path

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.files import check_file, check_ours, write_files
from ancf_casadi.support.tables import to_json
from problems.command.output import Output, positive_count
from problems.spec.schema import SCHEMA_FILE

STUDY = files("problems.command").joinpath("study.toml").read_text(encoding="utf-8")  # runs as it is


def add_init(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "file",
        nargs="?",
        type=Path,
        default=Path("study.toml"),
        metavar="STUDY.toml",
        help="file to write, which must not exist yet (default: study.toml)",
    )


def run_init(options: argparse.Namespace) -> Output:
    """Write a commented TOML file, and the schema by which editors complete its keys."""
    from problems.study.study import study_schema  # slow to import

    path: Path = options.file
    if path.suffix.lower() != ".toml":
        raise InputError("must end in .toml", str(path))
    if path.exists() or path.is_symlink():
        raise InputError("exists already; choose another name", str(path))
    schema = path.with_name(SCHEMA_FILE)
    content = to_json(study_schema())
    for target in (path, schema):
        check_file(target)
    check_ours(schema, content[:80])
    name = path.name if path.name.isprintable() else "study.toml"  # in comments, which a line break would end
    write = partial(write_files, {path: STUDY.replace("study.toml", name), schema: content})
    closing = f"wrote {path}, and {schema.name} for editors; try: ancf-casadi simulate {path} --out motion.csv"
    return Output(lambda: {"file": str(path), "schema": str(schema)}, str, [write], closing)


def add_study(parser: argparse.ArgumentParser) -> None:
    """Add the options, and the help on the tables of a study."""
    from problems.study.study import study_help

    parser.epilog = study_help()
    parser.add_argument("file", metavar="STUDY.toml", help="the study; init writes a file to start from")
    add_reproduce(parser)


def add_reproduce(parser: argparse.ArgumentParser) -> None:
    """Add the options, of which ``study`` has some more."""
    parser.set_defaults(
        file=None, unfinished="finished computations are kept, and the same command continues from there"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("results"), metavar="DIR", help="folder of the results (default: results)"
    )
    parser.add_argument("--quick", action="store_true", help="short excitations and long steps, for a first look")
    parser.add_argument(
        "--jobs", type=positive_count, default=os.cpu_count() or 1, metavar="N", help="processes (default: all cores)"
    )


def run_reproduce(options: argparse.Namespace) -> Output:
    """Run a study, which may be an edited copy of that of the paper, or that of the paper itself."""
    from problems.paper.reproduce import ALL_KINDS, PAPER_FILE  # slow to import, and only needed here
    from problems.study.study import write_study

    words = ("ancf-casadi", options.title, options.file, "--quick" if options.quick else None)
    given = [word for word in words if word is not None]
    report = write_study(
        PAPER_FILE if options.file is None else options.file,
        ALL_KINDS,
        options.out,
        quick=options.quick,
        executor=None,
        jobs=options.jobs,
        progress=sys.stderr.isatty(),
        command=" ".join(given),
    )
    return Output(report.to_dict, lambda: f"{report.report()}\n\n{report.page}")


run_study = run_reproduce
