"""A part that repeats simulated experiments with the other integrator, as a check."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypedDict, final

import numpy as np

from ancf_casadi.support.inputs import check_keys
from problems.study.data_table import Column, DataTable
from problems.study.kind import Kind
from problems.study.kinds.experiments.experiment import ExperimentResult
from problems.study.kinds.experiments.runs import ExperimentPart, read_runs, task_of
from problems.study.part import Effort, Finding, Heading, Outcome, Task
from problems.study.source import Source

KEYS = """\
  kind = "integrators"  simulated experiments by both integrators, Radau and IDAS:
                        the keys of "transients"
"""
METHODS = ("radau", "idas")


class IntegratorNumbers(TypedDict):
    """An experiment by both integrators: damping ratios, and the largest difference around the stop (m)."""

    mode: int
    law: str
    radau: float
    idas: float
    largest_difference_m: float


@final
@dataclass(frozen=True)
class Integrators(ExperimentPart):
    """Simulated experiments by both integrators."""

    kind = "integrators"
    numbers = list[IntegratorNumbers]

    def tasks(self, found: Mapping[str, Outcome], effort: Effort) -> tuple[Task, ...]:
        """Return each simulation by both integrators."""
        return tuple(
            task_of(run.experiment(law, self.choice, found, effort, method))
            for run in self.runs
            for law in run.laws
            for method in METHODS
        )

    def finding(self, results: Sequence[Any], found: Mapping[str, Outcome], effort: Effort) -> Finding:
        """Return the table of differences."""
        pairs: list[tuple[ExperimentResult, ExperimentResult]] = list(zip(results[::2], results[1::2], strict=True))
        which = [(run, law) for run in self.runs for law in run.laws]
        apart = [float(np.abs(ours.stop_motion - other.stop_motion).max()) for ours, other in pairs]
        columns = (
            Column("mode", tuple(run.mode for run, _ in which)),
            Column("law", tuple(law.title for _, law in which)),
            Column("damping ratio by Radau", tuple(100 * ours.damping_ratio for ours, _ in pairs), "%"),
            Column("by IDAS", tuple(100 * other.damping_ratio for _, other in pairs), "%"),
            Column("largest difference of the tip around the stop", tuple(1e3 * value for value in apart), "mm"),
            Column("amplitude there", tuple(1e3 * float(np.abs(ours.stop_motion).max()) for ours, _ in pairs), "mm"),
            Column("steps of Radau", tuple(ours.steps for ours, _ in pairs)),
            Column("of IDAS", tuple(other.steps for _, other in pairs)),
        )
        heading = self.heading
        table = DataTable(heading.name, "The same experiment by both integrators", columns, heading.notes)
        data = [
            {
                "mode": run.mode,
                "law": law.name,
                "radau": ours.damping_ratio,
                "idas": other.damping_ratio,
                "largest_difference_m": difference,
            }
            for (run, law), (ours, other), difference in zip(which, pairs, apart, strict=True)
        ]
        return Finding(Outcome(data), (table,))


def read(source: Source, given: dict[str, Any], heading: Heading, where: str) -> Integrators:
    """Return the part that a table describes.

    Raises
    ------
    InputError
        If a key or value cannot be used.
    """
    check_keys(given, {"runs"}, {"beam", "laws"}, where)
    return Integrators(heading, source.beam_choice(given, where), read_runs(source, given, where))


KIND = Kind(Integrators.kind, "Check of the integrators", KEYS, read)
