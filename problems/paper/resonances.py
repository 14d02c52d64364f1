"""The response curves of simulated experiments: steady vibration at their base amplitudes.

An experiment drives a mode for a limited time (``transients``).  The curve shows the steady vibration under
the same excitation, at its frequency and beside it, by the amplitude of the driven mode as in the experiment: the other
modes move the tip too, by about the amplitude of the base.  The range extends from the natural frequency by a multiple
of the relative width of the resonance, which is the damping ratio plus the change of the frequency with the amplitude.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.model import Model
from ancf_casadi.reduction.stepping import ReducedTrajectory
from ancf_casadi.response.periodic import PeriodicMotion
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import Figure
from problems.schema.beam import law_of
from problems.schema.response import RESPONSE_MODES, ResponseTable, ResponseTask
from problems.study.data_table import Column
from problems.study.drawing import drawn, new_figure, series
from problems.study.kinds.response import curve_numbers, draw_curve, summary_columns
from problems.study.part import Effort, Finding, Found, Task, Terms

if TYPE_CHECKING:
    from problems.paper.reproduce import PaperPart

RANGE_WIDTH = 5.0  # half-width of the range of frequencies relative to that of the resonance
RANGE_MARGIN = 1.3  # of the expected change of frequency

Resonance = tuple[dict[str, Any], Array]  # a curve, and the amplitude of the driven mode at the tip at each point, m


def resonance(beam: Beam, terms: Terms, amplitude: float, frequencies: tuple[float, float], mode: int) -> Resonance:
    """Return the response curve under a base amplitude (m), and the amplitude of the driven mode along it."""
    model = Model(beam)
    law, count = law_of(terms, model, "damping"), max(RESPONSE_MODES, mode)
    task = ResponseTask(model, law, ResponseTable(frequencies, amplitude, points=24), count, {})
    curve = task.curve(amplitude)
    return curve_numbers(task, curve), np.array([_amplitude(motion, mode) for motion in curve.motions])


def _amplitude(motion: PeriodicMotion, mode: int) -> float:
    """Return the amplitude of a mode at the tip in the motion relative to the clamp, m."""
    period = motion.trajectory(64)
    assert isinstance(period, ReducedTrajectory)
    modes = period.reduced.modes
    return float(np.ptp(modes.modal_coordinate(period.relative_coordinates, mode - 1)) / 2)


def tasks(part: PaperPart, found: Found, effort: Effort) -> tuple[Task, ...]:
    """Return the curve of each experiment under each law."""
    beam, terms = part.beam_in(found), {law.name: law.of(found) for law in part.laws}
    return tuple(
        Task(
            resonance,
            (beam, terms[run["law"]], run["base_amplitude_m"], range_of(run), run["mode"]),
            4.0,  # expected computing time of a curve
        )
        for run in _runs(part, found)
    )


def _runs(part: PaperPart, found: Found) -> list[Mapping[str, Any]]:
    """Return the numbers of the experiments under the laws of this part."""
    names = {law.name for law in part.laws}
    return [run for run in found[part.transients].data["runs"] if run["law"] in names]


def finding(part: PaperPart, results: Sequence[Resonance], found: Found, effort: Effort) -> Finding:
    """Return the curves of each mode in a panel, with the amplitudes that the experiments have reached."""
    runs = _runs(part, found)
    titles = {law.name: law.title for law in part.laws}
    columns = (
        Column("mode", tuple(run["mode"] for run in runs)),
        Column("law", tuple(titles[run["law"]] for run in runs)),
        Column("base amplitude", tuple(1e3 * run["base_amplitude_m"] for run in runs), "mm"),
        Column("reached before the stop", tuple(1e3 * run["reached_amplitude_m"] for run in runs), "mm"),
        *summary_columns([curve for curve, _ in results]),
    )
    table = part.data_table("Steady vibration at the base amplitudes of the experiments", columns)
    keys = ("mode", "law", "base_amplitude_m", "drive_hz", "reached_amplitude_m")
    data = [
        {**{key: run[key] for key in keys}, "amplitude_m": amplitudes.tolist(), "curve": curve}
        for run, (curve, amplitudes) in zip(runs, results, strict=True)
    ]
    figures = []
    for mode in dict.fromkeys(run["mode"] for run in runs):
        own = [(run, one) for run, one in zip(runs, results, strict=True) if run["mode"] == mode]
        caption = (
            f"Mode {mode}: steady vibration under the base motion of the experiment; dashed: unstable.  "
            "Larger markers: amplitude that the experiment has reached before its stop."
        )
        figures.append(drawn(caption, partial(_figure, titles, own)))
    return Finding(data, (table,), tuple(figures))


def _figure(titles: Mapping[str, str], own: Sequence[tuple[Mapping[str, Any], Resonance]]) -> Figure:
    """Draw the curves of one mode; ``titles`` are those of all laws by name."""
    figure, (axes,) = new_figure(3.4)
    for run, (curve, amplitudes) in own:
        k = list(titles).index(run["law"])
        draw_curve(axes, curve, 1e3 * amplitudes, k, titles[run["law"]])
        axes.plot(run["drive_hz"], 1e3 * run["reached_amplitude_m"], ls="", ms=8, mec="black", mew=0.8,
                  **{key: series(k)[key] for key in ("color", "marker")})  # fmt: skip
    axes.set(xlabel="frequency, Hz", ylabel="amplitude of the mode\nat the tip, mm", ylim=(0.0, None))
    axes.set_title(f"mode {own[0][0]['mode']}")
    axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.2), ncols=2)
    return figure


def range_of(run: Mapping[str, Any]) -> tuple[float, float]:
    """Return the first and the last frequency of a curve, Hz, from the numbers of an experiment.

    A mode that softens is on the upper branch of its curve above the resonance, where the curve therefore begins.  The
    amplitude of the steady vibration is estimated by the growth of a linear vibration until the stop, and the change of
    frequency with the amplitude by the frequency of the decay.
    """
    natural, ratio = run["natural_frequency_hz"], run["expected_damping_ratio"]
    amplitude = run["requested_amplitude_m"] / -math.expm1(-2 * math.pi * natural * ratio * run["stop_s"])
    change = (run["frequency_hz"] / natural - 1) * (amplitude / run["amplitude_m"]) ** 2
    # least distance of the last frequency below the natural one, relative to it
    lowest = 1 - min(RANGE_WIDTH * ratio - RANGE_MARGIN * min(change, 0.0), 0.03)
    return natural * (1 + RANGE_WIDTH * ratio + RANGE_MARGIN * max(change, 0.0)), natural * lowest
