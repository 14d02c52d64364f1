"""Forces, stiffness and mass of a structure as numbers, and products with the stiffness that keep their digits.

The balance of forces R = Q_e - Q_g and the pencil K - lambda M of a structure are sums over its elements, and so are
their derivatives.  The derivatives are therefore taken once for an element with coordinates e and properties p.

The entries of the stiffness K of n elements are of the size of n^4 times its lowest eigenvalues (relative to the mass).
Rounding the assembled K, or its factors, to u = 1e-16 therefore changes the low frequencies by up to n^4 u, relative to
their size: measured 1e-7 with 400 elements and 1e-6 with 1000; with 10 000 no digit is left.  Two measures help:

- A product K x is summed element by element as the derivative of the element's force along x, with the positions in x
  relative to the first node of the element.  These differences are exact, and the error in the strains is u x/l instead
  of u x/l^2.  The factors of K solve K x = b approximately; this product corrects them (iterative refinement).
- Rounding a position by u L strains an element by u n, and evaluating the strain of a steel beam to u = 1e-16 leaves a
  noise of 1e-10 N.  The balance R that remains at the rounded coordinates e gives their remainder, de = -K^-1 R.
  The remainder is too small to be added to e, but its effect on the stiffness is not: at the equilibrium the stiffness
  is K + (dK/de) de.

References
----------
N. J. Higham, Accuracy and Stability of Numerical Algorithms, SIAM (2002), Sections 4.3 and 12.1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import casadi as cs
import numpy as np
import scipy.sparse

from ancf_casadi.mechanics.element import Element
from ancf_casadi.mechanics.loads import Load, PointLoad
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.strain import gauss_pairs, hermite, hermite_slope, point_force
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.banded import sparse
from ancf_casadi.support.compilation import Buffered

BANDWIDTH = 2 * NODE - 1  # diagonals on either side of the main one
EPSILON = float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class ElementBalance:
    """The balance of forces and the mass of one element, and the Functions derived from them."""

    # (e, p, c) -> R (d,), the elastic force minus the weight, for coordinates e (d,), properties p (k,) and constants c
    force: cs.Function
    mass: cs.Function  # (p, c) -> mass matrix M (d, d)

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers d of coordinates and k of properties."""
        return self.force.size1_in(0), self.force.size1_in(1)

    @cached_property
    def linearisation(self) -> cs.Function:
        """(e, p, c) -> R, K = dR/de, dR/dp, M."""
        e, p, c = symbols = self._symbols()
        force = self.force(*symbols)
        return _function(
            "linearisation", symbols, [force, cs.jacobian(force, e), cs.jacobian(force, p), self.mass(p, c)]
        )

    @cached_property
    def stiffness_product(self) -> cs.Function:
        """(e, p, c, de, x) -> (K + (dK/de) de) x, the derivative of the force along x."""
        e, *_ = symbols = self._symbols()
        de, x = cs.SX.sym("de", self.sizes[0]), cs.SX.sym("x", self.sizes[0])
        derivative = cs.jtimes(self.force(*symbols), e, x)
        return _function("stiffness_product", [*symbols, de, x], [derivative + cs.jtimes(derivative, e, de)])

    @cached_property
    def pencil_jacobians(self) -> cs.Function:
        """(e, p, c, phi, lambda) -> d(K phi)/de, d((K - lambda M) phi)/dp, 1/2 d(phi^T M phi)/dp."""
        (e, p, *mode_symbols), pencil, norm = self._mode()
        jacobians = [cs.jacobian(pencil, e), cs.jacobian(pencil, p), cs.jacobian(norm, p)]
        return _function("pencil_jacobians", [e, p, *mode_symbols], jacobians)

    @cached_property
    def force_hessian(self) -> cs.Function:
        """(e, p, c, z) -> d2(z^T R)/d(e, p)2."""
        e, p, c = symbols = self._symbols()
        z = cs.SX.sym("z", self.sizes[0])
        hessian = cs.hessian(cs.dot(z, self.force(*symbols)), cs.vertcat(e, p))[0]
        return _function("force_hessian", [e, p, c, z], [hessian])

    @cached_property
    def pencil_hessian(self) -> cs.Function:
        """(e, p, c, phi, lambda, a, beta) -> d2(a^T (K - lambda M) phi - beta/2 phi^T M phi)/d(e, p, phi, lambda)2."""
        (e, p, c, phi, eigenvalue), pencil, norm = self._mode()
        a, beta = cs.SX.sym("a", self.sizes[0]), cs.SX.sym("beta")
        lagrangian = cs.dot(a, pencil) - beta * norm
        hessian = cs.hessian(lagrangian, cs.vertcat(e, p, phi, eigenvalue))[0]
        return _function("pencil_hessian", [e, p, c, phi, eigenvalue, a, beta], [hessian])

    def _symbols(self) -> list[cs.SX]:
        return [cs.SX.sym(name, self.force.size1_in(k)) for k, name in enumerate("epc")]

    def _mode(self) -> tuple[list[cs.SX], cs.SX, cs.SX]:
        """Symbols e, p, c, phi, lambda, and the expressions (K - lambda M) phi and 1/2 phi^T M phi."""
        e, p, c = symbols = self._symbols()
        phi, eigenvalue = cs.SX.sym("phi", self.sizes[0]), cs.SX.sym("lambda")
        inertia = self.mass(p, c) @ phi
        pencil = cs.jtimes(self.force(*symbols), e, phi) - eigenvalue * inertia
        return [*symbols, phi, eigenvalue], pencil, cs.dot(phi, inertia) / 2


