"""Public names that a package imports on first use, so that the package itself is imported at once (PEP 562).

The package states its names one time, as imports for type checkers:

    if TYPE_CHECKING:
        from ancf_casadi.mechanics.beam import Beam
    else:
        __getattr__, __dir__ = on_first_use(__name__)
"""

from __future__ import annotations

import ast
import pkgutil
import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any


def on_first_use(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return ``__getattr__`` and ``__dir__`` of a package, which import its names and its folders."""

    def attribute(name: str) -> Any:
        if not name.startswith("_"):
            if home := _homes(package).get(name):
                value = getattr(import_module(home), name)
                setattr(sys.modules[package], name, value)
                return value
            if find_spec(f"{package}.{name}"):
                return import_module(f"{package}.{name}")
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return attribute, lambda: sorted({*vars(sys.modules[package]), *_homes(package)})


@cache
def _homes(package: str) -> dict[str, str]:
    """Return the module of each name that a package imports under ``if TYPE_CHECKING``."""
    blocks = ast.parse(pkgutil.get_data(package, "__init__.py") or b"").body
    stated = [block for block in blocks if isinstance(block, ast.If) and ast.unparse(block.test) == "TYPE_CHECKING"]
    return {
        alias.name: statement.module
        for block in stated
        for statement in block.body
        if isinstance(statement, ast.ImportFrom) and statement.module
        for alias in statement.names
    }
