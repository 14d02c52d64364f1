"""Natural frequencies and mode shapes of small motion about a static equilibrium.

With the tangent stiffness K at the equilibrium (gravity and tip loads included) and the mass matrix M, both of the
free coordinates, the modes satisfy

    K phi = omega^2 M phi,        Phi^T M Phi = I,               Eq. (30).

``ancf_casadi.vibration.eigensolver`` computes them.

References
----------
"Comparison of external damping models in a large deformation problem", Section 4.3.
Allemang 2003, "The modal assurance criterion: twenty years of use and abuse" (MAC).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import NoneType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.exceptions import EquilibriumError, InputError
from ancf_casadi.mechanics.mesh_limits import SHORT_ELEMENTS_ADVICE, warn_of_overbent_elements
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.state import State
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.banded import factorise
from ancf_casadi.support.files import check_file, write_file
from ancf_casadi.support.inputs import array, check_instance, number, numbers, whole
from ancf_casadi.support.interrupts import lasting_interrupts
from ancf_casadi.support.tables import Reported, Table, plural, spread
from ancf_casadi.vibration.assembly import Position
from ancf_casadi.vibration.eigensolver import eigenvalue_rounding, lowest_modes
from ancf_casadi.vibration.equilibrium import Equilibrium
from ancf_casadi.vibration.statics import static_equilibrium

STATIONS = 101  # points along the beam at which shapes are given
MAX_FREQUENCY_RATIO = 4.0  # ratio of measured and computed frequencies that no modulus within a factor of ten explains


@dataclass(frozen=True)
class Modes(Reported):
    """The lowest modes about an equilibrium, in ascending order.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equilibrium about which the beam vibrates.
    frequencies : array (m,)
        Natural frequencies, Hz.
    shapes : array (4 n + 4, m)
        Mass-normalised mode shapes Phi in all nodal coordinates, zero where the beam is held.  The larger component of
        the displacement of the tip, or of the reference point if the tip is held, is positive.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, natural_modes
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> modes = natural_modes(Model(beam), count=3)
    >>> modes.count, modes.shapes.shape
    (3, (20, 3))
    >>> modes.frequencies.round(2)
    array([ 1.88, 10.59, 29.47])
    """

    _drawing = "ancf_casadi.figures.modes.modes_figure"

    equilibrium: Equilibrium
    frequencies: Array
    shapes: Array

    @property
    def model(self) -> Model:
        """The model of the beam."""
        return self.equilibrium.model

    @property
    def count(self) -> int:
        """Number of modes m."""
        return len(self.frequencies)

    @property
    def angular_frequencies(self) -> Array:
        """Natural frequencies omega, rad/s."""
        return 2 * np.pi * self.frequencies

    @cached_property
    def reference_points(self) -> tuple[float, ...]:
        """Arc length of the point of each mode to which amplitudes refer, m: the tip, or, if it is held, another node.

        The other node is the one that moves most, the one nearest to the middle if several do.
        """
        return _reference_points(self.model, self.shapes)

    def tip_amplitudes(self) -> Array:
        """Return the magnitude of each mass-normalised mode shape at its reference point, (m,), kg^-1/2."""
        return np.asarray(np.linalg.norm(_reference_displacements(self.model, self.shapes), axis=0))

    def modal_coordinate(self, coordinates: Array, mode: int) -> Array:
        """Return the modal coordinate of one mode in a given motion, scaled to the displacement of the tip, (...,), m.

        The projection phi^T M (e - e_rest) excludes all other modes of small motion.

        Parameters
        ----------
        coordinates : array (..., 4 n + 4)
            Nodal coordinates, relative to the clamp at the origin.
        mode : int
            Mode number, from 0.

        Raises
        ------
        InputError
            If the coordinates do not fit the model, or there is no such mode.

        Examples
        --------
        >>> from ancf_casadi import Beam, Model, natural_modes, static_equilibrium
        >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
        ...                     density=8000.0, elastic_modulus=210e9, elements=4)
        >>> modes = natural_modes(Model(beam), count=3)
        >>> pulled = static_equilibrium(modes.model, tip_force=(1e-4, 0.0))
        >>> [f"{1e3 * modes.modal_coordinate(pulled.coordinates, k):.2f} mm" for k in range(3)]
        ['0.29 mm', '0.01 mm', '0.00 mm']
        """
        mode, coordinates = whole(mode, "mode", 0, self.count - 1), array(coordinates, "coordinates")
        if coordinates.shape[-1:] != (self.model.size,):
            raise InputError(f"must have {self.model.size} columns, got {coordinates.shape}", "coordinates")
        mass = self.model.mass(self.model.properties).sparse()
        projector = mass @ self.shapes[:, mode] * self.tip_amplitudes()[mode]
        return np.asarray((coordinates - self.equilibrium.coordinates) @ projector)

    def state(self, mode: int, amplitude: float) -> State:
        """Return the beam at rest in the shape of one mode at a large amplitude, without stretching it.

        A multiple of the mode shape itself would stretch the beam, and set off axial vibrations.  The state is the
        shape of least energy in which the mode has this amplitude and the others of these modes have none.

        Parameters
        ----------
        mode : int
            Mode number, from 1.
        amplitude : float
            Displacement of the reference point (``reference_points``) from the equilibrium, m; negative for the other
            side.

        Raises
        ------
        InputError
            If there is no such mode, it is a rigid motion, or the amplitude is not a number.
        EquilibriumError
            If the beam cannot be bent so far.

        Examples
        --------
        >>> from ancf_casadi import Beam, Model, natural_modes, simulate
        >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
        ...                     density=8000.0, elastic_modulus=210e9, elements=4)
        >>> modes = natural_modes(Model(beam), count=2)
        >>> run = simulate(modes.model, start=modes.state(1, 0.2), duration=0.1)
        >>> print(f"{1e3 * run.tip[0, 0]:.0f} mm")
        194 mm
        """
        k, amplitude = whole(mode, "mode", 1, self.count) - 1, number(amplitude, "amplitude")
        if self.frequencies[k] == 0.0:
            raise InputError(f"mode {mode} is a rigid motion, which bends nothing", "mode")
        coordinates = self._bend_to_amplitude(k, amplitude)
        warn_of_overbent_elements(self.model, coordinates)
        return State(coordinates, np.zeros(self.model.size))

    def _bend_to_amplitude(self, k: int, amplitude: float) -> Array:
        """Return the coordinates of ``state``, for a mode from 0."""
        equilibrium, target = self.equilibrium.coordinates, abs(amplitude)
        interpolation, length = self.model.interpolation(self.reference_points[k]), self.model.beam.length
        modal, step = np.zeros(self.count), math.copysign(target / float(self.tip_amplitudes()[k]), amplitude)
        coordinates, reached = equilibrium, 0.0
        for _ in range(100):
            if abs(target - reached) <= 1e-9 * length:
                return coordinates
            trial = self._minimise_energy(coordinates, modal + step * (np.arange(self.count) == k))
            if trial is None:
                step /= 2
                continue
            modal[k] += step
            displacement = float(np.linalg.norm(interpolation @ (trial - equilibrium)))
            rate = step / (displacement - reached) if displacement != reached else math.nan
            coordinates, reached, step = trial, displacement, rate * (target - displacement)
        raise EquilibriumError(
            f"mode {k + 1} cannot displace the beam by {target:g} m at {self.reference_points[k]:g} m, only by "
            f"{reached:.3g} m; give a smaller amplitude"
        )

    def _minimise_energy(self, start: Array, modal: Array) -> Array | None:
        """Return the coordinates of least energy with modal coordinates (m,), by Newton's method from a start.

        They satisfy R = M Phi mu and Phi^T M (e - e_rest) = modal.  None if the method fails.
        """
        model, structure = self.model, self.equilibrium.structure
        reference, coordinates = self.equilibrium.coordinates, start
        modal_inertia = model.of_free(model.mass(model.properties).sparse() @ self.shapes)
        for _ in range(12):
            balance, stiffness, _ = structure.linearisation(Position.of(coordinates))
            try:
                solutions = factorise(stiffness).solve(np.column_stack([balance, modal_inertia]))
                mismatch = modal - modal_inertia.T @ (model.of_free(coordinates - reference) - solutions[:, 0])
                change = model.with_fixed_base(
                    solutions[:, 1:] @ np.linalg.solve(modal_inertia.T @ solutions[:, 1:], mismatch) - solutions[:, 0]
                )
            except np.linalg.LinAlgError:
                return None
            coordinates = coordinates + change
            rotation = np.abs((coordinates - start) / model.scale).reshape(-1, NODE)[:, 2:].max()
            if not rotation < 1.0:  # 0.5 rad
                return None
            if float(np.abs(change / model.scale).max()) < 1e-10:
                return np.asarray(coordinates)
        return None

    def along(self, points: ArrayLike) -> Array:
        """Return the displacement (x, y) of each mode at arc lengths (k,), m, as (m, k, 2); that of the tip is 1."""
        rows = np.stack([self.model.interpolation(s) @ self.shapes for s in numbers(points, "points")])
        return np.asarray(np.moveaxis(rows, 2, 0) / self.tip_amplitudes()[:, None, None])

    def animate(
        self,
        path: str | Path,
        *others: Modes,
        labels: Sequence[str] = (),
        modes: Sequence[int] | None = None,
        frame_rate: float = 25.0,
    ) -> None:
        """Write moving pictures of mode shapes beside each other, exaggerated: a period of each in two seconds.

        Parameters
        ----------
        path, frame_rate
            As in ``Trajectory.animate``.
        *others : Modes
            Modes to draw over these, also of another beam.
        labels : sequence of str
            As in ``figure``.
        modes : sequence of int
            Numbers of the modes, from 1; the first six, or as many as there are, if not given.

        Raises
        ------
        InputError
            As in ``Trajectory.animate``; or if there is no such mode.
        """
        options = {"path": check_file(path), "modes": modes, "frame_rate": frame_rate}
        write_file(
            Path(path), self._make_drawing("ancf_casadi.animation.motions.moving_modes", others, labels, **options)
        )

    def table(self) -> Table:
        """Return the natural frequencies."""
        x, y = self.equilibrium.tip.tolist()
        rows = list(enumerate(self.frequencies.tolist(), start=1))
        return Table("modes", "Natural modes", ("mode", "f_Hz"), rows, (f"the tip rests at ({x:.6g}, {y:.6g}) m",))

    def to_dict(self) -> dict[str, Any]:
        """Return frequencies and shapes as plain data; the displacement of the tip is 1 in each shape."""
        arc = np.linspace(0.0, self.model.beam.length, STATIONS)
        return {
            "kind": "modes",
            "frequencies_hz": self.frequencies.tolist(),
            "equilibrium_tip_m": self.equilibrium.tip.tolist(),
            "arc_length_m": arc.tolist(),
            "shapes": self.along(arc).tolist(),
        }

    def _summary(self) -> str:
        return f"{plural(self.count, 'mode')}, {spread(self.frequencies, 'Hz')}"


@lasting_interrupts()
def natural_modes(model: Model, *, count: int = 5, equilibrium: Equilibrium | None = None) -> Modes:
    """Return the lowest modes about an equilibrium.

    Parameters
    ----------
    model : Model
        The beam.
    count : int
        Number of modes, 1 to 4 n (4 n + 4 with an elastic clamp).
    equilibrium : Equilibrium, optional
        The equilibrium; by default under gravity alone.

    Raises
    ------
    InputError
        If ``count`` is not a whole number in this range, the equilibrium belongs to another model, or supports hold
        all nodes.
    EquilibriumError
        If the equilibrium is unstable, or none is found.

    Warns
    -----
    UserWarning
        If rounding limits the frequencies.

    Examples
    --------
    The frequencies of a strip that hangs, and of the same strip standing:

    >>> from ancf_casadi import Beam, Model, natural_modes
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> natural_modes(Model(beam), count=3).frequencies.round(2)
    array([ 1.88, 10.59, 29.47])
    >>> natural_modes(Model(beam.with_(axis=(0.0, 1.0))), count=3).frequencies.round(2)
    array([ 1.4 , 10.18, 29.07])
    """
    check_instance(model, "model", Model)
    check_instance(equilibrium, "equilibrium", Equilibrium, NoneType)
    count = whole(count, "count", 1, model.freedoms)
    if not model.of_free(np.resize([1.0, 1.0, 0.0, 0.0], model.size)).any():  # x and y of all nodes
        raise InputError(
            "hold every node, so no mode moves one; use more elements, so that nodes lie between the supports",
            "supports",
        )
    if equilibrium is None:
        equilibrium = static_equilibrium(model)
    if equilibrium.model != model:
        raise InputError("belongs to another model", "equilibrium")
    solution = lowest_modes(equilibrium.structure, equilibrium.exact, count)
    if solution is None:
        raise EquilibriumError(
            "the equilibrium is unstable, so it has no modes; a standing beam may be too slender for its weight"
            + (f", and {SHORT_ELEMENTS_ADVICE}" if model.has_short_elements else "")
        )
    eigenvalues, shapes = solution
    # an eigenvalue at this limit is wrong by up to a tenth of a percent
    limited = np.count_nonzero(eigenvalues < 10 * eigenvalue_rounding(model)) if model.is_held else 0
    if limited:
        warnings.warn(
            f"rounding limits the frequencies up to mode {limited}: the beam is so slender that rounding errors "
            "of its axial stiffness hide its bending stiffness; check thickness and length",
            stacklevel=4,
        )
    displacements = _reference_displacements(model, shapes)
    larger = np.abs(displacements).argmax(axis=0)
    shapes *= np.where(displacements[larger, np.arange(count)] < 0, -1.0, 1.0)
    return Modes(equilibrium, np.sqrt(eigenvalues) / (2 * np.pi), shapes)


def _reference_points(model: Model, shapes: Array) -> tuple[float, ...]:
    """Return the arc lengths of the points to which the amplitudes of mode shapes (4 n + 4, m) refer, m."""
    beam = model.beam
    if not beam.tip_is_held:
        return (beam.length,) * int(shapes.shape[1])
    points = []
    for phi in shapes.T:
        displacements = np.linalg.norm(phi.reshape(-1, NODE)[model.root :, :2], axis=1)
        candidates = beam.node_points[displacements > (1 - 1e-9) * displacements.max()]
        points.append(float(candidates[np.abs(candidates - beam.length / 2).argmin()]))
    return tuple(points)


def _reference_displacements(model: Model, shapes: Array) -> Array:
    """Return the displacements of the reference points in mode shapes (4 n + 4, m), (2, m)."""
    points = _reference_points(model, shapes)
    interpolations = {s: model.interpolation(s) for s in points}
    return np.column_stack([interpolations[s] @ phi for s, phi in zip(points, shapes.T, strict=True)])


def mac(first: Array, second: Array) -> Array:
    """Return the modal assurance criterion (MAC) of two sets of shapes, (a.b)^2 / (a.a b.b), (m1, m2).

    The values are from 0 (orthogonal) to 1 (the same shape).

    Parameters
    ----------
    first, second : array (k, m1), (k, m2)
        Shapes as columns, in the same coordinates and the same unit.

    Raises
    ------
    InputError
        If the shapes are not finite real numbers in columns of equal length, or one is zero everywhere.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, mac, natural_modes
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> modes = natural_modes(Model(beam), count=2)
    >>> heavy = natural_modes(Model(beam.with_(tip_mass=5e-3)), count=2)
    >>> mac(modes.shapes, heavy.shapes).round(2)
    array([[1.  , 0.24],
           [0.47, 0.94]])
    """
    first, second = array(first, "first"), array(second, "second")
    if first.ndim != 2 or second.ndim != 2 or len(first) != len(second):
        raise InputError(f"must be columns as long as the first, got {second.shape} for {first.shape}", "second")
    for name, shapes in (("first", first), ("second", second)):
        if not shapes.any(axis=0).all():
            raise InputError("has a shape that is zero everywhere, which has no MAC", name)
    first, second = (shapes / np.abs(shapes).max(axis=0) for shapes in (first, second))
    cross = (first.T @ second) ** 2
    return np.asarray(cross / np.outer((first**2).sum(axis=0), (second**2).sum(axis=0)))


def unit_warning(measured: Array, computed: Array) -> str:
    """Return a warning if measured frequencies are all far above or below those of a model, as in another unit."""
    ratios = measured / np.maximum(computed, np.finfo(float).tiny)
    if 1 / MAX_FREQUENCY_RATIO < ratios.max() and ratios.min() < MAX_FREQUENCY_RATIO:
        return ""
    pairs = (", ".join(f"{f:.4g}" for f in frequencies[:3]) for frequencies in (measured, computed))
    return (
        "the measured frequencies are {} Hz, where the model has {} Hz: give them in Hz, or correct the model".format(
            *pairs
        )
    )


def rigid_modes(model: Model) -> int:
    """Return the number of modes of a beam that are rigid motions, with frequency 0: none to three."""
    if model.is_held:
        return 0
    return int(np.count_nonzero(natural_modes(model, count=min(3, model.freedoms)).frequencies == 0.0))