@lru_cache(maxsize=32)
def element_balance(
    element: Element, shared: tuple[float, ...], constants: int, lumped: int, gravity: tuple[float, float]
) -> ElementBalance:
    """Return the balance of an element under gravity (m/s^2), with numbers of its constants and lumped properties."""
    coordinates = element.elastic_force.size1_in(0)
    properties = element.elastic_force.size1_in(1) - constants - len(shared)
    e, p, c = cs.SX.sym("e", coordinates), cs.SX.sym("p", properties), cs.SX.sym("c", constants)
    section, lumped_properties = cs.vertsplit(p, [0, properties - lumped, properties])
    parameters = cs.vertcat(section, *shared, c, lumped_properties)
    force = element.elastic_force(e, parameters) - element.gravity_force(parameters, gravity)
    return ElementBalance(
        cs.Function("force", [e, p, c], [force]), cs.Function("mass", [p, c], [element.mass(parameters)])
    )


@lru_cache(maxsize=2)
def load_balance(*, follower: bool) -> ElementBalance:
    """Return the balance of an element with c = (xi, l) under a load p = (Fx, Fy, m) at xi; m follows its slope."""
    e, load, c = cs.SX.sym("e", 2 * NODE), cs.SX.sym("load", 3), cs.SX.sym("c", 2)
    S, slope = (_interpolation(functions, *cs.vertsplit(c)) for functions in (hermite, hermite_slope))
    F, h = point_force(slope @ e, load, follower=follower)
    return _load_element_balance(e, load, c, S.T @ F + slope.T @ h)


@lru_cache(maxsize=2)
def line_balance(*, follower: bool) -> ElementBalance:
    """Return the balance of an element with c = (xi_1, xi_2, l) under a force per length p = (qx, qy) between them."""
    e, load, c = cs.SX.sym("e", 2 * NODE), cs.SX.sym("load", 2), cs.SX.sym("c", 3)
    begin, end, l = cs.vertsplit(c)
    force = cs.SX.zeros(2 * NODE)
    for abscissa, weight in gauss_pairs(4):  # approximate for a follower, whose direction is no polynomial
        xi = begin + abscissa * (end - begin)
        force_density, _ = point_force(_interpolation(hermite_slope, xi, l) @ e, cs.vertcat(load, 0), follower=follower)
        force += weight * (end - begin) * l * _interpolation(hermite, xi, l).T @ force_density
    return _load_element_balance(e, load, c, force)


