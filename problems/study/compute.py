"""Computations of a study: functions of plain data, run once, in any executor, with their results kept in files.

A step of a study is a function that is written from top to bottom, and calls expensive functions through ``Compute``:

    fits = compute.all(fit_record, [(record, "linear") for record in records])

Such a function is defined at module level, its arguments are plain data (numbers, texts, arrays, frozen dataclasses),
and its return annotation is the type of its result.

The name of the file of a result is a hash of everything that it depends on: the function, its arguments, and the
sources of this program with the version of CasADi.  The file is written as soon as the result is there, so that a study
that was stopped at any time continues from there.  It holds a SHA-256 digest, then the computing time (s) and the
result as MessagePack.  A result that does not match its digest is computed anew.  A file from elsewhere is never
executed, because it is decoded into the type that the function declares.
"""

from __future__ import annotations

import hashlib
import inspect
import threading
import time
import typing
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_EXCEPTION, CancelledError, Executor, Future, wait
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple, ParamSpec, TypeVar

import msgspec
import numpy as np
from tqdm import tqdm

import ancf_casadi
import problems
from ancf_casadi.support.figures import Figure
from ancf_casadi.support.files import write_file
from problems.study.drawing import FORMATS, Drawing, render

SUFFIX = ".msgpack"
DIGEST_BYTES = hashlib.sha256().digest_size

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


class Computation(NamedTuple):
    """The result of a function."""

    seconds: float  # computing time, as it was when the function ran
    result: Any


class ThisThread(Executor):
    """Calls each function at once; errors and Ctrl-C end the call of ``submit``."""

    def submit(
        self, function: Callable[Arguments, Result], /, *args: Arguments.args, **keywords: Arguments.kwargs
    ) -> Future[Result]:
        """Return the result."""
        future: Future[Result] = Future()
        future.set_result(function(*args, **keywords))
        return future


class Store:
    """The computations of a study: each runs once, and its result is kept in a folder, if there is one.

    Steps in several threads take turns, because CasADi builds the expressions of one thread at a time.  A step must
    hold the ``turn``, and gives it up while it waits for results.  A thread of each computation waits for the executor,
    and writes the result.

    Parameters
    ----------
    folder : Path, optional
        Folder of the kept results; none are kept without it.
    make_executor : callable
        Returns the executor when a computation must run, so that processes start only if they are needed.
    threads : Executor, optional
        Threads that wait for the results.
    bar : tqdm, optional
        Progress bar, which counts the computations that were not kept.
    """

    def __init__(
        self,
        folder: Path | None = None,
        make_executor: Callable[[], Executor] = ThisThread,
        threads: Executor | None = None,
        bar: Any = None,
    ) -> None:
        self.computations: dict[str, Future[Computation]] = {}  # by key
        self.turn = threading.Lock()
        self._folder, self._make_executor, self._threads = folder, make_executor, threads or ThisThread()
        self._bar: Any = tqdm(total=0, disable=True) if bar is None else bar
        self._running: list[Future[bytes]] = []
        self._stopped, self._lock = False, threading.Lock()  # guards _stopped, _running and the total of the bar

    def start(self, function: Callable[..., Any], inputs: Sequence[Any]) -> str:
        """Start a computation unless it has started, and return its key."""
        key = computation_key(function, *inputs)
        if key not in self.computations:
            path = self._folder and self._folder / f"{key}{SUFFIX}"
            self.computations[key] = self._threads.submit(self._run, function, inputs, path)
        return key

    def _run(self, function: Callable[..., Any], inputs: Sequence[Any], path: Path | None) -> Computation:
        if path and (computation := kept(path, function)):
            return computation
        with self._lock:
            if self._stopped:
                raise CancelledError
            self._bar.total += 1
            self._running.append(future := self._make_executor().submit(run_function, function, inputs))
        content = future.result()
        with self._lock:
            self._running.remove(future)
        if path:
            write_file(path, with_digest(content))
        self._bar.update()
        return unpack(content, function)

    def wait_for(self, keys: Iterable[str]) -> None:
        """Wait for the results of computations, and give up the turn meanwhile."""
        futures = [self.computations[key] for key in keys]
        if all(future.done() for future in futures):
            return
        self.turn.release()
        try:
            wait_for(futures)
        finally:
            self.turn.acquire()

    def stop(self, *, cancel: bool) -> None:
        """Refuse further computations, and cancel those that have not begun if this is asked for."""
        with self._lock:
            self._stopped = True
            for future in self._running if cancel else ():
                future.cancel()


