"""Reading files up to a size limit, and writing them so that none is ever incomplete.

An ``InputError`` names a file that cannot be read or written, and a path that cannot name a file.  Longer texts are
written from templates: files of a package that jinja2 fills with values.

JSON is read strictly.  Beyond its rules, a file has at most ``MAX_BYTES`` bytes and ``MAX_LEVELS`` levels, no key
twice in an object, only finite numbers, and no half characters (lone surrogates).  A place is written as
``$.damping.laws[1].alpha``; $ is the whole file.

References
----------
RFC 8259, "The JavaScript Object Notation (JSON) data interchange format".
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import stat
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping
from importlib.resources import files
from io import BufferedReader
from pathlib import Path
from typing import Any, NoReturn

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.inputs import check_instance, error_prefix, shown
from ancf_casadi.support.interrupts import delayed_interrupts

MAX_BYTES = 64 * 2**20  # of a file that is read as a whole
MAX_KEY_PARTS = 50  # of a dotted key; the time of tomllib grows with their square
DOTTED_KEY = re.compile(rb"""(?:\.[ \t]*(?:[\w-]+|'[^'\n]*'|"(?:[^"\\\n]|\\.)*")[ \t]*){%d}""" % MAX_KEY_PARTS)
MAX_LEVELS = 24
MAX_KEY_LENGTH = 200
REPEATED = object()  # placeholder for the values of a key that appears twice in an object


def check_folder(path: str | Path) -> Path:
    """Check that a folder can be written or created, without creating it."""
    check_path(path, "folder")
    folder = Path(path)
    existing = folder.absolute()
    while not os.path.exists(existing):  # also false if the name is too long
        existing = existing.parent
    if not existing.is_dir():
        raise InputError("is not a folder", str(existing))
    if not os.access(existing, os.W_OK | os.X_OK):
        raise InputError("cannot be written", str(existing))
    return folder


def check_file(path: str | Path) -> Path:
    """Check that a path can be written, without creating the file; it must not be a folder, device or pipe."""
    check_path(path, "path")
    target = Path(path)
    check_folder(Path(os.path.realpath(target)).parent)
    if os.path.isdir(target):
        raise InputError("is a folder", str(target))
    if os.path.exists(target) and not os.path.isfile(target):
        raise InputError("is a device or a pipe; name a file", str(target))
    return target


def check_ours(path: Path, start: str) -> None:
    """Check that a file does not exist, or has the start of the files that this package writes."""
    if not path.exists():
        return
    try:
        with open_file(path) as file:
            is_ours = file.read(len(start)) == start.encode()
    except InputError:
        is_ours = False
    if not is_ours:
        raise InputError("already exists, and was not written by this export; choose another path", str(path))


def write_file(path: Path, content: str | bytes) -> None:
    """Write a complete file or none; missing folders are created, and symbolic links are followed."""
    write_files({path: content})


def write_files(contents: Mapping[Path, str | bytes]) -> None:
    """Write several files, all or none; missing folders are created.

    All contents are first written to drafts beside their files, which are then renamed without interruption by signals.
    If the process is killed, each file is unchanged or complete.
    """
    for path in contents:
        check_file(path)
    drafts: dict[Path, str] = {}
    path = Path()
    try:
        for path, content in contents.items():
            drafts[path] = _draft(Path(os.path.realpath(path)), content)
        with delayed_interrupts():
            for path, draft in drafts.items():
                os.replace(draft, os.path.realpath(path))
    except OSError as error:
        raise InputError(f"cannot be written ({error.strerror or error})", str(path)) from None
    finally:
        for draft in drafts.values():
            with contextlib.suppress(FileNotFoundError):
                os.unlink(draft)


def _draft(path: Path, content: str | bytes) -> str:
    """Write the content of a file to a draft beside it, and return the path of the draft."""
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor, draft = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}-")
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
        os.chmod(draft, 0o644)
    except BaseException:
        os.unlink(draft)
        raise
    return draft


def check_path(path: Any, where: str) -> None:
    """Check that a value can name a file; ``open`` would accept a number as the descriptor of an open file."""
    check_instance(path, where, str, os.PathLike)
    name = os.fspath(path)
    if not isinstance(name, str) or "\0" in name or len(name) > 4096:  # characters of a path; systems allow no more
        raise InputError(f"{shown(name)} cannot be the name of a file", where)


