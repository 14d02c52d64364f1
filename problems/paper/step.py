"""A step of the paper: a function that makes its finding, below a heading."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, final

from problems.study.compute import Compute
from problems.study.step import Finding, Findings, Step

Function = Callable[[Compute], Finding]


@final
@dataclass(frozen=True, kw_only=True)
class PaperStep(Step):
    """A step of the paper."""

    kind: str = "paper"  # type: ignore[misc]  # in results.json; that of the steps of users that show the same
    function: Function

    def finding(self, compute: Compute, findings: Findings) -> Finding:
        """Return the finding of the function."""
        return self.function(compute)


def paper_step(**heading: Any) -> Callable[[Function], PaperStep]:
    """Make a step of the function below, whose name is the key of its numbers in ``results.json``."""
    return lambda function: PaperStep(name=function.__name__, function=function, **heading)
