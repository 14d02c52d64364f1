"""Frequency response functions in files: their kind, their values in SI units, and their order.

The unit of the values tells the kind, and the factor to SI units: displacement, velocity or acceleration per force, or
a quotient of equal quantities for a transmissibility.  Universal files name the input of each function; the functions
of all other files count as outputs of one input.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.over_frequency import SpectralFunction
from ancf_casadi.records.units import known_unit
from ancf_casadi.response.linear_frf import FrfKind
from ancf_casadi.support.arrays import ComplexArray
from ancf_casadi.support.inputs import shown

KINDS_OF_UNITS: dict[tuple[str, str], FrfKind] = {
    ("length", "force"): "receptance",
    ("velocity", "force"): "mobility",
    ("acceleration", "force"): "accelerance",
}
QUOTIENT = ("transmissibility", "relative-transmissibility")


def in_si(
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


def grid_of(functions: Sequence[SpectralFunction], path: str) -> tuple[tuple[int, int], list[int]]:
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
