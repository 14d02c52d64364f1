"""A beam and its damping written in the form that a caller names.

JSON and the FMU keep what the beam was identified from; C and CasADi Functions are the equations alone.
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
from ancf_casadi.export.document.strict_json import read_json

Format = Literal["json", "casadi", "c", "fmu"]

FORMATS: dict[Format, str] = {
    "json": "json: a document that can be read again",
    "casadi": "casadi: a file of Functions",
    "c": "c: a folder of C99",
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
        What is written.
    form : {"json", "casadi", "c", "fmu"}
        The format.
    out : Path
        The file; for C, the folder.
    markers : sequence of float
        Arc lengths of points to put out, m.
    modes : int, optional
        How many modes the reduced model keeps, which is then written; the full model if not given.
    identifications : sequence of Identification
        What goes along, after what the document has.

    Raises
    ------
    InputError
        If the format has no place for what is to go along, or as the functions that write it.
    EquilibriumError
        If the beam has no stable equilibrium, and the format needs one.
    """
    if identifications and form not in ("json", "fmu"):
        raise InputError("goes along with json and fmu", "--identification")
    if markers and form == "json":
        raise InputError("JSON holds the beam itself, and no outputs", "--markers")
    if modes is not None and form == "json":
        raise InputError("JSON holds the beam itself, from which the reduced model is made", "--reduced")
    document = replace(
        source,
        identifications=[*source.identifications, *identifications],
        provenance=Provenance.of_this(note=source.provenance.note),
    )
    if form == "json":
        write_document(out, document)
    elif form == "fmu":
        write_fmu(out, document, markers=markers, modes=modes, progress=True)
    else:
        functions = _functions(document, markers, modes)
        if form == "c":
            return write_c(functions, out)
        save_functions(functions, out)
    return (out,)


def _functions(document: Document, markers: Sequence[float], modes: int | None) -> BeamFunctions | ReducedModel:
    if modes is None:
        return beam_functions(document.model, document.damping, markers=markers)
    return reduce_model(document.model, damping=document.damping, markers=markers, modes=modes)


def read_identifications(results: Sequence[str], records: Sequence[str]) -> list[Identification]:
    """Read what commands printed with ``--json``, each with the record it was made from, if these are given.

    Raises
    ------
    InputError
        If a file cannot be read, is no such result, or the records are not as many.
    """
    if records and len(records) != len(results):
        raise InputError(f"there are {len(records)} for {len(results)} results of --identification", "--data")
    pairs = zip(results, [[record] for record in records] or [[] for _ in results], strict=True)
    found = []
    for path, data in pairs:
        result = read_json(path)
        try:
            found.append(Identification.of(result, data=data))
        except InputError as error:
            raise InputError(str(error), path) from None
    return found
