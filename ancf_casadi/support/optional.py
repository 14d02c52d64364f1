"""Optional libraries, imported where they are needed."""

from __future__ import annotations

import importlib.util
from importlib.machinery import ModuleSpec
from typing import Any

from ancf_casadi.exceptions import InputError


def library(module: str, need: str, package: str = "", name: str = "") -> Any:
    """Import a module; an error names it, or a module that it imports, if that is not installed."""
    find_module(module, need, package, name)
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise InputError(
            f"needs {error.name}, which is not installed; pip install {error.name}", name or module
        ) from None


def find_module(module: str, need: str, package: str = "", name: str = "") -> ModuleSpec:
    """Return the specification of a module, which ``pip install package`` installs.

    If it is missing, the error names the module by ``name``; ``need`` completes "is not installed, but".
    """
    try:
        spec = importlib.util.find_spec(module)
    except (ModuleNotFoundError, ValueError):  # without the package that holds it, or switched off
        spec = None
    if spec is None or spec.origin is None:  # or a mere folder of this name
        raise InputError(f"is not installed, but {need}; pip install {package or module}", name or module)
    return spec
