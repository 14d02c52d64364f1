"""Checks of arguments: numbers, vectors, names and tables.

Each check returns the value in the form that the toolkit uses, or raises an ``InputError`` that names the argument.
"""

from __future__ import annotations

import contextlib
import math
import re
import reprlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from numbers import Integral
from types import NoneType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array, ComplexArray

SMALLEST_TIME, LARGEST_TIME = 1e-30, 1e30  # s or Hz
LARGEST_WHOLE = 2**31 - 1  # larger ones overflow in libraries
REAL = "biufO"  # kinds of NumPy's types that may hold real numbers
INSTEAD: Mapping[tuple[str, str], str] = {
    ("Beam", "Model"): "Model(beam)",
    ("Model", "Beam"): "model.beam",
    ("Equilibrium", "Model"): "equilibrium.model",
    ("Modes", "Model"): "modes.model",
    ("ReducedModel", "Model"): "reduced.model",
    ("Trajectory", "Model"): "run.model",
    ("Model", "ReducedModel"): "reduce_model(model)",
    ("Beam", "ReducedModel"): "reduce_model(Model(beam))",
    ("Model", "Modes"): "natural_modes(model)",
    ("Beam", "Modes"): "natural_modes(Model(beam))",
    ("Modes", "Equilibrium"): "modes.equilibrium",
    ("Model", "Equilibrium"): "static_equilibrium(model)",
    ("Trajectory", "State"): "run.state(-1)",
    ("ReducedTrajectory", "State"): "run.state(-1)",
    ("ndarray", "State"): "State(coordinates, velocities)",
    ("list", "DampingLaw"): "the sum of the laws",
    ("tuple", "DampingLaw"): "the sum of the laws",
    ("ndarray", "Measurement"): "Measurement(time, displacement)",
}  # (class given, class needed) -> the expression to use instead
IN_WORDS = {
    "str": "a text",
    "PathLike": "a path",
    "Mapping": "a mapping",
    "ndarray": "an array",
    "Integral": "a whole number",
}


@contextlib.contextmanager
def located(where: str) -> Iterator[None]:
    """Put the place of a value, such as a file, a table or an option, in front of the message of an ``InputError``."""
    try:
        yield
    except InputError as error:
        raise InputError(str(error), where) from None


def keep_checked(owner: Any, **checks: Callable[[Any, str], Any]) -> None:
    """Check fields of a frozen dataclass, and keep what their checks return."""
    for name, check in checks.items():
        object.__setattr__(owner, name, check(getattr(owner, name), name))


def number(value: Any, where: str) -> float:
    """Return a finite number as a float."""
    if type(value) is float and math.isfinite(value):  # most numbers, such as those of fine meshes, without delay
        return value
    other = isinstance(value, str | bytes | bool) or (
        isinstance(value, np.ndarray | np.generic) and (value.ndim > 0 or value.dtype.kind not in REAL)
    )
    try:
        result = math.nan if other else float(value)
    except (TypeError, ValueError, OverflowError):
        result = math.nan
    if not math.isfinite(result):
        raise InputError(f"must be a finite number, got {shown(value)}", where)
    return result


def check_instance(value: Any, where: str, *kinds: type) -> None:
    """Check that a value is an instance of a class; the message proposes the right expression where it is known."""
    if not isinstance(value, kinds):
        raise InputError(_mistaken(value, kinds), where)


def instances(values: Any, where: str, *kinds: type, least: int = 1) -> tuple[Any, ...]:
    """Return a sequence of instances of one of some classes, by default of one or more, as a tuple."""
    names = " or ".join(kind.__name__ for kind in kinds)
    if not is_sequence(values):
        advice = "; put it in a list" if isinstance(values, kinds) else ""
        raise InputError(f"must be a sequence of {names}, got {_given(values)}{advice}", where)
    if len(values) < least:
        raise InputError(f"is empty; give at least one{'' if object in kinds else f' {names}'}", where)
    for value in values:
        check_instance(value, where, *kinds)
    return tuple(values)


