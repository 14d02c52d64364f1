"""Static equilibrium and natural frequencies as differentiable Functions of the parameters p.

Unknowns and equations are scaled by S = diag(K)^-1/2, where K is the tangent stiffness at the equilibrium of the model.
The scaling keeps the large axial stiffness out of the condition number.

    equilibrium     Q_e(e, p) - Q_g(p) = 0.  The unknown z is the scaled change from the equilibrium of the model.
                    Newton's method follows p_j = p_0 + (j/m)(p - p_0), j = 1..m, from each solution to the next.
    frequencies     K psi - mu B psi = 0, psi^T B psi = 1, with K = S K S and B = omega_k^2 S M S for mode k, Eq. (30).
                    Inverse iteration of all modes, orthogonalised in order, gives the start of Newton's method: it
                    converges to the lowest modes.

A value that is not certain is nan.  One further Newton step checks the equilibrium.  The modes are checked by their
residuals, by their order, and by a Sturm count: K - sigma M, with sigma just above the highest of m modes, has as many
negative pivots as there are modes below sigma, which must be m.  Without the count, some unstable beams would get
frequencies.

Range: in 675 beams (lying, hanging and standing), the properties of the elements differed at random from those of the
model by factors of up to 1.5, 3 or 6, and a third had up to 30 times the gravity.  575 got frequencies, within 1e-5 of
those of ``natural_modes``, which finds no modes for 94 of the others.  The remaining 6 have factors of up to 6.

References
----------
"Comparison of external damping models in a large deformation problem", Section 4.3.
B. N. Parlett, The Symmetric Eigenvalue Problem, SIAM 1998, sections 3.3 (Sturm count) and 4 (inverse iteration).
"""

from __future__ import annotations

import math

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.export.functions.newton import certain, newton, scaled
from ancf_casadi.support.arrays import Array
from ancf_casadi.vibration.equilibrium import Equilibrium
from ancf_casadi.vibration.modes import Modes

LOAD_STEPS = 8  # m, from the parameters of the model to p
CERTAIN = 1e-9  # largest change in a further Newton step (relative to length and slope), and largest residual of a mode


def equilibrium_function(rest: Equilibrium, equations: Equations, start: Array) -> cs.Function:
    """Return p -> q, the free coordinates at rest under gravity, with the clamp as in the model.

    Parameters
    ----------
    rest : Equilibrium
        The equilibrium of the model.
    equations : Equations
        The equation of motion.
    start : array
        Values of p in the model.
    """
    model, scale = rest.model, _scale(rest)
    shift = model.beam.length * scale / scale.max()  # of the coordinates per unit of z
    origin, known = cs.DM(rest.coordinates[model.free]), cs.DM(rest.coordinates[: model.free.start])
    z, p = cs.MX.sym("z", scale.size), cs.MX.sym("p", start.size)
    balance, e = equations.balance_for(p), cs.vertcat(known, origin + shift * z)
    rows, columns = cs.DM(scale**2 / shift), cs.DM(shift)
    residual = rows * balance.conservative(e)[model.free]
    stiffness = scaled(model.tangent_stiffness(e, balance.properties)[model.free, model.free], rows, columns)
    solve = newton("equilibrium_newton", [z, p], stiffness, residual)
    found = cs.MX.zeros(scale.size)
    for j in range(1, LOAD_STEPS + 1):
        found = solve(found, cs.DM(start) + (p - cs.DM(start)) * (j / LOAD_STEPS))
    step = cs.Function("step", [z, p], [cs.solve(stiffness, residual, "qr")])
    change = cs.norm_inf(step(found, p) * (shift / model.scale[model.free]))
    q = (origin + shift * found) * certain(change < CERTAIN)
    return cs.Function("equilibrium", [p], [q], ["p"], ["q"])


def frequencies_function(modes: Modes, equations: Equations, equilibrium: cs.Function) -> cs.Function:
    """Return p -> f, the lowest natural frequencies about the equilibrium, Hz.

    Parameters
    ----------
    modes : Modes
        Modes of the model, the first guess; their number is that of the frequencies.
    equations : Equations
        The equation of motion.
    equilibrium : Function
        p -> q.
    """
    model, scale, free = modes.model, cs.DM(_scale(modes.equilibrium)), modes.model.free
    p = cs.MX.sym("p", equilibrium.size1_in(0))
    properties = equations.balance_for(p).properties
    e = cs.vertcat(cs.DM(modes.equilibrium.coordinates[: free.start]), equilibrium(p))
    K = scaled(model.tangent_stiffness(e, properties)[free, free], scale, scale)
    M = scaled(model.mass(properties)[free, free], scale, scale)

    start = cs.MX(cs.DM(modes.shapes[free]) / cs.repmat(scale, 1, modes.count))
    iterate = _inverse_iteration(K.sparsity(), M.sparsity(), modes.count)
    for _ in range(10):
        start = iterate(start, K, M)
    solve = _eigenpair(K.sparsity(), M.sparsity())
    squares, residuals = [], []
    for omega, psi in zip(modes.angular_frequencies, cs.horzsplit(start), strict=True):
        B = omega**2 * M
        pair = solve(cs.vertcat(psi / omega, cs.bilin(K, psi, psi) / omega**2), K, B)
        psi, mu = pair[:-1], pair[-1]
        squares.append(omega**2 * mu)
        residuals.append(cs.norm_inf(K @ psi - mu * (B @ psi)))
    found = cs.vertcat(*squares)
    converged = cs.mmax(cs.vertcat(*residuals)) < CERTAIN
    ascending = cs.mmin(cs.vertcat(found[0], cs.diff(found))) > 0
    # relative distance of sigma from the highest mode
    complete = _negative_pivots(K - (1 + 1e-6) * found[-1] * M) == modes.count
    sure = certain(cs.logic_and(cs.logic_and(complete, ascending), converged))
    return cs.Function("frequencies", [p], [cs.sqrt(found) / (2 * math.pi) * sure], ["p"], ["f"])


def _scale(rest: Equilibrium) -> Array:
    return np.asarray(1 / np.sqrt(rest.stiffness.diagonal()))


def _inverse_iteration(K: cs.Sparsity, M: cs.Sparsity, count: int) -> cs.Function:
    """Return (psi, K, M) -> K^-1 M psi, with the columns orthonormalised in order with respect to M."""
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
    return newton("eigenpair", [pair, stiffness, mass], jacobian, equations)


def _negative_pivots(matrix: cs.MX) -> cs.MX:
    """Return the number of negative pivots of a symmetric band matrix, which is that of its negative eigenvalues."""
    A = cs.SX.sym("A", matrix.sparsity())
    pivots, _, _ = cs.ldl(A, False)
    return cs.Function("negative_pivots", [A], [cs.sum1(pivots < 0)])(matrix)
