"""Public names that a package imports on first use, so that the import of the package itself is fast (PEP 562).

A package lists its names once, as imports for type checkers, one per line; the alias marks a public name (PEP 484):

    if TYPE_CHECKING:
        from ancf_casadi.mechanics.beam import Beam as Beam
    else:
        __getattr__, __dir__, __all__ = lazy_exports(__name__)
"""

from __future__ import annotations

import pkgutil
import re
import sys
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from typing import Any

PUBLIC_IMPORT = re.compile(r"^ *from (\S+) import (\w+) as \2$", re.MULTILINE)


def lazy_exports(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package for its public names and its subpackages."""
    source = (pkgutil.get_data(package, "__init__.py") or b"").decode()
    modules = {name: module for module, name in PUBLIC_IMPORT.findall(source)}

    def attribute(name: str) -> Any:
        if name in modules:
            value = getattr(import_module(modules[name]), name)
            setattr(sys.modules[package], name, value)
            return value
        if not name.startswith("_") and find_spec(f"{package}.{name}"):
            return import_module(f"{package}.{name}")
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return attribute, lambda: sorted({*vars(sys.modules[package]), *modules}), sorted(modules)
