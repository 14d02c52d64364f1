"""Ctrl-C and requests to end while a solver library runs.

A signal that raises an exception inside a CasADi call surfaces as a failure of the solver, or not at all.  It is
therefore noted during the call and acted upon after it.  A Python function that the library calls can ask
``interrupted`` and stop early, so that the call ends soon.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from typing import Any

ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))

_noted: list[list[int]] = []  # signals noted in each open context, the innermost last; main thread only


@contextlib.contextmanager
def noted_interrupts() -> Iterator[list[int]]:
    """Note each Ctrl-C instead of raising; none is noted outside the main thread or if Ctrl-C is ignored.

    SIGTERM and SIGHUP are noted as well if the program handles them, and delivered to it at the end.
    """
    noted: list[int] = []
    before = _handlers(callable)
    if not before:
        yield noted
        return
    _noted.append(noted)
    try:
        with _handled(before, lambda number, frame: noted.append(number)):
            yield noted
    finally:
        _noted.pop()
        for number in noted:
            if number != signal.SIGINT:
                signal.raise_signal(number)


@contextlib.contextmanager
def raised_endings() -> Iterator[list[int]]:
    """Note Ctrl-C, SIGTERM and SIGHUP, and raise ``KeyboardInterrupt`` for each, so that a program can clean up.

    A CasADi call that is running may turn the exception into any error of its own, or into a run that ends early.
    """
    noted: list[int] = []

    def end(number: int, _: object) -> None:
        noted.append(number)
        raise KeyboardInterrupt

    with _handled(_handlers(lambda handler: handler in (signal.default_int_handler, signal.SIG_DFL)), end):
        yield noted


@contextlib.contextmanager
def delayed_interrupts() -> Iterator[None]:
    """Delay Ctrl-C: raise ``KeyboardInterrupt`` at the end, in place of any other error."""
    with noted_interrupts() as noted:
        try:
            yield
        finally:
            if noted:
                raise KeyboardInterrupt from None


def interrupted() -> bool:
    """Return whether a Ctrl-C was noted in an open context; the running work should then stop."""
    return any(_noted)


def _handlers(wanted: Callable[[Any], bool]) -> dict[int, Any]:
    """Return the present handlers that are wanted, by signal; none outside the main thread."""
    if threading.current_thread() is not threading.main_thread():
        return {}
    return {number: signal.getsignal(number) for number in ENDING if wanted(signal.getsignal(number))}


@contextlib.contextmanager
def _handled(before: dict[int, Any], handler: Callable[[int, Any], object]) -> Iterator[None]:
    """Handle signals in another way, and restore their handlers at the end."""
    for number in before:
        signal.signal(number, handler)
    try:
        yield
    finally:
        for number, usual in before.items():
            signal.signal(number, usual)
