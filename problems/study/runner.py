"""Running a study: each part as soon as those that it needs are found, in any executor, with finished tasks kept.

A part takes two steps, its tasks and its finding.  Tasks wait in one queue, and all processes stay busy as long as it
holds any: first come the tasks of parts that other parts wait for, and among these the longest.  Each result is written
as soon as it is there, so that a study that is stopped at any time continues from there.

The key of a result is a hash of everything that it depends on: the function, its inputs, and the sources of this
program with the version of CasADi.  A kept result is a SHA-256 digest, then the computing time (s) and the result as
MessagePack.  It is computed anew if it does not match its digest.  A file from elsewhere is never executed, because it
is decoded into the type that the function declares.
"""

from __future__ import annotations

import contextlib
import hashlib
import heapq
import math
import time
import typing
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import replace
from functools import cache, cached_property, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

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
from problems.study.part import Finding, Found, Part, PartReport, Study, Task

SUFFIX = ".msgpack"
DIGEST_BYTES = hashlib.sha256().digest_size
STEPS_FOLDER = "steps"  # folder with the kept results


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


def run_task(task: Task) -> bytes:
    """Run a task, and return its computing time and its result as they are kept; all results pass through this form."""
    began = time.perf_counter()
    result = task.function(*task.inputs)
    return encoded((time.perf_counter() - began, result))


def unpacked(content: bytes, task: Task) -> tuple[float, Any]:
    """Return the computing time (s) of a task, and its result in the type that its function declares."""
    seconds, result = msgspec.msgpack.decode(content, type=tuple[float, msgspec.Raw])
    return seconds, decoded(result, typing.get_type_hints(task.function)["return"])


def with_digest(content: bytes) -> bytes:
    """Return the content of a file that shows whether it was damaged: a SHA-256 digest stands in front."""
    return hashlib.sha256(content).digest() + content


def kept_in(folder: Path, key: str, task: Task) -> tuple[float, Any] | None:
    """Return time and result under a key in a folder, or None if there are none that can be used."""
    try:
        kept = (folder / f"{key}{SUFFIX}").read_bytes()
        content = kept[DIGEST_BYTES:]
        return unpacked(content, task) if kept == with_digest(content) else None
    except (OSError, ValueError, msgspec.MsgspecError):
        return None


def discard_all_but(folder: Path, keys: set[str]) -> None:
    """Remove the results of earlier studies from a folder."""
    for path in folder.glob(f"*{SUFFIX}"):
        if path.name.removesuffix(SUFFIX) not in keys:
            with contextlib.suppress(OSError):
                path.unlink()


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


def run_parts(
    study: Study, folder: Path, *, formats: tuple[str, ...], jobs: int, executor: Executor | None, progress: bool
) -> tuple[PartReport, ...]:
    """Run all parts of a study, and return their findings with the time of each.

    A part may stand before those that it needs.  The folder is that of the results, with the finished tasks of an
    earlier run.
    """
    findings = {"": Finding(None, beam=None if study.beam is None else BeamSpec.of(study.beam))}  # of the file
    awaited = {name for part in study.parts for name in part.needs}
    waiting = list(study.parts)
    running: dict[str, tuple[_Steps, list[str]]] = {}  # with the keys of the tasks that a part waits for
    keys: dict[str, list[str]] = {part.name: [] for part in study.parts}
    with contextlib.ExitStack() as stack:
        own = executor is None and jobs > 1
        start = partial(stack.enter_context, processes(jobs)) if own else lambda: executor
        bar = stack.enter_context(tqdm(total=0, disable=not progress, bar_format=COUNT_BAR, desc="study"))
        most = jobs + 1 if own else math.inf  # one task more than there are processes: none waits for this one
        queue = _Queue(folder / STEPS_FOLDER, start, most, bar)
        stack.callback(queue.cancel)

        def go_on(name: str, steps: _Steps, results: Any) -> None:
            try:
                tasks = steps.send(results)
            except StopIteration as end:
                findings[name] = end.value
            else:
                put = queue.put(tasks, urgent=name in awaited)
                keys[name] += put
                running[name] = steps, put

        while waiting or running:
            for part in [part for part in waiting if findings.keys() >= set(part.needs)]:
                waiting.remove(part)
                go_on(part.name, _steps(part, findings, formats), None)
            done = [name for name, (_, awaits) in running.items() if queue.results.keys() >= set(awaits)]
            for name in done:
                steps, awaits = running.pop(name)
                go_on(name, steps, [queue.results[key] for key in awaits])
            if not done:
                queue.finish_one()
    discard_all_but(queue.folder, set(queue.tasks))
    return tuple(_reports(study.parts, findings, keys, queue))


