"""Progress of work of unknown length, such as a fit, on a terminal or elsewhere.

The caller opens a counter; each step that takes noticeable time calls ``count_step``.  Without an open counter, or if
standard error is not a terminal, nothing is shown.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from contextvars import ContextVar

from tqdm import tqdm

LINE = "{desc}: {n} steps, {elapsed}, {rate_noinv_fmt}"
UNIT = " steps"
BAR_DELAY = 0.2  # s before the counter appears

_open: ContextVar[Callable[[], object] | None] = ContextVar("counter", default=None)  # called at each step


@contextlib.contextmanager
def counter(title: str, *, shown: bool = True) -> Iterator[None]:
    """Count steps on a terminal if ``shown`` is true, no other counter is open, and the work takes noticeable time."""
    if not shown or _open.get() is not None:
        yield
        return
    with tqdm(desc=title, unit=UNIT, disable=None, delay=BAR_DELAY, leave=False, bar_format=LINE) as bar:
        with counted(bar.update):
            yield


@contextlib.contextmanager
def counted(call: Callable[[], object]) -> Iterator[None]:
    """Call a function at each step, in place of a counter on a terminal."""
    token = _open.set(call)
    try:
        yield
    finally:
        _open.reset(token)


def progress_line(title: str, steps: int, seconds: float) -> str:
    """Return what a terminal shows after a number of steps and a time."""
    return tqdm.format_meter(steps, 0, seconds, prefix=title, unit=UNIT, bar_format=LINE)


def count_step() -> None:
    """Count one step."""
    call = _open.get()
    if call is not None:
        call()
