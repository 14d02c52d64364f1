"""The one thread that computes for the page, so that nothing is computed twice at the same time.

It also imports what computes, which is slow, while the browser loads the page.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, TypeVar

from ancf_casadi.support.interrupts import stoppable
from ancf_casadi.support.progress import counted, progress_line

T = TypeVar("T")

WORKER = ThreadPoolExecutor(1)


@dataclass(eq=False)
class Work:
    """A computation that counts its steps, and that another thread can stop."""

    title: str
    began: float = field(default_factory=time.perf_counter)
    steps: int = 0
    stop: threading.Event = field(default_factory=threading.Event)

    def run(self, function: Callable[..., T], *arguments: object) -> T | None:
        """Return the result of a function; None if it was stopped."""
        try:
            with stoppable(self.stop), counted(self._count):
                return function(*arguments)
        except KeyboardInterrupt:
            return None

    def progress(self) -> str:
        """Return what a command would show of the progress."""
        return progress_line(self.title, self.steps, time.perf_counter() - self.began)

    def _count(self) -> None:
        self.steps += 1


async def work(function: Callable[..., T], *arguments: Any) -> T:
    """Return the result of a function that the thread of all computations calls."""
    return await asyncio.get_running_loop().run_in_executor(WORKER, function, *arguments)
