"""Running a study: its steps in threads, which share the computations of the study.

A step may stand before those that it needs.  Its thread waits for them, then runs the function of the step, whose
computations run in any executor (``compute``).  With one job and no executor, all this happens in this thread, one
after the other.
"""

from __future__ import annotations

import contextlib
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path
from typing import Any

from tqdm import tqdm

from ancf_casadi.exceptions import NumericsError
from ancf_casadi.mechanics.spec import BeamSpec
from ancf_casadi.support.parallel import COUNT_BAR, executor_errors, processes
from problems.study.compute import SUFFIX, Compute, Store, ThisThread, decode, encode, wait_for
from problems.study.step import Finding, Step, Study

STEPS_FOLDER = "steps"  # folder with the kept results
MOST_THREADS = 10_000  # which wait: one for each step, and one for each computation


def run_steps(
    study: Study,
    folder: Path,
    *,
    quick: bool = False,
    keep_others: bool = False,
    formats: tuple[str, ...],
    jobs: int,
    executor: Executor | None,
    progress: bool,
) -> tuple[Finding, ...]:
    """Run all steps, and return their findings with the times of their computations.

    The folder is that of the results, with the finished computations of an earlier run; those of other steps are
    removed unless they are to be kept.
    """
    by_name = {step.name: step for step in study.steps}
    kept_folder = folder / STEPS_FOLDER
    findings: dict[str, Future[Finding]] = {}

    def run(step: Step) -> Finding:
        needed = {name: findings[name].result() for name in step.needs}
        with store.turn:
            compute = Compute(store, quick=quick, formats=formats if step.draw else ())
            try:
                finding: Finding = decode(encode(step.finding(compute, needed)), Finding)  # plain data alone
            except NumericsError as error:
                error.args = (f"{step.name}: {error}",)
                raise
        figures = [figure if "png" in formats else replace(figure, png=b"") for figure in finding.figures if step.draw]
        return replace(finding, name=step.name, times=compute.times, figures=tuple(figures))

    with contextlib.ExitStack() as stack:
        stack.enter_context(executor_errors())
        bar: Any = stack.enter_context(tqdm(total=0, disable=not progress, bar_format=COUNT_BAR, desc="study"))
        threads: Executor = ThisThread() if executor is None and jobs == 1 else ThreadPoolExecutor(MOST_THREADS)
        workers = cache(lambda: executor or (stack.enter_context(processes(jobs)) if jobs > 1 else threads))
        store = Store(kept_folder, workers, threads, bar)
        stack.callback(threads.shutdown, wait=False)
        stack.callback(store.stop, cancel=executor is not None)  # processes of the study are ended instead
        findings[""] = ThisThread().submit(Finding, None, beam=None if study.beam is None else BeamSpec.of(study.beam))
        for name in TopologicalSorter({step.name: step.needs for step in study.steps}).static_order():
            if name:
                findings[name] = threads.submit(run, by_name[name])
        wait_for(findings.values())
    for path in [] if keep_others else kept_folder.glob(f"*{SUFFIX}"):
        if path.stem not in store.computations:  # of an earlier study
            with contextlib.suppress(OSError):
                path.unlink()
    return tuple(findings[name].result() for name in by_name)