def _reports(
    parts: Sequence[Part], findings: Found, keys: Mapping[str, Sequence[str]], queue: _Queue
) -> Iterator[PartReport]:
    """Yield the findings with the time of each part, whose last key is that of its finding."""
    counted: set[str] = set()
    for part in parts:
        own = keys[part.name]
        new = set(own) - counted
        counted |= new
        yield PartReport(
            part,
            findings[part.name],
            seconds=sum(queue.seconds[key] for key in own),
            tasks=len(own) - 1,
            kept=sum(key in queue.earlier for key in own),
            own_seconds=sum(queue.seconds[key] for key in new),
            own_tasks=len(new - {own[-1]}),
        )


_Steps = Generator[list[Task], Any, Finding]


def _steps(part: Part, findings: Found, formats: tuple[str, ...]) -> _Steps:
    """Yield the tasks of a part, then its finding as a task, and return the finding."""
    found = {name: replace(findings[name], tables=(), figures=(), warnings=()) for name in part.needs}
    tasks = part.tasks(found)
    results = yield list(tasks)
    cost = 0.2 * (1 + len(tasks))  # s, to draw a figure; most parts have one for each task
    finding: Finding
    (finding,) = yield [Task(_finding, (part.kind, part, results, found, formats if part.draw else ()), cost)]
    return finding


def _finding(kind: str, part: Part, results: Sequence[Any], found: Found, formats: tuple[str, ...]) -> Finding:
    with located(part.name), only(formats):
        finding = part.finding(results, found)
    return finding if part.draw else replace(finding, figures=())


class _Queue:
    """Tasks by key: those that wait, those that run, and the results, of this run or kept from an earlier one.

    ``start`` returns the executor, or None to run the tasks in this process; it may have ``most`` tasks at once.  In
    the progress bar, a task counts by its cost.
    """

    def __init__(self, folder: Path, start: Callable[[], Executor | None], most: float, bar: Any) -> None:
        self.folder = folder
        self.tasks: dict[str, Task] = {}
        self.results: dict[str, Any] = {}
        self.seconds: dict[str, float] = {}  # computing times, as they were when the tasks ran
        self.earlier: set[str] = set()  # kept from an earlier run
        self._start, self._most, self._bar = start, most, bar
        self._waiting: list[tuple[bool, float, int, str]] = []  # a heap: not urgent, -cost, order, key
        self._running: dict[Future[bytes], str] = {}

    def cancel(self) -> None:
        """Drop the tasks that an executor has not begun."""
        for future in self._running:
            future.cancel()

    @cached_property
    def _executor(self) -> Executor | None:
        """The executor of all tasks, started with the first one, because each process takes a second to start."""
        return self._start()

    def put(self, tasks: Sequence[Task], *, urgent: bool) -> list[str]:
        """Return the keys of tasks, of which those wait that have no result yet; equal tasks run once."""
        keys = [key_of(task) for task in tasks]
        for key, task in zip(keys, tasks, strict=True):
            if key in self.tasks:
                continue
            self.tasks[key] = task
            if (kept := kept_in(self.folder, key, task)) is not None:
                self.seconds[key], self.results[key] = kept
                self.earlier.add(key)
            else:
                heapq.heappush(self._waiting, (not urgent, -task.cost, len(self.tasks), key))
                self._bar.total += task.cost
        return keys

    def finish_one(self) -> None:
        """Run tasks until at least one more is finished."""
        if (executor := self._executor) is None:
            key = heapq.heappop(self._waiting)[-1]
            self._keep(key, run_task(self.tasks[key]))
            return
        with unbroken():
            while self._waiting and len(self._running) < self._most:
                key = heapq.heappop(self._waiting)[-1]
                self._running[executor.submit(run_task, self.tasks[key])] = key
            for future in wait(self._running, return_when=FIRST_COMPLETED).done:
                self._keep(self._running.pop(future), future.result())

    def _keep(self, key: str, content: bytes) -> None:
        write_file(self.folder / f"{key}{SUFFIX}", with_digest(content))
        self.seconds[key], self.results[key] = unpacked(content, self.tasks[key])
        self._bar.update(self.tasks[key].cost)
