"""Results of finished tasks, kept in files so that an interrupted study resumes.

The key of a result is a hash of everything that it depends on: the function, its inputs, and the sources of this
program with the version of CasADi.  Results are MessagePack files that are decoded into the declared type, so that a
file from elsewhere is never executed.
"""

from __future__ import annotations

import contextlib
import hashlib
import time
import typing
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

import ancf_casadi
import problems
from ancf_casadi.support.files import write_file
from problems.study.part import Task

SUFFIX = ".msgpack"


def key_of(task: Task) -> str:
    """Return the key of a task, 24 hexadecimal digits."""
    name = f"{task.function.__module__}.{task.function.__qualname__}"
    return hashlib.sha256(encoded([name, _program(), task.inputs])).hexdigest()[:24]


def encoded(value: Any) -> bytes:
    """Return plain data as MessagePack; arrays keep every bit."""
    return msgspec.msgpack.encode(value, enc_hook=_array_data)


def decoded(content: bytes, kind: Any) -> Any:
    """Return plain data of a type from MessagePack."""
    return msgspec.msgpack.decode(content, type=kind, dec_hook=_array)


@dataclass(frozen=True)
class Kept:
    """A result as it is kept."""

    seconds: float  # computing time, s
    content: bytes  # the encoded result; all results pass through this form, whether new or kept

    def result(self, task: Task) -> Any:
        """Return the result of a task in the type that its function declares."""
        return decoded(self.content, typing.get_type_hints(task.function)["return"])


def run_task(task: Task) -> Kept:
    """Run a task."""
    began = time.perf_counter()
    result = task.function(*task.inputs)
    return Kept(time.perf_counter() - began, encoded(result))


class Store:
    """A folder with the results of finished tasks, created with the first one."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def get(self, key: str, task: Task) -> Kept | None:
        """Return the result under a key, or None if there is none that can be used."""
        try:
            kept: Kept = decoded(self._path(key).read_bytes(), Kept)
            kept.result(task)
        except (OSError, ValueError, msgspec.MsgspecError):
            return None
        return kept

    def keep(self, key: str, kept: Kept) -> None:
        """Keep a result."""
        write_file(self._path(key), encoded(kept))

    def discard_all_but(self, keys: set[str]) -> None:
        """Remove the results of earlier studies."""
        for path in self._folder.glob(f"*{SUFFIX}"):
            if path.name.removesuffix(SUFFIX) not in keys:
                with contextlib.suppress(OSError):
                    path.unlink()

    def _path(self, key: str) -> Path:
        return self._folder / f"{key}{SUFFIX}"


@cache
def _program() -> str:
    """Return a hash of the sources of this program and of the versions that determine its numbers."""
    digest = hashlib.sha256(f"{version('casadi')} {version('numpy')} {version('scipy')}".encode())
    for package in (ancf_casadi, problems):
        folder = Path(str(package.__file__)).parent
        for path in sorted(folder.rglob("*.py")):
            digest.update(str(path.relative_to(folder)).encode() + path.read_bytes())
    return digest.hexdigest()


def _array_data(value: Any) -> Any:
    """Return an array as type, shape and bytes."""
    if isinstance(value, np.ndarray):
        return [value.dtype.str, list(value.shape), np.ascontiguousarray(value).tobytes()]
    if isinstance(value, np.generic):
        return value.item()
    raise NotImplementedError(f"{type(value).__name__} is not plain data")


def _array(kind: Any, data: Any) -> Any:
    """Return an array from type, shape and bytes."""
    if typing.get_origin(kind) is not np.ndarray and kind is not np.ndarray:
        raise NotImplementedError(f"{kind} is not plain data")
    name, shape, content = data
    if np.dtype(name).hasobject:
        raise ValueError("an array of objects")
    return np.frombuffer(content, np.dtype(name)).reshape(shape)
