"""A part with response curves, as ``ancf-casadi response`` computes them from the tables of the file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Self, final

from problems.schema.response import read_response
from problems.schema.table import HIDDEN
from problems.study.data_table import Column
from problems.study.drawing import drawn
from problems.study.files import FilePart, TablesOfFile
from problems.study.kinds.steady.curves import (
    CurveData,
    LevelNumbers,
    curve_data,
    level_numbers,
    level_titles,
    summary_columns,
)
from problems.study.kinds.steady.figure import response_figure
from problems.study.part import Effort, Finding, Found, Task
from problems.study.source import Source

SECONDS = 5.0  # expected computing time of a curve


def level_curve(given: TablesOfFile, level: float) -> CurveData:
    """Return the response curve of a study file at one of its levels.

    Raises
    ------
    InputError, EquilibriumError, NumericsError
        As ``frequency_response``.
    """
    task = read_response(given.file())
    return curve_data(task, task.curve(level))


@final
@dataclass(frozen=True, kw_only=True)
class Response(FilePart):
    """Response curves at one or several levels."""

    kind, heading = "response", "Steady vibration"
    about = "steady vibration over frequency, with folds and jumps: the tables [[damping]], [response], [markers]"
    numbers = list[LevelNumbers]
    wanted = frozenset({"beam", "damping", "response", "markers"})

    levels: Annotated[tuple[float, ...], HIDDEN] = ()
    unit: Annotated[str, HIDDEN] = ""

    def checked(self, source: Source, where: str) -> Self:
        """Return the part with its levels and the tables that it reads."""
        task = read_response(source.file)
        return replace(super().checked(source, where), levels=task.levels, unit=task.unit)

    def tasks(self, found: Found, effort: Effort) -> tuple[Task, ...]:
        """Return the curve of each level."""
        return tuple(Task(level_curve, (self.given, level), SECONDS) for level in self.levels)

    def finding(self, results: Sequence[Any], found: Found, effort: Effort) -> Finding:
        """Return the curves with their peaks and jumps."""
        curves: Sequence[CurveData] = results
        titles = level_titles(self.levels, self.unit)
        columns = (Column("excitation", titles), *summary_columns(curves))
        table = self.data_table("Peaks and jumps of the response", columns)
        caption = (
            "Steady vibration of the tip relative to the clamp: half the peak-to-peak value, and phase against the "
            "excitation.  Dashed: unstable."
        )
        figure = drawn(self.name, caption, lambda: response_figure(titles, curves))
        data = level_numbers(self.levels, self.unit, curves)
        return Finding(data, (table,), (figure,))
