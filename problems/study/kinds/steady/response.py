"""A part with response curves, as ``ancf-casadi response`` computes them from the tables of the file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, Self, final

import numpy as np

from ancf_casadi.support.arrays import Array
from problems.schema.file import StudyFile
from problems.schema.response import read_response
from problems.schema.table import UNLISTED
from problems.study.data_table import Column
from problems.study.drawing import drawn, new_figure, series
from problems.study.kinds.steady.curves import (
    TIP_KEY,
    CurveData,
    LevelNumbers,
    curve_data,
    level_numbers,
    level_titles,
    summary_columns,
)
from problems.study.part import NO_FILE, Effort, Finding, Found, Part, Task
from problems.study.source import Source

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

RESPONSE_TABLES = {"beam", "damping", "response", "markers"}


def level_curve(given: StudyFile, level: float) -> CurveData:
    """Return the response curve of a study file at one of its levels.

    Raises
    ------
    InputError, EquilibriumError, NumericsError
        As ``frequency_response``.
    """
    task = read_response(given)
    return curve_data(task, task.curve(level))


@final
@dataclass(frozen=True, kw_only=True)
class ResponsePart(Part):
    """Response curves at one or several levels."""

    kind, heading = "response", "Steady vibration"
    about = "steady vibration over frequency, with folds and jumps: the tables [[damping]], [response], [markers]"
    numbers = list[LevelNumbers]

    given: Annotated[StudyFile, UNLISTED] = NO_FILE
    levels: Annotated[tuple[float, ...], UNLISTED] = ()
    unit: Annotated[str, UNLISTED] = ""

    def checked(self, source: Source, where: str) -> Self:
        """Return the part with its levels and the tables that it reads."""
        task = read_response(source.file)
        return replace(self, given=source.file.only(RESPONSE_TABLES), levels=task.levels, unit=task.unit)

    def tasks(self, found: Found, effort: Effort) -> tuple[Task, ...]:
        """Return the curve of each level."""
        # expected computing time of a curve
        return tuple(Task(level_curve, (self.given, level), 5.0) for level in self.levels)

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


def response_figure(titles: Sequence[str], curves: Sequence[CurveData]) -> Figure:
    """Draw amplitude and phase of the tip against frequency.

    Parameters
    ----------
    titles : sequence of str
        Name of each curve in the legend.
    curves : sequence of CurveData
        The curves.
    """
    figure, (above, below) = new_figure(5.4, 2, sharex=True, height_ratios=(1.7, 1))
    for k, (title, curve) in enumerate(zip(titles, curves, strict=True)):
        draw_curve(above, curve, 1e3 * curve.tip, k, title)
        draw_curve(below, curve, np.degrees(curve.phase[TIP_KEY]), k)
    above.set(ylabel="amplitude of the tip, mm", ylim=(0.0, None))
    below.set(xlabel="frequency, Hz", ylabel="phase, degrees")
    above.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    figure.align_ylabels()
    return figure


def draw_curve(axes: Axes, curve: CurveData, values: Array, number: int, label: str | None = None) -> None:
    """Draw values along a curve: stable parts solid, unstable parts dashed.

    Parameters
    ----------
    axes : Axes
        The panel.
    curve : CurveData
        The curve.
    values : ndarray
        Value at each of its points.
    number : int
        Number of the curve, from 0, for its colour and marker.
    label : str, optional
        Name in the legend.
    """
    style: dict[str, Any] = {**series(number), "ms": 4, "lw": 1.4, "linestyle": "-"}
    span = max(1, len(values) // 8)  # markers, which tell the curves apart in grey
    for first, last, stable in _parts(curve.stable):
        dash = {} if stable else {"linestyle": (0, (3, 2)), "marker": ""}
        axes.plot(curve.frequency[first:last], values[first:last], markevery=(span // 2, span),
                  label=label if first == 0 else None, **style | dash)  # fmt: skip


def _parts(stable: Any) -> list[tuple[int, int, bool]]:
    """Return begin, end and stability of the parts of a curve; neighbouring parts share a point."""
    ends = [0, *(np.flatnonzero(np.diff(stable)) + 1).tolist(), len(stable)]
    return [(begin, min(end + 1, len(stable)), bool(stable[begin])) for begin, end in pairwise(ends)]
