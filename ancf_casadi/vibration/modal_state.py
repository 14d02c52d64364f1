"""The modes of a beam with varied properties, as fast as an optimiser needs them, and their exact derivatives.

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

First and second derivatives.  The equilibrium q and the eigenpairs (lambda, phi) depend on the properties p through

    R(q, p) = Q_e - Q_g = 0,    (K(q, p) - lambda M(p)) phi = 0,    phi^T M phi = 1,    K = dR/dq.

Along a change dp the equilibrium moves by K dq = -R_p dp.  With f = (K phi)_q dq + ((K - lambda M) phi)_p dp,

    dlambda = phi^T f,    (K - lambda M) dphi = -f + dlambda M phi,    phi^T M dphi = -1/2 (phi^T M phi)_p dp.

The derivative of one combination y = sum_k (b_k lambda_k + c_k^T phi_k) costs one solution per mode for any number of
properties.  Each mode k has multipliers a_k and beta_k, written here without the index,

    (K - lambda M) a = -c + beta M phi,    beta = phi^T c,    phi^T M a = b,

the equilibrium has the multiplier z with K z = -sum_k ((K phi_k)_q)^T a_k, and

    y_p = z^T R_p + sum_k (a_k^T ((K - lambda_k M) phi_k)_p - beta_k/2 (phi_k^T M phi_k)_p).

All matrices are banded, so the work grows linearly with the number of elements for each direction or combination.

The matrix K - lambda M is singular in the direction of the mode shape phi alone.  Rows and columns are scaled to give
K a unit diagonal.  If the unknown is held at zero in the coordinate in which phi, scaled likewise, is largest, the
system is regular and keeps its band (Nelson).

For second derivatives, the combination y has the Lagrangian

    L = y + z^T R + sum_k (a_k^T (K - lambda_k M) phi_k - beta_k/2 (phi_k^T M phi_k - 1)).

Let u = (q, p) and v = (phi, lambda), with the first derivatives u_p and v_p.  The second derivatives are

    y_pp = B + B^T + v_p^T L_vv v_p,    B = u_p^T (1/2 L_uu u_p + L_uv v_p),    u_p^T Y = Y_p - R_p^T K^-1 Y_q,

    v_p^T L_vv v_p = -sum_k (beta_k phi_p^T M phi_p + lambda_p^T (a_k^T M phi_p) + (a_k^T M phi_p)^T lambda_p),

in which Y_q and Y_p are the rows of any matrix Y that belong to q and to p, and phi and lambda those of mode k.  L is a
sum over the elements, so its Hessian is needed for one element and one mode only.  The work grows with the square
of the number of elements if each element has properties of its own.

References
----------
R. L. Fox, M. P. Kapoor, Rates of change of eigenvalues and eigenvectors, AIAA Journal 6 (1968).
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
from ancf_casadi.support.banded import BandedFactors, factorise, sparse
from ancf_casadi.vibration.assembly import BANDWIDTH, EqualElements, Position, Structure, per_element, scatter
from ancf_casadi.vibration.eigensolver import lowest_modes
from ancf_casadi.vibration.equilibrium import neighbouring_equilibrium
from ancf_casadi.vibration.modes import Modes

MIN_STEP = 1e-3  # relative to the whole change of the properties
DIRECTIONS_AT_ONCE = 128  # directions at once: few enough that the products of small matrices stay in the cache


def pencil_solver(pencil: Array, diagonal: Array, phi: Array) -> Callable[[Array], Array]:
    """Return a solver with K - lambda M, stored by diagonals, for right-hand sides as columns."""
    scale = 1 / np.sqrt(diagonal)
    size, fixed = len(scale), int(np.abs(phi / scale).argmax())
    rows = np.arange(size) - np.arange(BANDWIDTH, -BANDWIDTH - 1, -1)[:, None]
    in_matrix = (rows >= 0) & (rows < size)
    banded = np.where(in_matrix, pencil * scale * scale[np.clip(rows, 0, size - 1)], 0.0)
    banded[rows == fixed] = 0.0
    banded[:, fixed] = 0.0
    banded[BANDWIDTH, fixed] = 1.0
    factors = factorise(banded)

    def solve(right_side: Array) -> Array:
        right_side = np.multiply(scale[:, None], right_side, order="F")
        right_side[fixed] = 0.0
        return np.asarray(scale[:, None] * factors.solve(right_side))

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
        return factorise(self.structure.regular_stiffness(*self._matrices))

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
        """dR/dp of the elements of each group, (elements, d, k)."""
        return [
            (group, per_element(group.balance.linearisation, *self.inputs(group))[2]) for group in self.structure.groups
        ]

    @cached_property
    def pencil_jacobians(self) -> list[tuple[EqualElements, Array, Array, Array]]:
        """Outputs of ``ElementBalance.pencil_jacobians`` for each group, (m, elements, rows, columns)."""
        jacobians = []
        for group in self.structure.groups:
            shape = len(self.eigenvalues), len(group.coordinates)
            outputs = per_element(group.balance.pencil_jacobians, *self.inputs_of_modes(group))
            by_coordinate, by_property, norm_jacobian = (
                output.reshape(*shape, *output.shape[1:]) for output in outputs
            )
            jacobians.append((group, by_coordinate, by_property, norm_jacobian))
        return jacobians

    def inputs(self, group: EqualElements) -> tuple[Array, Array, Array]:
        """Return coordinates, properties and constants, one row per element."""
        return self.structure.inputs(group, self.at)

    def inputs_of_modes(self, group: EqualElements) -> tuple[Array, ...]:
        """Return coordinates, properties, constants, shapes and eigenvalues, one row per element, mode by mode."""
        m, elements = len(self.eigenvalues), len(group.coordinates)
        phi = self.shapes.T[:, group.coordinates].reshape(m * elements, -1)
        tiled = [np.tile(rows, (m, 1)) for rows in self.inputs(group)]
        return *tiled, phi, np.repeat(self.eigenvalues, elements)[:, None]

    @cached_property
    def _matrices(self) -> tuple[Array, Array]:
        """Stiffness and mass of the free coordinates by diagonals."""
        return self.structure.linearisation(self.at)[1:]


def modes_near(structure: Structure, start: Position, count: int) -> ModalState | None:
    """Return the equilibrium next to a position and its lowest modes; None if there is no stable one."""
    position = neighbouring_equilibrium(structure, start)
    solution = None if position is None else lowest_modes(structure, position, count)
    if position is None or solution is None:
        return None
    return ModalState(structure, position, np.arange(count), *solution)


def modal_state(modes: Modes, numbers: Index) -> ModalState:
    """Return the modes with the given numbers, from 0, of a beam under gravity alone, as a state to follow."""
    equilibrium, eigenvalues = modes.equilibrium, modes.angular_frequencies[numbers] ** 2
    return ModalState(equilibrium.structure, equilibrium.exact, numbers, eigenvalues, modes.shapes[:, numbers])


def follow(start: ModalState, properties: Array) -> ModalState:
    """Return the same modes of the beam with other properties; fail if there is no stable equilibrium on the way."""
    state, fraction, step = start, 0.0, 1.0
    while fraction < 1.0:
        target = min(1.0, fraction + step)
        trial = _follow_step(state, start.properties + target * (properties - start.properties), step <= MIN_STEP)
        if trial is None:
            step /= 2
            if step < MIN_STEP / 2:
                raise EquilibriumError(
                    f"the beam has no stable equilibrium beyond {fraction:.3g} of the change of its properties"
                )
            continue
        state, fraction = trial, target
        step *= 2
    return state


def _follow_step(state: ModalState, properties: Array, smallest: bool) -> ModalState | None:
    """Return the modes of a neighbouring state; None if there is none, or the step is ambiguous and not smallest."""
    model = state.model
    # additional modes computed above the highest one followed
    count = min(model.freedoms, int(state.numbers.max()) + 1 + 4)
    trial = modes_near(replace(state.structure, properties=properties), state.at, count)
    if trial is None:
        return None
    correlations = _correlations(state, trial)
    modes, targets = scipy.optimize.linear_sum_assignment(-(correlations**2))
    order = modes[np.argsort(targets)]
    # MAC above which the assignment is unique
    if not smallest and (correlations[order, np.arange(len(order))] ** 2).min() <= 0.5:
        return None
    signs = np.sign(correlations[order, np.arange(len(order))])  # each mode continues with its sign
    shapes = trial.shapes[:, order] * signs
    return replace(trial, numbers=trial.numbers[order], eigenvalues=trial.eigenvalues[order], shapes=shapes)


def _correlations(first: ModalState, second: ModalState) -> Array:
    """Return phi^T M phi_0 / (phi_0^T M phi_0)^(1/2), the signed root of the MAC, (modes of second, modes of first)."""
    shapes = first.model.of_free(first.shapes)
    inertia = second.inertia @ shapes
    return np.asarray(second.model.of_free(second.shapes).T @ inertia / np.sqrt(np.sum(shapes * inertia, axis=0)))


def coordinate_derivatives(state: ModalState, directions: Array) -> Array:
    """Return the derivatives of the coordinates at rest along N changes of the properties, (4 n + 4, N)."""
    model, force = state.model, np.zeros((state.model.size, directions.shape[1]))
    for group, force_jacobian in state.force_jacobians:
        force += scatter(group.coordinates, force_jacobian @ directions[group.properties], model.size)
    return np.asarray(model.with_fixed_base(-state.stiffness_factors.solve(model.of_free(force))))


def sensitivities(state: ModalState, directions: Array) -> tuple[Array, Array, Array]:
    """Return the derivatives of equilibrium and modes along N changes of the properties, (properties, N).

    They are those of the coordinates at rest (4 n + 4, N), of the squared angular frequencies (m, N), and of the
    mass-normalised mode shapes (m, 4 n + 4, N).
    """
    model, size, m, N = state.model, state.model.size, len(state.eigenvalues), directions.shape[1]
    coordinates = coordinate_derivatives(state, directions)
    f, half_norm = np.zeros((m, size, N)), np.zeros((m, N))
    for group, by_coordinate, by_property, norm_jacobian in state.pencil_jacobians:
        dq, dp = coordinates[group.coordinates], directions[group.properties]
        for k in range(m):
            f[k] += scatter(group.coordinates, by_coordinate[k] @ dq + by_property[k] @ dp, size)
            half_norm[k] += (norm_jacobian[k] @ dp).sum(axis=(0, 1))
    eigenvalues, shapes = np.zeros((m, N)), np.zeros((m, size, N))
    for k, phi in enumerate(model.of_free(state.shapes).T):
        inertia, free_force = state.inertia @ phi, model.of_free(f[k])
        eigenvalues[k] = phi @ free_force
        particular = state.pencil_solvers[k](np.outer(inertia, eigenvalues[k]) - free_force)
        shapes[k] = model.with_fixed_base(particular - np.outer(phi, inertia @ particular + half_norm[k]))
    return coordinates, eigenvalues, shapes


def gradient(state: ModalState, b: Array, c: Array) -> Array:
    """Return the derivatives, (properties, C), of C combinations with weights b (m, C) and c (m, 4 n + 4, C)."""
    a, beta, z = multipliers(state, b, c)
    total = np.zeros((state.properties.size, b.shape[1]))
    for (group, force_jacobian), (_, _, by_property, norm_jacobian) in zip(
        state.force_jacobians, state.pencil_jacobians, strict=True
    ):
        terms = force_jacobian.transpose(0, 2, 1) @ z[group.coordinates]
        for k in range(len(beta)):
            terms += by_property[k].transpose(0, 2, 1) @ a[k, group.coordinates]
            terms -= norm_jacobian[k].transpose(0, 2, 1) * beta[k]
        total += scatter(group.properties, terms, len(total))
    return total


def multipliers(state: ModalState, b: Array, c: Array) -> tuple[Array, Array, Array]:
    """Return a (m, 4 n + 4, C), beta (m, C) and z (4 n + 4, C) for combinations as in ``gradient``."""
    model = state.model
    a, beta, force = np.zeros_like(c), np.zeros_like(b), np.zeros(c.shape[1:])
    for k, phi in enumerate(model.of_free(state.shapes).T):
        inertia, free_weights = state.inertia @ phi, model.of_free(c[k])
        beta[k] = phi @ free_weights
        particular = state.pencil_solvers[k](np.outer(inertia, beta[k]) - free_weights)
        a[k] = model.with_fixed_base(particular + np.outer(phi, b[k] - inertia @ particular))
    for group, by_coordinate, _, _ in state.pencil_jacobians:
        for k, block in enumerate(by_coordinate):
            force += scatter(group.coordinates, block.transpose(0, 2, 1) @ a[k, group.coordinates], len(force))
    return a, beta, model.with_fixed_base(-state.stiffness_factors.solve(model.of_free(force)))


def hessian(state: ModalState, directions: Array, b: Array, c: Array) -> Array:
    """Return the second derivatives, (N, N), of one combination, b (m,) and c (m, 4 n + 4), along N directions."""
    of_free, N = state.model.of_free, directions.shape[1]
    transposed = scipy.sparse.csr_array(directions).T
    a, beta, z = multipliers(state, b[:, None], c[:, :, None])
    blocks = _lagrangian_hessians(state, a[:, :, 0], beta[:, 0], z[:, 0])
    half, normalisation = np.empty((N, N)), np.zeros((N, N))
    eigenvalues, projections = np.empty((2, len(beta), N))  # lambda_p and a^T M phi_p
    shapes: list[Array] = []
    for begin in range(0, N, DIRECTIONS_AT_ONCE):
        columns = slice(begin, begin + DIRECTIONS_AT_ONCE)
        derivatives = sensitivities(state, directions[:, columns])
        half[:, columns] = np.asarray(transposed @ _property_block(state, directions[:, columns], derivatives, blocks))
        eigenvalues[:, columns] = derivatives[1]
        free_shapes = np.array([of_free(shape) for shape in derivatives[2]])
        for k, shape in enumerate(free_shapes):
            projections[k, columns] = (state.inertia @ of_free(a[k, :, 0])) @ shape
        if beta.any():
            shapes.append(free_shapes)
    if shapes:
        for k, shape in enumerate(np.concatenate(shapes, axis=2)):
            normalisation -= beta[k] * shape.T @ (state.inertia @ shape)
    half -= eigenvalues.T @ projections
    return half + half.T + normalisation


def _lagrangian_hessians(state: ModalState, a: Array, beta: Array, z: Array) -> list[tuple[EqualElements, Array]]:
    """Return 1/2 L_uu and L_uv of the elements of each group side by side, (elements, d + k, d + k + m (d + 1))."""
    m, hessians = len(beta), []
    for group in state.structure.groups:
        elements, u_size = len(group.coordinates), sum(group.balance.sizes)
        (force_hessians,) = per_element(group.balance.force_hessian, *state.inputs(group), z[group.coordinates])
        inputs = a[:, group.coordinates].reshape(m * elements, -1), np.repeat(beta, elements)[:, None]
        (mode_hessians,) = per_element(group.balance.pencil_hessian, *state.inputs_of_modes(group), *inputs)
        mode_hessians = mode_hessians.reshape(m, elements, *mode_hessians.shape[1:])[:, :, :u_size]
        state_hessian = (force_hessians + mode_hessians[:, :, :, :u_size].sum(axis=0)) / 2
        hessians.append((group, np.concatenate([state_hessian, *mode_hessians[:, :, :, u_size:]], axis=2)))
    return hessians


def _property_block(
    state: ModalState,
    directions: Array,
    derivatives: tuple[Array, Array, Array],
    blocks: list[tuple[EqualElements, Array]],
) -> Array:
    """Return B, a row for each property and a column for each direction with its ``derivatives``."""
    model, N = state.model, directions.shape[1]
    coordinates, eigenvalues, shapes = derivatives
    by_coordinate, by_property = np.zeros_like(coordinates), np.zeros_like(directions)
    for group, block in blocks:
        d = group.balance.sizes[0]
        rows = [coordinates[group.coordinates], directions[group.properties]]
        for shape, eigenvalue in zip(shapes, eigenvalues, strict=True):
            rows += [shape[group.coordinates], np.broadcast_to(eigenvalue, (len(block), 1, N))]
        terms = block @ np.concatenate(rows, axis=1)
        by_coordinate += scatter(group.coordinates, terms[:, :d], len(by_coordinate))
        by_property += scatter(group.properties, terms[:, d:], len(by_property))
    z = model.with_fixed_base(-state.stiffness_factors.solve(model.of_free(by_coordinate)))
    for group, force_jacobian in state.force_jacobians:
        terms = force_jacobian.transpose(0, 2, 1) @ z[group.coordinates]
        by_property += scatter(group.properties, terms, len(by_property))
    return by_property
