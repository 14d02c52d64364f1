"""The exported Functions in a file.

The file is for oneself and for now: CasADi reads what the same version of it wrote, and whoever loads a Function runs
what is in it.  Load only what you have saved yourself.  What is to last, or comes from others, is the document of
``ancf_casadi.export`` in JSON.

The first line is JSON and says what the file is, which model it holds, which version of CasADi wrote it, and the
tables of signals; what follows is CasADi's.
"""

from __future__ import annotations

import json
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import casadi as cs

from ancf_casadi.dynamics.signals import Signal
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.functions.motion_functions import BeamFunctions
from ancf_casadi.reduction.reduced import ReducedFunctions
from ancf_casadi.support.files import write_file

WHAT = "ancf-casadi functions"
FORMAT = f"{WHAT} 2"
KINDS: dict[str, type[BeamFunctions | ReducedFunctions]] = {"full": BeamFunctions, "reduced": ReducedFunctions}
TABLES = ("parameters", "states", "base", "outputs")


def save_functions(functions: BeamFunctions | ReducedFunctions, path: str | Path) -> None:
    """Save the Functions to a file, conventionally ``.casadi``; an earlier file of this kind is replaced.

    Of a ``ReducedModel`` the Functions and tables are saved, not the modes and the law that it was made from.

    Raises
    ------
    InputError
        If the file is there and is something else, or it cannot be written.
    """
    target = Path(path)
    if target.exists() and not _is_ours(target):
        raise InputError("is there already, and is not a file of Functions; choose another name", str(target))
    tables = {name: [asdict(signal) for signal in getattr(functions, name)] for name in TABLES}
    (kind,) = (name for name, kept in KINDS.items() if isinstance(functions, kept))
    head = {"format": FORMAT, "model": kind, "casadi": cs.CasadiMeta.version(), **tables}
    serializer = cs.StringSerializer()
    for function in functions.functions:
        serializer.pack(function)
    write_file(target, f"{json.dumps(head)}\n{serializer.encode()}")


def load_functions(path: str | Path) -> BeamFunctions | ReducedFunctions:
    """Load the Functions that ``save_functions`` saved.

    Raises
    ------
    InputError
        If the file cannot be read, is something else, is damaged, or another version of CasADi wrote it.
    """
    where = str(path)
    try:
        first, _, rest = Path(path).read_text(encoding="utf-8").partition("\n")
        head = json.loads(first)
        if head["format"] != FORMAT:
            raise ValueError(head["format"])
        writer, kind = head["casadi"], head["model"]
        names = [field.name for field in fields(KINDS[kind]) if field.name not in TABLES]
        tables: dict[str, Any] = {name: tuple(Signal(**entry) for entry in head[name]) for name in TABLES}
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror or error})", where) from None
    except (ValueError, KeyError, TypeError):
        raise InputError("is not a file of Functions that this version writes", where) from None
    if writer != cs.CasadiMeta.version():
        raise InputError(f"was written by CasADi {writer}, this is {cs.CasadiMeta.version()}; export it again", where)
    try:
        deserializer = cs.StringDeserializer(rest)
        found: dict[str, Any] = {name: deserializer.unpack() for name in names}
    except RuntimeError:
        raise InputError("is damaged; export it again", where) from None
    return KINDS[kind](**tables, **found)


def _is_ours(path: Path) -> bool:
    try:
        with open(path, "rb") as file:
            return WHAT.encode() in file.read(100)
    except OSError:
        return False
