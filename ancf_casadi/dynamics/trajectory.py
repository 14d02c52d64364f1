"""Result of a simulation: positions, forces and energies.

Axial force and bending moment follow from the strains, N = E A eps and M = E I kappa, at the places where these are
accurate (``mechanics.model``).

The energy balance is

    T + U + V - (T + U + V at the start) = work of the base + work of the tip load - energy lost to damping,

with kinetic energy T, strain energy U, and the potential V = -Q_g.e of gravity.  Work and loss are integrated with the
motion.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.dynamics.dense_output import MotionSource
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model, curvature_at, neighbouring_axial_strains
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.state import State
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.files import check_file, write_file
from ancf_casadi.support.inputs import array, whole
from ancf_casadi.support.tables import Displayed, Reported, Table, plural

MOVING = "ancf_casadi.animation.motions.moving_pictures"  # function that draws motions by their labels


@dataclass(frozen=True)
class IntegratorUse(Displayed):
    """The integrator of a motion."""

    start: float  # time at which it began, s
    method: str  # ``radau`` or ``idas``
    tolerance: float


class Motion(Reported):
    """Base class of simulated motions of a beam."""

    _drawing = "ancf_casadi.figures.motions.motion_figure"

    model: Model
    time: Array
    coordinates: Array
    steps: int
    wall_seconds: float

    @property
    @abstractmethod
    def tip(self) -> Array:
        """Position of the tip, (k, 2), m."""

    @abstractmethod
    def state(self, index: int) -> State:
        """Return the state at a sample; a missing sample, or a law that relaxes, raises an ``InputError``."""

    @property
    @abstractmethod
    def _methods(self) -> tuple[str, ...]:
        """The integrators in words."""

    @property
    def _clamp(self) -> Array:
        """Position of the clamp, (k, 2), m."""
        return self.coordinates[:, :2]

    @property
    def swing(self) -> Array:
        """Position of the tip relative to the clamp, (k, 2), m."""
        return np.asarray(self.tip - self._clamp)

    @property
    def relative_coordinates(self) -> Array:
        """Nodal coordinates relative to the position of the clamp, (k, 4 n + 4)."""
        nodes = self.coordinates.reshape(len(self.time), -1, NODE).copy()
        nodes[:, :, :2] -= nodes[:, :1, :2]
        return nodes.reshape(self.coordinates.shape)

    def position(self, point: float) -> Array:
        """Return the position of a point at an arc length (m), (k, 2), m; one off the beam raises an ``InputError``."""
        return np.asarray(self.coordinates @ self.model.interpolation(point).T)

    def animate(
        self,
        path: str | Path,
        *others: Motion,
        labels: Sequence[str] = (),
        slower: float | None = None,
        frame_rate: float = 25.0,
        begin: float | None = None,
        end: float | None = None,
        beside: bool = False,
        points: Sequence[float] | None = None,
        markers: tuple[ArrayLike, ArrayLike] | None = None,
        background: Any = None,
    ) -> None:
        """Write moving pictures of the motion, true to scale, with supports, gravity, and traces of the last second.

        Parameters
        ----------
        path : str or Path
            File that ends in .gif, .mp4 (which needs ffmpeg) or .html (one page with a player, for notebooks too).
        *others : Motion
            Motions to draw over this one, each while it lasts.
        labels : sequence of str
            As in ``figure``.
        slower : float
            How many times slower the motion is shown; less than 1 is faster.  If not given, a period of its vibration
            has at least 12 pictures.  It stands above the pictures.
        frame_rate : float
            Pictures per second, 1 to 50, rounded to a whole number of hundredths of a second for each.
        begin, end : float
            First and last instant, s.
        beside : bool
            Whether to draw the motions beside each other instead.
        points : sequence of float
            Arc lengths of the points that leave traces, m; the tip if not given.
        markers : (array_like (k,), array_like (k, m, 2))
            Times, s, and measured positions of m points, m, as in ``MarkerRecord``; nan where one is missing.  Between
            two samples they are interpolated.
        background : Footage
            Pictures of a video to draw on.

        Raises
        ------
        InputError
            If the file cannot be written in this format, an argument cannot be used, or there would be more than 3000
            pictures.  No file is written then.
        """
        content = self._make_drawing(
            MOVING, others, labels, path=check_file(path), slower=slower, frame_rate=frame_rate, begin=begin, end=end,
            beside=beside, points=points, markers=markers, background=background,
        )  # fmt: skip
        write_file(Path(path), content)

    def table(self) -> Table:
        """Return the position of the tip at the start and at the end, and its travel relative to the clamp."""
        ends = [("start", self.tip[0]), ("end", self.tip[-1])] if len(self.time) else []
        # without the rounding errors of a beam that hangs straight
        rows = [(name, *(values.round(12) + 0.0).tolist()) for name, values in (*ends, ("travel", self._travel))]
        title = f"Motion of the tip, {self._length}; the travel is relative to the clamp"
        notes = (*self._methods, f"{plural(self.steps, 'step')} in {self.wall_seconds:.3g} s")
        return Table("motion", title, ("tip", "x_m", "y_m"), rows, notes)

    def to_dict(self) -> dict[str, Any]:
        """Return the positions of clamp and tip over time as plain data; ``pickle`` keeps the whole motion."""
        return {
            "time_s": self.time.tolist(),
            "tip_m": self.tip.tolist(),
            "clamp_m": self._clamp.tolist(),
            "tip_travel_m": self._travel.tolist(),
            "steps": self.steps,
            "seconds": self.wall_seconds,
        }

    @property
    def _travel(self) -> Array:
        """Range of the tip relative to the clamp in each direction, (2,), m."""
        return np.asarray(np.ptp(self.swing, axis=0)) if len(self.time) else np.zeros(2)  # a run may fail at once

    @property
    def _length(self) -> str:
        length = float(np.ptp(self.time)) if len(self.time) else 0.0
        return f"{length:.4g} s, {plural(len(self.time), 'sample')}"

    def _summary(self) -> str:
        how = ", ".join(text.split(" from ")[0] for text in self._methods)
        travel = f"tip travel {1e3 * self._travel.max():.4g} mm"
        return f"{self._length}, {plural(self.model.beam.elements, 'element')}, {travel}, {how}"


@dataclass(frozen=True, eq=False)
class Trajectory(Motion):
    """A simulated motion, read at the instants ``time``; what is read is computed then.

    Parameters
    ----------
    model : Model
        The beam.
    time : array (k,)
        Instants, s, from 0, or from the time of the state from which the motion continues.
    source : MotionSource
        The motion: the steps of the integrator (``dense_output``), or samples.
    steps : int
        Steps of the integrator.
    wall_seconds : float
        Computing time, s, including the construction of the integrator.
    integrators : tuple of IntegratorUse
        The integrator used.
    interrupted : bool
        True if Ctrl-C stopped the run before its end; the trajectory then holds the finished part.

    Examples
    --------
    >>> from ancf_casadi import Beam, HarmonicBase, Model, simulate
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> run = simulate(Model(beam), base=HarmonicBase(amplitude=5e-3, frequency=2.0), duration=0.2)
    >>> run.tip.shape  # at the instants run.time
    (201, 2)
    >>> middle, moment = run.position(0.25), run.bending_moment(0.0)
    >>> print(f"{1e3 * middle[-1, 0]:.1f} mm, {1e3 * moment[-1]:.1f} N mm")
    6.7 mm, 1.8 N mm
    >>> bool(abs(run.balance_error).max() < 1e-3 * run.kinetic_energy.max())
    True

    The steps are kept, so the motion can be read at other instants:

    >>> peak = run.at([0.1231, 0.1232])
    >>> peak.tip.shape
    (2, 2)
    """

    model: Model
    time: Array
    source: MotionSource
    steps: int
    wall_seconds: float
    integrators: tuple[IntegratorUse, ...]
    interrupted: bool = False

    def at(self, times: ArrayLike) -> Trajectory:
        """Return the same motion, read at other instants.

        Parameters
        ----------
        times : array_like (k,)
            Instants between the beginning and the end of the motion, s, in any order.

        Raises
        ------
        InputError
            If an instant is not a number within the motion, or is not a sample of a motion that has samples alone.
        """
        instants = np.atleast_1d(array(times, "times"))
        if instants.ndim != 1:
            raise InputError(f"must be one row of numbers, got an array of shape {instants.shape}", "times")
        self.source.check(instants)
        return replace(self, time=instants)

    @cached_property
    def coordinates(self) -> Array:  # type: ignore[override]
        """Nodal coordinates in the laboratory frame, as in ``State``, (k, 4 n + 4)."""
        return np.asarray(self.source.nodes(self.time)[0])

    @cached_property
    def velocities(self) -> Array:
        """Rates of the coordinates, (k, 4 n + 4), m/s and 1/s."""
        return np.asarray(self.source.nodes(self.time, 2)[1])

    @cached_property
    def clamp_force(self) -> Array:
        """Generalized force of the base on the clamped node, (k, 4): force, N, and that conjugate to the slope, N m."""
        self._check_history("force")
        return self.source.base_force(self.time)

    @cached_property
    def tip_load(self) -> Array:
        """Force, N, and moment, N m, of the load, (k, 3)."""
        return self.source.tip_load(self.time)

    @property
    def dissipated_energy(self) -> Array:
        """Energy lost to damping since the start, (k,), J; in a flow that drives the beam, it is negative.

        It includes energy that is stored in a material that relaxes, and will be dissipated or returned.
        """
        return self._energies[:, 0]

    @property
    def base_work(self) -> Array:
        """Work done by the base since the start, (k,), J."""
        return self._energies[:, 1]

    @property
    def load_work(self) -> Array:
        """Work done by the load since the start, (k,), J."""
        return self._energies[:, 2]

    @cached_property
    def tip(self) -> Array:
        """Position of the tip, (k, 2), m."""
        return self.position(self.model.beam.length)

    @cached_property
    def base(self) -> Array:
        """Position of the clamp, (k, 2), m."""
        row = np.zeros(self.model.size // 2)
        row[0] = 1.0
        return self.source.along(row, self.time)

    @property
    def _clamp(self) -> Array:
        return self.base

    @property
    def tip_force(self) -> Array:
        """Force at the tip in the laboratory frame, (k, 2), N."""
        return self.tip_load[:, :2]

    @property
    def tip_moment(self) -> Array:
        """Moment at the tip, (k,), N m, positive counterclockwise."""
        return self.tip_load[:, 2]

    @property
    def _methods(self) -> tuple[str, ...]:
        """The integrators with their start and tolerance."""
        return tuple(
            f"{use.method} from {use.start:.6g} s at tolerance {use.tolerance:.1e}" for use in self.integrators
        )

    def state(self, index: int) -> State:
        """Return the state at a sample; a missing sample, or a law that relaxes, raises an ``InputError``."""
        index = whole(index, "index", -len(self.time), len(self.time) - 1)
        self._check_history("state")
        (coordinates,), (velocities,) = self.source.nodes(self.time[[index]], 2)
        return State(coordinates, velocities, float(self.time[index]))

    def _check_history(self, quantity: str) -> None:
        if self.source.relaxes:
            raise InputError(
                f"relaxes, so the {quantity} depends on internal strains, which are not kept at samples", "damping"
            )

    def position(self, point: float) -> Array:
        """Return the position of a point at an arc length (m), (k, 2), m; one off the beam raises an ``InputError``."""
        return self._read(self.model.interpolation(point))

    def velocity(self, point: float) -> Array:
        """Return the velocity of a material point, (k, 2), m/s; arguments and errors are those of ``position``."""
        return self._read(self.model.interpolation(point), 1)

    def slope(self, point: float) -> Array:
        """Return the angle from the x axis to the beam at a point, (k,), rad, unwrapped; see ``position``."""
        x, y = self._read(self.model.slope_interpolation(point)).T
        return np.asarray(np.unwrap(np.arctan2(y, x)))

    def curvature(self, point: float) -> Array:
        """Return the curvature at a point, (k,), 1/m, positive counterclockwise; see ``position``."""
        return np.asarray(curvature_at(self.model, point, self._interpolate))

    def axial_force(self, point: float) -> Array:
        """Return the axial force at a point, (k,), N, tension positive; see ``position``."""
        (width, thickness, _, modulus), prestress = self.model.properties, np.array(self.model.beam.prestress or [0.0])
        readings = (
            neighbouring_axial_strains(self.model, point, at) for at in (self._interpolate, self._unstressed_place)
        )
        strains = [
            (weight, k, strain - natural_strain)
            for (weight, k, strain), (*_, natural_strain) in zip(*readings, strict=True)
        ]
        stresses = ((weight, k, modulus[k] * strain + prestress[k % prestress.size]) for weight, k, strain in strains)
        return np.asarray(sum(weight * (width * thickness)[k] * stress for weight, k, stress in stresses))

    def bending_moment(self, point: float) -> Array:
        """Return the bending moment at a point, (k,), N m, positive counterclockwise; see ``position``."""
        width, thickness, _, modulus = self.model.properties[:, self.model.element_at(point)]
        bent = self.curvature(point) - curvature_at(self.model, point, self._unstressed_place)
        return np.asarray(float(modulus * width * thickness**3 / 12) * bent)

    @cached_property
    def kinetic_energy(self) -> Array:
        """Kinetic energy T, (k,), J."""
        mass = self.model.mass(self.model.properties).sparse()
        return np.asarray((self.velocities * (self.velocities @ mass)).sum(axis=1) / 2)

    @cached_property
    def strain_energy(self) -> Array:
        """Strain energy U, (k,), J."""
        e = cs.MX.sym("e", self.model.size)
        energy = cs.Function("U", [e], [self.model.strain_energy(e, self.model.properties)])
        # samples whose energy is computed together, to limit memory
        chunks = np.array_split(self.coordinates, len(self.time) // 1000 + 1)
        return np.concatenate([np.empty(0), *(energy(chunk.T).full().ravel() for chunk in chunks if len(chunk))])

    @cached_property
    def potential_energy(self) -> Array:
        """Potential energy V of gravity, (k,), J; 0 at the origin."""
        force = self.model.gravity_force(self.model.properties, self.model.beam.gravity).full().ravel()
        return np.asarray(-self.coordinates @ force)

    @property
    def energy(self) -> Array:
        """Mechanical energy T + U + V, (k,), J."""
        return self.kinetic_energy + self.strain_energy + self.potential_energy

    @property
    def balance_error(self) -> Array:
        """Error of the energy balance since the first instant, (k,), J; 0 for an exact solution."""
        supplied = self.base_work + self.load_work - self.dissipated_energy
        return np.asarray((self.energy - self.energy[:1]) - (supplied - supplied[:1]))

    def tables(self) -> tuple[Table, ...]:
        """Return the table of the tip, and that of the energies."""
        if not len(self.time):
            return (self.table(),)
        energies = {
            "lost to damping": self.dissipated_energy,
            "work of the base": self.base_work,
            "work of the load": self.load_work,
            "error of the balance": np.abs(self.balance_error),
        }
        rows = [(name, float(values[np.abs(values).argmax()])) for name, values in energies.items() if values.any()]
        return self.table(), Table("energies", "Energies at their largest", ("energy", "J"), rows)

    def to_dict(self) -> dict[str, Any]:
        """Return clamp, tip and energies over time as plain data; ``pickle`` keeps the whole motion."""
        return {
            "kind": "motion",
            **super().to_dict(),
            "dissipated_energy_j": self.dissipated_energy.tolist(),
            "base_work_j": self.base_work.tolist(),
            "load_work_j": self.load_work.tolist(),
            "integrators": [
                {"start_s": use.start, "method": use.method, "tolerance": use.tolerance} for use in self.integrators
            ],
            "interrupted": self.interrupted,
        }

    def _unstressed_place(self, matrix: Array) -> tuple[float, float]:
        """Return x and y of a row of the interpolation, times the coordinates of the beam without stress."""
        x, y = (matrix @ self.model.straight).tolist()
        return x, y

    def _interpolate(self, matrix: Array) -> tuple[Array, Array]:
        """Return x and y, (k,), from an interpolation matrix."""
        x, y = self._read(matrix).T
        return x, y

    def _read(self, matrix: Array, order: int = 0) -> Array:
        """Return a vector (k, 2) from its interpolation matrix (2, size), or a time derivative of it."""
        return self.source.along(matrix[0, ::2], self.time, order)

    @cached_property
    def _energies(self) -> Array:
        """Energies lost to damping and supplied by base and load since the start, (k, 3), J."""
        return self.source.energies(self.time)
