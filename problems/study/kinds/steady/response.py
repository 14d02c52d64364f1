"""A part with response curves, as ``ancf-casadi response`` computes them from the tables of the file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

from ancf_casadi.support.inputs import check_keys
from problems.schema.response import read_response
from problems.study.data_table import Column, DataTable
from problems.study.drawing import drawn
from problems.study.files import FilePart, TablesOfFile
from problems.study.kind import Kind
from problems.study.kinds.steady.curves import (
    CurveData,
    LevelNumbers,
    curve_data,
    level_numbers,
    level_titles,
    summary_columns,
)
from problems.study.kinds.steady.figure import response_figure
from problems.study.part import Effort, Finding, Heading, Outcome, Task
from problems.study.source import Source

KEYS = """\
  kind = "response"     steady vibration over frequency, with folds and jumps: the
                        tables [[damping]], [response], [markers]
"""
SECONDS = 5.0  # expected computing time of a curve
TABLES = {"beam", "damping", "response", "markers"}


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
@dataclass(frozen=True)
class Response(FilePart):
    """Response curves at one or several levels."""

    kind = "response"
    numbers = list[LevelNumbers]

    levels: tuple[float, ...]
    unit: str

    def tasks(self, found: Mapping[str, Outcome], effort: Effort) -> tuple[Task, ...]:
        """Return the curve of each level."""
        return tuple(Task(level_curve, (self.given, level), SECONDS) for level in self.levels)

    def finding(self, results: Sequence[Any], found: Mapping[str, Outcome], effort: Effort) -> Finding:
        """Return the curves with their peaks and jumps."""
        curves: Sequence[CurveData] = results
        titles = level_titles(self.levels, self.unit)
        columns = (Column("excitation", titles), *summary_columns(curves))
        heading = self.heading
        table = DataTable(heading.name, "Peaks and jumps of the response", columns, heading.notes)
        caption = (
            "Steady vibration of the tip relative to the clamp: half the peak-to-peak value, and phase against the "
            "excitation.  Dashed: unstable."
        )
        figure = drawn(heading.name, caption, lambda: response_figure(titles, curves))
        data = level_numbers(self.levels, self.unit, curves)
        return Finding(Outcome(data), (table,), (figure,))


def read(source: Source, given: dict[str, Any], heading: Heading, where: str) -> Response:
    """Return the part that a table describes.

    Raises
    ------
    InputError
        If a table is missing, or a key or value cannot be used.
    """
    check_keys(given, set(), set(), where)
    task = read_response(source.file)
    return Response(heading, TablesOfFile.of(source, TABLES), task.levels, task.unit)


KIND = Kind(Response.kind, "Steady vibration", KEYS, read)
