"""Backbones: frequency and damping ratio of a free vibration against its amplitude.

Without damping, a nonlinear normal mode is a family of periodic free vibrations that begins as a natural mode of small
motion.  With a damping law, a free vibration decays; the negative damping -xi M v makes it periodic (extended periodic
motion concept).  With the angular frequency omega of this motion, its damping ratio is

    zeta = xi/(2 omega),

which is that of the law for small motion.  A slowly decaying free vibration with the mean kinetic energy <T> loses the
power 4 zeta omega <T>.  In large motion, the logarithmic decrement of the tip differs a little from 2 pi zeta, because
the displacement of the tip is not proportional to the amplitude of the mode.

The same equations serve an undamped system, for which xi is zero.  The phase of the motion is set by the condition that
the mode, phi^T M q, has no cosine in its first harmonic.

References
----------
M. Krack, Nonlinear modal analysis of nonconservative systems: extension of the periodic motion concept, Computers &
Structures 154 (2015).
G. Kerschen, M. Peeters, J. C. Golinval, A. F. Vakakis, Nonlinear normal modes, Part I, Mechanical Systems and Signal
Processing 23 (2009).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import casadi as cs
import numpy as np
import scipy.linalg

from ancf_casadi.damping import DampingLaw
from ancf_casadi.exceptions import ContinuationError, InputError, NumericsError
from ancf_casadi.response.excited import Body, Excited, excite
from ancf_casadi.response.harmonic_balance.balance import Setting, motion_size
from ancf_casadi.response.harmonic_balance.continuation import follow, point_at
from ancf_casadi.response.harmonic_balance.family import Family, NotFound, Point
from ancf_casadi.response.onset import RESPONSE_ERROR, as_periodic_motion, solve_equilibrium
from ancf_casadi.response.periodic import PeriodicMotion
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import number, physical, positive, whole
from ancf_casadi.support.interrupts import lasting_interrupts
from ancf_casadi.support.tables import Reported, Table, plural, spread

MAX_BACKBONE_POINTS = 1000
SINE = 2  # row of the coefficients C: the sine in the first harmonic, which holds the whole mode in small motion


@dataclass(frozen=True, eq=False)
class Backbone(Reported):
    """Frequency and damping ratio of a mode against its amplitude.

    Parameters
    ----------
    mode : int
        Number of the mode, from 1.
    natural_frequency : float
        Frequency of small motion, Hz.
    motions : tuple of PeriodicMotion
        The motions, with increasing amplitude.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, backbone, reduce_model
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> curve = backbone(reduce_model(Model(beam), modes=2), mode=2, amplitude=0.03)
    >>> curve.amplitudes.shape == curve.frequencies.shape == curve.damping_ratios.shape
    True
    >>> print(f"{curve.frequency(0.02) / curve.natural_frequency - 1:.1%}")
    -1.0%
    """

    _drawing = "ancf_casadi.figures.responses.backbone_figure"

    mode: int
    natural_frequency: float
    motions: tuple[PeriodicMotion, ...]

    @cached_property
    def amplitudes(self) -> Array:
        """Half the peak-to-peak displacement, (k,): of the reference point of the mode, m, or a system's coordinate.

        The reference point is the tip or, if the tip is held, that of ``Modes.reference_points``.  For a system other
        than a beam, the largest coordinate replaces it.
        """
        point = _amplitude_point(self.motions[0])
        return np.array([motion.amplitude(point) for motion in self.motions])

    @property
    def frequencies(self) -> Array:
        """Frequency, (k,), Hz."""
        return np.array([motion.frequency for motion in self.motions])

    @property
    def damping_ratios(self) -> Array:
        """Damping ratio xi/(2 omega), (k,)."""
        return np.array([motion.setting.growth / (2 * motion.setting.omega) for motion in self.motions])

    def frequency(self, amplitude: float) -> float:
        """Return the frequency at an amplitude, Hz, interpolated by a cubic spline.

        Raises
        ------
        InputError
            If the backbone does not reach the amplitude, or turns in amplitude.
        """
        return self._interpolate(self.frequencies, amplitude)

    def damping_ratio(self, amplitude: float) -> float:
        """Return the damping ratio at an amplitude; interpolation and errors are those of ``frequency``."""
        return self._interpolate(self.damping_ratios, amplitude)

    def to_dict(self) -> dict[str, Any]:
        """Return the backbone as plain data."""
        return {
            "kind": "backbone",
            "mode": self.mode,
            "natural_frequency_hz": self.natural_frequency,
            "amplitudes": self.amplitudes.tolist(),
            "frequencies_hz": self.frequencies.tolist(),
            "damping_ratios": self.damping_ratios.tolist(),
        }

    def table(self) -> Table:
        """Return the backbone."""
        unit = self.motions[0].excited.unit
        columns = (f"amplitude, {unit}" if unit else "amplitude", "frequency, Hz", "damping ratio")
        title = f"Mode {self.mode}, {self.natural_frequency:.6g} Hz in small motion"
        rows = np.column_stack([self.amplitudes, self.frequencies, self.damping_ratios]).tolist()
        return Table("backbone", title, columns, rows)

    def _summary(self) -> str:
        extent = f"{plural(len(self.motions), 'motion')}, {spread(self.frequencies, 'Hz')}"
        return f"mode {self.mode}, {self.natural_frequency:.4g} Hz in small motion, {extent}"

    def _interpolate(self, values: Array, amplitude: float) -> float:
        from scipy.interpolate import CubicSpline  # slow to import

        value = number(amplitude, "amplitude")
        if not self.amplitudes[0] <= value <= self.amplitudes[-1]:
            raise InputError(
                f"must be from {self.amplitudes[0]:.4g} to {self.amplitudes[-1]:.4g}, got {value:.4g}", "amplitude"
            )
        if (np.diff(self.amplitudes) <= 0.0).any():
            raise InputError("has no single motion, because the backbone turns in amplitude; use motions", "amplitude")
        return float(CubicSpline(self.amplitudes, values)(value))


@lasting_interrupts()
def backbone(
    model: Body,
    mode: int = 1,
    *,
    amplitude: float,
    damping: DampingLaw | None = None,
    points: int = 30,
    tolerance: float = RESPONSE_ERROR,
) -> Backbone:
    """Return frequency and damping ratio of a mode against its amplitude, for a beam whose base is at rest.

    Parameters
    ----------
    model : Model, ReducedModel or SecondOrderSystem
        The full beam, the beam in a few modes, or another system, which is taken without excitation.
    mode : int
        Number of the mode, from 1.
    amplitude : float
        Amplitude at which the backbone ends, as of ``Backbone.amplitudes``.
    damping, tolerance
        As in ``periodic_motion``.
    points : int
        Smallest number of points, at most 500.

    Raises
    ------
    InputError
        If an argument is not in its range, there is no such mode, or it moves the beam along its axis.
    EquilibriumError
        If the beam has no equilibrium under gravity.
    NumericsError
        If the system has no stable equilibrium near its state of rest.
    ContinuationError
        If the backbone cannot be followed to the amplitude; its ``partial`` holds the backbone up to there.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, QuadraticDamping, backbone, reduce_model
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> reduced = reduce_model(Model(beam), modes=2, damping=QuadraticDamping(eta2=0.2))
    >>> curve = backbone(reduced, mode=1, amplitude=0.1)
    >>> for amplitude in (0.05, 0.1):  # of the tip, m
    ...     print(f"{curve.frequency(amplitude):.4f} Hz, {curve.damping_ratio(amplitude):.2%}")
    1.8764 Hz, 0.42%
    1.8764 Hz, 0.85%
    """
    amplitude, tolerance = physical(amplitude, "amplitude"), positive(tolerance, "tolerance")
    points = whole(points, "points", 2, MAX_BACKBONE_POINTS // 2)
    mode = whole(mode, "mode", 1)
    subject = excite(model, damping, mode=mode)
    whole(mode, "mode", 1, subject.system.size)
    if subject.model is not None and amplitude > subject.model.beam.length:
        raise InputError(
            f"{amplitude:g} m is more than the length of the beam, {subject.model.beam.length:g} m", "amplitude"
        )
    # the backbone begins at 1e-3 of the largest amplitude
    first = _small_mode_motion(subject, mode, 1e-3 * amplitude, tolerance)
    functional, frequency = first.family.phase, first.family.setting.omega / (2 * math.pi)
    motions = [as_periodic_motion(subject, first)]
    point_amplitude = partial(PeriodicMotion.amplitude, point=_amplitude_point(motions[0]))
    # the modal coordinate may change by its final value in small motion, divided by the number of points
    longest_change = float(functional @ first.coefficients[SINE]) / point_amplitude(motions[0]) * amplitude / points

    def longest(from_point: Point, tangent: Array) -> float:
        change, _ = from_point.family.split(tangent * from_point.family.scale)
        rate = abs(float(functional @ change[SINE]))
        return longest_change / rate if rate else math.inf

    try:
        for step in follow(first, first.row, 1.0, longest):
            motions.append(as_periodic_motion(subject, step.end))
            if point_amplitude(motions[-1]) >= amplitude:
                break
            if len(motions) >= MAX_BACKBONE_POINTS:
                raise NumericsError(f"the backbone does not reach the amplitude within {MAX_BACKBONE_POINTS} points")
    except NumericsError as error:
        raise ContinuationError(str(error), error.stats, Backbone(mode, frequency, tuple(motions))) from None
    return Backbone(mode, frequency, tuple(motions))


def _small_mode_motion(subject: Excited, mode: int, amplitude: float, tolerance: float) -> Point:
    """Return the motion of a mode at a small amplitude; its family holds frequency and growth of the linear mode."""
    balance = subject.balance
    C = solve_equilibrium(balance, 1.0)
    entries = balance.linearise(C, Setting(1.0, 0.0)).matrices
    K, D, M = (balance.system.matrix(matrix_entries[0]) for matrix_entries in entries)
    try:
        eigenvalues, shapes = scipy.linalg.eigh((K + K.T) / 2, (M + M.T) / 2)
    except np.linalg.LinAlgError:
        raise NumericsError("the mass matrix is not positive definite at rest, so there are no modes") from None
    if not eigenvalues[0] > 0.0:
        raise NumericsError("the state of rest is unstable, so it has no modes")
    shape, omega = shapes[:, mode - 1], math.sqrt(eigenvalues[mode - 1])
    setting, change, functional = Setting(omega, 0.0, float(shape @ D @ shape)), np.zeros_like(C), M @ shape
    change[SINE] = shape
    mode_amplitude = 1e6 * _amplitude(subject, C + change * 1e-6, setting)
    if subject.model is not None and mode_amplitude <= 1e-6 * subject.model.beam.length * motion_size(balance, change):
        raise InputError(f"{mode} moves the beam along its axis; its amplitude across it is zero", "mode")
    change *= amplitude / mode_amplitude
    family = Family(
        balance, setting, ("omega", "growth"), (omega, omega), motion_size(balance, change), tolerance, functional
    )
    guess = family.add_change(family.join(C, setting), family.join(change, Setting(0.0, 0.0)))
    gradient = np.zeros_like(C)
    gradient[SINE] = functional
    row = family.join(gradient, Setting(0.0, 0.0)) * family.scale
    try:
        return point_at(family, guess, row / np.linalg.norm(row))
    except NotFound:
        raise NumericsError("the mode was not found in small motion") from None


def _amplitude(subject: Excited, C: Array, setting: Setting) -> float:
    """Return the amplitude of the reference point, or of the largest coordinate."""
    if subject.model is None:
        return float(np.abs(C[SINE]).max())
    q, _, u = subject.kinematics(C, setting, np.array([0.5, 1.5]) * math.pi)  # the extremes of the sine
    highest, lowest = subject.displacement(cs.DM(q), cs.DM(u), None, None, relative=True).full().ravel().tolist()
    return float(abs(highest - lowest) / 2)


def _amplitude_point(motion: PeriodicMotion) -> float | None:
    """Return the ``point`` of amplitudes: None for the reference point of a beam, or the largest coordinate."""
    beam = motion.excited.model is not None
    return None if beam else int(np.abs(motion.coefficients[1:]).max(axis=0).argmax())
