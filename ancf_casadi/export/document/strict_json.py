"""JSON from others, read with limits: plain data, or one line that says what is wrong and where.

Besides what JSON itself demands, a file has at most ``MOST_BYTES`` and ``MOST_LEVELS`` levels, no key twice in an
object, only finite numbers, and only whole characters.  A place in it is written as ``damping.laws[1].alpha``.

References
----------
RFC 8259, "The JavaScript Object Notation (JSON) data interchange format".
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Set
from pathlib import Path
from typing import Any, NoReturn

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.files import read_bytes
from ancf_casadi.support.inputs import check_keys

MOST_LEVELS = 24
LONGEST_KEY = 200


class _Repeated:
    """Stands for the values of a key that an object has twice."""


def read_json(path: str | Path) -> dict[str, Any]:
    """Read a JSON file that holds an object.

    Raises
    ------
    InputError
        If the file cannot be read, is not JSON, is no object, or is beyond the limits.
    """
    content = read_bytes(path)
    try:
        value = json.loads(content.decode(), object_pairs_hook=_object, parse_constant=_no_number)
    except RecursionError:
        raise InputError(f"has more than {MOST_LEVELS} levels", str(path)) from None
    except ValueError as error:  # JSON, its characters, or a number of thousands of digits
        raise InputError(f"is not JSON ({error})", str(path)) from None
    if not isinstance(value, dict):
        raise InputError("must hold a JSON object", str(path))
    _check(value, str(path), "", 1)
    return value


def place(where: str, key: str | int) -> str:
    """Return the place of a key, or of an entry of a list, in what is at another place."""
    if isinstance(key, int):
        return f"{where}[{key}]"
    return f"{where}.{key}" if where else key


def object_at(
    value: Any, where: str, required: Set[str] | None = None, optional: Set[str] = frozenset()
) -> dict[str, Any]:
    """Return an object, with all of the required keys and none that is unknown, where these are given.

    Raises
    ------
    InputError
        If it is anything else.
    """
    if not isinstance(value, dict):
        raise InputError(f"must be an object, got {_kind(value)}", where)
    if required is not None:
        check_keys(value, set(required), set(optional), where)
    return value


def list_at(value: Any, where: str) -> list[Any]:
    """Return a list.

    Raises
    ------
    InputError
        If it is anything else.
    """
    if not isinstance(value, list):
        raise InputError(f"must be a list, got {_kind(value)}", where)
    return value


def text_at(value: Any, where: str) -> str:
    """Return a text.

    Raises
    ------
    InputError
        If it is anything else.
    """
    if not isinstance(value, str):
        raise InputError(f"must be a text, got {_kind(value)}", where)
    return value


def whole_text(text: str, where: str) -> str:
    """Return a text, of whole characters.

    Raises
    ------
    InputError
        If it holds a lone surrogate, which is half of one.
    """
    if any("\ud800" <= character <= "\udfff" for character in text):
        raise InputError("holds half a character (a lone surrogate)", where)
    return text


def number_at(value: Any, where: str) -> float:
    """Return a number.

    Raises
    ------
    InputError
        If it is anything else.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"must be a number, got {_kind(value)}", where)
    try:
        return float(value)
    except OverflowError:
        raise InputError("is beyond the range of numbers", where) from None


def numbers_at(value: Any, where: str) -> list[float]:
    """Return a list of numbers.

    Raises
    ------
    InputError
        If it is anything else.
    """
    return [number_at(item, place(where, index)) for index, item in enumerate(list_at(value, where))]


def _kind(value: Any) -> str:
    """Return what a JSON value is, in a word."""
    kinds = {
        bool: "true or false",
        int: "a number",
        float: "a number",
        str: "a text",
        list: "a list",
        dict: "an object",
    }
    return kinds.get(type(value), "null")


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        found |= {name: _Repeated() for name, times in Counter(name for name, _ in pairs).items() if times > 1}
    return found


def _no_number(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number there")


def _check(value: Any, file: str, where: str, level: int) -> None:
    """Refuse what is too deep, repeated, not finite, or no text."""
    at = f"{file}: {where}" if where else file
    if level > MOST_LEVELS:
        raise InputError(f"has more than {MOST_LEVELS} levels", at)
    if isinstance(value, _Repeated):
        raise InputError("the key is there twice", at)
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError("is beyond the range of numbers", at)
    if isinstance(value, str):
        whole_text(value, at)
    if isinstance(value, dict):
        for key, item in value.items():
            whole_text(key, at)
            if len(key) > LONGEST_KEY:
                raise InputError(f"has a key of {len(key)} characters; at most {LONGEST_KEY} are read", at)
            _check(item, file, place(where, key), level + 1)
    if isinstance(value, list):
        for index, item in enumerate(value):
            _check(item, file, place(where, index), level + 1)
