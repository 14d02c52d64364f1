"""Libraries for file formats, imported on demand; whatever they raise becomes an ``InputError``."""

from __future__ import annotations

import importlib.util
import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.reading.worker import Unusable


def library(module: str, format_name: str) -> Any:
    """Return the module that reads a format.

    Raises
    ------
    InputError
        If it is not installed.
    """
    check_installed(module, format_name)
    return importlib.import_module(module)


def check_installed(module: str, format_name: str) -> None:
    """Check that the module that reads a format is installed.

    Raises
    ------
    InputError
        If it is not.
    """
    try:
        found = importlib.util.find_spec(module)
    except ValueError:  # a module that was switched off
        found = None
    if found is None:
        raise InputError(f"is not installed, but {format_name} files need it; pip install {module}", module)


@contextmanager
def readable(path: str, format_name: str) -> Iterator[None]:
    """Turn every failure of a library into an ``InputError``: a damaged file may make it fail anywhere."""
    logging.disable(logging.CRITICAL)  # nptdms logs what it doubts
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except InputError:
        raise
    except Unusable as error:
        raise InputError(str(error), path) from None
    except Exception as error:
        reason = " ".join(str(error).split())[:80] or type(error).__name__
        raise InputError(f"is no readable {format_name} file ({reason})", path) from None
    finally:
        logging.disable(logging.NOTSET)
