"""Damped modes: complex eigenvalues of small motion about an equilibrium, and the load at which it becomes unstable.

With the tangent stiffness K at the equilibrium, follower loads included, the damping matrix D of the law and of the
dashpots at rest, and the mass matrix M, all of the free coordinates, small motion is a sum of terms phi exp(s t) with

    P(s) phi = 0,    P(s) = K + s D + s^2 M,    D = dQ_damp/de_t.

Each pair s = -zeta w +- i w (1 - zeta^2)^(1/2) is one mode, with the damped frequency |Im s|/2 pi and the damping ratio
zeta = -Re s/|s|; a real s is a mode that does not oscillate.  With v = s phi, the eigenvalues s next to a shift sigma
are those of largest 1/(s - sigma) of the operator

    (f_1, f_2) -> (q, v),    P(sigma) q = -M f_2 - (D + sigma M) f_1,    v = f_1 + sigma q.

With the banded factors of P(sigma) they follow from the matrix of the operator or, if it is large, by Arnoldi's method.

A law that relaxes adds r(s) V to P(s), where r(s) = sum_b g_b tau_b s/(1 + tau_b s), and V = J^T D J is the material
part of the tangent stiffness (``damping.viscoelastic``).  The modes follow from those without the branches by nonlinear
inverse iteration with a fixed vector n,

    P(s) y = P'(s) phi,    s <- s - (n . phi)/(n . y),    phi <- y/(n . y),

while the moduli g_b grow from 0 in steps.  Modes in which the branches relax without oscillation are left out.

An equilibrium is unstable if some s has a positive real part: by divergence if it is real, as in buckling, by flutter
if not, as under follower loads.

References
----------
F. Tisseur, K. Meerbergen, The quadratic eigenvalue problem, SIAM Review 43 (2001).
V. V. Bolotin, Nonconservative Problems of the Theory of Elastic Stability, Pergamon (1963).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import NoneType
from typing import Any, Literal

import casadi as cs
import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg

from ancf_casadi.damping import DampingLaw, RayleighDamping
from ancf_casadi.damping.law import refuse_branches
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.placed_load import LOAD_SIZE
from ancf_casadi.exceptions import EquilibriumError, InputError
from ancf_casadi.mechanics.loads import LineLoad, Load, PointLoad
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array, ComplexArray
from ancf_casadi.support.banded import BandedFactors, sparse
from ancf_casadi.support.inputs import check_instance, instances, positive, whole
from ancf_casadi.support.interrupts import lasting_interrupts
from ancf_casadi.support.last_calls import keep_last
from ancf_casadi.support.tables import Displayed, Reported, Table, plural
from ancf_casadi.vibration.assembly import BANDWIDTH, eigenvalue_shift
from ancf_casadi.vibration.eigensolver import eigenvalue_rounding
from ancf_casadi.vibration.equilibrium import Equilibrium
from ancf_casadi.vibration.statics import primary_equilibrium, static_equilibrium

DENSE = 800  # size of the operator up to which all its eigenvalues are computed
MODULUS_STEPS = 10  # in which the moduli of Maxwell branches grow from 0, so that each mode can be followed
MOST_ITERATIONS = 30  # of the inverse iteration in each of these steps
CONVERGED = 1e-6  # relative change of the eigenvalue in the last iteration; the error is about the square of this
GROWING = 1e-7  # real part of a growing mode, relative to |s|; rounding leaves 1e-12, or 1e-6 where two modes meet
# relative difference of two factors below which an equilibrium is the mean of those at both, as
# test_a_column_buckles_under_eulers_load_in_any_direction needs
NARROW = 4e-4


@dataclass(frozen=True)
class DampedModes(Reported):
    """The damped modes about an equilibrium that are next to rest, in ascending order of the size of s.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equilibrium about which the beam vibrates.
    eigenvalues : array (m,)
        Complex eigenvalues s with imaginary parts of 0 or more, 1/s.
    shapes : array (4 n + 4, m)
        Complex mode shapes phi in all nodal coordinates, of unit length.

    Examples
    --------
    >>> from ancf_casadi import Beam, Dashpot, Model, damped_modes
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9,
    ...                     elements=8, attachments=[Dashpot(0.5, (2e-3, 0.0))])
    >>> modes = damped_modes(Model(beam), count=2)
    >>> modes.frequencies.round(2), modes.damping_ratios.round(3), modes.is_stable
    (array([ 1.88, 10.58]), array([0.034, 0.006]), True)
    """

    _drawing = "ancf_casadi.figures.modes.damped_modes_figure"

    equilibrium: Equilibrium
    eigenvalues: ComplexArray
    shapes: ComplexArray

    @property
    def count(self) -> int:
        """Number of modes m."""
        return len(self.eigenvalues)

    @property
    def frequencies(self) -> Array:
        """Damped frequencies, Hz; 0 for modes that do not oscillate."""
        return np.asarray(self.eigenvalues.imag / (2 * np.pi))

    @property
    def damping_ratios(self) -> Array:
        """Damping ratios; negative for modes that grow."""
        size = np.abs(self.eigenvalues)
        return np.asarray(-self.eigenvalues.real / np.where(size > 0.0, size, 1.0))

    @property
    def is_stable(self) -> bool:
        """Stability: True if no mode grows, as far as rounding tells."""
        return _growth(self) <= 0.0

    def table(self) -> Table:
        """Return damped frequencies, damping ratios and eigenvalues."""
        numbers = zip(self.frequencies, self.damping_ratios, self.eigenvalues.real, self.eigenvalues.imag, strict=True)
        rows = [(k, *map(float, row)) for k, row in enumerate(numbers, start=1)]
        columns = ("mode", "f_Hz", "damping_ratio", "real_1/s", "imaginary_rad/s")
        return Table("damped_modes", "Damped modes", columns, rows)

    def to_dict(self) -> dict[str, Any]:
        """Return frequencies, damping ratios and eigenvalues as plain data."""
        return {
            "kind": "damped modes",
            "frequencies_hz": self.frequencies.tolist(),
            "damping_ratios": self.damping_ratios.tolist(),
            "eigenvalues": [[float(s.real), float(s.imag)] for s in self.eigenvalues],
            "stable": self.is_stable,
        }

    def _summary(self) -> str:
        return f"{plural(self.count, 'mode')}, {'stable' if self.is_stable else 'unstable'}"


@lasting_interrupts()
def damped_modes(
    model: Model, damping: DampingLaw | None = None, *, count: int = 5, equilibrium: Equilibrium | None = None
) -> DampedModes:
    """Return the damped modes about an equilibrium, those next to rest.

    Parameters
    ----------
    model : Model
        The beam.
    damping : DampingLaw, optional
        The damping law, as it is for vanishing motion; none if not given.  Dashpots of the beam act too.
    count : int
        Number of modes; at most half the number of free coordinates.
    equilibrium : Equilibrium, optional
        The equilibrium, under any loads, stable or not; by default under gravity and the flow of the law.

    Raises
    ------
    InputError
        If ``count`` is not a whole number in this range, the equilibrium belongs to another model, or it is unstable
        under a law that relaxes.
    EquilibriumError
        If no equilibrium is found, or its modes are not.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, Pin, RayleighDamping, damped_modes
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9,
    ...                     elements=8, supports=[Pin(0.0), Pin(0.5)], gravity=(0.0, 0.0))
    >>> damped_modes(Model(beam), RayleighDamping(alpha=0.5), count=2).damping_ratios.round(4)
    array([0.0086, 0.0021])
    """
    check_instance(model, "model", Model)
    check_instance(damping, "damping", DampingLaw, NoneType)
    check_instance(equilibrium, "equilibrium", Equilibrium, NoneType)
    count = whole(count, "count", 1, model.freedoms // 2)
    law = RayleighDamping() if damping is None else damping
    equilibrium_at_rest = static_equilibrium(model, loads=law.loads(model.beam)) if equilibrium is None else equilibrium
    if equilibrium_at_rest.model != model:
        raise InputError("belongs to another model", "equilibrium")
    inverse, sigma = _inverse(equilibrium_at_rest, law)
    eigenvalues, vectors = _largest(inverse, 2 * model.freedoms, 2 * count + 2)
    s = sigma + 1 / eigenvalues
    still = np.abs(s) ** 2 <= 10 * eigenvalue_rounding(model)
    s = np.where(still, 0.0, np.where(np.abs(s.imag) <= 1e-9 * np.abs(s), s.real, s))
    upper = np.concatenate([np.flatnonzero(still)[::2], np.flatnonzero(~still & (s.imag >= 0.0))])
    order = upper[np.argsort(np.abs(s[upper]), kind="stable")][:count]
    s, shapes = s[order], vectors[: model.freedoms, order]
    if law.branch_values[0].size:
        s, shapes = _relaxing_modes(equilibrium_at_rest, law, s, shapes)
    return DampedModes(equilibrium_at_rest, s, model.with_fixed_base(shapes))


def _relaxing_modes(
    equilibrium: Equilibrium, law: DampingLaw, eigenvalues: ComplexArray, shapes: ComplexArray
) -> tuple[ComplexArray, ComplexArray]:
    """Return the modes under a law that relaxes, from those without its branches, in place; rigid modes stay."""
    if not equilibrium.stable:
        raise InputError(
            "is unstable: under a law that relaxes, the beam creeps away from it without oscillating", "equilibrium"
        )
    model, (_, stiffness, mass) = equilibrium.model, equilibrium.structure.linearisation(equilibrium.exact)
    _, *matrices = damping_at_rest(model, law)(equilibrium.coordinates)
    D, d, V = (matrix.sparse() for matrix in matrices)
    B, M = model.of_free(law.projection(model)), sparse(mass)
    low_rank = B * d.toarray().ravel()  # the damping is D + B diag(d) B'
    damping, material_stiffness = banded(D, stiffness), banded(V, stiffness)
    storage = np.zeros((3 * BANDWIDTH + 1, len(shapes)), dtype=complex, order="F")  # first rows: fill-in of the factors
    for k in np.flatnonzero(eigenvalues):
        s, x = complex(eigenvalues[k]), shapes[:, k]
        normal = x.conj()
        for modulus in np.linspace(0.0, 1.0, MODULUS_STEPS + 1)[1:].tolist():
            for _ in range(MOST_ITERATIONS):
                nearby = s * (1 + 1e-6)
                r, r_nearby = modulus * law.relaxation([s, nearby])
                storage[BANDWIDTH:] = stiffness + r * material_stiffness + s * damping + s**2 * mass
                r_derivative = (r_nearby - r) / (nearby - s)
                right_side = D @ x + low_rank @ (B.T @ x) + 2 * s * (M @ x) + r_derivative * (V @ x)
                y = BandedFactors.of(storage.copy(order="F"), BANDWIDTH, s * low_rank, B).solve(right_side)
                x, step = y / (normal @ y), (normal @ x) / (normal @ y)
                s -= complex(step)
                if abs(step) <= CONVERGED * abs(s):
                    break
            else:
                raise EquilibriumError(
                    f"the iteration for mode {k + 1} does not converge; branches with smaller moduli may help"
                )
        eigenvalues[k], shapes[:, k] = s, x / np.linalg.norm(x)
    return eigenvalues, shapes


@dataclass(frozen=True)
class CriticalLoad(Displayed):
    """The load at which an equilibrium becomes unstable.

    Parameters
    ----------
    factor : float
        Factor on the given loads.
    kind : {"divergence", "flutter"}
        Divergence if the growing mode does not oscillate, flutter if it does.
    modes : DampedModes
        The damped modes just beyond.

    Examples
    --------
    A column under a force that follows its tip flutters at 20.05 E I/L^2 (Beck):

    >>> from ancf_casadi import Beam, Model, PointLoad, critical_load
    >>> column = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9,
    ...                       elements=8, axis=(1.0, 0.0), gravity=(0.0, 0.0))
    >>> unit = 210e9 * column.sections[0].second_moment / column.length**2
    >>> found = critical_load(Model(column), [PointLoad((-unit, 0.0), follower=True)], largest_factor=30.0)
    >>> print(f"{found.kind} at {found.factor:.2f}")
    flutter at 20.06
    """

    factor: float
    kind: Literal["divergence", "flutter"]
    modes: DampedModes


@lasting_interrupts()
def critical_load(
    model: Model,
    loads: Sequence[Load],
    damping: DampingLaw | None = None,
    *,
    largest_factor: float = 1.0,
    steps: int = 50,
) -> CriticalLoad | None:
    """Return the smallest factor on some loads at which the equilibrium under them and gravity is unstable.

    Supports, gravity and the flow of the law act first.  The factor then grows from 0 in equal steps, and is narrowed
    down to about seven digits; None if all are stable.

    Parameters
    ----------
    model : Model
        The beam.
    loads : sequence of PointLoad or LineLoad
        The loads, which grow together.
    damping : DampingLaw, optional
        The damping law; none if not given.
    largest_factor : float
        Largest factor.
    steps : int
        Number of equal steps up to it.

    Raises
    ------
    InputError
        If an argument is not of its kind.
    EquilibriumError
        If there is no equilibrium under a factor on the way.

    Examples
    --------
    A column buckles under pi^2 E I/(4 L^2):

    >>> import math
    >>> from ancf_casadi import Beam, Model, PointLoad, critical_load
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9,
    ...                     elements=8, axis=(1.0, 0.0), gravity=(0.0, 0.0))
    >>> euler = math.pi**2 * 210e9 * 5e-3 * 0.5e-3**3 / 12 / (4 * 0.5**2)
    >>> found = critical_load(Model(beam), [PointLoad((-euler, 0.0))], largest_factor=2.0)
    >>> print(f"{found.factor:.4f}, {found.kind}")
    1.0000, divergence
    """
    check_instance(model, "model", Model)
    check_instance(damping, "damping", DampingLaw, NoneType)
    refuse_branches(RayleighDamping() if damping is None else damping)
    acting = instances(loads, "loads", PointLoad, LineLoad)
    largest, steps = positive(largest_factor, "largest_factor"), whole(steps, "steps", 1)
    flow = () if damping is None else damping.loads(model.beam)

    def loads_at(factor: float) -> list[Load]:
        return [*flow, *(load.scaled(factor) for load in acting)]

    def modes_about(equilibrium: Equilibrium) -> DampedModes:
        return damped_modes(model, damping, count=min(4, model.freedoms // 2), equilibrium=equilibrium)

    def equilibrium_near(factor: float, start: Equilibrium) -> tuple[float, Equilibrium]:
        """Return a factor, a little smaller if it is too close to the critical one, and the equilibrium there."""
        try:
            return factor, primary_equilibrium(model, loads_at(factor), start)
        except EquilibriumError:
            factor *= 1 - NARROW / 4
            return factor, primary_equilibrium(model, loads_at(factor), start)

    stable, last_stable = 0.0, primary_equilibrium(model, flow)
    for step_end in np.linspace(0.0, largest, steps + 1).tolist():
        unstable, equilibrium = equilibrium_near(step_end, last_stable)
        modes = modes_about(equilibrium)
        if not modes.is_stable:
            break
        stable, last_stable = unstable, equilibrium
    else:
        return None
    while unstable - stable > 1e-9 * unstable:
        middle = (stable + unstable) / 2
        if unstable - stable > NARROW * unstable:
            middle, between = equilibrium_near(middle, last_stable)
        else:
            coordinates = (last_stable.coordinates + modes.equilibrium.coordinates) / 2
            between = Equilibrium(model, coordinates, loads=tuple(loads_at(middle)))
        modes_between = modes_about(between)
        if modes_between.is_stable:
            stable, last_stable = middle, between
        else:
            unstable, modes = middle, modes_between
    growing = modes.eigenvalues[modes.eigenvalues.real.argmax()]
    return CriticalLoad(unstable, "flutter" if growing.imag else "divergence", modes)


def _growth(modes: DampedModes) -> float:
    """Return the largest real part beyond what rounding leaves, relative to the size of the eigenvalues, 1/s."""
    s = modes.eigenvalues
    return float((s.real - GROWING * np.abs(s)).max())


def _largest(inverse: Callable[[Array], Array], size: int, count: int) -> tuple[ComplexArray, ComplexArray]:
    """Return the largest eigenvalues of an operator, at least ``count``, and eigenvectors as columns."""
    if size <= DENSE or count > size - 2:
        values, vectors = scipy.linalg.eig(inverse(np.eye(size)))
        order = np.argsort(-np.abs(values))
        return values[order], vectors[:, order]
    operator = scipy.sparse.linalg.LinearOperator((size, size), matvec=lambda f: inverse(f.ravel()), dtype=float)
    start = inverse(np.random.default_rng(0).standard_normal(size))
    try:
        values, vectors = scipy.sparse.linalg.eigs(operator, count, v0=start, ncv=min(6 * count, size))
    except scipy.sparse.linalg.ArpackError as error:
        raise EquilibriumError(f"the damped modes were not found ({error}); ask for fewer modes") from None
    return values, vectors


def banded(matrix: scipy.sparse.csc_array, like: Array) -> Array:
    """Return a sparse matrix in the same band storage as another matrix."""
    entries, storage = matrix.tocoo(), np.zeros_like(like)
    np.add.at(storage, (BANDWIDTH + entries.row - entries.col, entries.col), entries.data)
    return storage


@keep_last(8)
def damping_at_rest(model: Model, law: DampingLaw) -> cs.Function:
    """(e) -> D at rest without its low-rank part, of all and of the free coordinates, d of the low-rank part, and V.

    V, of the free coordinates, has no entries if the law does not relax.
    """
    equations, e = Equations(model, law), cs.MX.sym("e", model.size)
    terms = equations.balance(cs.MX(cs.DM(equations.parameters)))
    relaxed, V = None, cs.MX(model.freedoms, model.freedoms)
    if equations.branches:
        relaxed = cs.MX.zeros(*equations.internal_shape)
        V = model.free_matrix(terms.strain_products(e))
    _, entries, _ = terms.tangents(e, cs.MX.zeros(model.size), cs.MX.zeros(LOAD_SIZE), relaxed)
    matrices = [model.matrix(entries), model.free_matrix(entries)]
    return cs.Function("damping_at_rest", [e], [*matrices, cs.densify(terms.modal_coefficients), V])


def _inverse(equilibrium: Equilibrium, law: DampingLaw) -> tuple[Callable[[Array], Array], float]:
    """Return the operator whose eigenvalues are 1/(s - sigma), of vectors or columns, and sigma, 1/s."""
    model = equilibrium.model
    _, stiffness, mass = equilibrium.structure.linearisation(equilibrium.exact)
    _, resistance, d, _ = damping_at_rest(model, law)(equilibrium.coordinates)
    local, B = scipy.sparse.csc_array(resistance.sparse()), model.of_free(law.projection(model))
    coefficients = d.full().ravel()
    beam, M, N = model.beam, sparse(mass).tocsr(), model.freedoms
    bending = float(beam.bending_stiffness.mean()) / (beam.mass * beam.length**3)  # about (w_1/3.5)^2 of a cantilever
    sigma = math.sqrt(max(eigenvalue_shift(model, stiffness, mass), bending))

    def damping_force(x: Array) -> Array:
        return np.asarray(local @ x + (B * coefficients) @ (B.T @ x))

    storage = np.zeros((3 * BANDWIDTH + 1, N), order="F")
    storage[BANDWIDTH:] = stiffness + sigma * banded(local, stiffness) + sigma**2 * mass
    factors = BandedFactors.of(storage, BANDWIDTH, sigma * B * coefficients, B)

    def solve(f: Array) -> Array:
        first, second = np.split(f, 2)
        q = factors.solve(-(M @ second) - damping_force(first) - sigma * (M @ first))
        return np.concatenate([q, first + sigma * q])

    return solve, sigma
