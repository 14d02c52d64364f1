"""Compilation of Functions to machine code, if there is a C compiler.

CasADi's virtual machine evaluates a Function two to four times slower than compiled C.  Two kinds of Functions are
compiled: those of one element (``dynamics.equations``), and the passes of Radau along ten links
(``dynamics.radau.links``).  They depend neither on the mesh nor on the numbers of a beam, so one library serves all
beams.  It is kept, and found again by a hash of the Function.  Machine code and virtual machine do
the same operations in the same order, without fused multiply-add, and give the same digits.

Compiler.  The command in ``CC``, else ``cc`` or ``gcc``, else the package ``ziglang``.  If there is none, or it fails,
one warning says so, and the virtual machine runs the Functions.  ``ANCF_CASADI_COMPILE=0`` turns compilation off
without a warning.

Cache.  ``ANCF_CASADI_CACHE``, else ``ancf-casadi`` in ``XDG_CACHE_HOME`` or ``~/.cache``.  A library runs with the
rights of the user.  As ssh requires of its keys, the folder and its files must belong to the user, no folder above may
be open to others, and nothing may be writable by group or others; otherwise a private temporary folder is used.  The
name of a library contains the SHA-256 digest of its contents; a library that does not match its name is built again.
Another process loads new libraries first (``compiler_process.py``), and only those that can be loaded are kept.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.util
import json
import os
import platform
import shlex
import shutil
import stat
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ancf_casadi.support.arrays import Array
from ancf_casadi.support.interrupts import has_interrupt

LIBRARY = ("-fno-math-errno", "-fPIC", "-shared", "-ffp-contract=off")
COMPILER_FLAGS = ("-Og", *LIBRARY)  # -O1 takes a third longer, -O3 twice as long; their code is no faster
COMPILER_PROCESS = str(Path(__file__).with_name("compiler_process.py"))
COMPILER_SECONDS = 300  # limit of the compilers that run side by side
POLLING_INTERVAL = 0.05  # s between two looks for signals while a compiler runs
CACHE_FORMAT = "2"  # of the cache; raise it to compile the same functions again
OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH

_failed: set[tuple[str, ...]] = set()  # compilers that failed; this process does not try them again


def expand_function(function: cs.Function) -> cs.Function:
    """Return a function for the virtual machine, expanded to scalar operations.

    One that calls another again and again stays as it is: expanded, it would be simplified across the calls, and give
    other digits than machine code.
    """
    calls = sum(function.instruction_id(k) == cs.OP_CALL for k in range(function.n_instructions()))
    return function if calls > 1 else function.expand(function.name(), _differentiability(function))


def compile_function(function: cs.Function) -> cs.Function:
    """Return a function as machine code, or for the virtual machine if it cannot be compiled, with one warning."""
    return compile_together([function])[0]


def compile_together(functions: Sequence[cs.Function], *, derivatives: bool = False) -> list[cs.Function]:
    """Return several functions as ``compile_function`` does, by compilers that run side by side."""
    compiler = c_compiler()
    if os.environ.get("ANCF_CASADI_COMPILE") == "0" or compiler in _failed:
        return [expand_function(function) for function in functions]
    if not compiler:
        _give_up(compiler, "no C compiler was found")
        return [expand_function(function) for function in functions]
    folder = _safe_folder()
    requests = [(function, derivatives and _is_differentiable(function)) for function in functions]
    stems = [_stem(*request, compiler) for request in requests]
    libraries = {stem: library for stem in stems if (library := _kept(folder, stem))}
    sources = {stem: _source(*request) for stem, request in zip(stems, requests, strict=True) if stem not in libraries}
    if sources:
        libraries |= _built(sources, compiler, folder)
    return [_load(function, libraries.get(stem), compiler) for function, stem in zip(functions, stems, strict=True)]


def _stem(function: cs.Function, derivatives: bool, compiler: Sequence[str]) -> str:
    """Return the name of the library of a function, up to the digest of its contents."""
    contents = (CACHE_FORMAT, cs.CasadiMeta.version(), *compiler, *COMPILER_FLAGS, platform.machine(), str(derivatives))
    key = hashlib.sha256("\0".join((*contents, function.serialize())).encode()).hexdigest()
    return f"{function.name()}-{key[:32]}"


def _load(function: cs.Function, library: Path | None, compiler: tuple[str, ...]) -> cs.Function:
    """Return a function from its library, or for the virtual machine if there is none."""
    if library is None:
        return expand_function(function)
    try:
        return cs.external(function.name(), str(library), _differentiability(function))
    except RuntimeError:  # it was removed after the check, or its folder does not admit programs any more
        _give_up(compiler, f"{library} cannot be loaded")
        return expand_function(function)


def c_compiler() -> tuple[str, ...]:
    """Return the command of the C compiler: ``CC``, ``cc``, ``gcc`` or that of ziglang; empty if there is none."""
    if command := os.environ.get("CC", "").strip():
        try:
            return tuple(shlex.split(command))
        except ValueError:  # an open quotation: no program has this name, and the warning shows it
            return (command,)
    if compiler := shutil.which("cc") or shutil.which("gcc"):
        return (compiler,)
    return (sys.executable, "-m", "ziglang", "cc") if importlib.util.find_spec("ziglang") else ()


def cache_folder() -> Path | None:
    """Return the folder of compiled functions; None if the user has no home."""
    if given := os.environ.get("ANCF_CASADI_CACHE"):
        return Path(given)
    try:
        above = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    except RuntimeError:
        return None
    return Path(above) / "ancf-casadi"


def _safe_folder() -> Path:
    """Return the cache folder, or a temporary one if that cannot be used."""
    folder = cache_folder()
    if folder is None:
        return _private_folder("there is no home folder")
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder = folder.resolve()
    except OSError as error:
        return _private_folder(f"{folder}: {error.strerror}")
    danger = _danger(folder)
    return _private_folder(danger) if danger else folder


def _danger(folder: Path) -> str:
    """Return why other users could put a library into a folder; empty if only root could."""
    if os.name != "posix":
        return ""
    for path in (folder, *folder.parents):
        status = path.stat()
        if status.st_uid not in {os.geteuid(), *([] if path == folder else [0])}:
            return f"{path} belongs to another user"
        if status.st_mode & OTHERS_WRITE and (path == folder or not status.st_mode & stat.S_ISVTX):
            return f"{path} can be written by others (chmod go-w)"
    return ""


@functools.cache
def _temporary_folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="ancf-casadi-")


@functools.cache
def _private_folder(why: str) -> Path:
    """Return a temporary folder that is removed with the process, and warn of the reason once."""
    warnings.warn(
        f"compiled functions are not kept: {why}; set ANCF_CASADI_CACHE to a folder that only you can write",
        stacklevel=5,
    )
    return Path(_temporary_folder().name)


def _kept(folder: Path, stem: str) -> Path | None:
    """Return a library from the cache if it is there and intact; remove it if it is damaged."""
    for path in sorted(folder.glob(f"{stem}-*.so")):
        if _is_own(path) and path.name == f"{stem}-{_digest(path)}.so":
            return path
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)
    return None


def _is_own(path: Path) -> bool:
    """Return whether a path is a regular file that belongs to the user and that only the user can write."""
    status = path.lstat()
    if not stat.S_ISREG(status.st_mode):
        return False
    return os.name != "posix" or (status.st_uid == os.geteuid() and not status.st_mode & OTHERS_WRITE)


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _source(function: cs.Function, derivatives: bool) -> str:
    """Return the C code of a function, and of its derivatives if they are wanted."""
    generator = cs.CodeGenerator("source.c")
    generator.add(function)
    if derivatives:
        generator.add(function.forward(1))
        generator.add(function.reverse(1))
    code = str(generator.dump())
    return code + _jacobian_patterns(function) if _is_differentiable(function) else code


def _built(sources: Mapping[str, str], compiler: tuple[str, ...], folder: Path) -> dict[str, Path]:
    """Compile C code to libraries, by stem, which appear in the folder only when complete; none if one fails."""
    libraries = {}
    try:
        _remove_drafts(folder)
        with tempfile.TemporaryDirectory(dir=folder) as place:
            calls = {}
            for stem, code in sources.items():
                source = Path(place) / f"{stem}.c"
                source.write_text(code)
                calls[source.with_suffix(".so")] = [*compiler, *COMPILER_FLAGS, str(source)]
            if failure := compiler_failure(calls):
                _give_up(compiler, f"{shlex.join(compiler)} fails: {failure}")
                return {}
            for stem, draft in zip(sources, calls, strict=True):
                draft.chmod(0o700)
                libraries[stem] = folder / f"{stem}-{_digest(draft)}.so"
                os.replace(draft, libraries[stem])
    except OSError as error:
        _give_up(compiler, f"{shlex.join(compiler)} fails: {error}")
        return {}
    return libraries


def compiler_failure(calls: Mapping[Path, Sequence[str]]) -> str:
    """Let compilers write libraries into a folder, and another process load them; return why one fails, or "".

    Raises
    ------
    KeyboardInterrupt
        If a signal is noted meanwhile (``noted_interrupts``); the compilers are ended.
    """
    commands = {str(library): [*call, "-o", str(library), "-lm"] for library, call in calls.items()}
    drafts = os.environ | {"TMPDIR": str(next(iter(calls)).parent)}  # for the files of stopped compilers
    deadline = time.monotonic() + COMPILER_SECONDS
    with contextlib.ExitStack() as stack:
        output = stack.enter_context(tempfile.TemporaryFile())
        process = subprocess.Popen(
            [sys.executable, "-I", "-S", COMPILER_PROCESS, json.dumps(commands)],
            stdin=subprocess.PIPE,
            stdout=output,
            stderr=output,
            env=drafts,
            start_new_session=True,
        )
        stack.enter_context(process)  # the end of the block closes its standard input, which ends the compilers
        while process.poll() is None:
            if time.monotonic() > deadline:
                return f"it takes more than {COMPILER_SECONDS} s"
            if has_interrupt():
                raise KeyboardInterrupt
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(POLLING_INTERVAL)
        if process.returncode:
            output.seek(0)
            return _reason(process.returncode, output.read().decode(errors="replace"))
    return ""


def _reason(exit_code: int, output: str) -> str:
    """Return the line of a compiler's output that says why it failed."""
    if exit_code < 0:  # a signal, such as SIGBUS
        return "loading the library that it wrote ends the process"
    lines = [line for line in output.splitlines() if line.strip()]
    errors = [line for line in lines if "error" in line] or lines  # warnings may come first
    return errors[0] if errors else f"exit code {exit_code}"


