"""Calls of the readers that run in a process of their own (``worker``)."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.reading import worker
from ancf_casadi.records.reading.libraries import check_installed
from ancf_casadi.support.arrays import Array

ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}  # threads reserve memory


def read_isolated(kind: str, module: str, path: Path, format_name: str) -> tuple[dict[str, Array], dict[str, Any]]:
    """Return the arrays and the properties that a reader of ``worker`` finds in a file.

    Parameters
    ----------
    kind : str
        Name of the reader.
    module : str
        Library that it needs.
    path : Path
        The file.
    format_name : str
        Name of the format, for messages.

    Raises
    ------
    InputError
        If the library is missing, refuses the file, crashes, or needs too much memory or time.
    """
    check_installed(module, format_name)
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
