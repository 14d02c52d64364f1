"""Libraries for file formats, imported on demand; whatever they raise becomes an ``InputError``."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ancf_casadi.exceptions import InputError

LARGEST = 2**30  # bytes that one channel, or all of a compressed file, may take
MOST_PACKED = 1100  # unpacked bytes per byte of a compressed file; deflate reaches 1032


def library(module: str, format_name: str) -> Any:
    """Return the module that reads a format.

    Raises
    ------
    InputError
        If it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise InputError(
            f"is not installed, but {format_name} files need it; pip install 'ancf-casadi[records]'", module
        ) from None


@contextmanager
def readable(path: str, format_name: str) -> Iterator[None]:
    """Turn every failure of a library into an ``InputError``: a damaged file may make it fail anywhere."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except InputError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split())[:80] or type(error).__name__
        raise InputError(f"is no readable {format_name} file ({reason})", path) from None


def check_unpacked(size: int, packed: int, path: str) -> None:
    """Check that data of ``size`` bytes can come from ``packed`` bytes of a file.

    Raises
    ------
    InputError
        If they cannot, or take more than 1 GiB.
    """
    if size > LARGEST:
        raise InputError(f"unpacks to more than {LARGEST >> 20} MB; shorten the record", path)
    if size > MOST_PACKED * packed:
        raise InputError(f"declares {size} bytes of data, which its {packed} bytes cannot hold; it is damaged", path)
