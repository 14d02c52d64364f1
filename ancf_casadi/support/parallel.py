"""Independent runs, one after the other or through any executor of ``concurrent.futures``.

    if __name__ == "__main__":
        runs = run_all([partial(simulate, model, damping=law, duration=10.0) for law in laws], jobs=2)

Tasks and results are pickled on their way to other processes, so a task is a function of a module, or
``functools.partial`` of one.  A run gives the same numbers in any process.

Each process first imports the script that started it.  A script that starts processes at its top level, and not under
``if __name__ == "__main__":``, would start more in each of them, and is refused.

A process ends with its parent, however the parent ends: it waits for a pipe to close that only the parent holds open.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor, as_completed
from types import NoneType
from typing import TypeVar

from tqdm import tqdm

from ancf_casadi.exceptions import InputError, NumericsError
from ancf_casadi.support.inputs import check_instance, flag, is_sequence, numbers, shown, whole
from ancf_casadi.support.interrupts import lasting_interrupts

Result = TypeVar("Result")

COUNT_BAR = "{l_bar}{bar}| [{elapsed}<{remaining}]"


@lasting_interrupts()
def run_all(
    tasks: Sequence[Callable[[], Result]],
    *,
    executor: Executor | None = None,
    jobs: int = 1,
    progress: bool = False,
    sizes: Sequence[float] | None = None,
    title: str = "runs",
    each: Callable[[int, Result], object] | None = None,
) -> list[Result]:
    """Call each task, and return the results in their order.

    Parameters
    ----------
    tasks : sequence of callable
        Functions without arguments.
    executor : Executor, optional
        Executor of the tasks, such as a process pool or the executor of a dask client; ``jobs`` processes if not given.
    jobs : int
        Number of processes if no executor is given; with 1 the tasks run in this process, one after the other.  With
        more, a script must call this under ``if __name__ == "__main__":``.
    progress : bool
        Show a progress bar, in which a task counts by its size.
    sizes : sequence of float, optional
        Cost of each task, in any unit; the most expensive task starts first.  All equal if not given.
    title : str
        Title of the progress bar.
    each : callable, optional
        Called in this process with the number of a task, from 0, and its result as soon as it is done.

    Raises
    ------
    InputError
        If a task or the number of processes is not usable, or the script asks for processes at its top level.
    NumericsError
        If a process ends before its task is done.
    Exception
        The exception of a task; without an executor, tasks that have not started by then are dropped.  As in a
        ``NumericsError``, its attribute ``results`` holds the results so far, by the number of the task.

    Examples
    --------
    >>> from functools import partial
    >>> from ancf_casadi import Beam, Model, natural_modes, run_all
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> models = [Model(beam.with_(thickness=h)) for h in (0.4e-3, 0.5e-3, 0.6e-3)]
    >>> found = run_all([partial(natural_modes, model, count=1) for model in models])
    >>> [f"{modes.frequencies[0]:.2f} Hz" for modes in found]
    ['1.59 Hz', '1.88 Hz', '2.17 Hz']
    """
    if not is_sequence(tasks) or not all(map(callable, tasks)):
        raise InputError(f"must be a sequence of functions without arguments, got {shown(tasks)}", "tasks")
    if each is not None and not callable(each):
        raise InputError(f"must be a function, got {shown(each)}", "each")
    check_instance(executor, "executor", Executor, NoneType)
    progress = flag(progress, "progress")
    jobs = min(whole(jobs, "jobs", 1), max(1, len(tasks)))
    costs = [1.0] * len(tasks) if sizes is None else list(numbers(sizes, "sizes"))
    if len(costs) != len(tasks):
        raise InputError(f"has {len(costs)} values for {len(tasks)} tasks", "sizes")
    order = sorted(range(len(tasks)), key=lambda k: -costs[k])
    results: dict[int, Result] = {}
    with contextlib.ExitStack() as stack:
        total = sum(costs)
        bar = stack.enter_context(tqdm(total=total, disable=not progress, bar_format=COUNT_BAR, desc=title))
        if executor is None and jobs > 1:
            _check_portable(tasks)
            executor = stack.enter_context(processes(jobs))
        try:
            for k, result in _completed_tasks(tasks, order, executor):
                results[k] = result
                if each is not None:
                    each(k, result)
                bar.update(min(costs[k], total - bar.n))
        except Exception as error:
            error.results = results  # type: ignore[attr-defined]
            error.add_note(f"{len(results)} of {len(tasks)} tasks were done; `results` of this exception holds theirs")
            raise
    return [results[k] for k in range(len(tasks))]


@contextlib.contextmanager
def processes(jobs: int) -> Iterator[Executor]:
    """Start processes that ignore Ctrl-C and end with this process, or at once if it stops early."""
    _check_script()
    earlier_children = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn"), initializer=_start_process)
    try:
        try:
            first, *_ = [pool.submit(int) for _ in range(jobs)]
            first.result()  # wait until it is ready
        except BrokenExecutor:
            raise InputError(
                "processes import the script that asks for them, which failed; put what the script does under "
                'if __name__ == "__main__":, or use jobs=1',
                "jobs",
            ) from None
        yield pool
    except BaseException:
        for process in set(multiprocessing.active_children()) - earlier_children:
            process.terminate()
        pool.shutdown(cancel_futures=True)  # its thread ends before the interpreter, which would wake it up
        raise
    finally:
        pool.shutdown()


@contextlib.contextmanager
def executor_errors() -> Iterator[None]:
    """Raise a ``NumericsError`` if a process of an executor ends before its task is done."""
    try:
        yield
    except BrokenExecutor:
        raise NumericsError(
            "a process ended before its task was done, perhaps for lack of memory; use fewer jobs"
        ) from None


def _check_portable(tasks: Sequence[Callable[[], object]]) -> None:
    """Check that tasks can be sent to another process."""
    for position, task in enumerate(tasks, start=1):
        try:
            pickle.dumps(task)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise InputError(
                f"number {position} cannot be sent to another process ({error}); use a function of a module, or "
                "functools.partial of one",
                "tasks",
            ) from None


def _check_script() -> None:
    """End a process that asks for processes while it imports the script; refuse a script that is not a file."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):  # the test of multiprocessing itself
        sys.exit(1)  # without a message: the first process reports it
    main = sys.modules["__main__"]
    script = getattr(main, "__file__", None)
    if getattr(main, "__spec__", None) is None and script is not None and not os.path.exists(script):
        raise InputError(f"processes import the script, and {script} is not a file; save it, or use jobs=1", "jobs")


def _completed_tasks(
    tasks: Sequence[Callable[[], Result]], order: Sequence[int], executor: Executor | None
) -> Iterator[tuple[int, Result]]:
    """Yield the number and the result of each task once it is done."""
    if executor is None:
        for k in order:
            yield k, tasks[k]()
        return
    with executor_errors():
        futures = {executor.submit(tasks[k]): k for k in order}
        try:
            for future in as_completed(list(futures)):
                yield futures.pop(future), future.result()
        except Exception:
            for future, k in futures.items():  # those that ended at the same time
                if future.done() and not future.cancelled() and future.exception() is None:
                    yield k, future.result()
            raise


def _start_process() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    tqdm.set_lock(threading.RLock())  # the default lock is shared, and a killed process would keep it
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Wait for the end of the parent; this thread runs on during calls of CasADi."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
