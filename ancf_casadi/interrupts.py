"""Ctrl-C while a solver library is at work.

A signal that raises inside a CasADi call surfaces as a failure of the solver, or not at all.  It is therefore noted
while the call runs, and acted upon after it.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator


@contextlib.contextmanager
def noted_interrupts() -> Iterator[list[int]]:
    """Note each Ctrl-C instead of raising; outside the main thread, or where it is ignored, there is none to note."""
    noted: list[int] = []
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or before in (signal.SIG_IGN, None):
        yield noted
        return
    signal.signal(signal.SIGINT, lambda number, frame: noted.append(number))
    try:
        yield noted
    finally:
        signal.signal(signal.SIGINT, before)