def choices(values: Any, known: Sequence[str], where: str) -> tuple[str, ...]:
    """Return a sequence of names, each of them a known one."""
    if not is_sequence(values):
        raise InputError(f"must be a sequence of names, got {shown(values)}", where)
    return tuple(choice(value, known, where) for value in values)


def choice(value: Any, known: Sequence[str], where: str) -> str:
    """Return a known name."""
    if not is_one_of(value, known):
        raise InputError(f"must be one of {', '.join(known)}, got {shown(value)}", where)
    return str(value)


def is_one_of(value: Any, known: Sequence[str]) -> bool:
    """Return whether a value is one of some names."""
    return isinstance(value, str) and value in known


def matches(value: Any, pattern: str) -> bool:
    """Return whether a value is a text that matches a regular expression as a whole."""
    return isinstance(value, str) and re.fullmatch(pattern, value) is not None


def _mistaken(value: Any, kinds: tuple[type, ...]) -> str:
    """Return a message with the expected class, the given one, and the expression to use instead."""
    *most, last = [_with_article(kind) for kind in kinds if kind is not NoneType]
    expected = f"{', '.join(most)} or {last}" if most else last
    pairs = [(type(value).__name__, kind.__name__) for kind in kinds]
    instead = [f"; use {INSTEAD[pair]}" for pair in pairs if pair in INSTEAD]
    return f"must be {expected}, got {_given(value)}{''.join(instead[:1])}"


def _given(value: Any) -> str:
    """Return a value as a message about its class shows it."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if value is None or isinstance(value, str | bytes | int | float | complex):
        return shown(value)
    return _with_article(type(value))


def _with_article(kind: type) -> str:
    name = kind.__name__
    return IN_WORDS.get(name) or f"{'an' if name[0] in 'AEIOaeio' else 'a'} {name}"


def shown(value: Any) -> str:
    """Return a value as messages show it: on one line, and shortened if it is long."""
    return " ".join(reprlib.repr(value).split())


def positive(value: Any, where: str) -> float:
    """Return a finite number above zero as a float."""
    result = number(value, where)
    if result <= 0.0:
        raise InputError(f"must be positive, got {result:g}", where)
    return result


def not_negative(value: Any, where: str) -> float:
    """Return a finite number of zero or more as a float."""
    result = number(value, where)
    if result < 0.0:
        raise InputError(f"must not be negative, got {result:g}", where)
    return result


def physical(value: Any, where: str) -> float:
    """Return a time, frequency, amplitude or tolerance: a number from 1e-30 to 1e30, so that its powers are finite."""
    result = positive(value, where)
    if not SMALLEST_TIME <= result <= LARGEST_TIME:
        raise InputError(f"{result:g} is not within {SMALLEST_TIME:g} to {LARGEST_TIME:g}; check the unit", where)
    return result


def check_size(values: ArrayLike, where: str) -> None:
    """Refuse numbers that are not all zero, but so large or small that their powers are not finite."""
    largest = float(np.abs(values).max())
    if largest:
        physical(largest, where)


def sized(value: Any, where: str) -> float:
    """Return a finite number whose powers are finite."""
    result = number(value, where)
    check_size(result, where)
    return result


def sized_vector(value: Any, where: str) -> tuple[float, float]:
    """Return a pair of finite numbers whose powers are finite."""
    result = vector(value, where)
    check_size(result, where)
    return result


def positive_or_infinite(value: Any, where: str) -> float:
    """Return a number above zero, or infinity, as a float."""
    return math.inf if isinstance(value, float) and value == math.inf else positive(value, where)


def flag(value: Any, where: str) -> bool:
    """Return a truth value."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"must be True or False, got {shown(value)}", where)
    return bool(value)


def numbers(values: Any, where: str) -> tuple[float, ...]:
    """Return a sequence of finite numbers."""
    if not is_sequence(values):
        raise InputError(f"must be a sequence of numbers, got {shown(values)}", where)
    return tuple(number(value, where) for value in values)


