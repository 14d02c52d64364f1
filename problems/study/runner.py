"""Running a study: level by level, in any executor, with finished tasks kept.

A level holds the parts whose needs are met: those that other parts wait for, or all if there are none, so that the last
level is long and keeps all processes busy.  First all tasks of its parts run, the longest first, then their findings.
Each result is written as soon as it is there, so that a study that is stopped at any time continues from there.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from ancf_casadi.support.inputs import located
from ancf_casadi.support.parallel import processes, run_all
from problems.study.drawing import only
from problems.study.part import Effort, Finding, Found, Part, Study, Task
from problems.study.store import Store, key_of, run_task

STEPS_FOLDER = "steps"  # folder with the kept results


@dataclass(frozen=True)
class PartTime:
    """Time of a finished part.

    Parameters
    ----------
    name : str
        Name of the part.
    seconds : float
        Computing time of its tasks and of its finding, s, as they were when they ran.
    tasks : int
        Number of tasks.
    kept : int
        Number of these that were kept from an earlier run.
    """

    name: str
    seconds: float
    tasks: int
    kept: int


def run_parts(
    study: Study, folder: Path, *, effort: Effort, jobs: int, executor: Executor | None, progress: bool
) -> tuple[dict[str, Finding], tuple[PartTime, ...]]:
    """Run all parts of a study, and return their findings by name with the time of each.

    Parameters
    ----------
    study : Study
        The study; a part may stand before those that it needs.
    folder : Path
        Folder of the results, with the finished tasks of an earlier run.
    effort : Effort
        Accuracy and length of the simulations.
    jobs, executor, progress
        As for ``run_all``.

    Raises
    ------
    AncfError
        If a part fails.
    """
    findings = {"": Finding(None, beam=study.beam)}  # of the file
    waiting = list(study.parts)
    with contextlib.ExitStack() as stack:
        start = partial(stack.enter_context, processes(jobs)) if executor is None and jobs > 1 else lambda: executor
        runner = _Runner(Store(folder / STEPS_FOLDER), start, progress)
        while waiting:
            ready = [part for part in waiting if all(name in findings for name in part.needs)]
            awaited = {name for part in waiting for name in part.needs}
            ready = [part for part in ready if part.name in awaited] or ready
            ahead = {part.name for part in ready}
            waiting = [part for part in waiting if part.name not in ahead]
            findings |= runner.level(ready, findings, effort)
    runner.store.discard_all_but(set(runner.keys))
    del findings[""]
    return findings, tuple(runner.steps[part.name] for part in study.parts)


class _Runner:
    """The executor, the store and the times of a study that runs."""

    def __init__(self, store: Store, start: Callable[[], Executor | None], progress: bool) -> None:
        self.store = store
        self.keys: list[str] = []
        self.steps: dict[str, PartTime] = {}
        self._start, self._progress = start, progress

    @cached_property
    def _executor(self) -> Executor | None:
        """The executor of all tasks, started with the first one, because each process takes a second to start."""
        return self._start()

    def level(self, parts: Sequence[Part], findings: Found, effort: Effort) -> dict[str, Finding]:
        found = {
            part.name: {name: replace(findings[name], tables=(), figures=(), warnings=()) for name in part.needs}
            for part in parts
        }
        tasks = {part.name: part.tasks(found[part.name], effort) for part in parts}
        results, times = self._run([task for part in parts for task in tasks[part.name]], "computing")
        own = iter(results)
        drawings = []
        for part in parts:
            of_part = tasks[part.name]
            inputs = (part.kind, part, [next(own) for _ in of_part], found[part.name], effort)
            # s, to draw a figure
            drawings.append(Task(_finding, inputs, 0.2 * (1 + len(of_part))))  # most have a figure for each task
        drawn, drawing_times = self._run(drawings, "drawing")
        spent = iter(times)
        for part, (seconds, kept) in zip(parts, drawing_times, strict=True):
            name = part.name
            of_tasks = [next(spent) for _ in tasks[name]]
            total = seconds + sum(time for time, _ in of_tasks)
            self.steps[name] = PartTime(name, total, len(of_tasks), sum(was for _, was in of_tasks) + kept)
        return {part.name: finding for part, finding in zip(parts, drawn, strict=True)}

    def _run(self, tasks: Sequence[Task], title: str) -> tuple[list[Any], list[tuple[float, bool]]]:
        """Return the results of tasks, and for each its time and whether it was kept from an earlier run."""
        keys = [key_of(task) for task in tasks]
        self.keys += keys
        by_key = dict(zip(keys, tasks, strict=True))  # equal tasks run once
        kept = {key: found for key, task in by_key.items() if (found := self.store.get(key, task)) is not None}
        missing = [key for key in by_key if key not in kept]
        done = run_all(
            [partial(run_task, by_key[key]) for key in missing],
            sizes=[by_key[key].cost for key in missing],
            title=title,
            each=lambda k, result: self.store.keep(missing[k], result),
            executor=self._executor if missing else None,
            progress=self._progress and bool(missing),
        )
        all_kept = kept | dict(zip(missing, done, strict=True))
        results = [all_kept[key].result(task) for key, task in zip(keys, tasks, strict=True)]
        return results, [(all_kept[key].seconds, key in kept) for key in keys]


def _finding(kind: str, part: Part, results: Sequence[Any], found: Found, effort: Effort) -> Finding:
    with located(part.name), only(effort.formats if part.draw else ()):
        finding = part.finding(results, found, effort)
    return finding if part.draw else replace(finding, figures=())
