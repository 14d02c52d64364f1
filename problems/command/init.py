"""``ancf-casadi init``: a study file to start from."""

from __future__ import annotations

import argparse
from functools import partial
from importlib.resources import files
from pathlib import Path

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.files import check_file, check_ours, write_files
from ancf_casadi.support.tables import to_json
from problems.command.output import Output
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
    closing = f"wrote {path}, and {schema.name} for editors; try: ancf-casadi run {path} simulation --out results"
    return Output(lambda: {"file": str(path), "schema": str(schema)}, str, [write], closing)
