"""Libraries for file formats; whatever they raise becomes an ``InputError``.

Compiled libraries read in a process of their own (``worker``), which they may crash.
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
from ancf_casadi.records.reading.worker import Unusable
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.optional import installed

ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}  # threads reserve memory


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


def read_isolated(kind: str, module: str, path: Path, format_name: str) -> tuple[dict[str, Array], dict[str, Any]]:
    """Return the arrays and the properties that the reader ``kind`` of ``worker`` finds in a file with its library."""
    installed(module, f"{format_name} files need it")
    command = [sys.executable, "-P", "-W", "ignore", worker.__file__, kind, os.path.abspath(path)]
    try:
        # s: what a loaded machine may take, and 1 MB/s, which it reads at least
        run = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, check=False, env=os.environ | ONE_THREAD,
            timeout=60.0 + path.stat().st_size / (2**20),
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise InputError(f"takes too long to read, and is probably no {format_name} file", str(path)) from None
    head, _, content = run.stdout.partition(b"\n")
    found: dict[str, Any] = json.loads(head) if head.startswith(b"{") and head.endswith(b"}") else {}
    if "refused" in found:
        raise InputError(found["refused"], str(path))
    if run.returncode or "arrays" not in found:
        reason = found.get("unreadable", "it crashed the library, or exceeded memory or time")
        raise InputError(f"is no readable {format_name} file ({reason})", str(path))
    arrays, start = {}, 0
    for name, shape in found.pop("arrays"):
        values = np.frombuffer(content, dtype="<f8", count=math.prod(shape), offset=start).reshape(shape)
        arrays[name] = values.astype(float)
        start += values.nbytes
    return arrays, found
