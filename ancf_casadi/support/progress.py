"""Progress on a terminal of work of unknown length, such as a fit.

The caller opens a counter; each step that takes noticeable time calls ``count_step``.  Without an open counter, or if
standard error is not a terminal, nothing is shown.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from contextvars import ContextVar
from typing import NoReturn

from tqdm import tqdm

LINE = "{desc}: {n} steps, {elapsed}, {rate_noinv_fmt}"
BAR_DELAY = 0.2  # s before the counter appears

_open: ContextVar[tqdm[NoReturn] | None] = ContextVar("counter", default=None)


@contextlib.contextmanager
def counter(title: str, *, shown: bool = True) -> Iterator[None]:
    """Count steps on a terminal if ``shown`` is true, no other counter is open, and the work takes noticeable time."""
    if not shown or _open.get() is not None:
        yield
        return
    with tqdm(desc=title, unit=" steps", disable=None, delay=BAR_DELAY, leave=False, bar_format=LINE) as bar:
        token = _open.set(bar)
        try:
            yield
        finally:
            _open.reset(token)


def count_step() -> None:
    """Count one step."""
    bar = _open.get()
    if bar is not None:
        bar.update()
