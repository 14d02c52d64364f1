"""A part with the change of the damping ratio along a decay: Figure 16, Table 7 of the paper."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypedDict, final

import numpy as np

from problems.modal_damping.effects import RatiosOverTime, SimulatedDecay, crossing, ratios_over_time
from problems.study.data_table import Column, DataTable
from problems.study.drawing import drawn, line, new_figure, plain_log_ticks, series
from problems.study.kinds.drag.decays import DecayPart, decay_numbers
from problems.study.part import Effort, Finding, Found, Task

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CURVE_MARKERS = 12  # markers of a drawn curve


class ChangeNumbers(TypedDict):
    """Decays under each law, damping ratios along them, and the times at which they cross the first."""

    decays: list[dict[str, Any]]
    ratios: list[dict[str, Any]]


@final
@dataclass(frozen=True, kw_only=True)
class RatioChange(DecayPart):
    """The change of the damping ratio along decays."""

    kind, heading = "ratio_change", "Change of the damping ratio along a decay"
    about = "change of the damping ratio along decays in mode 1, on a weightless beam and by Eq. (27): {}"
    numbers = ChangeNumbers

    def tasks(self, found: Found, effort: Effort) -> tuple[Task, ...]:
        """Return the decays."""
        beam = self.beam_in(found)
        return tuple(self.task(beam, variant.law, self.frequency, effort) for variant in self.variants)

    def finding(self, results: Sequence[SimulatedDecay], found: Found, effort: Effort) -> Finding:
        """Return the damping ratios over time as a table and a figure."""
        ratios = [ratios_over_time(decay) for decay in results]
        crossings = [
            (crossing(results[0].envelope, one.envelope), crossing(results[0].formula, one.formula))
            for one in results[1:]
        ]
        duration = effort.window * self.duration
        data = {
            "decays": [
                decay_numbers(variant, decay, (duration / 3, duration))
                for variant, decay in zip(self.variants, results, strict=True)
            ],
            "ratios": [
                {
                    "law": variant.name,
                    "time_s": one.time.tolist(),
                    "damping_ratio": one.ratio.tolist(),
                    "damping_ratio_by_formula": one.formula.tolist(),
                    "crosses_the_first_law_at_s": None if math.isnan(cross[0]) else cross[0],
                    "crosses_the_first_law_by_formula_at_s": None if math.isnan(cross[1]) else cross[1],
                }
                for variant, one, cross in zip(self.variants, ratios, [(math.nan, math.nan), *crossings], strict=True)
            ],
        }
        caption = (
            f"Decays from {1e3 * self.amplitude:g} mm at {self.frequency:g} Hz.  Top: amplitude on the beam "
            "(markers) and by Eq. (27) (lines).  Bottom: damping ratio in windows of the motion of the beam (markers) "
            "and by Eq. (27) (lines)."
        )
        figure = drawn(self.name, caption, lambda: self._figure(results, ratios))
        return Finding(data, (self._laws(crossings), self._ratios(ratios)), (figure,))

    def _laws(self, crossings: Sequence[tuple[float, float]]) -> DataTable:
        columns = (
            Column("law", tuple(variant.title for variant in self.variants)),
            Column("frequency", tuple(self.frequency for _ in self.variants), "Hz"),
            Column("η1", tuple(variant.law.eta1 for variant in self.variants), "1/s"),
            Column("η2", tuple(variant.law.eta2 for variant in self.variants), "1/m"),
            Column("crosses the first, beam", (None, *(beam for beam, _ in crossings)), "s"),
            Column("by Eq. (27)", (None, *(formula for _, formula in crossings)), "s"),
        )
        note = f"Start with the tip at {1e3 * self.amplitude:g} mm.  A dash: the envelopes do not cross."
        return self.data_table("Laws whose damping ratio changes along a decay", columns, note)

    def _ratios(self, ratios: Sequence[RatiosOverTime]) -> DataTable:
        first, last = (float(ratios[0].time[k]) for k in (0, -1))
        columns = [Column("law", tuple(variant.title for variant in self.variants))]
        for k, time in ((0, first), (-1, last)):
            columns += [
                Column(f"after {time:.2g} s, beam", tuple(100 * float(one.ratio[k]) for one in ratios), "%"),
                Column("by Eq. (27)", tuple(100 * float(one.formula[k]) for one in ratios), "%"),
            ]
        return self.data_table("Damping ratio along the decay", columns, "In windows of two periods.", suffix="_ratios")

    def _figure(self, decays: Sequence[SimulatedDecay], ratios: Sequence[RatiosOverTime]) -> Figure:
        figure, (amplitude, ratio) = new_figure(5.4, 2, sharex=True)
        for k, (variant, decay, one) in enumerate(zip(self.variants, decays, ratios, strict=True)):
            markers = {**series(k), "linestyle": "", "ms": 5}
            envelope, label = decay.envelope, variant.title
            some = np.unique(np.linspace(0, len(envelope.time) - 1, CURVE_MARKERS).astype(int))
            amplitude.plot(envelope.time[some], 1e3 * envelope.amplitude[some], **markers)
            amplitude.plot(decay.formula.time, 1e3 * decay.formula.amplitude, **line(k))
            amplitude.plot([], [], **series(k), ms=5, label=label)
            some = np.unique(np.linspace(0, len(one.time) - 1, CURVE_MARKERS).astype(int))
            ratio.plot(one.time[some], 100 * one.ratio[some], **markers)
            ratio.plot(one.time, 100 * one.formula, **line(k))
        amplitude.set(ylabel="amplitude, mm", yscale="log")
        plain_log_ticks(amplitude, "y")
        ratio.set(xlabel="time, s", ylabel="damping ratio, %", ylim=(0.0, None))
        amplitude.set_title("markers: beam; lines: Eq. (27)")
        amplitude.legend()
        figure.align_ylabels()
        return figure
