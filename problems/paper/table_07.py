"""Table 7, Figure 16: the change of the damping ratio along a decay under quadratic laws."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import Figure, plain_log_ticks
from ancf_casadi.support.tables import Cell, finite_or_none
from problems.paper.effects import (
    QuadraticLaw,
    SimulatedDecay,
    crossing,
    decay_duration,
    decay_numbers,
    ratios_over_time,
    simulate_decays,
)
from problems.paper.step import paper_step
from problems.study.compute import Compute
from problems.study.drawing import line, new_figure, series
from problems.study.step import Finding, study_table

LAWS = (
    QuadraticLaw("changing_3", "Quadratic 3", 0.15, 0.11),
    QuadraticLaw("changing_4", "Quadratic 4 as printed", 3.0e-4, 0.22),
    QuadraticLaw("changing_4_twice", "Quadratic 4, twice 3", 0.30, 0.22),
)
FREQUENCY, AMPLITUDE, DURATION = 1.85, 0.2126, 15.0  # Hz, m, at the tip, and s
MARKER_SPACING = 0.1  # of a drawn curve, relative to the diagonal of its panel

Ratios = tuple[Array, Array, Array]  # times, s, damping ratio on the beam, and by Eq. (27)


@paper_step(
    title="Change of the damping ratio along a decay",
    tables=("Table 7",),
    figures=("Figure 16",),
    notes=(
        "Table 7 prints eta1 = 3.0E-4 for Quadratic 4, where twice Quadratic 3 would be 3.0E-1. As printed, the "
        "envelopes of Eq. (27) cross at 5 s, as in Figure 16, for a start at 212.6 mm only, which is assumed here; "
        "with 0.30 they never cross.",
    ),
)
def ratio_change(compute: Compute) -> Finding:
    """Return the damping ratios over time, and the times at which the envelopes cross that of the first law."""
    decays = [decay for (decay,) in simulate_decays(compute, LAWS, (FREQUENCY,), AMPLITUDE, DURATION)]
    first, duration = decays[0], decay_duration(compute, DURATION)
    data: dict[str, list[dict[str, Any]]] = {"decays": [], "ratios": []}
    ratios: list[Ratios] = []
    crossing_rows: list[tuple[Cell, ...]] = []
    ratio_rows: list[tuple[Cell, ...]] = []
    for law, decay in zip(LAWS, decays, strict=True):
        time, on_beam, by_formula = ratios_over_time(decay)
        beam_crossing = finite_or_none(crossing(first.envelope, decay.envelope))
        formula_crossing = finite_or_none(crossing(first.formula, decay.formula))
        data["decays"].append(decay_numbers(law, decay, (duration / 3, duration)))
        data["ratios"].append(
            {
                "law": law.name,
                "time_s": time.tolist(),
                "damping_ratio": on_beam.tolist(),
                "damping_ratio_by_formula": by_formula.tolist(),
                "crosses_the_first_law_at_s": beam_crossing,
                "crosses_the_first_law_by_formula_at_s": formula_crossing,
            }
        )
        ratios.append((time, on_beam, by_formula))
        crossing_rows.append((law.title, FREQUENCY, law.eta1, law.eta2, beam_crossing, formula_crossing))
        percent = [100 * float(values[k]) for k in (0, -1) for values in (on_beam, by_formula)]
        ratio_rows.append((law.title, *percent))
    crossing_heads = ("law", "frequency, Hz", "η1, 1/s", "η2, 1/m", "crosses the first, beam, s", "by Eq. (27), s")
    ends = ratios[0][0][[0, -1]].tolist()
    ratio_heads = ["law", *(head for end in ends for head in (f"after {end:.2g} s, beam, %", "by Eq. (27), %"))]
    tables = (
        study_table(
            "Laws whose damping ratio changes along a decay", crossing_heads, crossing_rows,
            f"Start with the tip at {1e3 * AMPLITUDE:g} mm.  A dash: the envelopes do not cross.",
        ),
        study_table("Damping ratio along the decay", ratio_heads, ratio_rows, "In windows of two periods."),
    )  # fmt: skip
    caption = (
        f"Decays from {1e3 * AMPLITUDE:g} mm at {FREQUENCY:g} Hz.  Top: amplitude on the beam (markers) and by "
        "Eq. (27) (lines).  Bottom: damping ratio in windows of the motion of the beam (markers) and by Eq. (27) "
        "(lines)."
    )
    return Finding(data, tables, compute.drawings((caption, _figure, decays, ratios)))


def _figure(decays: Sequence[SimulatedDecay], ratios: Sequence[Ratios]) -> Figure:
    figure, (amplitude, ratio) = new_figure(5.4, 2, sharex=True)
    for k, (law, decay, (time, on_beam, by_formula)) in enumerate(zip(LAWS, decays, ratios, strict=True)):
        markers = {**series(k), "linestyle": "", "ms": 5, "markevery": MARKER_SPACING}
        amplitude.plot(decay.envelope.time, 1e3 * decay.envelope.amplitude, **markers)
        amplitude.plot(decay.formula.time, 1e3 * decay.formula.amplitude, **line(k))
        amplitude.plot([], [], **series(k), ms=5, label=law.title)
        ratio.plot(time, 100 * on_beam, **markers)
        ratio.plot(time, 100 * by_formula, **line(k))
    amplitude.set(ylabel="amplitude, mm", yscale="log")
    plain_log_ticks(amplitude, "y")
    ratio.set(xlabel="time, s", ylabel="damping ratio, %", ylim=(0.0, None))
    amplitude.set_title("markers: beam; lines: Eq. (27)")
    amplitude.legend()
    figure.align_ylabels()
    return figure
