"""The last results of a function, kept for calls with equal arguments."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, update_wrapper
from typing import Any, Generic, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


class LastCalls(Generic[P, R]):
    """A function that keeps its last results; a call with an argument that has no hash is evaluated each time.

    A damping law of a user may be such an argument.
    """

    def __init__(self, function: Callable[P, R], count: int) -> None:
        self._function = function
        self._kept: Any = lru_cache(count)(function)
        update_wrapper(self, function)

    def __call__(self, *arguments: P.args, **options: P.kwargs) -> R:
        """Return the result of the function."""
        try:
            hash((arguments, *options.values()))
        except TypeError:
            return self._function(*arguments, **options)
        result: R = self._kept(*arguments, **options)
        return result

    def clear(self) -> None:
        """Forget all results."""
        self._kept.cache_clear()


def keep_last(count: int) -> Callable[[Callable[P, R]], LastCalls[P, R]]:
    """Let a function keep as many results."""
    return lambda function: LastCalls(function, count)
