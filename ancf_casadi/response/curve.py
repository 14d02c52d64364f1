"""The result of a continuation: a curve of periodic motions with its stability, folds and jumps.

A slow sweep follows the stable motions.  At the fold where they end or lose their stability, the vibration jumps to
another stable motion at the same frequency, further along the curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ancf_casadi.response.floquet import Bifurcation
from ancf_casadi.response.periodic import PeriodicMotion
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import Figure
from ancf_casadi.support.tables import Displayed, Reported, Table, plural, spread


@dataclass(frozen=True, eq=False)
class BifurcationPoint(Displayed):
    """A bifurcation on a curve."""

    kind: Bifurcation
    index: int  # of the motion in the curve, from 0
    motion: PeriodicMotion


class Jumps(NamedTuple):
    """Values of the frequency, amplitude or parameter at which a slow sweep jumps, in order."""

    up: tuple[float, ...]  # in a sweep towards larger values
    down: tuple[float, ...]  # in one towards smaller values


@dataclass(frozen=True, eq=False)
class ResponseCurve(Reported):
    """A curve of periodic motions.

    Parameters
    ----------
    free : {"omega", "amplitude", "value"}
        Whether the frequency, the amplitude of the excitation or a parameter varies along the curve.
    motions : tuple of PeriodicMotion
        The motions in the order of the curve.
    bifurcations : tuple of BifurcationPoint
        The bifurcations, which are among the motions.
    closed : bool
        Whether the curve is closed.

    Examples
    --------
    >>> import casadi as cs
    >>> from ancf_casadi import HarmonicForce, SecondOrderSystem, frequency_response
    >>> q, v, a, u = (cs.SX.sym(name) for name in ("q", "v", "a", "u"))
    >>> duffing = SecondOrderSystem.of(q, v, a, u, conservative=a + q + 0.5 * q**3, damping=0.05 * v, excitation=u)
    >>> curve = frequency_response(duffing, (0.1, 0.3), force=HarmonicForce(amplitude=0.1, frequency=0.1))
    >>> print(f"jumps up at {curve.jumps.up[0]:.3f} Hz, down at {curve.jumps.down[0]:.3f} Hz")
    jumps up at 0.215 Hz, down at 0.180 Hz
    >>> curve.amplitude().shape == curve.frequencies.shape == curve.stable.shape
    True
    """

    _drawing = "ancf_casadi.figures.responses.response_figure"

    free: str
    motions: tuple[PeriodicMotion, ...]
    bifurcations: tuple[BifurcationPoint, ...]
    closed: bool

    @property
    def frequencies(self) -> Array:
        """Frequency, (k,), Hz."""
        return np.array([motion.frequency for motion in self.motions])

    @property
    def drive_amplitudes(self) -> Array:
        """Amplitude of the excitation, (k,), m, N or N m."""
        return np.array([motion.drive_amplitude for motion in self.motions])

    @property
    def values(self) -> Array:
        """Frequency, Hz, amplitude of the excitation, or parameter, whichever varies along the curve, (k,)."""
        return np.array([_curve_value(motion, self.free) for motion in self.motions])

    @cached_property
    def stable(self) -> NDArray[np.bool_]:
        """True for each stable motion, (k,)."""
        return np.array([motion.stable for motion in self.motions])

    def amplitude(
        self, point: float | None = None, *, direction: Sequence[float] | None = None, relative: bool = True
    ) -> Array:
        """Return half the peak-to-peak displacement of a point, (k,), as ``PeriodicMotion.amplitude``."""
        return np.array([motion.amplitude(point, direction=direction, relative=relative) for motion in self.motions])

    def phase(
        self, point: float | None = None, *, direction: Sequence[float] | None = None, relative: bool = True
    ) -> Array:
        """Return the phase of the first harmonic of a point relative to the excitation, (k,), rad, unwrapped."""
        phases = [motion.phase(point, direction=direction, relative=relative) for motion in self.motions]
        return np.unwrap(phases)

    @cached_property
    def jumps(self) -> Jumps:
        """Values at which a slow sweep from the end of the curve with the lowest or highest value jumps."""
        values, stable = self.values, self.stable
        if values[0] > values[-1]:
            values, stable = values[::-1], stable[::-1]
        down = _jumps(-values[::-1], stable[::-1])
        return Jumps(_jumps(values, stable), tuple(-value for value in down))

    @property
    def peak(self) -> PeriodicMotion:
        """The motion with the largest amplitude, as ``amplitude`` gives it."""
        return self.motions[int(self.amplitude().argmax())]

    def table(self) -> Table:
        """Return bifurcations, jumps and the largest amplitude."""
        name, unit = self.quantity
        rows: list[tuple[str, float, float | None]] = [("largest amplitude", *self._value_and_amplitude(self.peak))]
        rows += [
            (bifurcation.kind, *self._value_and_amplitude(bifurcation.motion)) for bifurcation in self.bifurcations
        ]
        for direction, jumps in zip(("up", "down"), self.jumps, strict=True):
            rows += [(f"jump, sweeping {direction}", value, None) for value in jumps]
        length = self.motions[0].excited.unit
        columns = ("", f"{name}, {unit}" if unit else name, f"amplitude, {length}" if length else "amplitude")
        unstable = np.count_nonzero(~self.stable)
        title = f"Response curve of {plural(len(self.motions), 'motion')}, {unstable} of them unstable"
        return Table("response", title, columns, rows)

    def to_dict(self) -> dict[str, Any]:
        """Return the curve as plain data, with amplitude and phase of the tip or of the first coordinate."""
        return {
            "kind": "response curve",
            "free": self.free,
            "values": self.values.tolist(),
            "frequencies_hz": self.frequencies.tolist(),
            "drive_amplitudes": self.drive_amplitudes.tolist(),
            "amplitudes": self.amplitude().tolist(),
            "phases_rad": self.phase().tolist(),
            "stable": self.stable.tolist(),
            "bifurcations": [
                {
                    "kind": bifurcation.kind,
                    "index": bifurcation.index,
                    "value": _curve_value(bifurcation.motion, self.free),
                }
                for bifurcation in self.bifurcations
            ],
            "jumps": {"up": list(self.jumps.up), "down": list(self.jumps.down)},
            "closed": self.closed,
        }

    def figure(self, *others: ResponseCurve, labels: Sequence[str] = (), point: float | None = None) -> Figure:
        """Draw amplitude and phase of a point, and others over them; unstable motions are dashed, bifurcations marked.

        Parameters
        ----------
        *others : ResponseCurve
            Curves over the same quantity.
        labels : sequence of str
            Names of this curve and the others in the legend; their numbers, from 1, if not given.
        point : float, optional
            The point, as in ``PeriodicMotion.amplitude``.

        Raises
        ------
        InputError
            If a curve is over another quantity, or there is not one label for each.
        """
        return self._draw_figure(others, labels, point=point)

    def _value_and_amplitude(self, motion: PeriodicMotion) -> tuple[float, float]:
        return _curve_value(motion, self.free), motion.amplitude()

    def _summary(self) -> str:
        name, unit = self.quantity
        bifurcations = plural(len(self.bifurcations), "bifurcation")
        return f"{plural(len(self.motions), 'motion')}, {name} {spread(self.values, unit)}, {bifurcations}"

    @property
    def quantity(self) -> tuple[str, str]:
        """Name and unit of the value that varies along the curve."""
        if self.free == "omega":
            return "frequency", "Hz"
        if self.free == "amplitude":
            return "amplitude of the excitation", self.motions[0].excited.drive.unit
        balance = self.motions[0].balance
        parameter = balance.system.parameters[balance.varied or 0]
        return parameter.name, parameter.unit if parameter.unit != "1" else ""


def _curve_value(motion: PeriodicMotion, free: str) -> float:
    """Return the value that varies along a curve: frequency, Hz, amplitude of the excitation, or parameter."""
    return motion.frequency if free == "omega" else float(getattr(motion.setting, free))


def _jumps(values: Array, stable: NDArray[np.bool_]) -> tuple[float, ...]:
    """Return the values at which a sweep from the first motion of a curve towards larger values jumps."""
    jumps, index = [], int(stable.argmax())
    while index < len(values) - 1:
        if values[index + 1] > values[index] and stable[index + 1]:
            index += 1
            continue
        jumps.append(float(values[index]))
        crossings = np.flatnonzero((values[:-1] < values[index]) & (values[1:] >= values[index]) & stable[1:])
        later_crossings = crossings[crossings > index]
        if not len(later_crossings):
            break
        index = int(later_crossings[0]) + 1
    return tuple(jumps)