def _interpolation(functions: Callable[[Any, Any], tuple[Any, ...]], xi: cs.SX, l: cs.SX) -> cs.SX:
    """Return S of Eq. (2), or S', (2, 8)."""
    return cs.SX(cs.kron(cs.vertcat(*functions(xi, l)).T, cs.SX.eye(2)))


def _load_element_balance(e: cs.SX, load: cs.SX, c: cs.SX, force: cs.SX) -> ElementBalance:
    mass = cs.Function("mass", [load, c], [cs.DM.zeros(2 * NODE, 2 * NODE)])
    return ElementBalance(cs.Function("force", [e, load, c], [-force]), mass)


def _function(name: str, inputs: list[cs.SX], outputs: list[cs.SX]) -> cs.Function:
    """Return a Function with dense outputs that evaluates common subexpressions once."""
    return cs.Function(name, inputs, [cs.densify(output) for output in outputs], {"cse": True})


@dataclass(frozen=True, eq=False)
class Position:
    """Nodal coordinates, and the remainder lost by rounding."""

    coordinates: Array  # the coordinates e, rounded, (size,)
    remainder: Array  # the remainder de, whose effect is taken into account to first order, (size,)

    @classmethod
    def of(cls, coordinates: Array) -> Position:
        """Return a position without a remainder."""
        return cls(coordinates, np.zeros_like(coordinates))


@dataclass(frozen=True, eq=False)
class EqualElements:
    """Equal elements of a structure, and the indices of their coordinates and properties."""

    model: Model  # the beam of the structure
    balance: ElementBalance  # forces and mass of one element
    coordinates: Index  # indices of the coordinates of each element in the structure, (elements, d)
    properties: Index  # indices of the properties of each element in the structure, (elements, k)
    constants: Array  # the constants of each element, (elements, c)

    @cached_property
    def bands(self) -> tuple[Index, Array | None]:
        """Indices of the entries of element matrices in the diagonals, and N_ik N_jl unless all are 0 or 1."""
        model, freedoms = self.model, self.model.freedoms
        free_numbers: Index = model.free_of[self.coordinates]
        weights: Array = model.weights[self.coordinates]
        rows, columns = free_numbers[:, :, None], free_numbers[:, None, :]
        band_indices = (BANDWIDTH + rows - columns) * freedoms + columns
        band_indices = np.where((rows < 0) | (columns < 0), (2 * BANDWIDTH + 1) * freedoms, band_indices)
        is_slanted = not np.isin(weights, (0.0, 1.0)).all()
        return band_indices, weights[:, :, None] * weights[:, None, :] if is_slanted else None


def structure_properties(model: Model) -> Array:
    """Return all properties: P row by row, then the lumped properties of the model, (4 n + lumped,)."""
    return np.concatenate([model.properties.ravel(), [*model.lumped.values()]])


@lru_cache(maxsize=32)
def _beam_groups(model: Model) -> tuple[EqualElements, ...]:
    """Return the element groups of a model, with the properties of ``structure_properties``."""
    indices = np.arange(model.properties.size).reshape(model.properties.shape)
    names, groups = [*model.lumped], []
    for group in model.groups:
        constants = group.constants.T
        # those of an element that is alone, a spring or mass, may change with the displacement of a support
        is_equal = group.count > 1 and (constants == constants[0]).all()
        shared = tuple(constants[0].tolist()) if is_equal else ()
        varying = constants[:, len(shared) :]
        sizes = varying.shape[1], len(group.lumped)
        balance = element_balance(group.element, shared, *sizes, model.beam.gravity)
        columns = indices[:, group.columns].T
        sections = columns.reshape(group.count, -1) if columns.size else np.empty((group.count, 0), dtype=np.int64)
        lumped = np.array([indices.size + names.index(name) for name in group.lumped], dtype=np.int64)
        properties = np.hstack([sections, np.tile(lumped, (group.count, 1))])
        groups.append(EqualElements(model, balance, group.coordinates, properties, varying))
    return tuple(groups)