def _jacobian_patterns(function: cs.Function) -> str:
    """Return C code with the sparsity of the Jacobian, which CasADi otherwise takes as dense."""
    patterns = [function.jac_sparsity(k, i).compress() for k in range(function.n_out()) for i in range(function.n_in())]
    tables = [f"{{{', '.join(map(str, pattern))}}}" for pattern in patterns]
    size = max(map(len, patterns))
    return (
        f"static const casadi_int patterns[{len(tables)}][{size}] = {{{', '.join(tables)}}};\n"
        f"const casadi_int* jac_{function.name()}_sparsity_out(casadi_int i) {{ return patterns[i]; }}\n"
    )


def _remove_drafts(folder: Path) -> None:
    """Remove the files that killed compilers left behind."""
    for path in folder.glob("tmp*"):
        if path.is_dir() and path.lstat().st_mtime < time.time() - 2 * COMPILER_SECONDS:
            shutil.rmtree(path, ignore_errors=True)


def _give_up(compiler: tuple[str, ...], why: str) -> None:
    """Warn once that the virtual machine is used, and do not try this compiler again."""
    _failed.add(compiler)
    warnings.warn(
        f"{why}; the equations run uncompiled, two to four times slower. Install gcc or clang, set CC to a C compiler, "
        "or pip install ziglang; ANCF_CASADI_COMPILE=0 turns compilation off",
        stacklevel=4,
    )


