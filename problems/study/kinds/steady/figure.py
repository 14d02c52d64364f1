"""Drawing of response curves: amplitude and phase of the tip against frequency, unstable parts dashed."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from ancf_casadi.support.arrays import Array
from problems.study.drawing import new_figure, series
from problems.study.kinds.steady.curves import TIP, CurveData

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

UNSTABLE = (0, (3, 2))  # dash
MARKED = 8  # of a curve, which tell the curves apart in grey


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
        draw_curve(below, curve, np.degrees(curve.phase[TIP]), k)
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
    span = max(1, len(values) // MARKED)
    for first, last, stable in _parts(curve.stable):
        dash = {} if stable else {"linestyle": UNSTABLE, "marker": ""}
        axes.plot(curve.frequency[first:last], values[first:last], markevery=(span // 2, span),
                  label=label if first == 0 else None, **style | dash)  # fmt: skip


def _parts(stable: Any) -> list[tuple[int, int, bool]]:
    """Return begin, end and stability of the parts of a curve; neighbouring parts share a point."""
    ends = [0, *(np.flatnonzero(np.diff(stable)) + 1).tolist(), len(stable)]
    return [(begin, min(end + 1, len(stable)), bool(stable[begin])) for begin, end in pairwise(ends)]
