"""Tables 5 and 6, Figures 12 to 15: the effect of eta1 and of eta2 on a decay."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ancf_casadi.support.figures import Axes, Figure, plain_log_ticks
from ancf_casadi.support.tables import Cell, Table
from problems.paper.effects import (
    HORIZON,
    LEAST_AMPLITUDE,
    Envelope,
    QuadraticLaw,
    SimulatedDecay,
    characteristics,
    decay_duration,
    decay_numbers,
    simulate_decays,
)
from problems.paper.step import paper_step
from problems.paper.table_07 import MARKER_SPACING
from problems.study.compute import Compute
from problems.study.drawing import band, draw_band, line, new_figure, series
from problems.study.step import Finding, study_table

LAWS = (QuadraticLaw("eta1_alone", "Quadratic 1", 2.0, 0.0), QuadraticLaw("eta2_alone", "Quadratic 2", 1e-9, 1.0))
FREQUENCY, FREQUENCIES = 1.85, (1.0, 5.0, 20.0)  # Hz, of Figures 12 and 14, and of Figures 13 and 15
AMPLITUDE, DURATION = 0.076, 15.0  # m, at the tip, and s

CHARACTERISTICS = ("gross_motion", "frequency", "residual_motion")  # columns of Table 6
PRINTED = (("rapid decay", "independent", "controllable"), ("slow decay", "dependent", "uncontrollable"))  # Table 6


@paper_step(
    title="Effect of eta1 and eta2 on a decay",
    text="""
