"""Frequency matching: the beam nearest to a given one whose natural frequencies are the measured ones, Tables 9 and 10.

Unknowns are factors m on the beam's properties: width and thickness of each element, density, elastic modulus, each
within 1 - bounds to 1 + bounds.  The equilibrium q and the eigenpairs (lambda_k, phi_k) are unknowns too, and the
equations that define them constraints,

    minimise    1/2 |m - 1|^2 + 1/2 (1/w) sum_k (f_k/target_k - 1)^2,             f_k = lambda_k^(1/2)/(2 pi),
    subject to  Q_e(q, m) - Q_g(m) = 0,    K(q, m) phi_k - lambda_k M(m) phi_k = 0,    phi_k^T M(m) phi_k = 1,

so that every function is algebraic and every derivative exact.  More unknowns than frequencies leave a family of
answers; the small weight w makes the least change of the beam the preference that picks one of them.

The problem is partially separable: of the unknowns X, element i sees only x_i = A_i X + a_i, its coordinates,
properties, mode shapes and the eigenvalues, and it adds c(x_i) to the constraints.  One element's c, its Jacobian and
the Hessian of y.c are derived once and mapped over the elements,

    g(X) = sum_i B_i c(x_i),    dg/dX = sum_i B_i (dc/dx) A_i,    d2(y.g)/dX2 = sum_i A_i^T (d2(B_i^T y.c)/dx2) A_i.

Unknowns and constraints are scaled by diag(K)^-1/2, which takes the axial stiffness, 5e10 times the bending stiffness,
out of the conditioning; without it IPOPT does not converge.

References
----------
"Comparison of external damping models in a large deformation problem", Section 5.1.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from ancf_casadi.beam import PROPERTIES, Beam
from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.inputs import number, positive
from ancf_casadi.model import NODE, Model
from ancf_casadi.modes import Modes, natural_modes
from ancf_casadi.nlp import solve_nlp

Array = NDArray[np.float64]

WEIGHT = 1e-8  # w: what a relative frequency error of 1e-4 costs, a change of 1 in one factor costs too
ELEMENT = 2 * NODE  # coordinates of an element
SAME = 1e-7  # relative difference between the frequencies of the program and those computed afresh
AT_BOUND = 1e-6  # of the width of the bounds
OPTIONS = {
    "ipopt.tol": 1e-9,
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.max_iter": 200,
    "ipopt.mu_strategy": "adaptive",
    "ipopt.nlp_scaling_method": "none",  # the problem is scaled here; IPOPT's would loosen the tolerance by 1/WEIGHT
}


@dataclass(frozen=True)
class FrequencyMatch:
    """A beam matched to measured natural frequencies.

    Parameters
    ----------
    beam : Beam
        The matched beam.
    targets, standard, frequencies : tuple of float
        Measured frequencies, those of the given beam, and those of the matched beam, Hz.
    at_bound : tuple of str
        Properties at a bound, with their element from 1, such as ``thickness[3]``.
    iterations : int
        Iterations of IPOPT.
    build_seconds, solve_seconds : float
        Time to state the problem, and to solve it, s.
    """

    beam: Beam
    targets: tuple[float, ...]
    standard: tuple[float, ...]
    frequencies: tuple[float, ...]
    at_bound: tuple[str, ...]
    iterations: int
    build_seconds: float
    solve_seconds: float

    @property
    def max_relative_error(self) -> float:
        """Largest relative difference between matched and measured frequencies."""
        return float(np.abs(np.array(self.frequencies) / np.array(self.targets) - 1).max())


def match_frequencies(
    beam: Beam,
    *,
    targets: Sequence[float],
    bounds: float = 0.10,
    start: Sequence[float] | None = None,
) -> FrequencyMatch:
    """Find the least change of a beam that gives it the measured natural frequencies.

    Where the bounds do not admit the targets, the answer is the nearest within the bounds in the least-squares sense;
    ``max_relative_error`` and ``at_bound`` tell.

    Parameters
    ----------
    beam : Beam
        The beam to start from; its gravity acts.
    targets : sequence of float
        Measured natural frequencies of the lowest modes, ascending, Hz.
    bounds : float
        Largest relative change of any property, above 0 and at most 1.
    start : sequence of float, optional
        Factors to start from: n widths, n thicknesses, density, elastic modulus; all 1 if not given.

    Raises
    ------
    InputError
        If the targets are not positive and ascending or more than the mesh has modes, the bounds not in (0, 1], or
        the start not within the bounds.
    EquilibriumError
        If the beam has no stable equilibrium.
    FitError
        If IPOPT does not converge, or ends at modes that are not the lowest.
    """
    wanted = check_targets(targets, beam)
    bounds = positive(bounds, "bounds")
    if bounds > 1.0:
        raise InputError(f"must be at most 1, got {bounds:g}", "bounds")
    factors = _check_start(start, beam, bounds)
    began = time.perf_counter()

    standard = natural_modes(Model(beam), count=len(wanted))
    first = natural_modes(Model(_changed(beam, factors)), count=len(wanted))
    problem = _build(beam, first, wanted, factors)
    lower = np.full(problem.start.size, -math.inf)
    upper = np.full(problem.start.size, math.inf)
    lower[: factors.size], upper[: factors.size] = max(1 - bounds, SAME), 1 + bounds
    lower[-len(wanted) :] = 0.0
    options = {**OPTIONS, "jac_g": problem.jacobian, "hess_lag": problem.hessian}
    build_seconds = time.perf_counter() - began
    solution = solve_nlp(problem.nlp, problem.start, lower=lower, upper=upper, options=options)

    factors = solution.x[: factors.size]
    matched = _changed(beam, factors)
    frequencies = natural_modes(Model(matched), count=len(wanted)).frequencies
    found = wanted * np.sqrt(solution.x[-len(wanted) :])
    if np.abs(found / frequencies - 1).max() > SAME:
        raise FitError("the modes found are not the lowest ones; start nearer to the measured frequencies")
    return FrequencyMatch(
        beam=matched,
        targets=tuple(wanted.tolist()),
        standard=tuple(standard.frequencies.tolist()),
        frequencies=tuple(frequencies.tolist()),
        at_bound=_at_bound(beam, factors, bounds),
        iterations=solution.iterations,
        build_seconds=build_seconds,
        solve_seconds=solution.solve_seconds,
    )


def check_targets(targets: Sequence[float], beam: Beam) -> Array:
    """Return measured frequencies as an array, Hz.

    Raises
    ------
    InputError
        If they are not positive and ascending, none, or more than the mesh has bending modes.
    """
    if isinstance(targets, str) or not hasattr(targets, "__len__"):
        raise InputError(f"must be a sequence of frequencies, got {targets!r}", "targets")
    wanted = np.array([positive(target, "targets") for target in targets])
    if wanted.size == 0:
        raise InputError("needs at least one frequency", "targets")
    if (np.diff(wanted) <= 0.0).any():
        raise InputError(f"must be ascending, got {', '.join(f'{f:g}' for f in wanted)} Hz", "targets")
    if wanted.size > 2 * beam.elements:
        raise InputError(
            f"{wanted.size} modes are more than the {2 * beam.elements} of {beam.elements} elements", "targets"
        )
    return wanted


@dataclass(frozen=True)
class _Problem:
    """The program in its scaled unknowns X = (m, q, phi_1, ..., lambda_1, ...), and its derivatives."""

    nlp: dict[str, cs.MX]
    jacobian: cs.Function
    hessian: cs.Function
    start: Array


def _build(beam: Beam, modes: Modes, targets: Array, factors: Array) -> _Problem:
    """State the program, scaled and started by a first equilibrium and its modes."""
    model, count, n = modes.model, modes.count, beam.elements
    free = model.size - NODE
    scale = 1 / np.sqrt(modes.equilibrium.stiffness.diagonal())
    shift = beam.length * scale / scale.max()  # of the coordinates, for a change of q by 1

    # x_i = A_i X + a_i: what element i sees, as columns of x
    X = cs.MX.sym("X", factors.size + free + count * free + count)
    m, q, shapes, eigenvalues = cs.vertsplit(X, np.cumsum([0, factors.size, free, count * free, count]).tolist())
    clamped = cs.MX(NODE, 1)
    widths, thicknesses, common = cs.vertsplit(m, [0, n, 2 * n, 2 * n + 2])
    x = cs.vertcat(
        model.gather(cs.DM(modes.equilibrium.coordinates) + cs.vertcat(clamped, shift * q)),
        cs.vertcat(widths.T, thicknesses.T, cs.repmat(common, 1, n)) * Model(beam).properties,
        *(
            model.gather(cs.vertcat(clamped, omega * scale * psi))
            for omega, psi in zip(modes.angular, cs.vertsplit(shapes, free), strict=True)
        ),
        cs.repmat(eigenvalues * (2 * math.pi * targets) ** 2, 1, n),
    )
    # g = sum_i B_i c_i - d: balance of forces, eigenpairs and their norms, with c_i as columns of c
    each = ELEMENT * (1 + count) + count
    c = cs.MX.sym("c", each * n)
    rows = cs.vertsplit(cs.reshape(c, each, n), [*range(0, each - count + 1, ELEMENT), each])
    g = cs.vertcat(
        model.scatter(rows[0])[model.free] * scale**2 / shift,
        *(model.scatter(row)[model.free] * scale / omega for omega, row in zip(modes.angular, rows[1:-1], strict=True)),
        cs.sum2(rows[-1]) - 1,
    )
    frequencies = cs.sqrt(eigenvalues)  # relative to the targets
    objective = cs.sumsqr(m - 1) / 2 + cs.sumsqr(frequencies - 1) / (2 * WEIGHT)

    element, jacobian, hessian = (function.map(n) for function in _element_constraints(model, count))
    A, B = _constant_jacobian(x, X), _constant_jacobian(g, c)
    y = cs.MX.sym("y", g.numel())
    sigma = cs.MX.sym("sigma")
    blocks = cs.diagcat(*cs.horzsplit(jacobian(x), x.size1()))
    curvatures = cs.diagcat(*cs.horzsplit(hessian(x, cs.reshape(B.T @ y, each, n)), x.size1()))
    g = cs.substitute(g, c, cs.vec(element(x)))
    second = sigma * cs.hessian(objective, X)[0] + A.T @ curvatures @ A
    none = cs.MX.sym("p", 0)
    psi = modes.shapes[model.free] / (modes.angular * scale[:, None])
    start = [factors, np.zeros(free), psi.T.ravel(), (modes.frequencies / targets) ** 2]
    return _Problem(
        nlp={"x": X, "f": objective, "g": g},
        jacobian=cs.Function("jac_g", [X, none], [g, B @ blocks @ A]),
        hessian=cs.Function("hess_lag", [X, none, sigma, y], [cs.triu(second)]),
        start=np.concatenate(start),
    )


def _element_constraints(model: Model, count: int) -> tuple[cs.Function, cs.Function, cs.Function]:
    """Share of one element in the constraints, c(x); its Jacobian; and the Hessian of y.c, (x, y) -> d2(y.c)/dx2."""
    e, p = cs.SX.sym("e", ELEMENT), cs.SX.sym("p", len(PROPERTIES))
    phi, eigenvalues = cs.SX.sym("phi", ELEMENT, count), cs.SX.sym("lambda", count)
    functions = model.element
    mass = functions.mass(p)
    force = functions.elastic_force(e, p) - functions.gravity_force(p, model.beam.gravity)
    pencil = functions.tangent_stiffness(e, p) @ phi - mass @ phi @ cs.diag(eigenvalues)
    norms = cs.sum1(phi * (mass @ phi)).T
    x = cs.vertcat(e, p, cs.vec(phi), eigenvalues)
    c = cs.vertcat(force, cs.vec(pencil), norms)
    y = cs.SX.sym("y", c.numel())
    return (
        cs.Function("c", [x], [c]),
        cs.Function("dc", [x], [cs.jacobian(c, x)]),
        cs.Function("ddc", [x, y], [cs.hessian(cs.dot(y, c), x)[0]]),
    )


def _constant_jacobian(linear: cs.MX, x: cs.MX) -> cs.DM:
    """Return the Jacobian of an expression that is linear in x."""
    return cs.evalf(cs.jacobian(cs.vec(linear), x))


def _changed(beam: Beam, factors: Array) -> Beam:
    """Return the beam with its properties multiplied by the factors."""
    n = beam.elements
    spread = [factors[:n], factors[n : 2 * n], np.full(n, factors[-2]), np.full(n, factors[-1])]
    properties = {name: np.array(getattr(beam, name)) * f for name, f in zip(PROPERTIES, spread, strict=True)}
    return beam.with_(**{name: tuple(values.tolist()) for name, values in properties.items()})


def _check_start(start: Sequence[float] | None, beam: Beam, bounds: float) -> Array:
    size = 2 * beam.elements + 2
    if start is None:
        return np.ones(size)
    factors = np.array([number(factor, "start") for factor in start])
    if factors.size != size:
        raise InputError(f"needs {size} factors, got {factors.size}", "start")
    if np.abs(factors - 1).max() > bounds or factors.min() <= 0.0:
        raise InputError(f"the factors must be above 0 and within 1 +- {bounds:g}", "start")
    return factors


def _at_bound(beam: Beam, factors: Array, bounds: float) -> tuple[str, ...]:
    names = [f"{name}[{i + 1}]" for name in PROPERTIES[:2] for i in range(beam.elements)] + list(PROPERTIES[2:])
    active = np.abs(np.abs(factors - 1) - bounds) < AT_BOUND * bounds
    return tuple(name for name, is_active in zip(names, active, strict=True) if is_active)