def read_toml(path: str | Path) -> dict[str, Any]:
    """Read a TOML file of at most 64 MiB."""
    content = read_bytes(path)
    if DOTTED_KEY.search(content):
        raise InputError(f"has a key of more than {MAX_KEY_PARTS} parts", str(path))
    try:
        return tomllib.loads(content.decode("utf-8-sig"))
    except RecursionError:
        raise InputError("is not TOML (tables or lists are nested too deeply)", str(path)) from None
    except ValueError as error:  # invalid TOML or UTF-8, or a number with thousands of digits
        raise InputError(f"is not TOML ({error})", str(path)) from None


def read_bytes(path: str | Path) -> bytes:
    """Read a file of at most 64 MiB that is not empty."""
    with open_file(path, MAX_BYTES) as file:
        return file.read(MAX_BYTES)


@contextlib.contextmanager
def open_file(path: str | Path, limit: float = math.inf) -> Iterator[BufferedReader]:
    """Open a regular file of 1 to ``limit`` bytes; reading a pipe or device might never end."""
    check_path(path, "path")
    try:
        with open(path, "rb", opener=_open_without_waiting) as file:
            state = os.fstat(file.fileno())
            if not stat.S_ISREG(state.st_mode):
                raise InputError("is a device or a pipe; name a file", str(path))
            if not state.st_size:  # also files of the system, such as /proc/kmsg, which may never end
                raise InputError("is empty", str(path))
            if state.st_size > limit:
                raise InputError(f"is larger than {int(limit) >> 20} MiB", str(path))
            yield file
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read ({getattr(error, 'strerror', None) or error})", str(path)) from None


def _open_without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))  # a pipe would wait for its writer


def read_json(path: str | Path) -> dict[str, Any]:
    """Read a JSON file that holds an object within the limits."""
    content = read_bytes(path)
    try:
        value = json.loads(content.decode("utf-8-sig"), object_pairs_hook=_object, parse_constant=_refuse_constant)
    except RecursionError:
        raise InputError(f"has more than {MAX_LEVELS} levels", str(path)) from None
    except ValueError as error:  # invalid JSON or UTF-8, or a number with thousands of digits
        raise InputError(f"is not JSON ({error})", str(path)) from None
    if not isinstance(value, dict):
        raise InputError("must hold a JSON object", str(path))
    with error_prefix(str(path)):
        check(value, "$")
    return value


def template_text(package: str, name: str) -> str:
    """Return the text of a template in a package."""
    return files(package).joinpath(name).read_text(encoding="utf-8")


def fill_template(package: str, name: str, values: Mapping[str, Any]) -> str:
    """Fill a template with values and functions by name; a missing value is an error."""
    from jinja2 import Environment, StrictUndefined  # slow to import

    environment = Environment(undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.keep_trailing_newline = True
    return environment.from_string(template_text(package, name)).render(values)


def place(where: str, key: str | int) -> str:
    """Return the path of a key or list entry within the value at the path ``where``."""
    if isinstance(key, int):
        return f"{where}[{key}]"
    return f"{where}.{key}" if where else key


def check(value: Any, where: str, level: int = 1) -> None:
    """Check that plain data are within the limits."""
    if level > MAX_LEVELS:
        raise InputError(f"has more than {MAX_LEVELS} levels", where)
    if value is REPEATED:
        raise InputError("the key appears twice", where)
    if isinstance(value, int | float) and not abs(value) <= sys.float_info.max:  # whole numbers have any size
        raise InputError("is beyond the range of numbers", where)
    if isinstance(value, str):
        _check_text(value, where)
    if isinstance(value, dict):
        for key, item in value.items():
            _check_text(key, where)
            if len(key) > MAX_KEY_LENGTH:
                raise InputError(f"has a key of {len(key)} characters; at most {MAX_KEY_LENGTH} are allowed", where)
            check(item, place(where, key), level + 1)
    if isinstance(value, list | tuple):
        for index, item in enumerate(value):
            check(item, place(where, index), level + 1)


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    members = dict(pairs)
    if len(members) < len(pairs):
        members |= {name: REPEATED for name, count in Counter(name for name, _ in pairs).items() if count > 1}
    return members


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not allowed")


def _check_text(text: Any, where: str) -> None:
    if not isinstance(text, str):
        raise InputError(f"must be a text, got {shown(text)}", where)
    if any("\ud800" <= character <= "\udfff" for character in text):
        raise InputError("holds half a character (a lone surrogate)", where)
