"""``ancf-casadi export``: a beam and its damping for other programs."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from ancf_casadi.support.files import check_folder
from ancf_casadi.support.inputs import located
from problems.command.exporting import FORMATS, export, read_identifications
from problems.command.output import Output, comma_numbers, json_text, new_files, positive_count
from problems.schema.beam import DAMPED_HELP, read_damped


def add_export(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.set_defaults(run=_run)
    parser.epilog = DAMPED_HELP
    parser.add_argument("file", metavar="BEAM.toml", help="tables [beam] and [damping], or a JSON document")
    parser.add_argument("--format", choices=tuple(FORMATS), required=True, help="; ".join(FORMATS.values()))
    parser.add_argument("--out", type=Path, required=True, metavar="PATH", help="file to write; for c, a folder")
    parser.add_argument(
        "--markers",
        type=comma_numbers,
        default=(),
        metavar="S,S,...",
        help="arc lengths (m) of points whose positions are outputs",
    )
    parser.add_argument("--reduced", type=positive_count, metavar="N", help="write the reduced model with N modes")
    parser.add_argument(
        "--identification",
        action="append",
        default=[],
        metavar="RESULT.json",
        help="output of fit-decay --json or match --json to include in json or fmu; may be repeated",
    )
    parser.add_argument(
        "--data",
        action="append",
        default=[],
        metavar="FILE.csv",
        help="record behind each identification, in the same order",
    )


def _run(options: argparse.Namespace) -> Output:
    began = time.perf_counter()
    source = read_damped(options.file)
    if options.format == "c":
        with located("--out"):
            check_folder(options.out)
    else:
        new_files([options.file, *options.identification, *options.data], options.out)
    with located("--markers"):
        for marker in options.markers:
            source.model.element_at(marker)
    found = read_identifications(options.identification, options.data)
    written = export(
        source, options.format, options.out, markers=options.markers, modes=options.reduced, identifications=found
    )
    files = [{"path": str(path), "bytes": path.stat().st_size} for path in written]
    if options.json:
        return Output(json_text({"format": options.format, "files": files, "seconds": time.perf_counter() - began}))
    return Output("\n".join(f"{file['path']}  {file['bytes']} bytes" for file in files))
