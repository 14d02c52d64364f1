"""Static equilibrium and natural frequencies as differentiable Functions of the parameters.

Both solve equations F(z, p) = 0 by Newton's method inside a CasADi rootfinder, so that their derivatives follow
from the implicit function theorem, dz/dp = -(dF/dz)^-1 dF/dp.  Unknowns and equations are scaled by S = diag(K)^-1/2, K
the tangent stiffness of the model's own equilibrium, which takes the axial stiffness out of the conditioning.

    equilibrium     Q_e(e, p) - Q_g(p) = 0, with z the change from the model's own equilibrium.  Newton's method goes
                    there along p_j = p_0 + (j/m)(p - p_0), j = 1..m, each solution the start of the next.
    frequencies     K psi - mu B psi = 0, psi^T B psi = 1, with K = S K S and B = omega_k^2 S M S for mode k.  Inverse
                    iteration of all modes at once, orthogonalised in their order, gives the start: it goes to the
                    lowest modes from wherever it starts.

A number that is not certain is nan.  The equilibrium is checked by what one more step of Newton's method would change;
the modes by their order and by Sturm's count, that below the highest of m modes there are m - 1 others and no more: as
many as K - sigma M has negative pivots with sigma just above the highest.

Range: of 225 beams whose elements differed at random from the model's by factors of 1.5, 3 and 6, lying, hanging and
standing, none was answered wrongly; those by 1.5 and 3 were all answered, of those by 6 all but 3 that have an answer.

References
----------
B. N. Parlett, The Symmetric Eigenvalue Problem, SIAM 1998, sections 3.3 (Sturm's count) and 4.
"""

from __future__ import annotations

import math

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.equations import Balance, Equations
from ancf_casadi.support.arrays import Array
from ancf_casadi.vibration.equilibrium import Equilibrium
from ancf_casadi.vibration.modes import Modes

LOAD_STEPS = 8  # m, from the model's parameters to those asked for
INVERSE_ITERATIONS = 10
CERTAIN = 1e-9  # of the length of the beam and of 1: what one more step of Newton's method may change
STRAIGHT_LINE = 40  # unknowns up to which a straight line of operations beats loops: three times as fast
JUST_ABOVE = 1e-6  # relative distance of sigma from the highest mode
NEWTON = {"error_on_fail": False, "max_iter": 12, "abstol": 0.0, "abstolStep": 1e-9}


def equilibrium_function(rest: Equilibrium, equations: Equations, start: Array) -> cs.Function:
    """Return p -> q, the free coordinates at rest under gravity, the clamp where the model's own is.

    Parameters
    ----------
    rest : Equilibrium
        The model's own.
    equations : Equations
        Whose parameters, without the projection, are p.
    start : array
        Values of p for the model.
    """
    model, scale = rest.model, _scale(rest)
    shift = model.beam.length * scale / scale.max()  # of the coordinates, for a change of z by 1
    origin, known = cs.DM(rest.coordinates[model.free]), cs.DM(rest.coordinates[: model.free.start])
    z, p = cs.MX.sym("z", scale.size), cs.MX.sym("p", start.size)
    balance, e = balance_for(equations, p), cs.vertcat(known, origin + shift * z)
    rows, columns = cs.DM(scale**2 / shift), cs.DM(shift)
    unbalance = rows * balance.conservative(e)[model.free]
    stiffness = scaled(model.tangent_stiffness(e, balance.properties)[model.free, model.free], rows, columns)
    newton = rootfinder("equilibrium_newton", [z, p], stiffness, unbalance)
    found = cs.MX.zeros(scale.size)
    for j in range(1, LOAD_STEPS + 1):
        found = newton(found, cs.DM(start) + (p - cs.DM(start)) * (j / LOAD_STEPS))
    step = cs.Function("step", [z, p], [cs.solve(stiffness, unbalance, "qr")])
    change = cs.norm_inf(step(found, p) * (shift / model.scale[model.free]))
    q = (origin + shift * found) * certain(change < CERTAIN)
    return cs.Function("equilibrium", [p], [q], ["p"], ["q"])


def frequencies_function(modes: Modes, equations: Equations, equilibrium: cs.Function) -> cs.Function:
    """Return p -> f, the lowest natural frequencies about the equilibrium, Hz.

    Parameters
    ----------
    modes : Modes
        Of the model: as many as asked for, the first guess.
    equations : Equations
        Whose parameters, without the projection, are p.
    equilibrium : Function
        p -> q.
    """
    model, scale = modes.model, _scale(modes.equilibrium)
    p, free = cs.MX.sym("p", equilibrium.size1_in(0)), model.free
    properties = balance_for(equations, p).properties
    e = cs.vertcat(cs.DM(modes.equilibrium.coordinates[: free.start]), equilibrium(p))
    K = scaled(model.tangent_stiffness(e, properties)[free, free], cs.DM(scale), cs.DM(scale))
    M = scaled(model.mass(properties)[free, free], cs.DM(scale), cs.DM(scale))

    start = cs.MX(cs.DM(modes.shapes[free] / scale[:, None]))
    iterate = _inverse_iteration(K.sparsity(), M.sparsity(), modes.count)
    for _ in range(INVERSE_ITERATIONS):
        start = iterate(start, K, M)
    newton = _eigenpair(K.sparsity(), M.sparsity())
    squares, errors = [], []
    for omega, psi in zip(modes.angular_frequencies, cs.horzsplit(start), strict=True):
        B = omega**2 * M
        pair = newton(cs.vertcat(psi / omega, cs.bilin(K, psi, psi) / omega**2), K, B)
        psi, mu = pair[:-1], pair[-1]
        squares.append(omega**2 * mu)
        errors.append(cs.norm_inf(K @ psi - mu * (B @ psi)))
    found = cs.vertcat(*squares)
    below = _count_below(K.sparsity() + M.sparsity())(K - (1 + JUST_ABOVE) * found[-1] * M)
    ascending = cs.mmin(cs.vertcat(found[0], cs.diff(found))) > 0
    solved = cs.mmax(cs.vertcat(*errors)) < CERTAIN
    sure = certain(cs.logic_and(cs.logic_and(below == modes.count, ascending), solved))
    return cs.Function("frequencies", [p], [cs.sqrt(found) / (2 * math.pi) * sure], ["p"], ["f"])


