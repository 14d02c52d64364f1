"""A step with response curves, computed from the tables of the file.

A curve is a table as in ``results.json``: its points in their order along the curve, with the amplitude of the tip and
of each marker relative to the clamp (m) and the phase (rad), the peak of the tip, bifurcations, and the frequencies at
which slow sweeps jump (Hz).

The equivalent damping ratio at the peak is that of viscous damping that loses the same energy W per period in the mode
with the nearest natural frequency.  With the amplitude A of the tip, and the modal mass m for a tip displacement of 1,

    zeta = W/(2 pi m omega^2 A^2).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import repeat
from typing import Any, final

import numpy as np

from ancf_casadi.reduction.reduced import ReducedModel
from ancf_casadi.response.curve import ResponseCurve
from ancf_casadi.response.periodic import PeriodicMotion
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import Axes, Figure
from ancf_casadi.support.tables import Cell, Table
from ancf_casadi.vibration.modes import natural_modes
from problems.spec.file import StudyFile
from problems.spec.motion import ResponseTables
from problems.study.compute import Compute
from problems.study.drawing import new_figure, series
from problems.study.kinds.motion import TablesStep
from problems.study.step import Finding, Findings, study_table

TIP_KEY = "tip"
SUMMARY_HEADS = ("peak of the tip, mm", "at, Hz", "damping there, %", "jump up, Hz", "jump down, Hz")

Curve = Mapping[str, Any]  # a response curve as in results.json


def curve_numbers(curve: ResponseCurve, markers: Mapping[str, float]) -> dict[str, Any]:
    """Return a response curve for JSON, with the motion of markers at their arc lengths (m)."""
    places = {TIP_KEY: None, **markers}
    amplitudes = {name: curve.amplitude(place) for name, place in places.items()}
    peak = int(np.argmax(amplitudes[TIP_KEY]))
    return {
        "frequency_hz": curve.frequencies.tolist(),
        "stable": curve.stable.tolist(),
        "points": {
            name: {"amplitude_m": amplitudes[name].tolist(), "phase_rad": curve.phase(place).tolist()}
            for name, place in places.items()
        },
        "peak_frequency_hz": float(curve.frequencies[peak]),
        "peak_amplitude_m": float(amplitudes[TIP_KEY][peak]),
        "peak_damping_ratio": _damping_ratio(curve.motions[peak]),
        "bifurcations": [
            {"name": point.kind, "frequency_hz": point.motion.frequency, "amplitude_m": point.motion.amplitude()}
            for point in curve.bifurcations
        ],
        "jumps_up_hz": list(curve.jumps.up),
        "jumps_down_hz": list(curve.jumps.down),
    }


def _damping_ratio(motion: PeriodicMotion) -> float:
    """Return the equivalent damping ratio of a motion of a beam."""
    body = motion.excited.body
    assert body
    # the nearest mode is sought among ten of the full beam
    modes = body.modes if isinstance(body, ReducedModel) else natural_modes(body, count=10)
    nearest = int(np.argmin(np.abs(np.log(modes.frequencies / motion.frequency))))
    speed = 2 * math.pi * motion.frequency * motion.amplitude() / modes.tip_amplitudes()[nearest]
    return float(motion.dissipated_energy / (2 * math.pi * speed**2))


def summary_rows(curves: Sequence[Curve]) -> list[tuple[Cell, ...]]:
    """Return peak, damping and jumps of curves as rows of a table with ``SUMMARY_HEADS``."""
    rows: list[tuple[Cell, ...]] = []
    for curve in curves:
        peak = (1e3 * curve["peak_amplitude_m"], curve["peak_frequency_hz"], 100 * curve["peak_damping_ratio"])
        jumps = (", ".join(f"{jump:.5g}" for jump in curve[key]) or "–" for key in ("jumps_up_hz", "jumps_down_hz"))
        rows.append((*peak, *jumps))
    return rows


def level_curve(file: StudyFile, level: float) -> dict[str, Any]:
    """Return the response curve of a study file at one of its levels."""
    tables = ResponseTables.of(file)
    return curve_numbers(tables.curve(level), tables.markers)


@final
@dataclass(frozen=True, kw_only=True)
class ResponseStep(TablesStep):
    """Steady vibration over frequency, with folds and jumps: the tables [[damping]], [response], [markers]."""

    kind, heading = "response", "Steady vibration"
    converter = ResponseTables
    reading = frozenset({"beam", "damping", "response", "markers"})

    def finding(self, compute: Compute, findings: Findings) -> Finding:
        """Return the curves with their peaks and jumps."""
        tables = ResponseTables.of(self.file)
        levels, unit = tables.levels, tables.unit
        curves = compute.all(level_curve, [(self.file, level) for level in levels])
        titles = [f"{1e3 * level:.4g} m{unit}" for level in levels]  # in mm or mN
        rows = [(title, *row) for title, row in zip(titles, summary_rows(curves), strict=True)]
        bifurcations = [
            f"{title}: {bifurcation['name']} at {bifurcation['frequency_hz']:.6g} Hz, "
            f"tip {1e3 * bifurcation['amplitude_m']:.4g} mm"
            for title, curve in zip(titles, curves, strict=True)
            for bifurcation in curve["bifurcations"]
        ]
        table = study_table("Peaks and jumps of the response", ("excitation", *SUMMARY_HEADS), rows, *bifurcations)
        caption = (
            "Steady vibration of the tip relative to the clamp: half the peak-to-peak value, and phase against the "
            "excitation.  Dashed: unstable."
        )
        figures = compute.drawings((caption, _figure, titles, curves))
        data = [{"level": level, "unit": unit, "curve": curve} for level, curve in zip(levels, curves, strict=True)]
        files = {"response.csv": _points(levels, unit, curves).csv().encode()}
        return Finding(data, (table,), figures, files=files)


def _points(levels: Sequence[float], unit: str, curves: Sequence[Curve]) -> Table:
    """Return the points of all curves, one row each."""
    quantities = ("amplitude_m", "phase_rad")
    columns = [f"level_{unit.lower()}", "frequency_hz", "stable"]
    columns += [f"{name}_{quantity}" for name in curves[0]["points"] for quantity in quantities]
    rows: list[tuple[Cell, ...]] = []
    for level, curve in zip(levels, curves, strict=True):
        values = [point[quantity] for point in curve["points"].values() for quantity in quantities]
        rows += zip(repeat(level), curve["frequency_hz"], map(int, curve["stable"]), *values, strict=False)
    return Table("response", "Steady vibration", columns, rows)


def _figure(titles: Sequence[str], curves: Sequence[Curve]) -> Figure:
    """Draw amplitude and phase of the tip against frequency."""
    figure, (above, below) = new_figure(5.4, 2, sharex=True, height_ratios=(1.7, 1))
    for k, (title, curve) in enumerate(zip(titles, curves, strict=True)):
        tip = curve["points"][TIP_KEY]
        draw_curve(above, curve, 1e3 * np.array(tip["amplitude_m"]), k, title)
        draw_curve(below, curve, np.degrees(tip["phase_rad"]), k)
    above.set(ylabel="amplitude of the tip, mm", ylim=(0.0, None))
    below.set(xlabel="frequency, Hz", ylabel="phase, degrees")
    above.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    figure.align_ylabels()
    return figure


def draw_curve(axes: Axes, curve: Curve, values: Array, number: int, label: str | None = None) -> None:
    """Draw values along a curve in the style of its number: stable parts solid, unstable parts dashed."""
    from ancf_casadi.figures.responses import draw_branches  # slow to import

    span = max(1, len(values) // 8)  # markers, which tell the curves apart in grey
    style = series(number) | {"linestyle": "-", "lw": 1.4, "ms": 4, "markevery": (span // 2, span)}
    draw_branches(axes, np.array(curve["frequency_hz"]), values, np.array(curve["stable"]), label, **style)
