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
MAX_INTEGER = 2**31 - 1  # larger ones overflow in libraries
REAL_KINDS = "biufO"  # kinds of NumPy's types that may hold real numbers
REPLACEMENTS: Mapping[tuple[str, str], str] = {
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
}  # expression that replaces an instance of the first class if the second is needed
CLASS_NAMES = {
    "str": "a text",
    "PathLike": "a path",
    "Mapping": "a mapping",
    "ndarray": "an array",
    "Integral": "a whole number",
}


@contextlib.contextmanager
def error_prefix(where: str) -> Iterator[None]:
    """Prefix the message of an ``InputError`` with a place, such as a file, a table or an option."""
    try:
        yield
    except InputError as error:
        raise InputError(str(error), where) from None


def check_fields(owner: Any, **checks: Callable[[Any, str], Any]) -> None:
    """Check fields of a frozen dataclass, and replace them by the results of their checks."""
    for name, check in checks.items():
        object.__setattr__(owner, name, check(getattr(owner, name), name))


def number(value: Any, where: str) -> float:
    """Return a finite number as a float."""
    if type(value) is float and math.isfinite(value):  # the usual case is fast, for instance for fine meshes
        return value
    is_other = isinstance(value, str | bytes | bool) or (
        isinstance(value, np.ndarray | np.generic) and (value.ndim > 0 or value.dtype.kind not in REAL_KINDS)
    )
    try:
        result = math.nan if is_other else float(value)
    except (TypeError, ValueError, OverflowError):
        result = math.nan
    if not math.isfinite(result):
        raise InputError(f"must be a finite number, got {shown(value)}", where)
    return result


def check_instance(value: Any, where: str, *kinds: type) -> None:
    """Check that a value is an instance of a class; the message proposes a replacement from ``REPLACEMENTS``."""
    if not isinstance(value, kinds):
        raise InputError(_class_message(value, kinds), where)


def instances(values: Any, where: str, *kinds: type, minimum: int = 1) -> tuple[Any, ...]:
    """Return a sequence of at least ``minimum`` instances of the classes as a tuple."""
    names = " or ".join(kind.__name__ for kind in kinds)
    if not is_sequence(values):
        advice = "; put it in a list" if isinstance(values, kinds) else ""
        raise InputError(f"must be a sequence of {names}, got {_describe_class(values)}{advice}", where)
    if len(values) < minimum:
        raise InputError(f"is empty; give at least one{'' if object in kinds else f' {names}'}", where)
    for value in values:
        check_instance(value, where, *kinds)
    return tuple(values)


def choices(values: Any, options: Sequence[str], where: str) -> tuple[str, ...]:
    """Return a sequence of names, each of which must be one of the options."""
    if not is_sequence(values):
        raise InputError(f"must be a sequence of names, got {shown(values)}", where)
    return tuple(choice(value, options, where) for value in values)


def choice(value: Any, options: Sequence[str], where: str) -> str:
    """Return a name, which must be one of the options."""
    if not is_choice(value, options):
        raise InputError(f"must be one of {', '.join(options)}, got {shown(value)}", where)
    return str(value)


def is_choice(value: Any, options: Sequence[str]) -> bool:
    """Return whether a value is one of the options."""
    return isinstance(value, str) and value in options


def matches(value: Any, pattern: str) -> bool:
    """Return whether a value is a text that matches a regular expression as a whole."""
    return isinstance(value, str) and re.fullmatch(pattern, value) is not None


def _class_message(value: Any, kinds: tuple[type, ...]) -> str:
    """Return a message with the expected class, the actual one, and its replacement."""
    *names, last_name = [_with_article(kind) for kind in kinds if kind is not NoneType]
    expected = f"{', '.join(names)} or {last_name}" if names else last_name
    pairs = [(type(value).__name__, kind.__name__) for kind in kinds]
    advice = [f"; use {REPLACEMENTS[pair]}" for pair in pairs if pair in REPLACEMENTS]
    return f"must be {expected}, got {_describe_class(value)}{''.join(advice[:1])}"


