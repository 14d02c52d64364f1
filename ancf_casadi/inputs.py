"""Checks of what a caller gives: numbers, vectors, tables and files.

Each check returns the value in the form the toolkit works with, or raises ``InputError`` naming the place.
"""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ancf_casadi.exceptions import InputError


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
        raise InputError(f"must be a finite number, got {value!r}", where)
    return result


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


def vector(value: Any, where: str) -> tuple[float, float]:
    """Return a pair of finite numbers.

    Raises
    ------
    InputError
        If ``value`` is not a pair of finite numbers.
    """
    if isinstance(value, str | bytes | dict | set) or not hasattr(value, "__len__") or len(value) != 2:
        raise InputError(f"must be a pair of numbers (x, y), got {value!r}", where)
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
        If the file cannot be read, or is not TOML.
    """
    try:
        with open(path, "rb") as file:
            return tomllib.load(file)
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror or error})", str(path)) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"is not TOML ({error})", str(path)) from None
