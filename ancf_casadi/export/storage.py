"""Files of exported Functions, for temporary use on one machine.

CasADi reads only files of its own version, and to load a Function is to run the program in it: load only files that you
have saved yourself.  For storage and exchange, write the JSON document of ``ancf_casadi.export``.

The first line of a file is JSON: the format, the kind of model, the version of CasADi, and the tables of signals.  The
Functions follow in CasADi's format.
"""

from __future__ import annotations

import json
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import casadi as cs

from ancf_casadi.dynamics.signals import Signal
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.motion_functions import BeamFunctions
from ancf_casadi.reduction.reduced import ReducedFunctions
from ancf_casadi.support.files import check_file, check_ours, opened, write_file
from ancf_casadi.support.inputs import check_instance

TITLE = "ancf-casadi functions"
FUNCTIONS_FORMAT = f"{TITLE} 3"
BEGINNING = f'{{"format": "{TITLE}'
MODELS: dict[str, type[BeamFunctions | ReducedFunctions]] = {"full": BeamFunctions, "reduced": ReducedFunctions}
SIGNAL_TABLES = ("parameters", "states", "base", "outputs")


def save_functions(functions: BeamFunctions | ReducedFunctions, path: str | Path) -> None:
    """Save the Functions to a file, usually named ``.casadi``; an earlier file of this kind is replaced.

    Of a ``ReducedModel``, the Functions and tables are saved, but not its modes and its damping law.

    Raises
    ------
    InputError
        If the file exists and is of another kind, or it cannot be written.

    Examples
    --------
    >>> from pathlib import Path
    >>> from ancf_casadi import Beam, Model, reduce_model
    >>> from ancf_casadi.export import save_functions
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> save_functions(reduce_model(Model(beam), modes=2), "reduced.casadi")
    >>> Path("reduced.casadi").exists()
    True
    """
    check_instance(functions, "functions", *MODELS.values())
    target = check_file(path)
    check_ours(target, BEGINNING)
    tables = {name: [asdict(signal) for signal in getattr(functions, name)] for name in SIGNAL_TABLES}
    (kind,) = (name for name, kept in MODELS.items() if isinstance(functions, kept))
    head = {"format": FUNCTIONS_FORMAT, "model": kind, "casadi": cs.CasadiMeta.version(), **tables}
    serializer = cs.StringSerializer()
    for function in functions.functions:
        serializer.pack(function)
    write_file(target, f"{json.dumps(head)}\n{serializer.encode()}")


def load_functions(path: str | Path) -> BeamFunctions | ReducedFunctions:
    """Load the Functions from a file that ``save_functions`` wrote.

    Raises
    ------
    InputError
        If the file cannot be read, is of another kind, is damaged, or was written with another version of CasADi.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model
    >>> from ancf_casadi.export import beam_functions, load_functions, save_functions
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> save_functions(beam_functions(Model(beam)), "beam.casadi")
    >>> functions = load_functions("beam.casadi")
    >>> functions.rhs.name_in()
    ['q', 'v', 'base', 'p']
    """
    where = str(path)
    with opened(path) as file:
        content = file.read()
    try:
        first, _, rest = content.decode().partition("\n")
        head = json.loads(first)
        if head["format"] != FUNCTIONS_FORMAT:
            raise ValueError(head["format"])
        writer, kind = head["casadi"], head["model"]
        names = [field.name for field in fields(MODELS[kind]) if field.name not in SIGNAL_TABLES]
        tables: dict[str, Any] = {name: tuple(Signal(**entry) for entry in head[name]) for name in SIGNAL_TABLES}
    except (ValueError, KeyError, TypeError, RecursionError):
        raise InputError("is not a file of Functions of this version; export it again", where) from None
    if writer != cs.CasadiMeta.version():
        raise InputError(
            f"was written by CasADi {writer}, but {cs.CasadiMeta.version()} is in use; export it again", where
        )
    try:
        deserializer = cs.StringDeserializer(rest)
        found: dict[str, Any] = {name: deserializer.unpack() for name in names}
    except RuntimeError:
        raise InputError("is damaged; export it again", where) from None
    return MODELS[kind](**tables, **found)
