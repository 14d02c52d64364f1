"""Decays in mode 1 under quadratic laws, on a weightless beam and by Eq. (27).

The effect of eta1 and eta2: two laws at several first frequencies, Figures 12 to 15, Tables 5 and 6 of the paper.  The
change of the damping ratio along a decay: Figure 16, Table 7.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import Figure, plain_log_ticks
from ancf_casadi.support.tables import Cell, Table, known
from problems.paper.effects import (
    HORIZON,
    LEAST_AMPLITUDE,
    Envelope,
    SimulatedDecay,
    characteristics,
    crossing,
    ratios_over_time,
    simulate_decay,
)
from problems.spec.beam import law_of
from problems.study.drawing import Drawing, band, draw_band, drawn, line, new_figure, series
from problems.study.part import Finding, Found, LawChoice, Task

if TYPE_CHECKING:
    from problems.paper.reproduce import PaperPart

CURVE_MARKERS = 12  # markers of a drawn curve
CHARACTERISTICS = ("gross_motion", "frequency", "residual_motion")  # in Table 6
LAW_HEADS = ("law", "frequency, Hz", "η1, 1/s", "η2, 1/m")


def tasks(part: PaperPart, found: Found) -> tuple[Task, ...]:
    """Return the simulated decays, law by law: at the frequency of the part, then at the others of ``eta_effects``."""
    beam = part.beam_in(found)
    laws = [law_of(choice.of(found), Model(beam), choice.name) for choice in part.laws]
    return tuple(
        Task(
            simulate_decay,
            (beam, law, frequency, part.amplitude, part.duration, part.steps_per_period),
            0.3 + 0.006 * frequency * part.duration,  # computing time of a decay, and of each of its periods
        )
        for law in laws
        for frequency in (part.frequency, *part.inputs.get("frequencies", ()))
    )


def eta_effects(part: PaperPart, results: Sequence[SimulatedDecay], found: Found) -> Finding:
    """Return the decays as tables and figures, with the words that follow from them."""
    count = 1 + len(part.inputs["frequencies"])
    by_law = [results[k * count : (k + 1) * count] for k in range(len(part.laws))]
    first, second = ([decay.envelope for decay in decays[1:]] for decays in by_law)
    horizon = min(HORIZON, part.duration)
    words = characteristics(first, second, horizon)
    times = tuple(dict.fromkeys((horizon, part.duration)))
    data = {
        "decays": [
            _decay_numbers(law, decay, times) for law, decays in zip(part.laws, by_law, strict=True) for decay in decays
        ],
        "characteristics": [
            {"law": law.name, **{key: one[key] for key in (*CHARACTERISTICS, "decay_rates")}}
            for law, one in zip(part.laws, words, strict=True)
        ],
    }
    figures: list[Drawing] = []
    for law, decays in zip(part.laws, by_law, strict=True):
        figures += _effect_drawings(law, decays, part.duration)
    rows = [  # each frequency once
        (law, decay)
        for law, decays in zip(part.laws, by_law, strict=True)
        for _, decay in sorted({decay.frequency: decay for decay in decays}.items())
    ]
    tables = (_times(part, rows), _word_table(part, words, horizon), _left(part, rows, times))
    return Finding(data, tables, tuple(figures))


def _decay_numbers(law: LawChoice, decay: SimulatedDecay, times: Sequence[float]) -> dict[str, Any]:
    """Return the numbers of a decay for ``results.json``: None for what the decay does not reach."""
    return {
        "law": law.name,
        "frequency_hz": decay.frequency,
        "eta1": decay.law.eta1,
        "eta2_per_m": decay.law.eta2,
        "start_amplitude_m": float(decay.tip[0]),
        "mode_2_at_the_start": decay.other_modes,
        "time_to_a_tenth_s": known(decay.envelope.time_to(0.1)),
        "time_to_a_tenth_by_formula_s": known(decay.formula.time_to(0.1)),
        "times_s": list(times),
        "amplitude_m": [known(decay.envelope.at(time)) for time in times],
        "amplitude_by_formula_m": [known(decay.formula.at(time)) for time in times],
        "steps": decay.steps,
    }


def _amplitude_left(envelope: Envelope, time: float) -> float | str:
    """Return the amplitude at a time (s) in mm for a table; what a simulation does not resolve as an upper limit."""
    amplitude = envelope.at(time)
    if amplitude < LEAST_AMPLITUDE or (np.isnan(amplitude) and envelope.amplitude[-1] < LEAST_AMPLITUDE):
        return f"< {1e3 * LEAST_AMPLITUDE:g}"
    return 1e3 * amplitude


def _law_cells(law: LawChoice, decay: SimulatedDecay) -> tuple[str, float, float, float]:
    return law.title, decay.frequency, decay.law.eta1, decay.law.eta2


def _times(part: PaperPart, rows: Sequence[tuple[LawChoice, SimulatedDecay]]) -> Table:
    heads = (*LAW_HEADS, "time to 10 %, beam, s", "by Eq. (27), s")
    cells = [(*_law_cells(*row), row[1].envelope.time_to(0.1), row[1].formula.time_to(0.1)) for row in rows]
    largest = max(decay.other_modes for _, decay in rows)
    notes = (
        f"Weightless beam with its elastic modulus scaled to the frequency, released with the tip at "
        f"{1e3 * part.amplitude:g} mm; mode 2 starts with {100 * largest:.1g} % of mode 1.",
        "A dash: more than 10 % is left at the end.",
    )
    return part.table("Decays under each law", heads, cells, *notes)


def _left(part: PaperPart, rows: Sequence[tuple[LawChoice, SimulatedDecay]], times: Sequence[float]) -> Table:
    heads = [*LAW_HEADS[:2]]
    cells: list[list[Cell]] = [[*_law_cells(*row)[:2]] for row in rows]
    for time in times:
        heads += [f"after {time:g} s, beam, mm", "by Eq. (27), mm"]
        for own, (_, decay) in zip(cells, rows, strict=True):
            own += [_amplitude_left(envelope, time) for envelope in (decay.envelope, decay.formula)]
    note = f"The simulation does not resolve less than {1e3 * LEAST_AMPLITUDE:g} mm."
    return part.table("Amplitude that is left", heads, cells, note)


def _word_table(part: PaperPart, words: Sequence[Mapping[str, Any]], horizon: float) -> Table:
    rows = []
    for law, one, printed in zip(part.laws, words, part.inputs["words"], strict=True):
        own = [one[key] for key in CHARACTERISTICS]
        rows.append((law.title, *own, "yes" if own == printed else "no"))
    heads = ("law", *(key.replace("_", " ") for key in CHARACTERISTICS), f"as in the {part.printed_by}")
    rates = [", ".join(f"{rate:.3g}" for rate in one["decay_rates"]) for one in words]
    listed = ", ".join(f"{f:g}" for f in part.inputs["frequencies"])
    notes = (
        f"Mean decay rates over {horizon:g} s at {listed} Hz: "
        + "; ".join(f"{law.title} {rate} 1/s" for law, rate in zip(part.laws, rates, strict=True)) + ".",
        "Rapid: the larger rate at every frequency.  Independent: rates within 10 %.  Controllable: less than 2 % "
        f"of the amplitude left after {horizon:g} s at every frequency.",
    )  # fmt: skip
    return part.table("Characteristics of the laws", heads, rows, *notes)


def _effect_drawings(law: LawChoice, decays: Sequence[SimulatedDecay], end: float) -> list[Drawing]:
    quadratic = decays[0].law
    about = f"{law.title} (η1 = {quadratic.eta1:.3g} 1/s, η2 = {quadratic.eta2:.3g} 1/m)"
    first = (
        f"{about} at {decays[0].frequency:g} Hz.  Top: motion of the tip of the beam.  Bottom: the "
        "same by Eq. (27), from rest.  Dashed: envelope by Eq. (27)."
    )
    several = (
        f"{about} at several first frequencies.  Top: extremes of the tip motion of the beam; "
        "dashed: envelope by Eq. (27).  Bottom: the envelopes on the beam (markers) and by Eq. (27) (lines)."
    )
    return [
        drawn(first, lambda: _motion(law, decays[0], end)),
        drawn(several, lambda: _frequencies(law, decays[1:], end)),
    ]


def _motion(law: LawChoice, decay: SimulatedDecay, end: float) -> Figure:
    """Draw the motion on the beam and by the formula, one above the other."""
    figure, panels = new_figure(4.0, 2, sharex=True, sharey=True)
    for k, (axes, motion, label) in enumerate(
        zip(panels, (decay.tip, decay.formula_tip), ("beam", "Eq. (27)"), strict=True)
    ):
        axes.plot(decay.time, 1e3 * motion, **{**line(2 * k), "linestyle": "-"}, lw=0.8)
        for side in (-1e3, 1e3):
            axes.plot(decay.formula.time, side * decay.formula.amplitude, "k--", lw=0.8)
        axes.set(ylabel="tip, mm", xlim=(0.0, end))
        axes.set_title(f"{law.title}, {decay.frequency:g} Hz: {label}")
    panels[-1].set(xlabel="time, s")
    return figure


def _frequencies(law: LawChoice, decays: Sequence[SimulatedDecay], end: float) -> Figure:
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
        axes.set_title(f"{law.title}, {decay.frequency:g} Hz")
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
    envelopes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=count)
    figure.align_ylabels()
    return figure


def ratio_change(part: PaperPart, results: Sequence[SimulatedDecay], found: Found) -> Finding:
    """Return the damping ratios over time as a table and a figure."""
    ratios = [ratios_over_time(decay) for decay in results]
    crossings = [
        (crossing(results[0].envelope, one.envelope), crossing(results[0].formula, one.formula)) for one in results[1:]
    ]
    data = {
        "decays": [
            _decay_numbers(law, decay, (part.duration / 3, part.duration))
            for law, decay in zip(part.laws, results, strict=True)
        ],
        "ratios": [
            {
                "law": law.name,
                "time_s": time.tolist(),
                "damping_ratio": ratio.tolist(),
                "damping_ratio_by_formula": formula.tolist(),
                "crosses_the_first_law_at_s": known(cross[0]),
                "crosses_the_first_law_by_formula_at_s": known(cross[1]),
            }
            for law, (time, ratio, formula), cross in zip(
                part.laws, ratios, [(math.nan, math.nan), *crossings], strict=True
            )
        ],
    }
    caption = (
        f"Decays from {1e3 * part.amplitude:g} mm at {part.frequency:g} Hz.  Top: amplitude on the beam "
        "(markers) and by Eq. (27) (lines).  Bottom: damping ratio in windows of the motion of the beam (markers) "
        "and by Eq. (27) (lines)."
    )
    figure = drawn(caption, lambda: _change_figure(part, results, ratios))
    return Finding(data, (_laws(part, results, crossings), _ratios(part, ratios)), (figure,))


def _laws(part: PaperPart, decays: Sequence[SimulatedDecay], crossings: Sequence[tuple[float, float]]) -> Table:
    given = zip(part.laws, decays, [(None, None), *crossings], strict=True)
    rows: list[tuple[Cell, ...]] = [(*_law_cells(law, decay), *cross) for law, decay, cross in given]
    heads = (*LAW_HEADS, "crosses the first, beam, s", "by Eq. (27), s")
    note = f"Start with the tip at {1e3 * part.amplitude:g} mm.  A dash: the envelopes do not cross."
    return part.table("Laws whose damping ratio changes along a decay", heads, rows, note)


def _ratios(part: PaperPart, ratios: Sequence[tuple[Array, Array, Array]]) -> Table:
    times = ratios[0][0][[0, -1]].tolist()
    heads = ["law", *(head for time in times for head in (f"after {time:.2g} s, beam, %", "by Eq. (27), %"))]
    rows: list[tuple[Cell, ...]] = [
        (law.title, *(100 * float(one[k]) for k in (0, -1) for one in (ratio, formula)))
        for law, (_, ratio, formula) in zip(part.laws, ratios, strict=True)
    ]
    return part.table("Damping ratio along the decay", heads, rows, "In windows of two periods.")


def _change_figure(
    part: PaperPart, decays: Sequence[SimulatedDecay], ratios: Sequence[tuple[Array, Array, Array]]
) -> Figure:
    figure, (amplitude, ratio) = new_figure(5.4, 2, sharex=True)
    for k, (law, decay, (time, found, formula)) in enumerate(zip(part.laws, decays, ratios, strict=True)):
        markers = {**series(k), "linestyle": "", "ms": 5}
        envelope, label = decay.envelope, law.title
        some = np.unique(np.linspace(0, len(envelope.time) - 1, CURVE_MARKERS).astype(int))
        amplitude.plot(envelope.time[some], 1e3 * envelope.amplitude[some], **markers)
        amplitude.plot(decay.formula.time, 1e3 * decay.formula.amplitude, **line(k))
        amplitude.plot([], [], **series(k), ms=5, label=label)
        some = np.unique(np.linspace(0, len(time) - 1, CURVE_MARKERS).astype(int))
        ratio.plot(time[some], 100 * found[some], **markers)
        ratio.plot(time, 100 * formula, **line(k))
    amplitude.set(ylabel="amplitude, mm", yscale="log")
    plain_log_ticks(amplitude, "y")
    ratio.set(xlabel="time, s", ylabel="damping ratio, %", ylim=(0.0, None))
    amplitude.set_title("markers: beam; lines: Eq. (27)")
    amplitude.legend()
    figure.align_ylabels()
    return figure
