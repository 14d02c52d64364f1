"""A part with the deformed shapes of the beam over the last period of its excitation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypedDict, final

import numpy as np

from ancf_casadi.support.inputs import check_keys
from problems.study.drawing import drawn, new_figure, series
from problems.study.kind import Kind
from problems.study.kinds.experiments.experiment import ExperimentResult
from problems.study.kinds.experiments.runs import ExperimentPart, Run, read_runs
from problems.study.part import Effort, Finding, Heading, Outcome
from problems.study.source import Source

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KEYS = """\
  kind = "shapes"       deformed shapes over the last period of an excitation: the
                        keys of "transients", with one law
"""


class ShapeNumbers(TypedDict):
    """Extent of the motion over one period: across the beam at the tip, and along it (m)."""

    mode: int
    tip_across_m: float
    tip_along_m: float


@final
@dataclass(frozen=True)
class Shapes(ExperimentPart):
    """Deformed shapes over one period."""

    kind = "shapes"
    numbers = list[ShapeNumbers]

    def finding(self, results: Sequence[Any], found: Mapping[str, Outcome], effort: Effort) -> Finding:
        """Return one figure with a panel per mode."""
        axis = np.array(self.choice.beam(found).axis)
        data = []
        for run, result in zip(self.runs, results, strict=True):
            tip = result.shapes[:, -1]
            along, across = tip @ axis, tip @ np.array([-axis[1], axis[0]])
            data.append({"mode": run.mode, "tip_across_m": float(np.ptp(across)), "tip_along_m": float(np.ptp(along))})
        caption = (
            "Deformed shapes over the last period before the stop, light to dark.  Each panel has its own scale across "
            "the beam."
        )
        figure = drawn(self.heading.name, caption, lambda: _figure(self.runs, results, axis))
        return Finding(Outcome(data), figures=(figure,))


def _figure(runs: Sequence[Run], results: Sequence[ExperimentResult], axis: Any) -> Figure:
    """Draw the shapes of each mode in coordinates along and across the beam."""
    figure, panels = new_figure(4.4, 1, len(runs), sharey=True)
    normal = np.array([-axis[1], axis[0]])
    for axes, run, result in zip(panels, runs, results, strict=True):
        along, across = result.shapes @ axis, result.shapes @ normal
        for k in range(len(along)):
            axes.plot(1e3 * across[k], 1e3 * along[k], color=series(0)["color"], lw=0.8,
                      alpha=0.25 + 0.75 * k / (len(along) - 1))  # fmt: skip
        axes.set_title(f"mode {run.mode}")
        axes.set_xlabel("mm")
    panels[0].set_ylabel("position along the beam, mm")
    panels[0].invert_yaxis()
    return figure


def read(source: Source, given: dict[str, Any], heading: Heading, where: str) -> Shapes:
    """Return the part that a table describes.

    Raises
    ------
    InputError
        If a key or value cannot be used.
    """
    check_keys(given, {"runs"}, {"beam", "laws"}, where)
    runs = read_runs(source, given, where)
    return Shapes(heading, source.beam_choice(given, where), tuple(run.under_first_law() for run in runs))


KIND = Kind(Shapes.kind, "Deformed shapes over a period", KEYS, read)
