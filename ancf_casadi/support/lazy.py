"""Public names that a package imports on first use, so that the package itself is imported at once (PEP 562).

The package states its names one time, as imports for type checkers; the alias says that a name is public (PEP 484):

    if TYPE_CHECKING:
        from ancf_casadi.mechanics.beam import Beam as Beam
    else:
        __getattr__, __dir__, __all__ = on_first_use(__name__)
"""

from __future__ import annotations

import ast
import pkgutil
import sys
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from typing import Any


def on_first_use(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package with its names and folders."""
    homes = {  # the module of each name that the package imports
        alias.name: statement.module
        for statement in ast.walk(ast.parse(pkgutil.get_data(package, "__init__.py") or b""))
        if isinstance(statement, ast.ImportFrom) and statement.module
        for alias in statement.names
        if alias.asname
    }

    def attribute(name: str) -> Any:
        if home := homes.get(name):
            value = getattr(import_module(home), name)
            setattr(sys.modules[package], name, value)
            return value
        if not name.startswith("_") and find_spec(f"{package}.{name}"):
            return import_module(f"{package}.{name}")
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return attribute, lambda: sorted({*vars(sys.modules[package]), *homes}), sorted(homes)
