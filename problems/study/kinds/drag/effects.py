"""A part with the effect of eta1 and eta2 on a decay: Figures 12 to 15, Tables 5 and 6 of the paper.

The laws decay at several first frequencies, on the beam and by Eq. (27).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Self, TypedDict, final

import numpy as np
from msgspec import Meta

from ancf_casadi.exceptions import InputError
from problems.modal_damping.effects import HORIZON, LEAST_AMPLITUDE, Characteristics, SimulatedDecay, characteristics
from problems.schema.table import Positive
from problems.study.data_table import Column, DataTable
from problems.study.drawing import Drawing, band, draw_band, drawn, line, new_figure, plain_log_ticks, series
from problems.study.kinds.drag.decays import DecayPart, Variant, amplitude_left, decay_numbers
from problems.study.part import Effort, Finding, Found, Task
from problems.study.source import Source

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class EffectNumbers(TypedDict):
    """Decays under each law at each frequency, and the words of Table 6."""

    decays: list[dict[str, Any]]
    characteristics: list[dict[str, Any]]


@final
@dataclass(frozen=True, kw_only=True)
class EtaEffects(DecayPart):
    """The effect of the coefficients of two laws on a decay."""

    kind, heading = "eta_effects", "Effect of eta1 and eta2 on a decay"
    about = "decays in mode 1 under two quadratic laws, on a weightless beam and by Eq. (27): {}"
    numbers = EffectNumbers

    frequencies: Annotated[tuple[Positive, ...], Meta(min_length=2, description="Hz")] = (1.0, 5.0, 20.0)
    words: Annotated[
        tuple[tuple[str, ...], ...],
        Meta(description="[[gross motion, frequency, residual motion] of each law, as printed]"),
    ] = ()

    def checked(self, source: Source, where: str) -> Self:
        """Return the part with its two laws."""
        if len(self.laws) != 2:
            raise InputError(f"needs two laws, got {len(self.laws)}", f"{where}: laws")
        if len(self.words) not in (0, 2):
            raise InputError(f"must be two lists of texts, got {len(self.words)}", f"{where}: words")
        return super().checked(source, where)

    def tasks(self, found: Found, effort: Effort) -> tuple[Task, ...]:
        """Return the decays, law by law: at the frequency of the detailed figure, then at the others."""
        beam = self.beam_in(found)
        return tuple(
            self.task(beam, variant.law, frequency, effort)
            for variant in self.variants
            for frequency in (self.frequency, *self.frequencies)
        )

    def finding(self, results: Sequence[SimulatedDecay], found: Found, effort: Effort) -> Finding:
        """Return the decays as tables and figures, with the words that follow from them."""
        count = 1 + len(self.frequencies)
        by_law = [results[k * count : (k + 1) * count] for k in range(len(self.variants))]
        first, second = ([decay.envelope for decay in decays[1:]] for decays in by_law)
        duration = effort.window * self.duration
        horizon = min(HORIZON, duration)
        words = characteristics(first, second, horizon)
        times = tuple(dict.fromkeys((horizon, duration)))
        data = {
            "decays": [
                decay_numbers(variant, decay, times)
                for variant, decays in zip(self.variants, by_law, strict=True)
                for decay in decays
            ],
            "characteristics": [
                {
                    "law": variant.name,
                    "gross_motion": one.gross_motion,
                    "frequency": one.frequency,
                    "residual_motion": one.residual_motion,
                    "decay_rates": list(one.rates),
                }
                for variant, one in zip(self.variants, words, strict=True)
            ],
        }
        figures: list[Drawing] = []
        for variant, decays in zip(self.variants, by_law, strict=True):
            figures += self._drawings(variant, decays, duration)
        tables = (self._times(by_law), self._words(words, horizon), self._left(by_law, times))
        return Finding(data, tables, tuple(figures))

    def _times(self, by_law: Sequence[Sequence[SimulatedDecay]]) -> DataTable:
        rows = self._rows(by_law)
        columns = (
            Column("law", tuple(variant.title for variant, _ in rows)),
            Column("frequency", tuple(decay.frequency for _, decay in rows), "Hz"),
            Column("η1", tuple(decay.law.eta1 for _, decay in rows), "1/s"),
            Column("η2", tuple(decay.law.eta2 for _, decay in rows), "1/m"),
            Column("time to 10 %, beam", tuple(decay.envelope.time_to(0.1) for _, decay in rows), "s"),
            Column("by Eq. (27)", tuple(decay.formula.time_to(0.1) for _, decay in rows), "s"),
        )
        largest = max(decay.other_modes for _, decay in rows)
        notes = (
            f"Weightless beam with its elastic modulus scaled to the frequency, released with the tip at "
            f"{1e3 * self.amplitude:g} mm; mode 2 starts with {100 * largest:.1g} % of mode 1.",
            "A dash: more than 10 % is left at the end.",
        )
        return self.data_table("Decays under each law", columns, *notes)

    def _left(self, by_law: Sequence[Sequence[SimulatedDecay]], times: Sequence[float]) -> DataTable:
        rows = self._rows(by_law)
        columns = [
            Column("law", tuple(variant.title for variant, _ in rows)),
            Column("frequency", tuple(decay.frequency for _, decay in rows), "Hz"),
        ]
        for time in times:
            beam = tuple(amplitude_left(decay.envelope, time) for _, decay in rows)
            formula = tuple(amplitude_left(decay.formula, time) for _, decay in rows)
            columns += [Column(f"after {time:g} s, beam", beam, "mm"), Column("by Eq. (27)", formula, "mm")]
        note = f"The simulation does not resolve less than {1e3 * LEAST_AMPLITUDE:g} mm."
        return self.data_table("Amplitude that is left", columns, note, suffix="_left")

    def _rows(self, by_law: Sequence[Sequence[SimulatedDecay]]) -> list[tuple[Variant, SimulatedDecay]]:
        """Return the decays with their laws, in the order of law and frequency, each frequency once."""
        return [
            (variant, decay)
            for variant, decays in zip(self.variants, by_law, strict=True)
            for _, decay in sorted({decay.frequency: decay for decay in decays}.items())
        ]

    def _words(self, words: Sequence[Characteristics], horizon: float) -> DataTable:
        columns = [
            Column("law", tuple(variant.title for variant in self.variants)),
            Column("gross motion", tuple(one.gross_motion for one in words)),
            Column("frequency", tuple(one.frequency for one in words)),
            Column("residual motion", tuple(one.residual_motion for one in words)),
        ]
        if self.words:
            same = (
                (one.gross_motion, one.frequency, one.residual_motion) == printed
                for one, printed in zip(words, self.words, strict=True)
            )
            columns.append(Column(f"as in the {self.printed_by}", tuple("yes" if one else "no" for one in same)))
        rates = [", ".join(f"{rate:.3g}" for rate in one.rates) for one in words]
        listed = ", ".join(f"{f:g}" for f in self.frequencies)
        notes = (
            f"Mean decay rates over {horizon:g} s at {listed} Hz: "
            + "; ".join(f"{v.title} {rate} 1/s" for v, rate in zip(self.variants, rates, strict=True)) + ".",
            "Rapid: the larger rate at every frequency.  Independent: rates within 10 %.  Controllable: less than 2 % "
            f"of the amplitude left after {horizon:g} s at every frequency.",
        )  # fmt: skip
        return self.data_table("Characteristics of the laws", columns, *notes, suffix="_words")

    def _drawings(self, variant: Variant, decays: Sequence[SimulatedDecay], end: float) -> list[Drawing]:
        name = f"{self.name}_{variant.name}"
        law = f"η1 = {variant.law.eta1:.3g} 1/s, η2 = {variant.law.eta2:.3g} 1/m"
        first = (
            f"{variant.title} ({law}) at {decays[0].frequency:g} Hz.  Top: motion of the tip of the beam.  Bottom: the "
            "same by Eq. (27), from rest.  Dashed: envelope by Eq. (27)."
        )
        several = (
            f"{variant.title} ({law}) at several first frequencies.  Top: extremes of the tip motion of the beam; "
            "dashed: envelope by Eq. (27).  Bottom: the envelopes on the beam (markers) and by Eq. (27) (lines)."
        )
        return [
            drawn(f"{name}_motion", first, lambda: _motion(variant, decays[0], end)),
            drawn(f"{name}_frequencies", several, lambda: _frequencies(variant, decays[1:], end)),
        ]


def _motion(variant: Variant, decay: SimulatedDecay, end: float) -> Figure:
    """Draw the motion on the beam and by the formula, one above the other."""
    figure, panels = new_figure(4.0, 2, sharex=True, sharey=True)
    for k, (axes, motion, label) in enumerate(
        zip(panels, (decay.tip, decay.formula_tip), ("beam", "Eq. (27)"), strict=True)
    ):
        axes.plot(decay.time, 1e3 * motion, **{**line(2 * k), "linestyle": "-"}, lw=0.8)
        for side in (-1e3, 1e3):
            axes.plot(decay.formula.time, side * decay.formula.amplitude, "k--", lw=0.8)
        axes.set(ylabel="tip, mm", xlim=(0.0, end))
        axes.set_title(f"{variant.title}, {decay.frequency:g} Hz: {label}")
    panels[-1].set(xlabel="time, s")
    return figure


def _frequencies(variant: Variant, decays: Sequence[SimulatedDecay], end: float) -> Figure:
    """Draw the extremes of the motion at each frequency, and all envelopes."""
    count = len(decays)
    figure, (*motions, envelopes) = new_figure(1.05 * count + 2.25, count + 1, height_ratios=(*([1.0] * count), 2.0))
    for k, (axes, decay) in enumerate(zip(motions, decays, strict=True)):
        draw_band(
            axes,
            band(decay.time, decay.tip, decay.frequency),
            1e3,
            filled=True,
            **{**line(k), "linestyle": "-"},
            lw=0.7,
        )
        for side in (-1e3, 1e3):
            axes.plot(decay.formula.time, side * decay.formula.amplitude, "k--", lw=0.8)
        axes.set(ylabel="tip, mm", xlim=(0.0, end))
        axes.set_title(f"{variant.title}, {decay.frequency:g} Hz")
        some = np.unique(np.linspace(0, len(decay.envelope.time) - 1, 8).astype(int))  # markers of a drawn envelope
        some = some[decay.envelope.amplitude[some] > LEAST_AMPLITUDE]
        style = series(k)
        envelopes.plot(decay.envelope.time[some], 1e3 * decay.envelope.amplitude[some], **{**style, "linestyle": ""},
                       ms=5, label=f"{decay.frequency:g} Hz")  # fmt: skip
        envelopes.plot(decay.formula.time, 1e3 * decay.formula.amplitude, **line(k), lw=1)
    envelopes.set(xlabel="time, s", ylabel="amplitude, mm", yscale="log", xlim=(0.0, end))
    envelopes.set_ylim(
        bottom=1e3 * LEAST_AMPLITUDE if min(d.formula.amplitude[-1] for d in decays) < LEAST_AMPLITUDE else None
    )
    plain_log_ticks(envelopes, "y")
    envelopes.set_title("markers: beam; lines: Eq. (27)")
    envelopes.legend(loc="lower left")
    figure.align_ylabels()
    return figure