def _describe_class(value: Any) -> str:
    """Describe a value for a message about its class."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if value is None or isinstance(value, str | bytes | int | float | complex):
        return shown(value)
    return _with_article(type(value))


def _with_article(kind: type) -> str:
    name = kind.__name__
    return CLASS_NAMES.get(name) or f"{'an' if name[0] in 'AEIOaeio' else 'a'} {name}"


def shown(value: Any) -> str:
    """Return the representation of a value for messages, on one line and shortened."""
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
    """Return a time, frequency, amplitude or tolerance: a number from 1e-30 to 1e30, whose powers are finite."""
    result = positive(value, where)
    if not SMALLEST_TIME <= result <= LARGEST_TIME:
        raise InputError(f"{result:g} is not within {SMALLEST_TIME:g} to {LARGEST_TIME:g}; check the unit", where)
    return result


def check_size(values: ArrayLike, where: str) -> None:
    """Check that the largest of some numbers is zero or has finite powers."""
    largest = float(np.abs(values).max())
    if largest:
        physical(largest, where)


def limited_number(value: Any, where: str) -> float:
    """Return a finite number whose powers are finite."""
    result = number(value, where)
    check_size(result, where)
    return result


def limited_vector(value: Any, where: str) -> tuple[float, float]:
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
    """Return whether a value is a sequence or an array, but not a text."""
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


def whole(value: Any, where: str, minimum: int, maximum: int | None = None) -> int:
    """Return a whole number within a range, which never extends beyond 32-bit integers."""
    is_whole = isinstance(value, Integral) and not isinstance(value, bool)
    if maximum is None and is_whole and value > MAX_INTEGER:
        maximum = MAX_INTEGER
    if not is_whole or value < minimum or (maximum is not None and value > maximum):
        range_ = f"{minimum} or more" if maximum is None else f"{minimum} to {maximum}"
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
        raw = np.asarray(values)
        result = raw.astype(float) if raw.dtype.kind in REAL_KINDS else None
    except (TypeError, ValueError, OverflowError):
        result = None
    if result is None:
        raise InputError("must be numbers", where)
    if finite and not np.isfinite(result).all():
        raise InputError("must be finite", where)
    return result


def two_numbers(pair: Any, where: str, names: str = "(lower, upper)", *, finite: bool = False) -> tuple[float, float]:
    """Return a pair of numbers as floats."""
    values: Array = array(pair, where, finite=finite)
    if values.shape != (2,):
        raise InputError(f"must be a pair {names}, got {shown(pair)}", where)
    return float(values[0]), float(values[1])


def positive_array(values: ArrayLike, where: str, shape: tuple[int, ...] | None = None) -> Array:
    """Return a copy of numbers above zero as an array, broadcast to a shape if it is given."""
    result = array(values, where)
    if not (result > 0.0).all():
        raise InputError("must be positive", where)
    try:
        return result if shape is None else np.broadcast_to(result, shape).copy()
    except ValueError:
        raise InputError(f"must be one number, or fit the shape {shape} of the values", where) from None


def complex_array(values: ArrayLike, where: str) -> ComplexArray:
    """Return a copy of finite numbers, real or complex, as an array."""
    if not is_sequence(values):
        raise InputError(f"must be an array of numbers, got {shown(values)}", where)
    try:
        result = np.array(values, dtype=complex)
    except (TypeError, ValueError, OverflowError):
        raise InputError("must be numbers", where) from None
    if not np.isfinite(result).all():
        raise InputError("must be finite", where)
    return result


def check_keys(table: Any, required: set[str], optional: set[str], where: str) -> None:
    """Check that a table has all required keys and no unknown key."""
    if not isinstance(table, dict):
        raise InputError(f"must be a table, got {shown(table)}", where)
    unknown = sorted(table.keys() - required - optional, key=str)
    for key in sorted(required - table.keys()):
        advice = f"; unknown keys: {', '.join(map(shown, unknown))}" if unknown else ""
        raise InputError(f"the key '{key}' is missing{advice}", where)
    for key in unknown:
        raise InputError(f"unknown key {shown(key)}; known are {', '.join(sorted(required | optional))}", where)