def _elements_under(model: Model, load: Load) -> list[tuple[int, list[float]]]:
    """Return the elements under a load, each with the constants of its balance.

    They are the place of a point load in the element, or both ends of a line load, from 0 to 1, and its length, m.
    """
    beam = model.beam
    if isinstance(load, PointLoad):
        index, xi = model.place_at(load.place(beam))
        return [(index, [xi, float(beam.element_lengths[index])])]
    begin, end = load.places(beam)
    begins, ends = np.clip((np.array([[begin], [end]]) - beam.node_points[:-1]) / np.diff(beam.node_points), 0.0, 1.0)
    constants = np.column_stack([begins, ends, beam.element_lengths]).tolist()
    return [(k, constants[k]) for k in np.flatnonzero(ends > begins).tolist()]


@dataclass(frozen=True, eq=False)
class Structure:
    """A beam and its loads as groups of equal elements with properties."""

    model: Model  # the beam; ``properties`` override the properties of ``model.beam``
    groups: tuple[EqualElements, ...]
    properties: Array  # the properties of all groups, (properties,)

    @classmethod
    def of(cls, model: Model, loads: Sequence[Load] = ()) -> Structure:
        """Return a model with its own properties, under gravity and loads, whose values follow the properties."""
        beam_groups, properties = _beam_groups(model), structure_properties(model)
        rows: dict[ElementBalance, list[tuple[Index, Index, list[float]]]] = {}  # of the loads with the same balance
        for load in loads:
            balance_function = load_balance if isinstance(load, PointLoad) else line_balance
            elements = rows.setdefault(balance_function(follower=load.follower), [])
            load_indices = len(properties) + np.arange(len(load.values))
            for index, constants in _elements_under(model, load):
                elements.append((NODE * (index + model.root) + np.arange(2 * NODE), load_indices, constants))
            properties = np.concatenate([properties, load.values])
        loaded_elements = [
            EqualElements(model, balance, *map(np.array, zip(*elements, strict=True)))
            for balance, elements in rows.items()
        ]
        return cls(model, (*beam_groups, *loaded_elements), properties)

    def inputs(self, group: EqualElements, at: Position) -> tuple[Array, Array, Array]:
        """Return coordinates, with positions relative to the first node, properties and constants of each element."""
        return (
            relative_coordinates(at.coordinates[group.coordinates]),
            self.properties[group.properties],
            group.constants,
        )

    def linearisation(self, at: Position) -> tuple[Array, Array, Array]:
        """Return R, K and M of the free coordinates at the rounded coordinates; K and M are stored by diagonals."""
        size, N, bands = self.model.size, self.model.freedoms, 2 * BANDWIDTH + 1
        force, stiffness, mass = np.zeros((size, 1)), np.zeros((bands * N + 1, 1)), np.zeros((bands * N + 1, 1))
        for group in self.groups:
            forces, stiffnesses, _, masses = per_element(group.balance.linearisation, *self.inputs(group, at))
            band_indices, products = group.bands
            force += scatter(group.coordinates, forces, size)
            stiffness += scatter(
                band_indices, stiffnesses if products is None else products * stiffnesses, bands * N + 1
            )
            mass += scatter(band_indices, masses if products is None else products * masses, bands * N + 1)
        return self.model.of_free(force)[:, 0], stiffness[:-1].reshape(bands, N), mass[:-1].reshape(bands, N)

    def regular_stiffness(self, stiffness: Array, mass: Array) -> Array:
        """Return K by diagonals, shifted if the supports do not hold the beam, so that it has an inverse."""
        return stiffness if self.model.is_held else stiffness + eigenvalue_shift(self.model, stiffness, mass) * mass

    def stiffness_product(self, at: Position) -> Callable[[Array], Array]:
        """Return x -> K x for the free coordinates, summed element by element."""
        product = self.whole_product(at)
        return lambda x: product(self.model.with_fixed_base(x))

    def whole_product(self, at: Position) -> Callable[[Array], Array]:
        """Return x -> N^T K x for a change of all coordinates, summed element by element."""
        model, size = self.model, self.model.size
        evaluations = []
        for group in self.groups:
            x = np.zeros(group.coordinates.shape)
            inputs = *self.inputs(group, at), relative_coordinates(at.remainder[group.coordinates]), x
            evaluations.append((group.coordinates, x, bound_per_element(group.balance.stiffness_product, *inputs)))

        def product(change: Array) -> Array:
            force = np.zeros((size, 1))
            for coordinates, x, evaluate in evaluations:
                x[:] = relative_coordinates(change[coordinates])
                force += scatter(coordinates, evaluate()[0], size)
            return model.of_free(force)[:, 0]

        return product


