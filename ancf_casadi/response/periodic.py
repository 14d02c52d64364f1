"""The result of harmonic balance: a periodic motion under harmonic excitation."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.dense_output import MotionSamples
from ancf_casadi.dynamics.trajectory import MOVING, IntegratorUse, Trajectory
from ancf_casadi.exceptions import InputError
from ancf_casadi.reduction.forces import BASE_SIZE
from ancf_casadi.reduction.reduced import ReducedModel
from ancf_casadi.reduction.stepping import ReducedTrajectory
from ancf_casadi.response.excited import Excited, half_range
from ancf_casadi.response.floquet import is_stable
from ancf_casadi.response.harmonic_balance.balance import Errors, HarmonicBalance, Setting, fourier
from ancf_casadi.response.harmonic_balance.beams import base_force
from ancf_casadi.support.arrays import Array, ComplexArray
from ancf_casadi.support.files import check_file, write_file
from ancf_casadi.support.inputs import instances, whole
from ancf_casadi.support.tables import Reported, Table, plural

PERIOD_SAMPLES = 256  # samples of a period for peaks and harmonics of a point


@dataclass(frozen=True, eq=False)
class PeriodicMotion(Reported):
    """A periodic motion; the phase of the excitation is sin(omega t).

    Parameters
    ----------
    excited : Excited
        The system with its excitation.
    balance : HarmonicBalance
        The equations, with the numbers of harmonics and samples.
    coefficients : array (2 H + 1, n)
        Fourier coefficients of the coordinates: mean, then cosine and sine of each harmonic.
    setting : Setting
        Angular frequency, amplitude of the excitation and so on.
    multipliers : array (2 n,)
        Floquet multipliers, the largest first.
    errors : Errors
        Estimated errors relative to the size of the motion.

    Examples
    --------
    >>> import math
    >>> from ancf_casadi import Beam, HarmonicBase, Model, RayleighDamping, periodic_motion, reduce_model
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> reduced = reduce_model(Model(beam), modes=2, damping=RayleighDamping(alpha=0.5))
    >>> motion = periodic_motion(reduced, base=HarmonicBase(amplitude=5e-3, frequency=1.9))
    >>> print(f"{math.degrees(motion.phase()):.0f} degrees")
    -123 degrees
    >>> motion.stable
    True
    >>> tip, middle = motion.amplitude(), motion.amplitude(0.25)
    >>> bool(abs(motion.supplied_energy / motion.dissipated_energy - 1) < 1e-9)
    True
    """

    _drawing = "ancf_casadi.figures.responses.periodic_figure"

    excited: Excited
    balance: HarmonicBalance
    coefficients: Array
    setting: Setting
    multipliers: ComplexArray
    errors: Errors

    @property
    def frequency(self) -> float:
        """Frequency, Hz."""
        return self.setting.omega / (2 * math.pi)

    @property
    def drive_amplitude(self) -> float:
        """Amplitude of the excitation, m, N or N m."""
        return self.setting.amplitude

    @property
    def harmonic_count(self) -> int:
        """Number H of harmonics."""
        return len(self.coefficients) // 2

    @property
    def stable(self) -> bool:
        """True if small disturbances die out: no Floquet multiplier lies outside the unit circle."""
        return is_stable(self.multipliers)

    def displacement(
        self, point: float | None = None, *, direction: Sequence[float] | None = None, relative: bool = True
    ) -> Array:
        """Return the displacement of a point at 256 equally spaced instants of a period, (256,).

        Parameters
        ----------
        point : float, optional
            Arc length of the point of a beam, m, the tip if not given, or if it is held the point of mode 1 in
            ``Modes.reference_points``; the number of a coordinate, from 0, of another system.
        direction : (float, float), optional
            Direction; ``Beam.across`` if not given.
        relative : bool
            Whether to take the position relative to the base; otherwise it is that in the laboratory frame.

        Raises
        ------
        InputError
            If the point or coordinate does not exist.
        """
        phases = fourier(0, PERIOD_SAMPLES).phases
        q, _, u = self.excited.kinematics(self.coefficients, self.setting, phases)
        displacement = self.excited.displacement(cs.DM(q), cs.DM(u), point, direction, relative=relative)
        return np.asarray(displacement.full().ravel())

    def amplitude(
        self, point: float | None = None, *, direction: Sequence[float] | None = None, relative: bool = True
    ) -> float:
        """Return half the peak-to-peak displacement of a point; the arguments are those of ``displacement``."""
        return half_range(self.displacement(point, direction=direction, relative=relative))

    def harmonics(
        self, point: float | None = None, *, direction: Sequence[float] | None = None, relative: bool = True
    ) -> ComplexArray:
        """Return the complex amplitudes X_k of the displacement, Im sum X_k exp(i k omega t), k = 0, 1, ...

        X_1 of a displacement A sin(omega t + phi) is A exp(i phi), and X_0 is i times the mean.  The arguments are
        those of ``displacement``.
        """
        spectrum = np.fft.rfft(self.displacement(point, direction=direction, relative=relative)) / PERIOD_SAMPLES
        spectrum[1:] *= 2.0
        return np.asarray(1j * spectrum)

    def phase(
        self, point: float | None = None, *, direction: Sequence[float] | None = None, relative: bool = True
    ) -> float:
        """Return the phase of the first harmonic relative to the excitation, rad; negative if it lags."""
        return float(np.angle(self.harmonics(point, direction=direction, relative=relative)[1]))

    @cached_property
    def _energies(self) -> tuple[float, float]:
        dissipated, supplied = self.balance.sampled_powers(self.coefficients, self.setting)
        return float(dissipated.mean()) / self.frequency, float(supplied.mean()) / self.frequency

    @property
    def dissipated_energy(self) -> float:
        """Energy lost to damping in a period, J."""
        return self._energies[0]

    @property
    def supplied_energy(self) -> float:
        """Energy supplied by the excitation in a period, J."""
        return self._energies[1]

    def trajectory(self, samples: int = PERIOD_SAMPLES) -> Trajectory | ReducedTrajectory:
        """Return the motion of a beam over one period, sampled at equal intervals; both ends are included.

        Parameters
        ----------
        samples : int
            Number of intervals.

        Raises
        ------
        InputError
            If the motion is not that of a beam, or the samples are too few for its harmonics.
        """
        body, law, setting = self.excited.body, self.excited.law, self.setting
        count = whole(samples, "samples", 2 * self.harmonic_count + 1)
        if body is None or law is None:
            raise InputError("has no trajectory, because it is not a beam; use displacement(index)", "system")
        began = time.perf_counter()
        phases = 2 * np.pi * np.arange(count + 1) / count
        q, v, u = self.excited.kinematics(self.coefficients, setting, phases)
        instants = phases / setting.omega
        if isinstance(body, ReducedModel):
            return ReducedTrajectory(body, instants, q.T, v.T, u[:BASE_SIZE].T, 0, time.perf_counter() - began)
        slope = np.tile(np.array(body.beam.axis)[:, None], (1, count + 1))
        e = body.whole(q, np.vstack([u[:2], slope])).T
        e_t = body.whole(v, np.vstack([u[3:5], np.zeros_like(slope)])).T
        balance = replace(self.balance, fourier=fourier(self.harmonic_count, count))
        motion, parameters = balance.motion(self.coefficients, setting), balance.parameters(setting)
        force = (
            base_force(body, law, self.excited.place).map(count)(*motion, np.tile(parameters[:, None], count)).full()
        )
        dissipated, supplied = (
            _integral(power, instants) for power in balance.sampled_powers(self.coefficients, setting)
        )
        zero, moves_base = np.zeros(count + 1), self.excited.drive.moves_base
        work = np.column_stack([dissipated, supplied, zero] if moves_base else [dissipated, zero, supplied])
        forces, loads = np.hstack([force, force[:, :1]]).T, u[BASE_SIZE:].T
        return Trajectory(
            model=body,
            time=instants,
            source=MotionSamples(instants, np.array([e, e_t]), forces, loads, work),
            steps=0,
            wall_seconds=time.perf_counter() - began,
            integrators=(IntegratorUse(0.0, "harmonic balance", self.errors.largest),),
        )

    def animate(
        self,
        path: str | Path,
        *others: PeriodicMotion,
        labels: Sequence[str] = (),
        slower: float | None = None,
        frame_rate: float = 25.0,
        beside: bool = False,
        points: Sequence[float] | None = None,
    ) -> None:
        """Write moving pictures of one period, for a player that repeats them, with the whole path of the points.

        ``Trajectory.animate`` explains the arguments; ``slower`` changes a little, so that a period has a whole number
        of pictures.

        Raises
        ------
        InputError
            As in ``Trajectory.animate``; or if a motion is not that of a beam.
        """
        motions = (self, *instances(others, "others", PeriodicMotion, minimum=0))
        runs = [motion.trajectory(max(PERIOD_SAMPLES, 4 * motion.harmonic_count)) for motion in motions]
        options = {"slower": slower, "frame_rate": frame_rate, "beside": beside, "points": points}
        content = runs[0]._make_drawing(MOVING, runs[1:], labels, path=check_file(path), periodic=True, **options)
        write_file(Path(path), content)

    def table(self) -> Table:
        """Return amplitude and phase of the tip, or of the first coordinate of another system, and the stability."""
        rows = [
            ("frequency", self.frequency, "Hz"),
            ("amplitude of the excitation", self.drive_amplitude, self.excited.drive.unit),
            ("amplitude", self.amplitude(), self.excited.unit),
            ("phase", self.phase(), "rad"),
            ("energy lost per period", self.dissipated_energy, "J"),
            ("largest Floquet multiplier", float(np.abs(self.multipliers).max()), ""),
            ("estimated relative error", self.errors.largest, ""),
        ]
        title = f"{'Stable' if self.stable else 'Unstable'} periodic motion, {plural(self.harmonic_count, 'harmonic')}"
        return Table("periodic_motion", title, ("quantity", "value", "unit"), rows)

    def to_dict(self) -> dict[str, Any]:
        """Return the motion as plain data, with the harmonics of the tip or of the first coordinate."""
        harmonics = self.harmonics()[: self.harmonic_count + 1]
        return {
            "kind": "periodic motion",
            "frequency_hz": self.frequency,
            "drive_amplitude": self.drive_amplitude,
            "drive_unit": self.excited.drive.unit,
            "amplitude": self.amplitude(),
            "phase_rad": self.phase(),
            "stable": self.stable,
            "harmonics": {"real": harmonics.real.tolist(), "imaginary": harmonics.imag.tolist()},
            "multipliers": {"real": self.multipliers.real.tolist(), "imaginary": self.multipliers.imag.tolist()},
            "coefficients": self.coefficients.tolist(),
            "dissipated_energy_j": self.dissipated_energy,
            "relative_error": self.errors.largest,
        }

    def _summary(self) -> str:
        size, unit = self.amplitude(), self.excited.unit
        amplitude = f"{1e3 * size:.4g} mm" if unit else f"{size:.4g}"
        state = "stable" if self.stable else "unstable"
        return f"{self.frequency:.6g} Hz, amplitude {amplitude}, {plural(self.harmonic_count, 'harmonic')}, {state}"


def _integral(power: Array, instants: Array) -> Array:
    """Return the integral, from the first instant, of a power at equally spaced samples of a period."""
    spectrum = np.fft.fft(power)
    angular_rates = 2j * np.pi * np.fft.fftfreq(len(power), instants[1])
    oscillating = np.fft.ifft(
        np.divide(spectrum, angular_rates, out=np.zeros_like(spectrum), where=angular_rates != 0.0)
    ).real
    return np.asarray(power.mean() * instants + np.append(oscillating, oscillating[0]) - oscillating[0])