Under eta1 alone, the amplitude falls exponentially at the same rate at every frequency. Under eta2 alone, it falls in \
inverse proportion to time, faster at high frequency, and never quite ends. The beam of each decay is weightless, and \
its elastic modulus is scaled to the frequency; point loads in the shape of mode 1 displace its tip before it is \
released.""",
    tables=("Table 5", "Table 6"),
    figures=("Figure 12", "Figure 13", "Figure 14", "Figure 15"),
    notes=(
        "The paper states neither amplitude nor frequencies other than the range 1 to 20 Hz; those here are inputs. It "
        "prints eta2 per mm: 0.001 stands for 1 1/m; the caption of its Figure 14 has 0.0001.",
        "At 20 Hz, Quadratic 2 falls to 10 % as fast as Quadratic 1; only the rest decays slowly.",
        "Eq. (27) as printed is 0/0 at eta1 = 0 and starts with a velocity; here it has its limit and starts from "
        "rest.",
    ),
)
def eta_effects(compute: Compute) -> Finding:
    """Return the decays of both laws, and the words that follow from their rates."""
    duration = decay_duration(compute, DURATION)
    results = simulate_decays(compute, LAWS, (FREQUENCY, *FREQUENCIES), AMPLITUDE, DURATION)
    horizon = min(HORIZON, duration)
    first, second = ([decay.envelope for decay in decays[1:]] for decays in results)
    words = characteristics(first, second, horizon)
    times = tuple(dict.fromkeys((horizon, duration)))
    pairs = [(law, decay) for law, decays in zip(LAWS, results, strict=True) for decay in decays]
    data = {
        "decays": [decay_numbers(law, decay, times) for law, decay in pairs],
        "characteristics": [
            {"law": law.name, **{key: row[key] for key in (*CHARACTERISTICS, "decay_rates")}}
            for law, row in zip(LAWS, words, strict=True)
        ],
    }
    unique = {(LAWS.index(law), decay.frequency): (law, decay) for law, decay in pairs}
    rows = [unique[key] for key in sorted(unique)]
    tables = (_times_to_a_tenth(rows), _word_table(words, horizon), _amplitudes_left(rows, times))
    drawings: list[Any] = []
    for law, decays in zip(LAWS, results, strict=True):
        at_one_frequency = (
            f"{law.about} at {FREQUENCY:g} Hz.  Top: motion of the tip of the beam.  Bottom: the same by Eq. (27), "
            "from rest.  Dashed: envelope by Eq. (27)."
        )
        at_several = (
            f"{law.about} at several first frequencies.  Top: extremes of the tip motion of the beam; dashed: envelope "
            "by Eq. (27).  Bottom: the envelopes on the beam (markers) and by Eq. (27) (lines)."
        )
        drawings.append((at_one_frequency, _motion_figure, law, decays[0], duration))
        drawings.append((at_several, _frequencies_figure, law, decays[1:], duration))
    return Finding(data, tables, compute.drawings(*drawings))


def _times_to_a_tenth(rows: Sequence[tuple[QuadraticLaw, SimulatedDecay]]) -> Table:
    heads = ("law", "frequency, Hz", "η1, 1/s", "η2, 1/m", "time to 10 %, beam, s", "by Eq. (27), s")
    cells = [
        (law.title, decay.frequency, law.eta1, law.eta2, decay.envelope.time_to(0.1), decay.formula.time_to(0.1))
        for law, decay in rows
    ]
    largest = max(decay.other_modes for _, decay in rows)
    notes = (
        f"Weightless beam with its elastic modulus scaled to the frequency, released with the tip at "
        f"{1e3 * AMPLITUDE:g} mm; mode 2 starts with {100 * largest:.1g} % of mode 1.",
        "A dash: more than 10 % is left at the end.",
    )
    return study_table("Decays under each law", heads, cells, *notes)


def _word_table(words: Sequence[Mapping[str, Any]], horizon: float) -> Table:
    rows = []
    for law, row, printed in zip(LAWS, words, PRINTED, strict=True):
        cells = tuple(row[key] for key in CHARACTERISTICS)
        rows.append((law.title, *cells, "yes" if cells == printed else "no"))
    heads = ("law", *(key.replace("_", " ") for key in CHARACTERISTICS), "as in the paper")
    rates = [
        f"{law.title} {', '.join(f'{rate:.3g}' for rate in row['decay_rates'])} 1/s"
        for law, row in zip(LAWS, words, strict=True)
    ]
    frequencies = ", ".join(f"{f:g}" for f in FREQUENCIES)
    notes = (
        f"Mean decay rates over {horizon:g} s at {frequencies} Hz: {'; '.join(rates)}.",
        "Rapid: the larger rate at every frequency.  Independent: rates within 10 %.  Controllable: less than 2 % "
        f"of the amplitude left after {horizon:g} s at every frequency.",
    )
    return study_table("Characteristics of the laws", heads, rows, *notes)


def _amplitudes_left(rows: Sequence[tuple[QuadraticLaw, SimulatedDecay]], times: Sequence[float]) -> Table:
    heads = [head for time in times for head in (f"after {time:g} s, beam, mm", "by Eq. (27), mm")]
    cells: list[list[Cell]] = []
    for law, decay in rows:
        left = [_amplitude_left(envelope, time) for time in times for envelope in (decay.envelope, decay.formula)]
        cells.append([law.title, decay.frequency, *left])
    note = f"The simulation does not resolve less than {1e3 * LEAST_AMPLITUDE:g} mm."
    return study_table("Amplitude that is left", ["law", "frequency, Hz", *heads], cells, note)


def _amplitude_left(envelope: Envelope, time: float) -> float | str:
    """Return the amplitude at a time (s) in mm for a table; what a simulation does not resolve as an upper limit."""
    amplitude = float(envelope.at(time))
    if amplitude < LEAST_AMPLITUDE or (np.isnan(amplitude) and envelope.amplitude[-1] < LEAST_AMPLITUDE):
        return f"< {1e3 * LEAST_AMPLITUDE:g}"
    return 1e3 * amplitude


def _motion_figure(law: QuadraticLaw, decay: SimulatedDecay, end: float) -> Figure:
    """Draw the motion on the beam and by the formula, one above the other."""
    figure, panels = new_figure(4.0, 2, sharex=True, sharey=True)
    motions = ((decay.tip, "beam"), (decay.formula_tip, "Eq. (27)"))
    for k, (axes, (motion, label)) in enumerate(zip(panels, motions, strict=True)):
        axes.plot(decay.time, 1e3 * motion, **{**line(2 * k), "linestyle": "-"}, lw=0.8)
        _draw_formula(axes, decay)
        axes.set(ylabel="tip, mm", xlim=(0.0, end))
        axes.set_title(f"{law.title}, {decay.frequency:g} Hz: {label}")
    panels[-1].set(xlabel="time, s")
    return figure


def _draw_formula(axes: Axes, decay: SimulatedDecay) -> None:
    """Draw the envelope by Eq. (27) on both sides of the axis."""
    for side in (-1e3, 1e3):
        axes.plot(decay.formula.time, side * decay.formula.amplitude, "k--", lw=0.8)


def _frequencies_figure(law: QuadraticLaw, decays: Sequence[SimulatedDecay], end: float) -> Figure:
    """Draw the extremes of the motion at each frequency, and all envelopes."""
    count = len(decays)
    figure, (*motions, envelopes) = new_figure(1.05 * count + 2.25, count + 1, height_ratios=(*([1.0] * count), 2.0))
    for k, (axes, decay) in enumerate(zip(motions, decays, strict=True)):
        extremes = band(decay.time, decay.tip, decay.frequency)
        draw_band(axes, extremes, 1e3, filled=True, **{**line(k), "linestyle": "-"}, lw=0.7)
        _draw_formula(axes, decay)
        axes.set(ylabel="tip, mm", xlim=(0.0, end))
        axes.set_title(f"{law.title}, {decay.frequency:g} Hz")
        style = {**series(k), "linestyle": "", "ms": 5, "label": f"{decay.frequency:g} Hz"}
        resolved = np.where(decay.envelope.amplitude > LEAST_AMPLITUDE, 1e3 * decay.envelope.amplitude, np.nan)
        envelopes.plot(decay.envelope.time, resolved, **style, markevery=MARKER_SPACING)
        envelopes.plot(decay.formula.time, 1e3 * decay.formula.amplitude, **line(k), lw=1)
    envelopes.set(xlabel="time, s", ylabel="amplitude, mm", yscale="log", xlim=(0.0, end))
    if min(decay.formula.amplitude[-1] for decay in decays) < LEAST_AMPLITUDE:
        envelopes.set_ylim(bottom=1e3 * LEAST_AMPLITUDE)
    plain_log_ticks(envelopes, "y")
    envelopes.set_title("markers: beam; lines: Eq. (27)")
    envelopes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=count)
    figure.align_ylabels()
    return figure
