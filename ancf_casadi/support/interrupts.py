"""Ctrl-C and termination signals while a solver library runs.

A signal that raises an exception inside a CasADi call appears as a failure of the solver, or not at all: CasADi
swallows the exception even while it converts an array.  There are two remedies.  During a long call, the signal is
noted and handled afterwards; a Python function that the library calls can check ``has_interrupt`` and stop early.
Around work of many calls, the exception is raised repeatedly until the work ends.

Signals reach the main thread alone.  An event stops the work of another thread (``stoppable``) at the same places.
"""

from __future__ import annotations

import _thread
import contextlib
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from typing import Any

ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))

REPEAT = 0.2  # interval at which Ctrl-C is raised again, s

_noted: list[list[int]] = []  # signals noted in each open context, the innermost last; main thread only
_stop: ContextVar[threading.Event | None] = ContextVar("stop", default=None)


@contextlib.contextmanager
def stoppable(stop: threading.Event) -> Iterator[None]:
    """Raise ``KeyboardInterrupt`` in the work of this thread once an event is set, in place of any error or result."""
    token = _stop.set(stop)
    try:
        yield
    finally:
        _stop.reset(token)
        if stop.is_set() and not isinstance(sys.exception(), KeyboardInterrupt):
            raise KeyboardInterrupt from None


@contextlib.contextmanager
def noted_interrupts() -> Iterator[list[int]]:
    """Note each Ctrl-C instead of raising; none is noted outside the main thread or if Ctrl-C is ignored.

    SIGTERM and SIGHUP are noted as well if the program handles them, and delivered to it at the end.  So is a Ctrl-C
    within ``lasting_interrupts`` or ``raised_endings``.
    """
    noted: list[int] = []
    handlers = _handlers(callable)
    if not handlers:
        yield noted
        return
    _noted.append(noted)
    try:
        with _replace_handlers(handlers, lambda number, frame: noted.append(number)):
            yield noted
    finally:
        _noted.pop()
        for number in noted:
            if number != signal.SIGINT or isinstance(handlers[number], _RepeatedInterrupt):
                signal.raise_signal(number)


@contextlib.contextmanager
def raised_endings() -> Iterator[list[int]]:
    """Note Ctrl-C, SIGTERM and SIGHUP, and raise ``KeyboardInterrupt`` for each, so that a program can clean up.

    The exception is raised again if a CasADi call swallows it.  Such a call may also convert it to another error.
    """
    with _raise_until_end(_handlers(lambda handler: handler in (signal.default_int_handler, signal.SIG_DFL))) as noted:
        yield noted


@contextlib.contextmanager
def lasting_interrupts() -> Iterator[None]:
    """Raise ``KeyboardInterrupt`` at Ctrl-C until the work ends, and in place of any other error or result.

    It is also a decorator for long functions.  A handler of Ctrl-C that the program has installed remains in force.
    """
    with _raise_until_end(_handlers(lambda handler: handler is signal.default_int_handler)) as noted:
        try:
            yield
        finally:
            if noted and not isinstance(sys.exception(), KeyboardInterrupt):
                raise KeyboardInterrupt from None


@contextlib.contextmanager
def delayed_interrupts() -> Iterator[None]:
    """Delay Ctrl-C: raise ``KeyboardInterrupt`` at the end, in place of any other error."""
    with noted_interrupts() as noted:
        try:
            yield
        finally:
            if noted or _is_stopped():
                raise KeyboardInterrupt from None


def has_interrupt() -> bool:
    """Return whether a Ctrl-C was noted in an open context, or an event stops this thread; its work should stop."""
    return any(_noted) or _is_stopped()


def _is_stopped() -> bool:
    """Return whether an event stops the work of this thread."""
    stop = _stop.get()
    return stop is not None and stop.is_set()


def _handlers(wanted: Callable[[Any], bool]) -> dict[int, Any]:
    """Return the current handlers that satisfy a condition, by signal; none outside the main thread."""
    if threading.current_thread() is not threading.main_thread():
        return {}
    return {number: signal.getsignal(number) for number in ENDING if wanted(signal.getsignal(number))}


@contextlib.contextmanager
def _raise_until_end(handlers: dict[int, Any]) -> Iterator[list[int]]:
    """Raise ``KeyboardInterrupt`` at each of these signals, and again as long as the context is open."""
    ending, hook = _RepeatedInterrupt(), sys.unraisablehook
    with _replace_handlers(handlers, ending):
        try:
            yield ending.noted
        finally:
            ending.open = False
            with ending.sending:  # a signal that is on its way finds this handler
                sys.unraisablehook = hook


class _RepeatedInterrupt:
    """A handler that notes signals and raises ``KeyboardInterrupt``, again until that is handled."""

    def __init__(self) -> None:
        self.noted: list[int] = []
        self.open = True
        self.sending = threading.Lock()
        self._is_repeat = False  # the next signal comes from ``_repeat``

    def __call__(self, number: int, _: object) -> None:
        if self._is_repeat:
            self._is_repeat = False
            if not self.open or isinstance(sys.exception(), KeyboardInterrupt):
                return
        else:
            self.noted.append(number)
            if len(self.noted) == 1:
                sys.unraisablehook = _without_interrupts(sys.unraisablehook)
                _thread.start_new_thread(self._repeat, (number,))  # a Thread takes locks that this thread may hold
        raise KeyboardInterrupt

    def _repeat(self, number: int) -> None:
        """Send the signal to the main thread every ``REPEAT`` seconds."""
        while self.open:
            time.sleep(REPEAT)
            with self.sending:
                if self.open:
                    self._is_repeat = True
                    if sys.platform == "win32":
                        _thread.interrupt_main(number)
                    else:
                        signal.pthread_kill(threading.main_thread().ident or 0, number)  # it wakes from waiting


def _without_interrupts(hook: Callable[[Any], object]) -> Callable[[Any], object]:
    """Return a hook that does not print a swallowed ``KeyboardInterrupt``, which will be raised again."""
    return lambda failure: None if failure.exc_type is KeyboardInterrupt else hook(failure)


@contextlib.contextmanager
def _replace_handlers(handlers: dict[int, Any], handler: Callable[[int, Any], object]) -> Iterator[None]:
    """Replace the handlers of signals, and restore them at the end."""
    for number in handlers:
        signal.signal(number, handler)
    try:
        yield
    finally:
        for number, original in handlers.items():
            signal.signal(number, original)
