"""The modes of a beam with varied properties, as fast as an optimiser needs them, and their linearisation.

``natural_modes`` follows the equilibrium from the straight beam.  Here Newton's method starts from a neighbouring
equilibrium, and the properties are numerical inputs of Functions that are derived once.  Newton's method and the
eigenvalue solver are the same in both cases (``ancf_casadi.vibration.equilibrium`` and ``.eigensolver``).

Over a small change of the properties a mode keeps its shape, by which it is followed, not by its order.
Shapes are compared by the modal assurance criterion, weighted with the mass matrix,

    MAC = (phi^T M phi_0)^2 / (phi_0^T M phi_0),                    phi^T M phi = 1.

For one shape phi_0 the values of all modes phi add up to at most 1, so at most one mode exceeds one half.  If no mode
does, or the equilibrium moves too far, the change is divided into smaller steps.  Uncoupled modes, such as bending and
axial modes, cross without changing shape.  Coupled modes veer away from the crossing; there, in the smallest step, the
assignment with the largest sum of MAC values decides.

The derivatives of a mode need solutions with the matrix K - lambda M, which is singular in the direction of the mode
shape phi alone.  Rows and columns are scaled to give K a unit diagonal.  If the unknown is held at zero in the
coordinate in which phi, scaled likewise, is largest, the system is regular and keeps its band (Nelson).

References
----------
R. B. Nelson, Simplified calculation of eigenvector derivatives, AIAA Journal 14 (1976).
Allemang 2003, "The modal assurance criterion: twenty years of use and abuse" (MAC).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy  # its packages are imported on first use
import scipy.sparse

from ancf_casadi.exceptions import EquilibriumError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.banded import BandedFactors, factorised, sparse
from ancf_casadi.vibration.assembly import BANDWIDTH, EqualElements, Position, Structure, per_element
from ancf_casadi.vibration.eigensolver import lowest_modes, shift_of
from ancf_casadi.vibration.equilibrium import neighbour
from ancf_casadi.vibration.modes import Modes

SMALLEST_STEP = 1e-3  # relative to the whole change of the properties


def pencil_solver(pencil: Array, diagonal: Array, phi: Array) -> Callable[[Array], Array]:
    """Return a solver with K - lambda M, stored by diagonals, for right-hand sides as columns."""
    scale = 1 / np.sqrt(diagonal)
    size, held = len(scale), int(np.abs(phi / scale).argmax())
    rows = np.arange(size) - np.arange(BANDWIDTH, -BANDWIDTH - 1, -1)[:, None]
    inside = (rows >= 0) & (rows < size)
    banded = np.where(inside, pencil * scale * scale[np.clip(rows, 0, size - 1)], 0.0)
    banded[rows == held] = 0.0
    banded[:, held] = 0.0
    banded[BANDWIDTH, held] = 1.0
    factors = factorised(banded)

    def solve(right: Array) -> Array:
        right = np.multiply(scale[:, None], right, order="F")
        right[held] = 0.0
        return np.asarray(scale[:, None] * factors.solve(right))

    return solve


@dataclass(frozen=True, eq=False)
class ModalState:
    """An equilibrium and some of its modes, with the matrices that their derivatives need."""

    structure: Structure
    at: Position
    numbers: Index  # numbers of the modes in ascending order of frequency, from 0, (m,)
    eigenvalues: Array  # squared angular frequencies, (rad/s)^2, (m,)
    shapes: Array  # mass-normalised mode shapes, (4 n + 4, m)

    @property
    def model(self) -> Model:
        """The beam; ``properties`` override the properties of ``model.beam``."""
        return self.structure.model

    @property
    def properties(self) -> Array:
        """The properties, in the order of ``structure_properties``."""
        return self.structure.properties

    @property
    def coordinates(self) -> Array:
        """Nodal coordinates at rest, (4 n + 4,)."""
        return self.at.coordinates

    @property
    def frequencies(self) -> Array:
        """Natural frequencies, Hz."""
        return np.asarray(np.sqrt(self.eigenvalues) / (2 * np.pi))

    @cached_property
    def inertia(self) -> scipy.sparse.csr_array:
        """Mass matrix M of the free coordinates, sparse."""
        return sparse(self._matrices[1]).tocsr()

    @cached_property
    def stiffness_factors(self) -> BandedFactors:
        """Factors of the stiffness K of the free coordinates, shifted as for the modes if the beam is not held."""
        stiffness, mass = self._matrices
        shift = 0.0 if self.model.is_held else shift_of(self.model, stiffness, mass)
        return factorised(stiffness + shift * mass if shift else stiffness)

    @cached_property
    def pencil_solvers(self) -> list[Callable[[Array], Array]]:
        """The solver with K - lambda M of each mode."""
        stiffness, mass = self._matrices
        return [
            pencil_solver(stiffness - eigenvalue * mass, stiffness[BANDWIDTH], phi)
            for eigenvalue, phi in zip(self.eigenvalues, self.model.of_free(self.shapes).T, strict=True)
        ]

    @cached_property
    def force_jacobians(self) -> list[tuple[EqualElements, Array]]:
        """dR/dp of the elements of each part, (elements, d, k)."""
        return [(part, per_element(part.balance.linearisation, *self.inputs(part))[2]) for part in self.structure.parts]

    @cached_property
    def pencil_jacobians(self) -> list[tuple[EqualElements, Array, Array, Array]]:
        """Outputs of ``ElementBalance.pencil_jacobians`` for each part, (m, elements, rows, columns)."""
        found = []
        for part in self.structure.parts:
            shape = len(self.eigenvalues), len(part.coordinates)
            outputs = per_element(part.balance.pencil_jacobians, *self.inputs_of_modes(part))
            by_coordinate, by_property, of_norm = (output.reshape(*shape, *output.shape[1:]) for output in outputs)
            found.append((part, by_coordinate, by_property, of_norm))
        return found

    def inputs(self, part: EqualElements) -> tuple[Array, Array, Array]:
        """Return coordinates, properties and constants, one row per element."""
        return self.structure.inputs(part, self.at)

    def inputs_of_modes(self, part: EqualElements) -> tuple[Array, ...]:
        """Return coordinates, properties, constants, shapes and eigenvalues, one row per element, mode by mode."""
        m, elements = len(self.eigenvalues), len(part.coordinates)
        phi = self.shapes.T[:, part.coordinates].reshape(m * elements, -1)
        tiled = [np.tile(rows, (m, 1)) for rows in self.inputs(part)]
        return *tiled, phi, np.repeat(self.eigenvalues, elements)[:, None]

    @cached_property
    def _matrices(self) -> tuple[Array, Array]:
        """Stiffness and mass of the free coordinates by diagonals."""
        return self.structure.linearisation(self.at)[1:]


def modes_near(structure: Structure, near: Position, count: int) -> ModalState | None:
    """Return the equilibrium next to a position and its lowest modes; None if there is no stable one."""
    at = neighbour(structure, near)
    found = None if at is None else lowest_modes(structure, at, count)
    if at is None or found is None:
        return None
    return ModalState(structure, at, np.arange(count), *found)


def followed_modes(modes: Modes, numbers: Index) -> ModalState:
    """Return the modes with the given numbers, from 0, of a beam under gravity alone, as a state to follow."""
    rest, eigenvalues = modes.equilibrium, modes.angular_frequencies[numbers] ** 2
    return ModalState(rest.structure, rest.exact, numbers, eigenvalues, modes.shapes[:, numbers])


def follow(start: ModalState, properties: Array) -> ModalState:
    """Return the same modes of the beam with other properties; fail if there is no stable equilibrium on the way."""
    here, position, step = start, 0.0, 1.0
    while position < 1.0:
        there = min(1.0, position + step)
        trial = _step(here, start.properties + there * (properties - start.properties), step <= SMALLEST_STEP)
        if trial is None:
            step /= 2
            if step < SMALLEST_STEP / 2:
                raise EquilibriumError(
                    f"the beam has no stable equilibrium beyond {position:.3g} of the change of its properties"
                )
            continue
        here, position = trial, there
        step *= 2
    return here


def _step(here: ModalState, properties: Array, smallest: bool) -> ModalState | None:
    """Return the modes of a neighbouring state; None if there is none, or the step is ambiguous and not smallest."""
    model = here.model
    # additional modes computed above the highest one followed
    count = min(model.freedoms, int(here.numbers.max()) + 1 + 4)
    state = modes_near(replace(here.structure, properties=properties), here.at, count)
    if state is None:
        return None
    correlations = _correlations(here, state)
    modes, targets = scipy.optimize.linear_sum_assignment(-(correlations**2))
    order = modes[np.argsort(targets)]
    # MAC above which the assignment is unique
    if not smallest and (correlations[order, np.arange(len(order))] ** 2).min() <= 0.5:
        return None
    signs = np.sign(correlations[order, np.arange(len(order))])  # each mode continues with its sign
    numbers, eigenvalues, shapes = state.numbers[order], state.eigenvalues[order], state.shapes[:, order] * signs
    return replace(state, numbers=numbers, eigenvalues=eigenvalues, shapes=shapes)


def _correlations(before: ModalState, after: ModalState) -> Array:
    """Return phi^T M phi_0 / (phi_0^T M phi_0)^(1/2), the signed root of the MAC, (modes after, modes before)."""
    shapes = before.model.of_free(before.shapes)
    inertia = after.inertia @ shapes
    return np.asarray(after.model.of_free(after.shapes).T @ inertia / np.sqrt(np.sum(shapes * inertia, axis=0)))
