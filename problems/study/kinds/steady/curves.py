"""Response curves as plain data: amplitude and phase against frequency, with their bifurcations and jumps.

The equivalent damping ratio at the peak is that of viscous damping that loses the same energy W per period in the mode
with the nearest natural frequency.  With the amplitude A of the tip, and the modal mass m for a tip displacement of 1,

    zeta = W/(2 pi m omega^2 A^2).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypedDict

import numpy as np
import numpy.typing as npt

from ancf_casadi.mechanics.model import Model
from ancf_casadi.reduction.reduced import ReducedModel
from ancf_casadi.response.curve import ResponseCurve
from ancf_casadi.response.periodic import PeriodicMotion
from ancf_casadi.support.arrays import Array
from ancf_casadi.vibration.modes import natural_modes
from problems.schema.response import ResponseTask
from problems.study.data_table import Column

TIP_KEY = "tip"


class BifurcationNumbers(TypedDict):
    """A fold, a period doubling or a Neimark-Sacker point, with the amplitude of the tip."""

    name: str
    frequency_hz: float
    amplitude_m: float


class PointNumbers(TypedDict):
    """Amplitude relative to the clamp, and phase, of a point of the beam along a curve."""

    amplitude_m: list[float]
    phase_rad: list[float]


class CurveNumbers(TypedDict):
    """A response curve: its points in their order along the curve, peak of the tip, bifurcations and jumps."""

    frequency_hz: list[float]
    stable: list[bool]
    points: dict[str, PointNumbers]
    peak_frequency_hz: float
    peak_amplitude_m: float
    peak_damping_ratio: float
    bifurcations: list[BifurcationNumbers]
    jumps_up_hz: list[float]
    jumps_down_hz: list[float]


class LevelNumbers(TypedDict):
    """The response curve at an amplitude of the excitation, of the base (m) or of the force at the tip (N)."""

    level: float
    unit: str
    curve: CurveNumbers


@dataclass(frozen=True)
class Bifurcation:
    """A bifurcation of a response curve.

    Parameters
    ----------
    name : str
        Its name.
    frequency : float
        Frequency, Hz.
    amplitude : float
        Amplitude of the tip, m.
    """

    name: str
    frequency: float
    amplitude: float


@dataclass(frozen=True)
class CurveData:
    """A response curve as plain data.

    Parameters
    ----------
    frequency : ndarray (k,)
        Frequencies in their order along the curve, Hz.
    amplitude, phase : dict of ndarray (k,)
        Amplitude relative to the clamp, m, and phase, rad, by the name of the point; the first is the tip.
    stable : ndarray (k,)
        Whether the motion is stable.
    damping_ratio : float
        Equivalent damping ratio at the peak.
    bifurcations : tuple of Bifurcation
        Folds and other bifurcations.
    up, down : tuple of float
        Frequencies at which slow upward and downward sweeps jump, Hz.
    """

    frequency: Array
    amplitude: dict[str, Array]
    phase: dict[str, Array]
    stable: npt.NDArray[np.bool_]
    damping_ratio: float
    bifurcations: tuple[Bifurcation, ...]
    up: tuple[float, ...]
    down: tuple[float, ...]

    @property
    def tip(self) -> Array:
        """Amplitude of the tip, (k,), m."""
        return self.amplitude[TIP_KEY]

    @property
    def peak(self) -> tuple[float, float]:
        """Frequency (Hz) and amplitude of the tip (m) where this amplitude is largest."""
        k = int(np.argmax(self.tip))
        return float(self.frequency[k]), float(self.tip[k])

    @property
    def numbers(self) -> CurveNumbers:
        """The curve for JSON."""
        frequency, amplitude = self.peak
        return {
            "frequency_hz": self.frequency.tolist(),
            "stable": self.stable.tolist(),
            "points": {
                name: {"amplitude_m": own.tolist(), "phase_rad": self.phase[name].tolist()}
                for name, own in self.amplitude.items()
            },
            "peak_frequency_hz": frequency,
            "peak_amplitude_m": amplitude,
            "peak_damping_ratio": self.damping_ratio,
            "bifurcations": [
                {"name": one.name, "frequency_hz": one.frequency, "amplitude_m": one.amplitude}
                for one in self.bifurcations
            ],
            "jumps_up_hz": list(self.up),
            "jumps_down_hz": list(self.down),
        }


def curve_data(task: ResponseTask, curve: ResponseCurve) -> CurveData:
    """Return a response curve of a task as plain data."""
    places = {TIP_KEY: None, **task.markers}
    amplitude = {name: curve.amplitude(place) for name, place in places.items()}
    return CurveData(
        frequency=curve.frequencies,
        amplitude=amplitude,
        phase={name: curve.phase(place) for name, place in places.items()},
        stable=curve.stable,
        damping_ratio=_damping_ratio(task.body, curve.motions[int(np.argmax(amplitude[TIP_KEY]))]),
        bifurcations=tuple(
            Bifurcation(one.kind, one.motion.frequency, one.motion.amplitude()) for one in curve.bifurcations
        ),
        up=curve.jumps.up,
        down=curve.jumps.down,
    )


def level_numbers(levels: Sequence[float], unit: str, curves: Sequence[CurveData]) -> list[LevelNumbers]:
    """Return the curves at the levels of an excitation for JSON."""
    return [{"level": level, "unit": unit, "curve": curve.numbers} for level, curve in zip(levels, curves, strict=True)]


def level_titles(levels: Sequence[float], unit: str) -> tuple[str, ...]:
    """Return the levels of an excitation as text, in mm or mN."""
    return tuple(f"{1e3 * level:.4g} m{unit}" for level in levels)


def _damping_ratio(body: Model | ReducedModel, motion: PeriodicMotion) -> float:
    """Return the equivalent damping ratio of a motion."""
    # the nearest mode is sought among ten of the full beam
    modes = body.modes if isinstance(body, ReducedModel) else natural_modes(body, count=10)
    nearest = int(np.argmin(np.abs(np.log(modes.frequencies / motion.frequency))))
    speed = 2 * math.pi * motion.frequency * motion.amplitude() / modes.tip_amplitudes()[nearest]
    return float(motion.dissipated_energy / (2 * math.pi * speed**2))


def summary_columns(curves: Sequence[CurveData]) -> tuple[Column, ...]:
    """Return peak, damping and jumps of curves as columns of a table, one row per curve."""
    peaks = [curve.peak for curve in curves]
    return (
        Column("peak of the tip", tuple(1e3 * amplitude for _, amplitude in peaks), "mm"),
        Column("at", tuple(frequency for frequency, _ in peaks), "Hz"),
        Column("damping there", tuple(100 * curve.damping_ratio for curve in curves), "%"),
        Column("jump up", tuple(_listed(curve.up) for curve in curves), "Hz"),
        Column("jump down", tuple(_listed(curve.down) for curve in curves), "Hz"),
    )


def _listed(frequencies: Sequence[float]) -> str:
    return ", ".join(f"{frequency:.5g}" for frequency in frequencies) or "–"