def eigenvalue_shift(model: Model, stiffness: Array, mass: Array) -> float:
    """Return the shift a of the pencil K + a M (``eigensolver``), stored by diagonals, (rad/s)^2."""
    translation, positions = (model.of_free(np.resize(row, model.size)) for row in ([1.0, 0, 0, 0], [1.0, 1.0, 0, 0]))
    total_mass = translation @ (sparse(mass) @ translation)
    if not total_mass:  # supports hold the positions of all nodes
        return 0.0
    return float(10.0 * EPSILON * (stiffness[BANDWIDTH] @ (positions != 0.0)) / total_mass)  # c in the shift a


def relative_coordinates(rows: Array) -> Array:
    """Return coordinates of elements, (elements, d), with positions relative to the first node of each."""
    pairs = rows.reshape(len(rows), -1, 2).copy()
    pairs[:, ::2] -= pairs[:, :1].copy()
    return pairs.reshape(rows.shape)


def per_element(function: cs.Function, *inputs: Array) -> list[Array]:
    """Call a Function for each element, with one row of each input; return its outputs, (elements, rows, columns)."""
    return bound_per_element(function, *inputs)()


def bound_per_element(function: cs.Function, *inputs: Array) -> Callable[[], list[Array]]:
    """Return ``per_element`` as a function without arguments, which reads the input arrays (C order) at each call."""
    count, sizes = len(inputs[0]), [function.size1_out(k) for k in range(function.n_out())]
    evaluate = Buffered(_map_over_elements(function, count), *(np.ascontiguousarray(values) for values in inputs))

    def call() -> list[Array]:
        outputs = zip(evaluate(), sizes, strict=True)
        return [output.reshape(count, -1, size).transpose(0, 2, 1) for output, size in outputs]

    return call


@lru_cache(maxsize=64)
def _map_over_elements(function: cs.Function, count: int) -> cs.Function:
    return function.map(count)


def scatter(indices: Index, values: Array, size: int) -> Array:
    """Return the sums at each index, (size, C), of values (elements, ..., C) with indices (elements, ...)."""
    count, columns = indices.size, values.size // indices.size
    if columns == 1:
        return np.asarray(np.bincount(indices.ravel(), values.ravel(), size)[:, None], dtype=np.float64)
    incidence = scipy.sparse.csc_array((np.ones(count), indices.ravel(), np.arange(count + 1)), shape=(size, count))
    return np.asarray(incidence @ values.reshape(count, columns))


def solve_refined(solve: Callable[[Array], Array], product: Callable[[Array], Array], right_side: Array) -> Array:
    """Solve A x = b by iterative refinement to rounding, with an approximate inverse of A and exact products A x."""
    x = solve(right_side)
    last_size = float(np.linalg.norm(x))
    for _ in range(12):  # most refinements of one solution
        change = solve(right_side - product(x))
        size = float(np.linalg.norm(change))
        if not size < last_size:
            break
        x = x + change
        if size**2 <= EPSILON * last_size * float(np.linalg.norm(x)):
            break
        last_size = size
    return x
