"""Frequency response functions in files: the arguments of an ``FrfRecord``.

The unit of the values tells the kind, and the factor to SI units: displacement, velocity or acceleration per force, or
a quotient of equal quantities for a transmissibility.  Universal files name the input of each function; the functions
of all other files count as outputs of one input.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import NoneType
from typing import Any, get_args

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.over_frequency import SpectralFunction, functions_of, read_spectral
from ancf_casadi.records.recording import unit_notes
from ancf_casadi.records.units import known_unit
from ancf_casadi.response.linear_frf import FrfKind
from ancf_casadi.support.arrays import ComplexArray
from ancf_casadi.support.inputs import check_instance, choice, shown

KINDS_OF_UNITS: dict[tuple[str, str], FrfKind] = {
    ("length", "force"): "receptance",
    ("velocity", "force"): "mobility",
    ("acceleration", "force"): "accelerance",
}
QUOTIENT = ("transmissibility", "relative-transmissibility")


@np.errstate(all="ignore")  # a file may hold any numbers; those that are not finite are refused
def read_frf(
    path: str | Path,
    kind: FrfKind | None,
    *,
    column: str | int | None,
    frequency: str | int | None,
    phase: str | int | None,
    unit: str | None,
    phase_unit: str | None,
    progress: bool,
) -> dict[str, Any]:
    """Return the arguments of the ``FrfRecord`` of a file; see ``FrfRecord.from_file``."""
    check_instance(unit, "unit", str, NoneType)
    if kind is not None:
        choice(kind, get_args(FrfKind), "kind")
    found = read_spectral(path, frequency, progress=progress)
    columns = tuple(("" if part == "level" else part, channel) for part, channel in found.columns)
    found = (
        replace(found, columns=columns)
        .only("--column", ["amplitude", "real", ""], column)
        .only("--phase", ["phase"], phase)
    )
    functions = functions_of(found, phase_unit)
    if not functions:
        raise InputError("has no columns with the values of functions", str(path))
    bare = [one.channel for one in functions if not np.iscomplexobj(one.values)]
    functions = [one for one in functions if np.iscomplexobj(one.values)]
    if not functions:
        raise InputError(
            "has amplitudes only; a function needs its phase, or real and imaginary part",
            f"{path}: column {bare[0].label}",
        )
    found_kind, values = _in_si(functions, kind, unit, str(path))
    notes = [*found.notes, *(f"column {one.label} has no phase, and is left out" for one in bare)]
    notes += () if unit else unit_notes([one.channel for one in functions])
    shape, order = _grid(functions, str(path))
    f = found.frequencies
    quality = [one.coherence for one in functions]
    coherence = None if any(one is None for one in quality) else np.array(quality, dtype=float)
    kept = np.isfinite(f) & np.isfinite(values).all(axis=0) & (f != 0.0)
    if not kept.all():
        notes.append(f"{int((~kept).sum())} lines at 0 Hz or with a gap are left out")
    return {
        "frequencies": f[kept],
        "values": values[order][:, kept].reshape(*shape, -1),
        "kind": found_kind,
        "coherence": None if coherence is None else coherence[order][:, kept].reshape(*shape, -1),
        "notes": tuple(f"{Path(path).name}: {note}" for note in notes),
    }


def _in_si(
    functions: Sequence[SpectralFunction], kind: FrfKind | None, unit: str | None, path: str
) -> tuple[FrfKind, ComplexArray]:
    """Return the kind of the functions and their values in SI units, (functions, k)."""
    values, kinds = [], {kind} if kind else set()
    for function in functions:
        text = unit or function.channel.symbol
        own, factor = frf_unit(text, f"{path}: column {function.channel.label}") if text else (kind, 1.0)
        if own and not (own in QUOTIENT and kind in QUOTIENT):
            kinds.add(own)
        values.append(factor * function.values)
    if len(kinds) != 1:
        what = f"are in units of {' and '.join(sorted(kinds))}" if kinds else "have no unit"
        raise InputError(f"the values {what}; give the kind (--kind), and their unit (--unit)", path)
    return kinds.pop(), np.array(values)


def frf_unit(text: str, where: str) -> tuple[FrfKind, float]:
    """Return the kind of functions with a unit such as ``(mm/s)/N`` or ``g/g``, and the factor to SI units."""
    if text.strip() in ("1", "-"):
        return "transmissibility", 1.0
    for place in [k for k, letter in enumerate(text) if letter == "/"]:
        try:
            above, below = (known_unit(part.strip().strip("()[]"), "") for part in (text[:place], text[place + 1 :]))
        except InputError:
            continue
        kind = KINDS_OF_UNITS.get((above.quantity, below.quantity))
        if kind or above.quantity == below.quantity:
            return kind or "transmissibility", above.factor / below.factor
    raise InputError(f"the unit {shown(text)} is none of such a function; give it with --unit, as mm/N or g/N", where)


def _grid(functions: Sequence[SpectralFunction], path: str) -> tuple[tuple[int, int], list[int]]:
    """Return the numbers of outputs and inputs, and the order of the functions, output after output."""
    outputs = list(dict.fromkeys(one.name for one in functions))
    inputs = list(dict.fromkeys(one.channel.reference for one in functions))
    if len(inputs) == 1:
        return (len(functions), 1), list(range(len(functions)))
    places = {(one.name, one.channel.reference): k for k, one in enumerate(functions)}
    pairs = [(output, source) for output in outputs for source in inputs]
    missing = next((pair for pair in pairs if pair not in places), None)
    if missing or len(places) != len(functions):
        what = f"has no function of {missing[0]} for the input {missing[1]}" if missing else "has a function twice"
        raise InputError(f"{what}; keep the functions of one input, or all of a full matrix", path)
    return (len(outputs), len(inputs)), [places[pair] for pair in pairs]
