"""Ctrl-C, and requests to end, while a solver library is at work.

A signal that raises inside a CasADi call surfaces as a failure of the solver, or not at all.  It is therefore noted
while the call runs, and acted upon after it.  A function written in Python that the library calls can ask
``interrupted`` and give up its work, so that the call ends soon.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from typing import Any

ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))

_noted: list[list[int]] = []  # by the contexts that are open, the innermost last; of the main thread alone


@contextlib.contextmanager
def noted_interrupts() -> Iterator[list[int]]:
    """Note each Ctrl-C instead of raising; outside the main thread, or where it is ignored, there is none to note.

    SIGTERM and SIGHUP are noted as well, if the program handles them, and delivered to it at the end.
    """
    noted: list[int] = []
    before: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        before = {number: signal.getsignal(number) for number in ENDING if callable(signal.getsignal(number))}
    if not before:
        yield noted
        return
    for number in before:
        signal.signal(number, lambda number, frame: noted.append(number))
    _noted.append(noted)
    try:
        yield noted
    finally:
        _noted.pop()
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in noted:
            if number != signal.SIGINT:
                signal.raise_signal(number)


@contextlib.contextmanager
def delayed_interrupts() -> Iterator[None]:
    """Raise KeyboardInterrupt after a Ctrl-C, but only at the end, in place of any other error.

    Raises
    ------
    KeyboardInterrupt
        If there was a Ctrl-C.
    """
    with noted_interrupts() as noted:
        try:
            yield
        finally:
            if noted:
                raise KeyboardInterrupt from None


def interrupted() -> bool:
    """Return whether a Ctrl-C was noted in a context that is still open; the work under way is then to be given up."""
    return any(_noted)
