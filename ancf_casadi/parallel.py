"""Many independent runs, one after the other or through any executor of ``concurrent.futures``.

    runs = run_all([partial(simulate, model, damping=law, duration=10.0) for law in laws], jobs=2)

The tasks travel to other processes, so they are functions of a module, or ``functools.partial`` of one, and so are what
they return.  A run gives the same numbers wherever it takes place.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from typing import TypeVar

from tqdm import tqdm

Result = TypeVar("Result")

BAR = "{l_bar}{bar}| [{elapsed}<{remaining}]"


def run_all(
    tasks: Sequence[Callable[[], Result]],
    *,
    executor: Executor | None = None,
    jobs: int = 1,
    sizes: Sequence[float] | None = None,
    progress: bool = False,
    title: str = "runs",
) -> list[Result]:
    """Call each task, and return the results in their order.

    Parameters
    ----------
    tasks : sequence of callable
        What to call, without arguments.
    executor : Executor, optional
        Where: a pool of processes, a dask client's executor, ...; ``jobs`` processes if not given.
    jobs : int
        Processes, where no executor is given; with 1 the tasks are called here, one after the other.
    sizes : sequence of float, optional
        What each task costs; the largest begin first.  1 each if not given.
    progress : bool
        Whether to show a progress bar; a task counts as much as its size.
    title : str
        What stands before it.

    Raises
    ------
    Exception
        What a task raises; without an executor, those that have not begun by then are dropped.
    """
    costs = [1.0] * len(tasks) if sizes is None else list(sizes)
    order = sorted(range(len(tasks)), key=lambda k: -costs[k])
    results: dict[int, Result] = {}
    with contextlib.ExitStack() as stack:
        total = sum(costs)
        bar = stack.enter_context(tqdm(total=total, disable=not progress, bar_format=BAR, desc=title))
        if executor is None and jobs > 1:
            executor = stack.enter_context(processes(jobs))
        for k, result in _finished(tasks, order, executor):
            results[k] = result
            bar.update(min(costs[k], total - bar.n))
    return [results[k] for k in range(len(tasks))]


@contextlib.contextmanager
def processes(jobs: int) -> Iterator[Executor]:
    """Give processes that leave Ctrl-C to this one, and end at once where it stops early."""
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn"), initializer=_start_process)
    try:
        yield pool
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        raise
    finally:
        pool.shutdown()


def _finished(
    tasks: Sequence[Callable[[], Result]], order: Sequence[int], executor: Executor | None
) -> Iterator[tuple[int, Result]]:
    """Yield number and result of each task as it is done."""
    if executor is None:
        for k in order:
            yield k, tasks[k]()
        return
    futures = {executor.submit(tasks[k]): k for k in order}
    for future in as_completed(futures):
        yield futures[future], future.result()


def _start_process() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    tqdm.set_lock(threading.RLock())  # its own is shared between processes, and would outlive one that is ended
