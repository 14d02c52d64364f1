"""Export of a beam and its damping in one of the formats, as ``ancf-casadi export`` does.

JSON and the FMU keep the identifications behind the beam; C and CasADi Functions hold the equation of motion only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from ancf_casadi import ReducedModel, reduce_model
from ancf_casadi.exceptions import InputError
from ancf_casadi.export import (
    BeamFunctions,
    Document,
    Identification,
    Provenance,
    beam_functions,
    save_functions,
    write_c,
    write_document,
    write_fmu,
)
from ancf_casadi.export.strict_json import read_json
from ancf_casadi.support.inputs import located

Format = Literal["json", "casadi", "c", "fmu"]

FORMATS: dict[Format, str] = {
    "json": "json: a document that can be read again",
    "casadi": "casadi: a file of Functions",
    "c": "c: a folder with C99 files",
    "fmu": "fmu: FMI 3.0, model exchange",
}


def export(
    source: Document,
    form: Format,
    out: Path,
    *,
    markers: Sequence[float] = (),
    modes: int | None = None,
    identifications: Sequence[Identification] = (),
) -> Sequence[Path]:
    """Write a beam and its damping, and return the files.

    Parameters
    ----------
    source : Document
        The beam, its damping law and its identifications.
    form : {"json", "casadi", "c", "fmu"}
        The format.
    out : Path
        The file to write; for C, the folder.
    markers : sequence of float
        Arc lengths of the points whose positions are outputs, m.
    modes : int, optional
        Number of modes of the reduced model; the full model is written if not given.
    identifications : sequence of Identification
        Identifications to write after those of the source.
    """
    if identifications and form not in ("json", "fmu"):
        raise InputError(f"cannot be kept in {form}; choose json or fmu", "--identification")
    if markers and form == "json":
        raise InputError("a JSON document has no outputs; choose another format", "--markers")
    if modes is not None and form == "json":
        raise InputError("a JSON document holds the full beam; choose another format", "--reduced")
    document = replace(
        source,
        identifications=[*source.identifications, *identifications],
        provenance=Provenance.of_this(note=source.provenance.note),
    )
    if form == "json":
        write_document(out, document)
        return (out,)
    functions = _functions(document, markers, modes)
    if form == "c":
        return write_c(functions, out)
    if form == "fmu":
        write_fmu(functions, out, document=document, progress=True)
    else:
        save_functions(functions, out)
    return (out,)


def read_identifications(results: Sequence[str], records: Sequence[str]) -> list[Identification]:
    """Read the output of commands with ``--json``; if records are given, hash the record behind each output."""
    if records and len(records) != len(results):
        raise InputError(f"there are {len(records)} for {len(results)} --identification; give one for each", "--data")
    pairs = zip(results, [[record] for record in records] or [[] for _ in results], strict=True)
    found = []
    for path, data in pairs:
        result = read_json(path)
        with located(path):
            found.append(Identification.of(result, data=data))
    return found


def _functions(document: Document, markers: Sequence[float], modes: int | None) -> BeamFunctions | ReducedModel:
    if modes is None:
        return beam_functions(document.model, document.damping, markers=markers)
    with located("--reduced"):
        return reduce_model(document.model, damping=document.damping, markers=markers, modes=modes)