def balance_for(equations: Equations, p: cs.MX) -> Balance:
    """Return the terms of the equation of motion for parameters without the projection, which stays as it is."""
    return equations.balance(cs.vertcat(p, cs.DM(equations.projection.T.ravel())))


def _scale(rest: Equilibrium) -> Array:
    return np.asarray(1 / np.sqrt(rest.stiffness.diagonal()))


def scaled(matrix: cs.MX, rows: cs.MX | cs.DM, columns: cs.MX | cs.DM) -> cs.MX:
    """Return a sparse matrix with its rows and columns multiplied by some numbers."""
    row, column = matrix.sparsity().get_triplet()
    return cs.MX(matrix.sparsity(), matrix.nz[:] * rows[row] * columns[column])


def rootfinder(name: str, inputs: list[cs.MX], jacobian: cs.MX, equations: cs.MX) -> cs.Function:
    """Return (start, parameters) -> solution of equations in the first input, by Newton's method."""
    derivative = cs.Function(f"{name}_jacobian", inputs, [jacobian, equations])
    function = cs.Function(f"{name}_equations", inputs, [equations])
    if inputs[0].numel() <= STRAIGHT_LINE:
        derivative, function = (f.expand(f.name(), {"cse": True}) for f in (derivative, function))
    return cs.rootfinder(name, "fast_newton", function, {**NEWTON, "jacobian_function": derivative})


def certain(condition: cs.MX) -> cs.MX:
    """Return 1, or nan where the condition does not hold; a factor, so that derivatives are nan there too."""
    return cs.if_else(condition, 1.0, math.nan)


def _inverse_iteration(K: cs.Sparsity, M: cs.Sparsity, count: int) -> cs.Function:
    """Return (psi, K, M) -> K^-1 M psi, made orthonormal with respect to M one after the other."""
    stiffness, mass = cs.MX.sym("K", K), cs.MX.sym("M", M)
    psi = cs.MX.sym("psi", K.size1(), count)
    columns: list[cs.MX] = []
    for column in cs.horzsplit(cs.solve(stiffness, mass @ psi, "ldl")):
        for other in columns:
            column -= cs.dot(other, mass @ column) * other
        columns.append(column / cs.sqrt(cs.bilin(mass, column, column)))
    return cs.Function("inverse_iteration", [psi, stiffness, mass], [cs.horzcat(*columns)])


def _eigenpair(K: cs.Sparsity, M: cs.Sparsity) -> cs.Function:
    """Return ((psi, mu), K, B) -> (psi, mu) with K psi - mu B psi = 0 and (psi^T B psi - 1)/2 = 0."""
    stiffness, mass, pair = cs.MX.sym("K", K), cs.MX.sym("B", M), cs.MX.sym("pair", K.size1() + 1)
    psi, mu = pair[:-1], pair[-1]
    load = mass @ psi
    equations = cs.vertcat(stiffness @ psi - mu * load, (cs.dot(psi, load) - 1) / 2)
    jacobian = cs.blockcat(stiffness - mu * mass, -load, load.T, cs.MX(1, 1))
    return rootfinder("eigenpair", [pair, stiffness, mass], jacobian, equations)


def _count_below(pattern: cs.Sparsity) -> cs.Function:
    """Return A -> how many eigenvalues of a symmetric band matrix are negative: its negative pivots.

    A window over the rows that the next pivot touches goes down the matrix; each step takes the pivot's share from it,
    and lets in the next row.
    """
    size, width = pattern.size1(), pattern.bw_lower() + 1
    window, row = cs.SX.sym("window", width, width), cs.SX.sym("row", width)
    rest = window[1:, 1:] - window[1:, :1] @ window[:1, 1:] / window[0, 0]
    moved = cs.blockcat(rest, row[:-1], row[:-1].T, row[-1])
    eliminate = cs.Function("eliminate", [window, row], [moved, window[0, 0]])
    A = cs.MX.sym("A", pattern)
    padded = cs.diagcat(A, cs.MX.eye(width))
    rows = [padded[k + 1 : k + width + 1, k + width] for k in range(size)]
    _, pivots = eliminate.mapaccum("pivots", size)(cs.densify(padded[:width, :width]), cs.densify(cs.horzcat(*rows)))
    return cs.Function("count_below", [A], [cs.sum2(pivots < 0)])
