"""Ctrl-C, and requests to end, while a solver library is at work.

A signal that raises inside a CasADi call surfaces as a failure of the solver, or not at all.  It is therefore noted
while the call runs, and acted upon after it.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from typing import Any

ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))


@contextlib.contextmanager
def noted_interrupts() -> Iterator[list[int]]:
    """Note each Ctrl-C instead of raising; outside the main thread, or where it is ignored, there is none to note.

    SIGTERM and SIGHUP are noted as well, if the program handles them, and delivered to it at the end.
    """
    noted: list[int] = []
    before: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        before = {number: signal.getsignal(number) for number in ENDING if callable(signal.getsignal(number))}
    for number in before:
        signal.signal(number, lambda number, frame: noted.append(number))
    try:
        yield noted
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in noted:
            if number != signal.SIGINT:
                signal.raise_signal(number)
