"""Running a study: each part once those that it needs have run, in any executor, with finished computations kept.

A part takes two steps, its tasks and its finding, which is a task too.  A task is a function and its arguments; equal
tasks run once.  Each result is written as soon as it is there, so that a study that was stopped at any time continues
from there.

The name of the file of a result is a hash of everything that it depends on: the function, its arguments, and the
sources of this program with the version of CasADi.  The file holds a SHA-256 digest, then the computing time (s) and
the result as MessagePack.  A result that does not match its digest is computed anew.  A file from elsewhere is never
executed, because it is decoded into the type that the function declares.
"""

from __future__ import annotations

import contextlib
import hashlib
import threading
import time
import typing
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_EXCEPTION, CancelledError, Executor, Future, ThreadPoolExecutor, wait
from dataclasses import replace
from functools import cache
from graphlib import TopologicalSorter
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple, ParamSpec, TypeVar

import msgspec
import numpy as np
from tqdm import tqdm

import ancf_casadi
import problems
from ancf_casadi.mechanics.spec import BeamSpec
from ancf_casadi.support.files import write_file
from ancf_casadi.support.inputs import located
from ancf_casadi.support.parallel import COUNT_BAR, processes, unbroken
from problems.study.drawing import only
from problems.study.part import Finding, Found, Part, Study, Task

SUFFIX = ".msgpack"
DIGEST_BYTES = hashlib.sha256().digest_size
STEPS_FOLDER = "steps"  # folder with the kept results
MOST_THREADS = 10_000  # which wait: one for each part, and one for each task

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


class Computation(NamedTuple):
    """The result of a task."""

    seconds: float  # computing time, as it was when the task ran
    result: Any


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


def run_task(task: Task, *, draw: bool = True) -> bytes:
    """Run a task, and return its computing time and its result as they are kept; all results pass through this form."""
    began = time.perf_counter()
    with contextlib.nullcontext() if draw else only(()):
        result = task.function(*task.inputs)
    return encoded((time.perf_counter() - began, result))


def kept(path: Path, task: Task) -> Computation | None:
    """Return the result of a task in a file, or None if there is none that can be used."""
    try:
        content = path.read_bytes()
        return unpacked(body, task) if content == with_digest(body := content[DIGEST_BYTES:]) else None
    except (OSError, ValueError, msgspec.MsgspecError):
        return None


def unpacked(content: bytes, task: Task) -> Computation:
    """Return a kept computation, with its result in the type that the function of its task declares."""
    seconds, result = msgspec.msgpack.decode(content, type=tuple[float, msgspec.Raw])
    return Computation(seconds, decoded(result, typing.get_type_hints(task.function)["return"]))


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


class ThisThread(Executor):
    """Calls each function at once; errors and Ctrl-C end the call of ``submit``."""

    def submit(
        self, function: Callable[Arguments, Result], /, *args: Arguments.args, **keywords: Arguments.kwargs
    ) -> Future[Result]:
        """Return the result."""
        future: Future[Result] = Future()
        future.set_result(function(*args, **keywords))
        return future


def run_parts(
    study: Study,
    folder: Path,
    *,
    keep_others: bool = False,
    formats: tuple[str, ...],
    jobs: int,
    executor: Executor | None,
    progress: bool,
) -> tuple[Finding, ...]:
    """Run all parts of a study, and return their findings with the times of their computations.

    A part may stand before those that it needs.  A thread of each part waits for those parts, then for its tasks; a
    thread of each task waits for the executor, and writes the result.  With one job and no executor, all this happens
    in this thread, one after the other.  The folder is that of the results, with the finished tasks of an earlier run;
    those of other parts are removed unless they are to be kept.
    """
    steps = folder / STEPS_FOLDER
    computations: dict[str, Future[Computation]] = {}  # by key
    findings: dict[str, Future[Finding]] = {}  # by the name of the part
    running: list[Future[bytes]] = []
    lock, stopped = threading.RLock(), threading.Event()

    def compute(path: Path, task: Task) -> Computation:
        if computation := kept(path, task):
            return computation
        with lock:
            if stopped.is_set():
                raise CancelledError
            bar.total += task.cost
            running.append(future := workers().submit(run_task, task, draw=bool(formats)))
        write_file(path, with_digest(content := future.result()))
        bar.update(task.cost)
        return unpacked(content, task)

    def submit(task: Task) -> tuple[str, Future[Computation]]:
        key = key_of(task)
        with lock:
            if key not in computations:
                computations[key] = threads.submit(compute, steps / f"{key}{SUFFIX}", task)
            return key, computations[key]

    def stop() -> None:
        with lock:
            stopped.set()
            for future in running if executor else ():  # processes of the study are ended instead
                future.cancel()

    def run(part: Part) -> Finding:
        found = {name: findings[name].result().needed_later() for name in part.needs}
        with lock:  # CasADi builds the expressions of one thread at a time
            tasks = part.tasks(found)
        longest_first = sorted(range(len(tasks)), key=lambda number: -tasks[number].cost)
        by_number = {number: submit(tasks[number]) for number in longest_first}
        submitted = [by_number[number] for number in range(len(tasks))]
        wait_for(future for _, future in submitted)
        results, cost = [future.result().result for _, future in submitted], 0.2 * (1 + len(tasks))  # s, of figures
        last = submit(Task(_finding, (part.kind, part, results, found, formats if part.draw else ()), cost))
        times = {key: future.result().seconds for key, future in (*submitted, last)}
        finding: Finding = last[1].result().result
        return replace(finding, name=part.name, times=times)

    with contextlib.ExitStack() as stack:
        stack.enter_context(unbroken())
        bar: Any = stack.enter_context(tqdm(total=0, disable=not progress, bar_format=COUNT_BAR, desc="study"))
        threads: Executor = ThisThread() if executor is None and jobs == 1 else ThreadPoolExecutor(MOST_THREADS)
        workers = cache(lambda: executor or (stack.enter_context(processes(jobs)) if jobs > 1 else threads))
        stack.callback(threads.shutdown, wait=False)
        stack.callback(stop)
        beam = None if study.beam is None else BeamSpec.of(study.beam)
        findings[""] = ThisThread().submit(Finding, None, beam=beam)  # of the file
        parts = {part.name: part for part in study.parts}
        for name in TopologicalSorter({name: part.needs for name, part in parts.items()}).static_order():
            if name:
                findings[name] = threads.submit(run, parts[name])
        wait_for(findings.values())
    for path in [] if keep_others else steps.glob(f"*{SUFFIX}"):
        if path.stem not in computations:  # of an earlier study
            with contextlib.suppress(OSError):
                path.unlink()
    return tuple(findings[name].result() for name in parts)


def wait_for(futures: Iterable[Future[Any]]) -> None:
    """Wait for all futures, or raise the first error."""
    for future in wait(futures, return_when=FIRST_EXCEPTION).done:
        future.result()


def _finding(kind: str, part: Part, results: Sequence[Any], found: Found, formats: tuple[str, ...]) -> Finding:
    with located(part.name), only(formats):
        finding = part.finding(results, found)
    return finding if part.draw else replace(finding, figures=())
