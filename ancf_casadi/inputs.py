"""Checks of what a caller gives: numbers, vectors, tables and files.

Each check returns the value in the form the toolkit works with, or raises ``InputError`` naming the place.
"""

from __future__ import annotations

import math
import reprlib
import tomllib
from collections.abc import Sequence
from numbers import Integral
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ancf_casadi.exceptions import InputError

MOST_BYTES = 64 * 2**20  # of a file that is read as a whole


def number(value: Any, where: str) -> float:
    """Return a finite number as a float.

    Raises
    ------
    InputError
        If ``value`` is not a number, or not finite.
    """
    try:
        result = float(value) if not isinstance(value, str | bytes | bool) else math.nan
    except (TypeError, ValueError, OverflowError):
        result = math.nan
    if not math.isfinite(result):
        raise InputError(f"must be a finite number, got {shown(value)}", where)
    return result


def shown(value: Any) -> str:
    """Return a value as one reads it in a message, cut short where it is long."""
    return reprlib.repr(value)


def positive(value: Any, where: str) -> float:
    """Return a finite number above zero as a float.

    Raises
    ------
    InputError
        If ``value`` is not a finite number above zero.
    """
    result = number(value, where)
    if result <= 0.0:
        raise InputError(f"must be positive, got {result:g}", where)
    return result


def numbers(values: Any, where: str) -> tuple[float, ...]:
    """Return a sequence of finite numbers.

    Raises
    ------
    InputError
        If it is anything else.
    """
    if not is_sequence(values):
        raise InputError(f"must be a sequence of numbers, got {shown(values)}", where)
    return tuple(number(value, where) for value in values)


def is_sequence(value: Any) -> bool:
    """Whether something is a sequence of values in their order, an array included, and no text."""
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


def whole(value: Any, where: str, least: int, most: int | None = None) -> int:
    """Return a whole number within its range.

    Raises
    ------
    InputError
        If it is anything else.
    """
    whole_one = isinstance(value, Integral) and not isinstance(value, bool)
    if not whole_one or value < least or (most is not None and value > most):
        range_ = f"{least} or more" if most is None else f"{least} to {most}"
        raise InputError(f"must be a whole number, {range_}, got {shown(value)}", where)
    return int(value)


def vector(value: Any, where: str) -> tuple[float, float]:
    """Return a pair of finite numbers.

    Raises
    ------
    InputError
        If ``value`` is not a pair of finite numbers.
    """
    if isinstance(value, str | bytes | dict | set) or not hasattr(value, "__len__") or len(value) != 2:
        raise InputError(f"must be a pair of numbers (x, y), got {shown(value)}", where)
    return number(value[0], where), number(value[1], where)


def array(values: ArrayLike, where: str) -> NDArray[np.float64]:
    """Return finite numbers as an array, a copy.

    Raises
    ------
    InputError
        If a value is not a number, or not finite.
    """
    try:
        result = np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise InputError("must be numbers", where) from None
    if not np.isfinite(result).all():
        raise InputError("must be finite", where)
    return result


def check_keys(table: dict[str, Any], required: set[str], optional: set[str], where: str) -> None:
    """Check that a table has all its required keys, and none that is unknown.

    Raises
    ------
    InputError
        Naming the first missing or unknown key.
    """
    for key in sorted(required - table.keys()):
        raise InputError(f"the key '{key}' is missing", where)
    for key in sorted(table.keys() - required - optional):
        raise InputError(f"unknown key '{key}'; known are {', '.join(sorted(required | optional))}", where)


def read_toml(path: str | Path) -> dict[str, Any]:
    """Read a TOML file.

    Raises
    ------
    InputError
        If the file cannot be read, is larger than 64 MiB, or is not TOML.
    """
    try:
        return tomllib.loads(read_bytes(path).decode())
    except RecursionError:
        raise InputError("is not TOML (tables or lists too deep in each other)", str(path)) from None
    except ValueError as error:  # TOML, its characters, or a number of thousands of digits
        raise InputError(f"is not TOML ({error})", str(path)) from None


def read_bytes(path: str | Path) -> bytes:
    """Read a file of reasonable size.

    Raises
    ------
    InputError
        If it cannot be read, or is larger than 64 MiB.
    """
    try:
        with open(path, "rb") as file:
            content = file.read(MOST_BYTES + 1)
    except (OSError, ValueError) as error:  # a name with a null character is a value error
        raise InputError(f"cannot be read ({getattr(error, 'strerror', None) or error})", str(path)) from None
    if len(content) > MOST_BYTES:
        raise InputError(f"is larger than {MOST_BYTES // 2**20} MiB", str(path))
    return content
