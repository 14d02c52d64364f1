"""Units of measurement: the quantity and the factor to SI units of a unit as people write it.

``UNITS`` lists the units by their plain spelling: without spaces, dots and ``^``, with ``u`` for micro.  A name of a
column carries a unit in brackets (``Time (ms)``, ``x [mm]``), behind a slash or ``in`` (``x / mm``, ``Weg in mm``), or
at its end (``tip_mm``, ``Time ms``, ``v_mm_per_s``).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.inputs import shown

STANDARD_GRAVITY = 9.80665  # m/s^2
DEGREE = 0.017453292519943295  # rad


@dataclass(frozen=True)
class Unit:
    """A unit of measurement.

    Parameters
    ----------
    symbol : str
        The unit as it was written.
    quantity : str
        Quantity that it measures, such as ``length``.
    factor : float
        SI units per unit.
    """

    symbol: str
    quantity: str
    factor: float


TIME = {
    "s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "sek": 1.0, "sekunden": 1.0,
    "ms": 1e-3, "msec": 1e-3, "millisecond": 1e-3, "milliseconds": 1e-3,
    "us": 1e-6, "usec": 1e-6, "microsecond": 1e-6, "microseconds": 1e-6,
    "ns": 1e-9, "nsec": 1e-9, "nanosecond": 1e-9, "nanoseconds": 1e-9,
    "min": 60.0, "minute": 60.0, "minutes": 60.0, "h": 3600.0, "hr": 3600.0, "hour": 3600.0, "hours": 3600.0,
    "day": 86400.0, "days": 86400.0,
}  # fmt: skip
LENGTH = {
    "m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "km": 1e3, "dm": 0.1,
    "cm": 1e-2, "centimeter": 1e-2, "centimeters": 1e-2, "centimetre": 1e-2, "centimetres": 1e-2,
    "mm": 1e-3, "millimeter": 1e-3, "millimeters": 1e-3, "millimetre": 1e-3, "millimetres": 1e-3,
    "um": 1e-6, "micron": 1e-6, "microns": 1e-6, "micrometer": 1e-6, "micrometers": 1e-6, "micrometre": 1e-6,
    "micrometres": 1e-6, "nm": 1e-9,
    "in": 0.0254, "inch": 0.0254, "inches": 0.0254, "ft": 0.3048, "foot": 0.3048, "feet": 0.3048,
    "mil": 2.54e-5, "mils": 2.54e-5, "thou": 2.54e-5,
}  # fmt: skip
OTHERS: Mapping[str, Mapping[str, float]] = {
    "acceleration": {
        "g": STANDARD_GRAVITY, "gn": STANDARD_GRAVITY, "g0": STANDARD_GRAVITY, "gs": STANDARD_GRAVITY,
        "mg": 1e-3 * STANDARD_GRAVITY, "ug": 1e-6 * STANDARD_GRAVITY, "gal": 1e-2,
    },
    "angle": {
        "rad": 1.0, "rads": 1.0, "radian": 1.0, "radians": 1.0, "mrad": 1e-3, "urad": 1e-6,
        "deg": DEGREE, "degs": DEGREE, "degree": DEGREE, "degrees": DEGREE, "°": DEGREE, "grad": 0.9 * DEGREE,
    },
    "strain": {
        "strain": 1.0, "m/m": 1.0, "mm/mm": 1.0, "ε": 1.0, "mm/m": 1e-3, "um/m": 1e-6, "ustrain": 1e-6,
        "microstrain": 1e-6, "microstrains": 1e-6, "uε": 1e-6, "ue": 1e-6, "ueps": 1e-6,
    },
    "force": {
        "N": 1.0, "newton": 1.0, "newtons": 1.0, "mN": 1e-3, "uN": 1e-6, "kN": 1e3, "lbf": 4.4482216152605,
        "kgf": STANDARD_GRAVITY, "gf": 1e-3 * STANDARD_GRAVITY,
    },
    "moment": {"Nm": 1.0, "Nmm": 1e-3, "mNm": 1e-3, "Ncm": 1e-2, "kNm": 1e3},
    "angular velocity": {
        "rad/s": 1.0, "mrad/s": 1e-3, "deg/s": DEGREE, "°/s": DEGREE, "dps": DEGREE, "rpm": 6.0 * DEGREE,
    },
    "frequency": {"Hz": 1.0, "kHz": 1e3, "1/s": 1.0},
    "voltage": {"V": 1.0, "mV": 1e-3, "uV": 1e-6, "volt": 1.0, "volts": 1.0},
    "pixels": {"px": 1.0, "pix": 1.0, "pixel": 1.0, "pixels": 1.0},
    "counts": {"count": 1.0, "counts": 1.0, "lsb": 1.0},
    "mass": {"kg": 1.0},
    "temperature": {"°C": 1.0, "degC": 1.0},
}  # fmt: skip


def _table() -> Mapping[str, tuple[str, float]]:
    table = {name: ("time", factor) for name, factor in TIME.items()}
    table |= {name: ("length", factor) for name, factor in LENGTH.items()}
    for quantity, units in OTHERS.items():
        table |= {name: (quantity, factor) for name, factor in units.items()}
    for length, metres in LENGTH.items():
        for time, seconds in TIME.items():
            table.setdefault(f"{length}/{time}", ("velocity", metres / seconds))
            for spelling in (f"{length}/{time}2", f"{length}/{time}/{time}"):
                table.setdefault(spelling, ("acceleration", metres / seconds**2))
        table[f"{length}s-1"] = ("velocity", metres)  # only with s: mms-1 could be millimetres or metres
        table[f"{length}s-2"] = ("acceleration", metres)
    return MappingProxyType(table)


UNITS = _table()  # plain spelling -> quantity, SI units per unit
PLAIN = str.maketrans({"µ": "u", "μ": "u", "²": "2", "⁻": "-", "¹": "1", "\N{MINUS SIGN}": "-"})
SILENT = str.maketrans(dict.fromkeys(" .·⋅*^_"))
SCALED = re.compile(r"([+-]?\d+\.?\d*(?:[eE][+-]?\d+)?(?=[ *]))?[ *]*(\D.*)")
SEPARATORS = re.compile(r"[_\s.\-]+")
BRACKETS = re.compile(r"[(\[{<]([^()\[\]{}<>]*)[)\]}>]")
BEHIND = re.compile(r"\s*/\s*(\S.*)$|\s+in\s+(\S+)$|,\s*(\S+)$|\s(\S+)$")
COUNTERS = {"min", "h", "in", "g", "gs", "grad", "mil"}  # as the whole name of a column, these are rarely units


def parse_unit(text: str) -> Unit | None:
    """Return the unit that a text denotes; None if it is not understood."""
    plain = text.strip().strip("()[]{}<>").translate(PLAIN).translate(SILENT).replace("per", "/")
    for spelling in (plain, plain.lower()):
        if spelling in UNITS:
            return Unit(text.strip(), *UNITS[spelling])
    return None


def known_unit(text: object, where: str) -> Unit:
    """Return the unit that an argument denotes; a number before it is a scale, such as ``0.25 mm`` per pixel.

    Raises
    ------
    InputError
        If it is not understood.
    """
    match = SCALED.fullmatch(text.strip()) if isinstance(text, str) else None
    unit = parse_unit(match[2]) if match else None
    factor = float(match[1] or 1.0) if match else 0.0
    if unit is None or not 0.0 < abs(factor) < math.inf:
        raise InputError(
            f"{shown(text)} is not a known unit; write for example mm, um, ms, m/s^2, g, deg, or 0.25 mm for a scale",
            where,
        )
    return replace(unit, symbol=str(text).strip(), factor=factor * unit.factor)


def unit_in_name(name: str) -> tuple[str, Unit | None]:
    """Return the unit that the name of a column carries, as it is written there, and its meaning.

    The text is empty if the name carries no unit; the meaning is None if the unit is not understood.
    """
    bracketed = [text.strip() for text in BRACKETS.findall(name)]
    for text in bracketed:
        if parse_unit(text):
            return text, parse_unit(text)
    if bracketed and name.rstrip()[-1] in ")]}>":
        return bracketed[-1], None
    if parse_unit(name) and name not in COUNTERS:
        return name, parse_unit(name)
    behind = BEHIND.search(name)
    if behind:
        text = next(part for part in behind.groups() if part)
        if parse_unit(text):
            return text, parse_unit(text)
    return _unit_in_parts(SEPARATORS.split(name))


def _unit_in_parts(parts: list[str]) -> tuple[str, Unit | None]:
    """Return the unit at the end of a name such as ``tip_mm`` or ``v_mm_per_s``, or within one such as ``x_mm_raw``."""
    if len(parts) > 3 and parts[-2] == "per":
        text = f"{parts[-3]}/{parts[-1]}"
        return text, parse_unit(text)
    last = len(parts) - 1
    certain = [k == last or (len(part) > 1 and part not in COUNTERS) for k, part in enumerate(parts)]
    units = [(part, parse_unit(part)) for k, part in enumerate(parts) if k and certain[k]]
    found = [(part, unit) for part, unit in units if unit]
    if len(found) > 1:
        return "_".join(part for part, _ in found), None
    return found[0] if found else ("", None)
