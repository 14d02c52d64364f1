"""Beyond the paper: steady vibration under the excitations of Table 11.

An experiment drives a mode for a limited time.  The curve shows the steady vibration under the same excitation, at its
frequency and beside it, by the amplitude of the driven mode as in the experiment: the other modes move the tip too, by
about the amplitude of the base.  The range extends from the natural frequency by a multiple of the relative width of
the resonance, which is the damping ratio plus the change of the frequency with the amplitude.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ancf_casadi.dynamics.base_motion import HarmonicBase
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.model import Model
from ancf_casadi.reduction.reduced import reduce_model
from ancf_casadi.reduction.stepping import ReducedTrajectory
from ancf_casadi.response.tracing import frequency_response
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import Figure
from problems.paper.inputs import experiments, matched_beam, three_laws
from problems.paper.step import paper_step
from problems.spec.beam import make_law
from problems.spec.motion import RESPONSE_MODES, RESPONSE_TOLERANCE
from problems.study.compute import Compute
from problems.study.drawing import new_figure, series
from problems.study.kinds.experiment import RequestedRun
from problems.study.kinds.response import SUMMARY_HEADS, curve_numbers, draw_curve, summary_rows
from problems.study.kinds.transients import run_experiments
from problems.study.step import Finding, LawChoice, Terms, study_table

RANGE_WIDTH = 5.0  # half-width of the range of frequencies relative to that of the resonance
RANGE_MARGIN = 1.3  # of the expected change of frequency

Resonance = tuple[dict[str, Any], Array]  # a curve, and the amplitude of the driven mode at the tip at each point, m


@paper_step(
    title="Steady vibration under the same excitations",
    text="""
If the clamp kept shaking, each mode would settle on its response curve. Modes 2 to 5 soften: their resonance leans to \
lower frequencies, by more than its width, so that two stable vibrations of different amplitude exist over a range of \
frequencies. A drive at the natural frequency of small motion meets the flank of the curve, far below its peak. This \
is why the excitation of the paper reaches less than the requested amplitude.""",
    quick=False,
    notes=(
        "The curves begin above the resonance and are followed downwards, at most to 3 % below the natural frequency.",
        "Under the quadratic law, modes 3 to 5 are still growing at the stop: their steady vibration is larger than "
        "the amplitude that was reached.",
        "The generic law damps five modes only. The vibration of mode 5 under it is unstable because a higher, "
        "undamped mode grows, at a rate of 0.0007 1/s, which no experiment of this length shows; with 0.3 % of "
        "damping in every mode it is stable.",
    ),
)
def steady_vibration(compute: Compute) -> Finding:
    """Return the curves under the excitations of Table 11."""
    return resonances(compute, matched_beam(compute), experiments(*three_laws()))


def resonances(compute: Compute, beam: Beam, runs: Sequence[RequestedRun]) -> Finding:
    """Return the curves of each mode in a figure, with the amplitudes that the experiments have reached."""
    rows: list[tuple[LawChoice, dict[str, Any]]] = [
        (law, result.numbers)
        for run, results in zip(runs, run_experiments(compute, beam, runs), strict=True)
        for law, result in zip(run.laws, results, strict=True)
    ]
    inputs = [(beam, law.terms, row["base_amplitude_m"], frequency_range(row), row["mode"]) for law, row in rows]
    curves = compute.all(resonance, inputs)
    heads = ("mode", "law", "base amplitude, mm", "reached before the stop, mm", *SUMMARY_HEADS)
    cells = [
        (row["mode"], law.title, 1e3 * row["base_amplitude_m"], 1e3 * row["reached_amplitude_m"], *peaks)
        for (law, row), peaks in zip(rows, summary_rows([curve for curve, _ in curves]), strict=True)
    ]
    table = study_table("Steady vibration at the base amplitudes of the experiments", heads, cells)
    data = [
        {
            "mode": row["mode"],
            "law": law.name,
            **{key: row[key] for key in ("base_amplitude_m", "drive_hz", "reached_amplitude_m")},
            "amplitude_m": amplitudes.tolist(),
            "curve": curve,
        }
        for (law, row), (curve, amplitudes) in zip(rows, curves, strict=True)
    ]
    titles = {law.name: law.title for law, _ in rows}
    drawings = []
    for mode in dict.fromkeys(run.mode for run in runs):
        caption = (
            f"Mode {mode}: steady vibration under the base motion of the experiment; dashed: unstable.  "
            "Larger markers: amplitude that the experiment has reached before its stop."
        )
        drawings.append((caption, _figure, titles, [row for row in data if row["mode"] == mode]))
    return Finding(data, (table,), compute.drawings(*drawings))


def _figure(titles: Mapping[str, str], rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw the curves of one mode; ``titles`` are those of all laws by name."""
    figure, (axes,) = new_figure(3.4)
    for row in rows:
        k = list(titles).index(row["law"])
        draw_curve(axes, row["curve"], 1e3 * np.array(row["amplitude_m"]), k, titles[row["law"]])
        axes.plot(row["drive_hz"], 1e3 * row["reached_amplitude_m"], ls="", ms=8, mec="black", mew=0.8,
                  **{key: series(k)[key] for key in ("color", "marker")})  # fmt: skip
    axes.set(xlabel="frequency, Hz", ylabel="amplitude of the mode\nat the tip, mm", ylim=(0.0, None))
    axes.set_title(f"mode {rows[0]['mode']}")
    axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.2), ncols=2)
    return figure


def resonance(beam: Beam, terms: Terms, amplitude: float, frequencies: tuple[float, float], mode: int) -> Resonance:
    """Return the response curve under a base amplitude (m), and the amplitude of the driven mode along it."""
    model = Model(beam)
    law, count = make_law(terms, model, "damping"), max(RESPONSE_MODES, mode)
    reduced, base = reduce_model(model, modes=count, damping=law), HarmonicBase(amplitude, frequencies[0])
    curve = frequency_response(reduced, frequencies, base=base, points=24, tolerance=RESPONSE_TOLERANCE)
    amplitudes = []
    for motion in curve.motions:
        period = motion.trajectory(64)
        assert isinstance(period, ReducedTrajectory)
        coordinate = period.reduced.modes.modal_coordinate(period.relative_coordinates, mode - 1)
        amplitudes.append(np.ptp(coordinate) / 2)
    return curve_numbers(curve, {}), np.array(amplitudes)


def frequency_range(numbers: Mapping[str, Any]) -> tuple[float, float]:
    """Return the first and the last frequency of a curve, Hz, from the numbers of an experiment.

    The curve begins above the resonance, because a mode that softens has its upper branch there.  The
    amplitude of the steady vibration is estimated by the growth of a linear vibration until the stop, and the change of
    frequency with the amplitude by the frequency of the decay.
    """
    natural, ratio = numbers["natural_frequency_hz"], numbers["expected_damping_ratio"]
    amplitude = numbers["requested_amplitude_m"] / -math.expm1(-2 * math.pi * natural * ratio * numbers["stop_s"])
    change = (numbers["frequency_hz"] / natural - 1) * (amplitude / numbers["amplitude_m"]) ** 2
    # the last frequency lies at most 3 % below the natural one
    lowest = 1 - min(RANGE_WIDTH * ratio - RANGE_MARGIN * min(change, 0.0), 0.03)
    return natural * (1 + RANGE_WIDTH * ratio + RANGE_MARGIN * max(change, 0.0)), natural * lowest
