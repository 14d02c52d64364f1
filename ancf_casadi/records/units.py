"""Units of measurement as people write them, alone or in the name of a column: quantity and factor to SI units.

``UNITS`` lists the symbols, with ``u`` for micro; ``PRODUCTS`` the products and quotients that have a name.
Any other combination is unknown, and the user must state the unit.

In the name of a column, the unit stands in brackets (``Time (ms)``, ``x [mm]``), behind a slash or ``in`` (``x / mm``,
``Weg in mm``), or among the words, usually at the end (``tip_mm``, ``Time ms``, ``acc_m_s2``, ``v_mm_per_s``,
``x_mm_raw``).  The first word names the quantity.  Among the other words, the longest run that denotes a unit counts.
A run that may belong to another unit, as in ``x_mm_per_rev``, ``force_N_m`` or ``area_mm2``, is doubtful, and the user
must state the unit.  So is a length, angle, mass or force behind a number, which may be the place or the size of
something, as in ``acc at 250 mm`` or ``x, 20 g``; but a single digit is an index, as in ``Weg 1 mm``, and so are two
before a line, as in ``marker_12_mm``, and any number before another unit, as in ``Channel 1 V``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.inputs import shown

STANDARD_GRAVITY = 9.80665  # m/s^2
DEGREE = 0.017453292519943295  # rad
MAX_STEP = 1.0  # s; from here on, the time between samples of a vibration counts only with its unit


@dataclass(frozen=True)
class Unit:
    """A unit of measurement."""

    symbol: str  # the unit as it was written
    quantity: str  # quantity that it measures, such as ``length``
    factor: float  # SI units per unit


UNITS: Mapping[str, Mapping[str, float]] = {
    "time": {
        "s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "sek": 1.0, "sekunden": 1.0,
        "ms": 1e-3, "msec": 1e-3, "millisecond": 1e-3, "milliseconds": 1e-3,
        "us": 1e-6, "usec": 1e-6, "microsecond": 1e-6, "microseconds": 1e-6,
        "ns": 1e-9, "nsec": 1e-9, "nanosecond": 1e-9, "nanoseconds": 1e-9,
        "min": 60.0, "minute": 60.0, "minutes": 60.0, "h": 3600.0, "hr": 3600.0, "hour": 3600.0, "hours": 3600.0,
        "day": 86400.0, "days": 86400.0,
    },
    "length": {
        "m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "km": 1e3, "dm": 0.1,
        "cm": 1e-2, "centimeter": 1e-2, "centimeters": 1e-2, "centimetre": 1e-2, "centimetres": 1e-2,
        "mm": 1e-3, "millimeter": 1e-3, "millimeters": 1e-3, "millimetre": 1e-3, "millimetres": 1e-3,
        "um": 1e-6, "micron": 1e-6, "microns": 1e-6, "micrometer": 1e-6, "micrometers": 1e-6, "micrometre": 1e-6,
        "micrometres": 1e-6, "nm": 1e-9,
        "in": 0.0254, "inch": 0.0254, "inches": 0.0254, "ft": 0.3048, "foot": 0.3048, "feet": 0.3048,
        "mil": 2.54e-5, "mils": 2.54e-5, "thou": 2.54e-5,
    },
    "acceleration": {
        "g": STANDARD_GRAVITY, "gn": STANDARD_GRAVITY, "g0": STANDARD_GRAVITY, "gs": STANDARD_GRAVITY,
        "mg": 1e-3 * STANDARD_GRAVITY, "ug": 1e-6 * STANDARD_GRAVITY, "gal": 1e-2,
    },
    "angle": {
        "rad": 1.0, "rads": 1.0, "radian": 1.0, "radians": 1.0, "mrad": 1e-3, "urad": 1e-6,
        "deg": DEGREE, "degs": DEGREE, "degree": DEGREE, "degrees": DEGREE, "°": DEGREE, "Grad": DEGREE,
        "gon": 0.9 * DEGREE,
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
    "velocity": {"mph": 0.44704, "kmh": 1 / 3.6, "kph": 1 / 3.6},
    "angular velocity": {"dps": DEGREE, "rpm": 6.0 * DEGREE},
    "frequency": {"Hz": 1.0, "hz": 1.0, "HZ": 1.0, "kHz": 1e3, "mHz": 1e-3},
    "voltage": {"V": 1.0, "mV": 1e-3, "uV": 1e-6, "volt": 1.0, "volts": 1.0},
    "pressure": {"Pa": 1.0, "hPa": 1e2, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "psi": 6894.757293168},
    "current": {"mA": 1e-3, "uA": 1e-6},
    "pixels": {"px": 1.0, "pix": 1.0, "pixel": 1.0, "pixels": 1.0},
    "counts": {"count": 1.0, "counts": 1.0, "lsb": 1.0},
    "mass": {"kg": 1.0},
    "temperature": {"°C": 1.0, "degC": 1.0},
}  # fmt: skip


KNOWN_UNITS = {name: (quantity, factor) for quantity, units in UNITS.items() for name, factor in units.items()}
PRODUCTS: Mapping[frozenset[tuple[str, int]], str] = {
    frozenset({("length", 1), ("time", -1)}): "velocity",
    frozenset({("length", 1), ("time", -2)}): "acceleration",
    frozenset({("angle", 1), ("time", -1)}): "angular velocity",
    frozenset({("angle", 1), ("time", -2)}): "angular acceleration",
    frozenset({("force", 1), ("length", 1)}): "moment",
    frozenset({("time", -1)}): "frequency",
}  # quantities and their powers -> the quantity of the product
SECOND = {"s", "sec", "second", "seconds"}
SQUARED = {"squared", "sq"}
OVER = {"/", "per"}
PLAIN_SIGNS = str.maketrans({"µ": "u", "μ": "u", "²": "2", "³": "3", "⁻": "-", "¹": "1", "\N{MINUS SIGN}": "-",
                            "º": "°", "∙": "·", "•": "·", "ϵ": "ε", "ɛ": "ε"})  # fmt: skip
LETTER = r"[^\s_.,·⋅*/\-]"
TOKENS = re.compile(rf"\s?/\s?|{LETTER}+(?:-\d(?!{LETTER}))?|[\s_.,·⋅*\-]+")
POWER = re.compile(r"([^\d^+\-]+)\^?([+-]?\d)?")
PER_SECOND = re.compile(r"(.+?)p(?:er)?(s|sec|second)", re.IGNORECASE)
RATE_UNIT = re.compile(
    r"([km]?)(?:hz|sa?/s|sps|fps|1/s|(?:samples?|frames?) ?(?:/|per) ?s(?:ec(?:onds?)?)?)", re.IGNORECASE
)
SCALED = re.compile(r"([+-]?\d+(?:\.\d*)?(?:[eE][+-]?\d+)?(?=[ *]))?[ *]*(\D.*)")
SIZE = re.compile(  # a number with a unit behind it
    r"(?:.*[\W_])?(?:(?:at|bei|@) \d[ *·⋅]|(?:\d\d+|\d+\.\d+)[ *·⋅]|(?:\d{3,}|\d+\.\d+)[_-])", re.DOTALL | re.IGNORECASE
)
BRACKETS = re.compile(r"[(\[{<]([^()\[\]{}<>]*)[)\]}>]")
CAPITALS = {"S", "M", "G", "MM", "CM", "KM", "UM", "IN", "FT", "MS", "US"}  # of programs that know no other letters
AMBIGUOUS_UNITS = {"min", "h", "in", "g", "gs", "mil"}  # as the whole name of a column, these are rarely units
UNCLEAR_UNITS = {"grad", "GRAD"}  # the German degree, Grad, or the gradian, gon
SEPARATING = " _.,·⋅*-"
TIME_NAMES = re.compile(
    r"(?:elapsed|relative|rel\.?|abs\.?|absolute|sample|test|run|local|system)?[ _]*"
    r"(?:t|times?|zeit|temps|tiempo|tempo|tid|tijd|aika|time[ _-]?stamps?|date[ _/-]?time|uhrzeit|messzeit|"
    r"seconds|secs?|milli(?:second)?s|micro(?:second)?s|nano(?:second)?s|x_value)",
    re.IGNORECASE,
)
CLOCK_UNITS = {"millis": "ms", "micros": "us", "nanos": "ns"}  # names of times in a unit, after functions of Arduino
BEFORE_UNIT = re.compile(r" ?[(\[{</,]| in |[_ ](?=[^_ ]*$)")


def _plain_text(text: str) -> str:
    """Return a text with single spaces and without superscripts and Greek letters."""
    return " ".join(text.split()).translate(PLAIN_SIGNS).replace("**", "^")


def _powers(word: str) -> dict[str, tuple[int, float]] | None:
    """Return power and factor of each quantity in a word of a unit, such as ``s2`` or ``mps2``; None if unknown."""
    if word == "1":
        return {}
    unit = _look_up(word)
    if unit:
        return {unit[0]: (1, unit[1])}
    match = POWER.fullmatch(word)
    if not match:
        return None
    symbol, power = match[1], int(match[2] or 1)
    rate = PER_SECOND.fullmatch(symbol) if power > 0 else None
    if rate and _moves(rate[1]):
        return {**_moves(rate[1]), "time": (-power, 1.0)}
    if power < 0 and symbol[-1] == "s" and _moves(symbol[:-1]):  # ms-2: not the inverse of milliseconds
        return {**_moves(symbol[:-1]), "time": (power, 1.0)}
    base = _look_up(symbol)
    return {base[0]: (power, base[1] ** power)} if base else None


def _look_up(symbol: str) -> tuple[str, float] | None:
    """Return quantity and factor of a unit, in any case if no other unit is written so: NM may be N m, H henry."""
    in_any_case = len(symbol) > 2 or symbol in CAPITALS
    return KNOWN_UNITS.get(symbol) or (KNOWN_UNITS.get(symbol.lower()) if in_any_case else None)


def _moves(symbol: str) -> dict[str, tuple[int, float]]:
    """Return a unit of length or angle, which can be per second; empty for other symbols."""
    quantity, factor = _look_up(symbol) or ("", 0.0)
    return {quantity: (1, factor)} if quantity in ("length", "angle") else {}


@lru_cache(maxsize=4096)  # a long name repeats the same few words
def parse_unit(text: str) -> Unit | None:
    """Return the unit that a text denotes; None if unknown.

    Factors are separated by a space, a dot or ``*`` (product), by ``/`` or ``per`` (quotient), or by ``_``, which is a
    quotient before seconds, as in ``m_s2``, and otherwise needs a negative power, as in ``m_s-2``.
    """
    plain = _plain_text(text.strip().strip("()[]{}<>"))
    quantity_and_factor = _look_up(plain.replace(" /", "/").replace("/ ", "/")) or _product(
        TOKENS.findall(plain)
    )  # first um/m
    return Unit(text.strip(), *quantity_and_factor) if quantity_and_factor else None


def _product(tokens: list[str]) -> tuple[str, float] | None:
    """Return quantity and factor of a product of units; None if unknown."""
    total: dict[str, int] = {}
    factor, sign, separator, over = 1.0, 1, "", False
    last: dict[str, tuple[int, float]] | None = None
    for token in tokens:
        if token.strip() in OVER:
            if sign < 0 or last is None:
                return None
            sign, over = -1, True
            continue
        if not re.match(LETTER, token):
            separator += token
            continue
        word = last if token in SQUARED else _powers(token)
        if word is None or "," in separator or (last == {} and sign > 0) or (word == {} and last is not None):
            return None
        if token not in SQUARED and last is not None and sign > 0:
            if "_" in separator and any(power > 0 for power, _ in word.values()):
                if token.rstrip("^23").lower() not in SECOND:
                    return None
                sign = -1
            elif over:  # m/s s: the second s may be above or below
                return None
        if token not in SQUARED:
            word = {name: (sign * power, scale**sign) for name, (power, scale) in word.items()}
        for name, (power, scale) in word.items():
            total[name] = total.get(name, 0) + power
            factor *= scale
        last, sign, separator = word, 1, ""
    if sign < 0 or last is None:
        return None
    if list(total.values()) == [1]:
        return next(iter(total)), factor
    quantity = PRODUCTS.get(frozenset(total.items()))
    return (quantity, factor) if quantity else None


def known_unit(text: object, where: str) -> Unit:
    """Return the unit in an argument; a number before it is a scale, such as ``0.25 mm`` per pixel."""
    match = SCALED.fullmatch(text.strip()) if isinstance(text, str) else None
    unit = parse_unit(match[2]) if match else None
    factor = float(match[1] or 1.0) if match else 0.0
    if unit is None or not 0.0 < abs(factor) < math.inf:
        raise InputError(
            f"{shown(text)} is not a known unit; write for example mm, um, ms, m/s^2, g, deg, or 0.25 mm for a scale",
            where,
        )
    return replace(unit, symbol=str(text).strip(), factor=factor * unit.factor)


def mass_factor(unit: Unit) -> float:
    """Return the kg per unit of a mass; g, mg and ug, which are accelerations elsewhere, are masses here."""
    if unit.quantity == "acceleration" and re.fullmatch(r"[\d.eE+* -]*[muµμ]?g", unit.symbol):
        return 1e-3 * unit.factor / STANDARD_GRAVITY
    if unit.quantity != "mass":
        raise InputError(f"is in {unit.symbol}, a unit of {unit.quantity}, not of mass; state the unit, such as 'g'")
    return unit.factor


def hertz_factor(unit: Unit) -> float:
    """Return the Hz per unit of a frequency, or of an angular velocity such as rad/s or rpm."""
    if unit.quantity not in ("frequency", "angular velocity"):
        raise InputError(f"is in {unit.symbol}, and holds no frequencies")
    return unit.factor if unit.quantity == "frequency" else unit.factor / (2.0 * math.pi)


def sampling_unit(text: str) -> Unit | None:
    """Return the unit of a sampling rate or step, such as kS/s, fps or ms; None if unknown."""
    rate = RATE_UNIT.fullmatch(text.strip())
    factors = {"": 1.0, "k": 1e3, "K": 1e3, "M": 1e6, "m": 1e-3}
    return Unit(text.strip(), "frequency", factors[rate[1]]) if rate else parse_unit(text)


def step_between_samples(number: float, quantity: str, unit: Unit | None = None) -> float:
    """Return the time between samples, s, from a number that states it (``time``) or the rate (``frequency``).

    A unit decides which of them it is.  The step is nan if it is in doubt.
    """
    quantity, value = (unit.quantity, unit.factor * number) if unit else (quantity, number)
    if quantity not in ("time", "frequency") or not 0.0 < value < math.inf:
        return math.nan
    step = value if quantity == "time" else 1.0 / value
    return step if unit or step < MAX_STEP else math.nan


def unit_in_name(name: str) -> tuple[str, Unit | None]:
    """Return the text of the unit in the name of a column, '' if there is none, and the unit, None if unknown."""
    bracketed = [text.strip() for text in BRACKETS.findall(name)]
    for text in bracketed:
        if parse_unit(text):
            return text, parse_unit(text)
    if bracketed and name.rstrip()[-1] in ")]}>":
        return bracketed[-1], None
    written = " ".join(name.split()).replace("**", "^")
    tokens = TOKENS.findall(_plain_text(name))
    items = [k for k, token in enumerate(tokens) if token.strip(SEPARATING)]
    runs = _runs(tokens, items)
    sizes = [begin - 2 for begin, end in runs if end == begin + 1 and _is_size(tokens, begin)]
    doubtful = [*_doubtful(tokens, items, runs), *sizes]
    if not runs and not doubtful:
        return "", None
    places = [*(place for begin, end in runs for place in (begin, end - 1)), *doubtful]
    begin, end = (sum(map(len, tokens[:k])) for k in (min(places), max(places) + 1))
    text = written[begin:end].strip()
    return text, None if doubtful or len(runs) > 1 else parse_unit(text)


def column_unit(written: str, name: str) -> tuple[str, Unit | None]:
    """Return the text of the unit of a column, written beside its name or in it, and the unit, None if unknown."""
    if written:
        return written, parse_unit(written)
    words = re.findall(r"[^\W_]+", name.casefold())
    clock = next((CLOCK_UNITS[word] for word in words if word in CLOCK_UNITS), "")
    return (clock, parse_unit(clock)) if clock and names_time(name.strip()) else unit_in_name(name)


def _runs(tokens: list[str], items: list[int]) -> list[tuple[int, int]]:
    """Return begin and end of each run of tokens that denotes a unit: all of them, or from the second word on."""
    if parse_unit("".join(tokens)) and "".join(tokens) not in AMBIGUOUS_UNITS:
        return [(0, len(tokens))]
    runs: list[tuple[int, int]] = []
    for n, begin in enumerate(items):
        if n == 0 or not _powers(tokens[begin]) or (runs and begin < runs[-1][1]):
            continue
        # words of the longest spelling, such as m per second per second
        ends = [k + 1 for k in reversed(items[n : n + 5]) if parse_unit("".join(tokens[begin : k + 1]))]
        if not ends or (tokens[begin] == "in" and parse_unit("".join(tokens[begin + 1 : ends[0]]).lstrip(SEPARATING))):
            continue  # the preposition, as in Weg in mm
        certain = begin == items[-1] or (len(tokens[begin]) > 1 and tokens[begin] not in AMBIGUOUS_UNITS)
        if certain or ends[0] > begin + 1:
            runs.append((begin, ends[0]))
    return runs


def _doubtful(tokens: list[str], items: list[int], runs: list[tuple[int, int]]) -> list[int]:
    """Return the places outside the runs that may belong to an unknown unit."""
    inside = {k for begin, end in runs for k in range(begin, end)}
    places: list[int] = []
    for before, place, after in zip([None, *items], items, [*items[1:], None], strict=False):
        word = tokens[place]
        previous, following = ("" if k is None else tokens[k] for k in (before, after))
        if place in inside:
            continue
        if word.strip() in OVER:  # x_mm/rev, counts per mm; but s / mm is the quantity s in mm
            quantity = before == 0 or word != word.strip()
            over = before in inside or (parse_unit(previous) and not quantity)
            if over or (word == "per" and parse_unit(following)):
                places += [k for k in (before, place, after) if k is not None]
        elif parse_unit(word):  # force_N_m is a moment or a force per length
            pairs = [(a, b) for a, b in ((previous, word), (word, following)) if a and b and a != "in"]
            if any(parse_unit(f"{a} {b}") or parse_unit(f"{a}/{b}") for a, b in pairs):
                places.append(place)
        elif before is not None and word in UNCLEAR_UNITS:
            places.append(place)
        elif word == "2" and before in inside:  # acc_m_s_2
            begin, end = next(run for run in runs if run[0] <= before < run[1])
            if parse_unit("".join(tokens[begin:end]) + word):
                places.append(place)
        elif before is not None and _powers(word):
            symbol = word.rstrip("0123456789")
            if parse_unit(previous):
                places += [before, place]
            elif (len(symbol) > 1 and symbol not in AMBIGUOUS_UNITS) or previous.strip() in OVER:
                places.append(place)
    return places


def _is_size(tokens: list[str], place: int) -> bool:
    """Return whether the unit at a place belongs to a number before it."""
    unit = parse_unit(tokens[place])
    sized = unit is not None and unit.quantity in ("length", "angle", "acceleration", "force", "mass")
    return sized and SIZE.fullmatch("".join(tokens[max(place - 4, 0) : place])) is not None


def names_time(name: str) -> bool:
    """Return whether the name of a column, without its unit, denotes times."""
    single = " ".join(name.split())
    bare = BEFORE_UNIT.split(single, maxsplit=1)[0] if unit_in_name(name)[0] else single
    return TIME_NAMES.fullmatch(bare) is not None
