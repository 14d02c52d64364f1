"""``ancf-casadi export``: a beam and its damping for other programs.

JSON and the FMUs keep the identifications behind the beam; C and CasADi Functions hold the equation of motion only; the
files for simulators hold the beam in the terms of these programs, and the command prints how well they fit.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from ancf_casadi import ReducedModel, reduce_model
from ancf_casadi.exceptions import InputError
from ancf_casadi.export import (
    BeamFunctions,
    Document,
    ExportedBeam,
    Identification,
    Provenance,
    beam_functions,
    save_functions,
    write_c,
    write_document,
    write_exudyn,
    write_fmu,
    write_mujoco,
    write_newton,
    write_pyelastica,
)
from ancf_casadi.export.fmu import FmuKind
from ancf_casadi.support.files import check_folder, read_json
from ancf_casadi.support.inputs import error_prefix
from problems.command.output import Output, add_options, comma_numbers, finite, new_files, option_values, positive_count
from problems.spec.beam import read_damped_beam

FORMATS = {
    "json": "json: a document that can be read again",
    "casadi": "casadi: a file of Functions",
    "c": "c: a folder with C99 files",
    "fmu": "fmu: FMI 3.0, model exchange",
    "co-simulation": "co-simulation: FMI 3.0, an FMU with steps of its own",
    "mujoco": "mujoco: a model file (MJCF)",
    "pyelastica": "pyelastica: a script with a Cosserat rod",
    "exudyn": "exudyn: a script with the same elements",
    "newton": "newton: a script with links and hinges, or a USD curve if the file is named .usda",
}
UNDAMPED = "{file} has no damping, so that the exported beam swings for ever; {advice}"
DAMP_TABLES = "add [[damping]] to the file"
DAMP_DOCUMENT = 'export a TOML file with [beam] document = "{file}" and [[damping]]'
SIMULATORS: dict[str, Callable[..., ExportedBeam]] = {
    "mujoco": write_mujoco,
    "pyelastica": write_pyelastica,
    "exudyn": write_exudyn,
    "newton": write_newton,
}


SIMULATOR_OPTIONS, DOCUMENT_OPTIONS = ("segments", "tolerance", "amplitude"), ("identification", "data")
REFUSED = {  # options by format
    **dict.fromkeys(("fmu", "co-simulation"), SIMULATOR_OPTIONS),
    **dict.fromkeys(("c", "casadi"), (*SIMULATOR_OPTIONS, *DOCUMENT_OPTIONS)),
    **dict.fromkeys(SIMULATORS, ("markers", "reduced", *DOCUMENT_OPTIONS)),
    "json": (*SIMULATOR_OPTIONS, "markers", "reduced"),
    "exudyn": ("segments", "markers", "reduced", *DOCUMENT_OPTIONS),
}


def add_export(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.epilog = "ancf-casadi run --keys lists the keys of the tables"
    parser.add_argument("file", metavar="BEAM.toml", help="tables [beam] and [damping], or a JSON document")
    parser.add_argument("--format", choices=tuple(FORMATS), required=True, help="; ".join(FORMATS.values()))
    parser.add_argument("--out", type=Path, required=True, metavar="PATH", help="file to write; for c, a folder")
    parser.set_defaults(markers=())
    add_options(
        parser,
        markers=(comma_numbers, "S,S,...", "arc lengths (m) of points whose positions are outputs"),
        reduced=(positive_count, "N", "write the reduced model with N modes"),
        segments=(positive_count, "N", "of a beam for a simulator; else the fewest"),
        tolerance=(finite, "X", "relative error of its first three frequencies, 0.01 if not given"),
        amplitude=(finite, "M", "tip amplitude (m) at which laws that depend on it are represented"),
    )
    about = "output of fit-decay --json or run --json to include in json or an FMU; may be repeated"
    parser.add_argument("--identification", action="append", default=[], metavar="RESULT.json", help=about)
    about = "record behind each identification, in the same order"
    parser.add_argument("--data", action="append", default=[], metavar="FILE.csv", help=about)


def run_export(options: argparse.Namespace) -> Output:
    """Write the files."""
    began = time.perf_counter()
    source = read_damped_beam(options.file)
    if options.format == "c":
        with error_prefix("--out"):
            check_folder(options.out)
    else:
        new_files([options.file, *options.identification, *options.data], options.out)
    with error_prefix("--markers"):
        for marker in options.markers:
            source.model.element_at(marker)
    for name in REFUSED[options.format]:
        if getattr(options, name) not in (None, (), []):
            raise InputError(f"does not apply to {options.format}; leave it out, or choose another format", f"--{name}")
    beam: ExportedBeam | None = None
    if options.format in SIMULATORS:
        settings = option_values(options, SIMULATOR_OPTIONS)
        beam = SIMULATORS[options.format](source.model, options.out, damping=source.damping, **settings)
    paths = [options.out] if beam else _export(source, options)
    files = [{"path": str(path), "bytes": path.stat().st_size} for path in paths]
    advice = DAMP_DOCUMENT.format(file=options.file) if options.file.endswith(".json") else DAMP_TABLES
    notes = [] if source.damping else [UNDAMPED.format(file=options.file, advice=advice)]
    data = {"format": options.format, "files": files, "seconds": time.perf_counter() - began, "warnings": notes}
    lines = [f"{file['path']}  {file['bytes']} bytes" for file in files]
    text = "\n".join([*lines, *(f"note: {note}" for note in notes)])
    if beam is None:
        return Output(lambda: data, lambda: text)
    return Output(lambda: data | {"beam": beam.to_dict()}, lambda: f"{text}\n\n{beam.report()}")


def _export(source: Document, options: argparse.Namespace) -> Sequence[Path]:
    """Write a beam and its damping, and return the files."""
    form, out, markers, modes = options.format, options.out, options.markers, options.reduced
    identifications = _identifications(options.identification, options.data)
    document = replace(
        source,
        identifications=[*source.identifications, *identifications],
        provenance=Provenance.of_this(note=source.provenance.note),
    )
    if form == "json":
        write_document(out, document)
        return (out,)
    functions: BeamFunctions | ReducedModel
    if modes is None:
        functions = beam_functions(document.model, document.damping, markers=markers)
    else:
        with error_prefix("--reduced"):
            functions = reduce_model(document.model, damping=document.damping, markers=markers, modes=modes)
    if form == "c":
        return write_c(functions, out)
    if form == "casadi":
        save_functions(functions, out)
    else:
        kind: FmuKind = "co-simulation" if form == "co-simulation" else "model-exchange"
        write_fmu(functions, out, kind=kind, document=document, progress=True)
    return (out,)


def _identifications(results: Sequence[str], records: Sequence[str]) -> list[Identification]:
    """Read the output of commands with ``--json``; if records are given, hash the record behind each output."""
    if records and len(records) != len(results):
        raise InputError(f"there are {len(records)} for {len(results)} --identification; give one for each", "--data")
    pairs = zip(results, [[record] for record in records] or [[] for _ in results], strict=True)
    identifications = []
    for path, data in pairs:
        result = read_json(path)
        with error_prefix(path):
            identifications.append(Identification.of(result, data=data))
    return identifications