def is_sequence(value: Any) -> bool:
    """Return whether a value is a sequence or an array, and no text."""
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


def whole(value: Any, where: str, least: int, most: int | None = None) -> int:
    """Return a whole number within its range, which ends at the largest 32-bit number at the latest."""
    whole_one = isinstance(value, Integral) and not isinstance(value, bool)
    if most is None and whole_one and value > LARGEST_WHOLE:
        most = LARGEST_WHOLE
    if not whole_one or value < least or (most is not None and value > most):
        range_ = f"{least} or more" if most is None else f"{least} to {most}"
        raise InputError(f"must be a whole number, {range_}, got {shown(value)}", where)
    return int(value)


def vector(value: Any, where: str) -> tuple[float, float]:
    """Return a pair of finite numbers."""
    if not is_sequence(value) or len(value) != 2:
        raise InputError(f"must be a pair of numbers (x, y), got {shown(value)}", where)
    return number(value[0], where), number(value[1], where)


def unit_vector(value: Any, where: str) -> tuple[float, float]:
    """Return a direction of any positive length as a unit vector."""
    x, y = vector(value, where)
    length = math.hypot(x, y)
    if length == 0.0:
        raise InputError("must not be the zero vector", where)
    if abs(length - 1.0) <= 1e-15:  # a unit vector keeps all its digits
        return x, y
    return x / length, y / length


def array(values: ArrayLike, where: str, *, finite: bool = True) -> Array:
    """Return a copy of numbers as an array."""
    try:
        given = np.asarray(values)
        result = given.astype(float) if given.dtype.kind in REAL else None
    except (TypeError, ValueError, OverflowError):
        result = None
    if result is None:
        raise InputError("must be numbers", where)
    if finite and not np.isfinite(result).all():
        raise InputError("must be finite", where)
    return result


def two_numbers(given: Any, where: str, names: str = "(lower, upper)", *, finite: bool = False) -> tuple[float, float]:
    """Return two numbers that the user gave as a pair."""
    values: Array = array(given, where, finite=finite)
    if values.shape != (2,):
        raise InputError(f"must be a pair {names}, got {shown(given)}", where)
    return float(values[0]), float(values[1])


def positive_array(values: ArrayLike, where: str, shape: tuple[int, ...] | None = None) -> Array:
    """Return a copy of numbers above zero as an array; with a shape, one number may stand for all."""
    found = array(values, where)
    if not (found > 0.0).all():
        raise InputError("must be positive", where)
    try:
        return found if shape is None else np.broadcast_to(found, shape).copy()
    except ValueError:
        raise InputError(f"must be one number, or fit the shape {shape} of the values", where) from None


def complex_array(values: ArrayLike, where: str) -> ComplexArray:
    """Return a copy of finite numbers, real or complex, as an array."""
    if not is_sequence(values):
        raise InputError(f"must be an array of numbers, got {shown(values)}", where)
    try:
        found = np.array(values, dtype=complex)
    except (TypeError, ValueError, OverflowError):
        raise InputError("must be numbers", where) from None
    if not np.isfinite(found).all():
        raise InputError("must be finite", where)
    return found


def check_keys(table: Any, required: set[str], optional: set[str], where: str) -> None:
    """Check that a table has all required keys and no unknown key; name the first missing one, or the unknown ones."""
    if not isinstance(table, dict):
        raise InputError(f"must be a table, got {shown(table)}", where)
    unknown = sorted(table.keys() - required - optional, key=str)
    for key in sorted(required - table.keys()):
        instead = f"; unknown keys: {', '.join(map(shown, unknown))}" if unknown else ""
        raise InputError(f"the key '{key}' is missing{instead}", where)
    for key in unknown:
        raise InputError(f"unknown key {shown(key)}; known are {', '.join(sorted(required | optional))}", where)
