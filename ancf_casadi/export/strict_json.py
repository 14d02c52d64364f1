"""Strict reader of JSON files: it returns plain data, or one line that names the error and its place.

Beyond the rules of JSON, a file has at most ``MOST_BYTES`` bytes and ``MOST_LEVELS`` levels, no key twice in an object,
only finite numbers, and no half characters (lone surrogates).  A place is written as ``$.damping.laws[1].alpha``; $ is
the whole file.

References
----------
RFC 8259, "The JavaScript Object Notation (JSON) data interchange format".
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from pathlib import Path
from typing import Any, NoReturn

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.files import read_bytes
from ancf_casadi.support.inputs import located, shown

MOST_LEVELS = 24
LONGEST_KEY = 200
REPEATED = object()  # placeholder for the values of a key that appears twice in an object


def read_json(path: str | Path) -> dict[str, Any]:
    """Read a JSON file that holds an object; refuse anything else, and what exceeds the limits."""
    content = read_bytes(path)
    try:
        value = json.loads(content.decode(), object_pairs_hook=_object, parse_constant=_refuse_constant)
    except RecursionError:
        raise InputError(f"has more than {MOST_LEVELS} levels", str(path)) from None
    except ValueError as error:  # invalid JSON or UTF-8, or a number with thousands of digits
        raise InputError(f"is not JSON ({error})", str(path)) from None
    if not isinstance(value, dict):
        raise InputError("must hold a JSON object", str(path))
    with located(str(path)):
        check(value, "$")
    return value


def place(where: str, key: str | int) -> str:
    """Return the place of a key or of a list entry within the value at another place."""
    if isinstance(key, int):
        return f"{where}[{key}]"
    return f"{where}.{key}" if where else key


def check(value: Any, where: str, level: int = 1) -> None:
    """Check that plain data stay within the limits."""
    if level > MOST_LEVELS:
        raise InputError(f"has more than {MOST_LEVELS} levels", where)
    if value is REPEATED:
        raise InputError("the key appears twice", where)
    if isinstance(value, int | float) and not abs(value) <= sys.float_info.max:  # whole numbers have any size
        raise InputError("is beyond the range of numbers", where)
    if isinstance(value, str):
        _check_text(value, where)
    if isinstance(value, dict):
        for key, item in value.items():
            _check_text(key, where)
            if len(key) > LONGEST_KEY:
                raise InputError(f"has a key of {len(key)} characters; at most {LONGEST_KEY} are allowed", where)
            check(item, place(where, key), level + 1)
    if isinstance(value, list | tuple):
        for index, item in enumerate(value):
            check(item, place(where, index), level + 1)


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        found |= {name: REPEATED for name, times in Counter(name for name, _ in pairs).items() if times > 1}
    return found


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not allowed")


def _check_text(text: Any, where: str) -> None:
    if not isinstance(text, str):
        raise InputError(f"must be a text, got {shown(text)}", where)
    if any("\ud800" <= character <= "\udfff" for character in text):
        raise InputError("holds half a character (a lone surrogate)", where)
