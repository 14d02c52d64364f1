"""Signs of life on a terminal from work whose length is unknown, such as a fit.

The caller opens a counter; each part of the work that takes noticeable time calls ``step``.  Without an open counter,
or if standard error is no terminal, nothing is shown.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from contextvars import ContextVar
from typing import NoReturn

from tqdm import tqdm

LINE = "{desc}: {n} steps, {elapsed}"
BAR_DELAY = 0.2  # s before the counter appears

_open: ContextVar[tqdm[NoReturn] | None] = ContextVar("counter", default=None)


@contextlib.contextmanager
def counter(title: str) -> Iterator[None]:
    """Count steps on a terminal, unless the work is done at once."""
    with tqdm(desc=title, disable=None, delay=BAR_DELAY, leave=False, bar_format=LINE) as bar:
        token = _open.set(bar)
        try:
            yield
        finally:
            _open.reset(token)


def step() -> None:
    """Count one step."""
    bar = _open.get()
    if bar is not None:
        bar.update()