def _is_differentiable(function: cs.Function) -> bool:
    return any(_differentiability(function)["is_diff_in"])


def _differentiability(function: cs.Function) -> dict[str, list[bool]]:
    return {
        "is_diff_in": [function.is_diff_in(k) for k in range(function.n_in())],
        "is_diff_out": [function.is_diff_out(k) for k in range(function.n_out())],
    }


class Buffered:
    """A dense Function bound to arrays, matrices by columns: a call reads its inputs and writes to ``outputs``.

    The first outputs may be given, as arrays that no input shares.
    """

    def __init__(self, function: cs.Function, *inputs: NDArray[Any], outputs: Sequence[Array] = ()) -> None:
        buffer: Any
        buffer, self._evaluate = function.buffer()
        sizes = [function.numel_out(k) for k in range(function.n_out())]
        self.outputs = [*outputs, *map(np.zeros, sizes[len(outputs) :])]
        flat_inputs, flat_outputs = [array.reshape(-1).view(float) for array in inputs], [*map(np.ravel, self.outputs)]
        self._memory = buffer, flat_inputs, flat_outputs  # which CasADi only points to
        for k, array in enumerate(flat_inputs):
            buffer.set_arg(k, array.data)
        for k, array in enumerate(flat_outputs):
            buffer.set_res(k, array.data)

    def __call__(self) -> list[Array]:
        """Evaluate, and return ``outputs``, the same arrays in every call."""
        self._evaluate()
        return self.outputs


def evaluate_dense(function: cs.Function, *inputs: ArrayLike) -> list[Array]:
    """Return the outputs of a Function, dense as its inputs, as arrays; for large ones, much faster than a call."""
    columns = [np.array(values, dtype=float).ravel(order="F") for values in inputs]
    outputs = Buffered(function, *columns)()
    return [values.reshape(function.size_out(k), order="F") for k, values in enumerate(outputs)]