class Compute:
    """Runs the expensive functions of one step: ``Compute()`` in this process, a study in its executor.

    Parameters
    ----------
    store : Store, optional
        The computations of the study.
    quick : bool
        Whether this is a quick look, for which simulations are shortened.
    formats : tuple of str
        Formats of figures, of ``"svg"`` and ``"png"``; no figures are drawn if there are none.
    """

    def __init__(self, store: Store | None = None, *, quick: bool = False, formats: tuple[str, ...] = FORMATS) -> None:
        self.quick = quick
        self.formats = FORMATS if formats else ()  # of figures that a computation draws beside its numbers
        self.times: dict[str, float] = {}  # of the computations when they ran, s, by key
        self._store, self._formats = store or Store(), formats

    def __call__(self, function: Callable[..., Result], *inputs: Any) -> Result:
        """Return the result of a function."""
        (result,) = self.all(function, [inputs])
        return result

    def all(self, function: Callable[..., Result], inputs: Iterable[Sequence[Any]]) -> list[Result]:
        """Return the results of a function for several tuples of arguments."""
        keys = [self._store.start(function, arguments) for arguments in inputs]
        self._store.wait_for(keys)
        computations = [self._store.computations[key].result() for key in keys]
        self.times |= {key: computation.seconds for key, computation in zip(keys, computations, strict=True)}
        return [computation.result for computation in computations]

    def drawings(self, *figures: tuple[str, Callable[..., Figure], *tuple[Any, ...]]) -> tuple[Drawing, ...]:
        """Draw figures, each given by its caption, the function that draws it, and the arguments of this function."""
        if not self._formats:
            return tuple(Drawing(caption, "", b"") for caption, *_ in figures)
        inputs = [(caption, function, arguments, self._formats) for caption, function, *arguments in figures]
        return tuple(self.all(_drawing, inputs))


def _drawing(
    caption: str, function: Callable[..., Figure], arguments: Sequence[Any], formats: tuple[str, ...]
) -> Drawing:
    return render(caption, partial(function, *arguments), formats)


def wait_for(futures: Iterable[Future[Any]]) -> None:
    """Wait for all futures, or raise the first error."""
    for future in wait(futures, return_when=FIRST_EXCEPTION).done:
        future.result()


def computation_key(function: Callable[..., Any], *inputs: Any) -> str:
    """Return the key of a computation, 24 hexadecimal digits."""
    return hashlib.sha256(encode([function, _program(), inputs])).hexdigest()[:24]


def encode(value: Any) -> bytes:
    """Return plain data as MessagePack; arrays keep every bit."""
    return msgspec.msgpack.encode(value, enc_hook=_plain)


def decode(content: bytes, kind: Any) -> Any:
    """Return plain data of a type from MessagePack."""
    return msgspec.msgpack.decode(content, type=kind, dec_hook=_array)


def run_function(function: Callable[..., Any], inputs: Sequence[Any]) -> bytes:
    """Return computing time and result of a function as they are kept; all results pass through this form."""
    began = time.perf_counter()
    result = function(*inputs)
    return encode((time.perf_counter() - began, result))


def kept(path: Path, function: Callable[..., Any]) -> Computation | None:
    """Return the result of a function in a file, or None if there is none that can be used."""
    try:
        content = path.read_bytes()
        return unpack(body, function) if content == with_digest(body := content[DIGEST_BYTES:]) else None
    except (OSError, ValueError, msgspec.MsgspecError):
        return None


def unpack(content: bytes, function: Callable[..., Any]) -> Computation:
    """Return a kept computation, with its result in the type that the function declares."""
    seconds, result = msgspec.msgpack.decode(content, type=tuple[float, msgspec.Raw])
    return Computation(seconds, decode(result, typing.get_type_hints(function)["return"]))


def with_digest(content: bytes) -> bytes:
    """Return the content of a file that shows whether it was damaged: a SHA-256 digest stands in front."""
    return hashlib.sha256(content).digest() + content


@cache
def _program() -> str:
    """Return a hash of the sources of this program and of the versions that determine its numbers."""
    digest = hashlib.sha256(f"{version('casadi')} {version('numpy')} {version('scipy')}".encode())
    for package in (ancf_casadi, problems):
        folder = Path(str(package.__file__)).parent
        for path in sorted(folder.rglob("*.py")):
            digest.update(str(path.relative_to(folder)).encode() + path.read_bytes())
    return digest.hexdigest()


def _plain(value: Any) -> Any:
    """Return an array as type, shape and bytes, and a function of a module as its name."""
    if isinstance(value, np.ndarray):
        return [value.dtype.str, list(value.shape), np.ascontiguousarray(value).tobytes()]
    if isinstance(value, np.generic):
        return value.item()
    if inspect.isfunction(value) and "<" not in value.__qualname__:
        return f"{value.__module__}.{value.__qualname__}"
    raise NotImplementedError(f"{type(value).__name__} is not plain data")


def _array(kind: Any, data: Any) -> Any:
    """Return an array from type, shape and bytes."""
    if typing.get_origin(kind) is not np.ndarray and kind is not np.ndarray:
        raise NotImplementedError(f"{kind} is not plain data")
    name, shape, content = data
    if np.dtype(name).hasobject:
        raise ValueError("an array of objects")
    return np.frombuffer(content, np.dtype(name)).reshape(shape)
