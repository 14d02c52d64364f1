"""Libraries for file formats; any exception of theirs becomes an ``InputError``.

Compiled libraries run in another process (``worker``), which they may crash.
"""

from __future__ import annotations

import json
import logging
import math
import os
import subprocess
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.reading import worker
from ancf_casadi.records.reading.worker import UnusableFileError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.optional import find_module

ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}  # threads reserve memory


@contextmanager
def library_errors(path: str, format_name: str) -> Iterator[None]:
    """Turn every exception of a library into an ``InputError``: with a damaged file, any may occur."""
    logging.disable(logging.CRITICAL)  # nptdms logs warnings
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except InputError:
        raise
    except UnusableFileError as error:
        raise InputError(str(error), path) from None
    except Exception as error:
        reason = " ".join(str(error).split())[:80] or type(error).__name__
        raise InputError(f"is no readable {format_name} file ({reason})", path) from None
    finally:
        logging.disable(logging.NOTSET)


def read_in_process(kind: str, module: str, path: Path, format_name: str) -> tuple[dict[str, Array], dict[str, Any]]:
    """Read the arrays and properties of a file by the reader ``kind`` of ``worker``, in another process."""
    find_module(module, f"{format_name} files need it")
    command = [sys.executable, "-P", "-W", "ignore", worker.__file__, kind, os.path.abspath(path)]
    try:
        # s: a margin for a loaded machine, and the time at the lowest rate, 1 MB/s
        run = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, check=False, env=os.environ | ONE_THREAD,
            timeout=60.0 + path.stat().st_size / (2**20),
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise InputError(f"takes too long to read, and is probably no {format_name} file", str(path)) from None
    header_line, _, content = run.stdout.partition(b"\n")
    properties: dict[str, Any] = (
        json.loads(header_line) if header_line.startswith(b"{") and header_line.endswith(b"}") else {}
    )
    if "refused" in properties:
        raise InputError(properties["refused"], str(path))
    if run.returncode or "arrays" not in properties:
        reason = properties.get("unreadable", "it crashed the library, or exceeded memory or time")
        raise InputError(f"is no readable {format_name} file ({reason})", str(path))
    arrays, start = {}, 0
    for name, shape in properties.pop("arrays"):
        values = np.frombuffer(content, dtype="<f8", count=math.prod(shape), offset=start).reshape(shape)
        arrays[name] = values.astype(float)
        start += values.nbytes
    return arrays, properties
