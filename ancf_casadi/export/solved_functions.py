"""Functions that solve equations: static equilibrium, natural frequencies, and one time step, all differentiable.

The solution z(p) of F(z, p) = 0 comes from Newton's method in a CasADi rootfinder, which differentiates it by the
implicit function theorem, dz/dp = -(dF/dz)^-1 dF/dp.  The rootfinder does not report a failure; the solution is checked
here, and a value that did not converge is nan.

Statics.  Unknowns and equations are scaled by S = diag(K)^-1/2, where K is the tangent stiffness at the equilibrium of
the model.  The scaling keeps the large axial stiffness out of the condition number.

    equilibrium     Q_e(e, p) - Q_g(p) = 0, with the force of a flow, if there is one.  The unknown z is the scaled
                    change from the equilibrium of the model.
                    Newton's method follows p_j = p_0 + (j/m)(p - p_0), j = 1..m, from each solution to the next.
    frequencies     K psi - mu B psi = 0, psi^T B psi = 1, with K = S K S and B = omega_k^2 S M S for mode k, Eq. (30).
                    Inverse iteration of all modes, orthogonalised in order, gives the start of Newton's method: it
                    converges to the lowest modes.

A further call of Newton's method checks the equilibrium; the modes are checked by their residuals, their order and
their sign, and by the number of lower modes: far from the parameters of the model, another mode may be one of the
lowest.

Step, for C and for programs without an integrator.  The method of Alexander is singly diagonally implicit, of order 2,
L-stable (motion too fast for the step decays) and stiffly accurate.  Its successive stages solve

    r(q_i, v_i, a_i) = 0,    v_i = v^ + g h a_i,    q_i = q^ + g h v_i,
    q^ = q + h sum_{j<i} A_ij v_j,    v^ = v + h sum_{j<i} A_ij a_j,

with two stages, g = A_ii = 1 - 1/2^(1/2) and A_21 = 1 - g.  The last stage is the end of the step.  The unknown is the
scaled change x in q_i = q^ + g h v^ + c x; the scale c and that of the equations follow from diag(M/(g h)^2 + K) of the
model.  The method of Kennedy and Carpenter, ARK4(3)6L[2]SA, has the same properties and order 4.  Its first stage is
the start of the step, and its stages have order 2.  With stages of lower order, the axial force, which is almost a
constraint, would reduce the order.  With weights d it estimates the error of a step, h sum_j d_j v_j and
h sum_j d_j a_j.

References
----------
"Comparison of external damping models in a large deformation problem", Section 4.3.
B. N. Parlett, The Symmetric Eigenvalue Problem, SIAM 1998, section 4 (inverse iteration).
R. Alexander, Diagonally implicit Runge-Kutta methods for stiff O.D.E.'s, SIAM Journal on Numerical Analysis 14 (1977).
C. A. Kennedy and M. H. Carpenter, Additive Runge-Kutta schemes for convection-diffusion-reaction equations, Applied
Numerical Mathematics 44 (2003), the implicit part of ARK4(3)6L[2]SA.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.equations import Equations, scaled_matrix
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.support.arrays import Array
from ancf_casadi.vibration.assembly import eigenvalue_shift
from ancf_casadi.vibration.eigensolver import eigenvalue_rounding
from ancf_casadi.vibration.equilibrium import Equilibrium
from ancf_casadi.vibration.modes import Modes

NEWTON_OPTIONS = {"error_on_fail": False, "max_iter": 12, "abstol": 0.0, "abstolStep": 1e-9}
LOAD_STEPS = 8  # m, from the parameters of the model to p
MAX_ERROR = 1e-9  # change in a further Newton step, relative to length and slope, and residual of a mode
GAMMA = 1 - 1 / math.sqrt(2)

Rows = tuple[tuple[float, ...], ...]  # of A up to the diagonal, which is constant except for an explicit first stage

ALEXANDER: Rows = ((GAMMA,), (1 - GAMMA, GAMMA))
KENNEDY_CARPENTER: Rows = (
    (0.0,),
    (1 / 4, 1 / 4),
    (8611 / 62500, -1743 / 31250, 1 / 4),
    (5012029 / 34652500, -654441 / 2922500, 174375 / 388108, 1 / 4),
    (15267082809 / 155376265600, -71443401 / 120774400, 730878875 / 902184768, 2285395 / 8070912, 1 / 4),
    (82889 / 524892, 0.0, 15625 / 83664, 69875 / 102672, -2260 / 8211, 1 / 4),
)
KENNEDY_CARPENTER_ERROR = (  # d
    31666707 / 9881966720, 0.0, -256875 / 105007616, -2768025 / 128864768, 169839 / 3864644, -5247 / 225920
)  # fmt: skip


def stage_instants(rows: Rows) -> tuple[float, ...]:
    """Return the instants of the stages, as fractions of a step."""
    return tuple(math.fsum(row) for row in rows)


SDIRK_STAGES = stage_instants(ALEXANDER)


def newton(name: str, inputs: list[cs.MX], jacobian: cs.MX, equations: cs.MX) -> cs.Function:
    """Return (start, parameters) -> solution of the equations for the first input."""
    derivative = cs.Function(f"{name}_jacobian", inputs, [jacobian, equations])
    function = cs.Function(f"{name}_equations", inputs, [equations])
    if inputs[0].numel() <= 40:  # unknowns; up to this number, scalar operations are faster than loops over elements
        derivative, function = (f.expand(f.name(), {"cse": True}) for f in (derivative, function))
    return cs.rootfinder(name, "fast_newton", function, {**NEWTON_OPTIONS, "jacobian_function": derivative})


def free_block(model: Model, matrix: Any) -> Any:
    """Return N^T A N of a sparse matrix A over all nodes, of numbers or symbols."""
    return matrix[NODE:, NODE:] if model.held_at_base_alone else model.whole_of_free.T @ matrix @ model.whole_of_free


def nan_unless(condition: cs.MX) -> cs.MX:
    """Return a factor that is 1 if the condition holds, and otherwise makes a value and its derivatives nan."""
    return cs.if_else(condition, 1.0, math.nan)


def equilibrium_function(modes: Modes, equations: Equations, start: Array) -> cs.Function:
    """Return p -> q, the free coordinates in equilibrium under gravity, with the base as in the model of ``modes``."""
    model, model_equilibrium, scale = modes.model, modes.equilibrium, _coordinate_scale(modes.equilibrium)
    column_scale = model.beam.length * scale / scale.max()  # of the coordinates per unit of z
    origin, base = cs.DM(model.of_free(model_equilibrium.coordinates)), cs.DM(model_equilibrium.coordinates[:NODE])
    z, p = cs.MX.sym("z", scale.size), cs.MX.sym("p", start.size)
    if not modes.frequencies[0]:
        return _nan_function("equilibrium", p, "q", scale.size)
    balance, e = equations.balance_for(p), model.whole(origin + column_scale * z, base)
    row_scale, column_scales = cs.DM(scale**2 / column_scale), cs.DM(column_scale)
    residual = row_scale * model.of_free(balance.at_rest(e))
    tangent_stiffness = free_block(model, model.tangent_stiffness(e, balance.properties))
    stiffness = scaled_matrix(tangent_stiffness, row_scale, column_scales)
    solve = newton("equilibrium_newton", [z, p], stiffness, residual)
    solution = cs.MX.zeros(scale.size)
    for j in range(1, LOAD_STEPS + 1):
        solution = solve(solution, cs.DM(start) + (p - cs.DM(start)) * (j / LOAD_STEPS))
    change = cs.norm_inf((solve(solution, p) - solution) * (column_scale / model.free_scale))
    q = (origin + column_scale * solution) * nan_unless(change < MAX_ERROR)
    return cs.Function("equilibrium", [p], [q], ["p"], ["q"])


def frequencies_function(modes: Modes, equations: Equations, equilibrium: cs.Function) -> cs.Function:
    """Return p -> f, the lowest natural frequencies about the ``equilibrium`` p -> q, Hz, near those of ``modes``."""
    model, scale = modes.model, cs.DM(_coordinate_scale(modes.equilibrium))
    p = cs.MX.sym("p", equilibrium.size1_in(0))
    if not modes.frequencies[0]:
        return _nan_function("frequencies", p, "f", modes.count)
    properties = equations.balance_for(p).properties
    q: cs.MX = equilibrium(p)
    e = model.whole(q, cs.MX(cs.DM(modes.equilibrium.coordinates[:NODE])))
    K = scaled_matrix(free_block(model, model.tangent_stiffness(e, properties)), scale, scale)
    M = scaled_matrix(free_block(model, model.mass(properties)), scale, scale)

    start = cs.MX(cs.DM(model.of_free(modes.shapes)) / cs.repmat(scale, 1, modes.count))
    iterate = _inverse_iteration(K.sparsity(), M.sparsity(), modes.count)
    for _ in range(10):
        start = iterate(start, K, M)
    solve = _eigenpair(K.sparsity(), M.sparsity())
    eigenvalues, residuals = [], []
    for omega, psi in zip(modes.angular_frequencies, cs.horzsplit(start), strict=True):
        B = omega**2 * M
        pair = solve(cs.vertcat(psi / omega, cs.bilin(K, psi, psi) / omega**2), K, B)
        psi, mu = pair[:-1], pair[-1]
        eigenvalues.append(omega**2 * mu)
        residuals.append(cs.norm_inf(K @ psi - mu * (B @ psi)))
    squared_frequencies = cs.vertcat(*eigenvalues)
    converged = cs.mmax(cs.vertcat(*residuals)) < MAX_ERROR
    positive = squared_frequencies[0] - eigenvalue_rounding(model)
    ascending = cs.mmin(cs.vertcat(positive, cs.diff(squared_frequencies))) > 0
    _, stiffness, mass = modes.equilibrium.structure.linearisation(modes.equilibrium.exact)
    rounding = cs.DM(eigenvalue_shift(model, stiffness, mass)) / modes.angular_frequencies[-1] ** 2
    lower = _modes_below(K.sparsity(), M.sparsity())((1 - rounding) * squared_frequencies[-1], K, M)
    validity = nan_unless(cs.logic_and(cs.logic_and(ascending, converged), lower < modes.count))
    return cs.Function("frequencies", [p], [cs.sqrt(squared_frequencies) / (2 * math.pi) * validity], ["p"], ["f"])


def _nan_function(name: str, p: cs.MX, result: str, size: int) -> cs.Function:
    """Return p -> nan (size,), for a beam with a rigid motion, in which K has no factors."""
    return cs.Function(name, [p], [cs.MX(cs.DM([math.nan] * size))], ["p"], [result])


def _coordinate_scale(equilibrium: Equilibrium) -> Array:
    return np.asarray(1 / np.sqrt(equilibrium.stiffness.diagonal()))


def _inverse_iteration(K: cs.Sparsity, M: cs.Sparsity, count: int) -> cs.Function:
    """Return (psi, K, M) -> K^-1 M psi, with the columns orthonormalised in order with respect to M."""
    stiffness, mass = cs.MX.sym("K", K), cs.MX.sym("M", M)
    psi = cs.MX.sym("psi", K.size1(), count)
    columns: list[cs.MX] = []
    for column in cs.horzsplit(cs.solve(stiffness, mass @ psi, "ldl")):
        for earlier_column in columns:
            column -= cs.dot(earlier_column, mass @ column) * earlier_column
        columns.append(column / cs.sqrt(cs.bilin(mass, column, column)))
    return cs.Function("inverse_iteration", [psi, stiffness, mass], [cs.horzcat(*columns)])


def _modes_below(K: cs.Sparsity, M: cs.Sparsity) -> cs.Function:
    """Return (mu, K, M) -> the number of eigenvalues below mu, that of the negative pivots of K - mu M (Sylvester)."""
    stiffness, mass, mu = cs.SX.sym("K", K), cs.SX.sym("M", M), cs.SX.sym("mu")
    pivots, *_ = cs.ldl(stiffness - mu * mass)
    return cs.Function("modes_below", [mu, stiffness, mass], [cs.sum1(pivots < 0)], {"is_diff_out": [False]})


def _eigenpair(K: cs.Sparsity, M: cs.Sparsity) -> cs.Function:
    """Return ((psi, mu), K, B) -> (psi, mu) with K psi - mu B psi = 0 and (psi^T B psi - 1)/2 = 0."""
    stiffness, mass, pair = cs.MX.sym("K", K), cs.MX.sym("B", M), cs.MX.sym("pair", K.size1() + 1)
    psi, mu = pair[:-1], pair[-1]
    load = mass @ psi
    equations = cs.vertcat(stiffness @ psi - mu * load, (cs.dot(psi, load) - 1) / 2)
    jacobian = cs.blockcat(stiffness - mu * mass, -load, load.T, cs.MX(1, 1))
    return newton("eigenpair", [pair, stiffness, mass], jacobian, equations)


def step_function(
    residual: cs.Function,
    jacobians: cs.Function,
    diagonals: tuple[cs.DM, cs.DM],
    length: float,
    tableau: Rows = ALEXANDER,
    error: Sequence[float] = (),
    rhs: cs.Function | None = None,
) -> cs.Function:
    """Return the step (q, v, base, p, h) -> q_next, v_next.

    The stages solve ``residual``, (q, v, a, base, p) -> r, with its ``jacobians`` dr_dq, dr_dv and dr_da.  Their
    scale follows from the ``diagonals`` of M and K and the ``length`` of the beam.  With weights of the ``error``, the
    estimated errors of q_next and v_next are further outputs.  An explicit first stage needs ``rhs``.
    """
    names = ("q", "v", "base", "p")
    q, v, base, p = (cs.MX.sym(name, residual.size1_in(name)) for name in names)
    h, x, gamma = cs.MX.sym("h"), cs.MX.sym("x", q.numel()), tableau[-1][-1]
    motion = cs.MX.sym("base", base.numel(), len(tableau))
    s = 1 / (gamma * h)
    scale = 1 / cs.sqrt(diagonals[0] * s**2 + diagonals[1])
    column_scale = length * scale / cs.mmax(scale)
    row_scale = scale**2 / column_scale

    state = (q + v / s + column_scale * x, v + s * column_scale * x, s**2 * column_scale * x)
    dr_dq, dr_dv, dr_da = jacobians(*state, base, p)
    stage_inputs = [q, v, base, p, h]
    unbalance = row_scale * residual(*state, base, p)
    jacobian = scaled_matrix(dr_dq + s * dr_dv + s**2 * dr_da, row_scale, column_scale)
    solve = newton("step_newton", [x, *stage_inputs], jacobian, unbalance)
    solution = solve(cs.MX(x.numel(), 1), *stage_inputs)
    *stage_end, stage_residual = cs.graph_substitute([*state, unbalance], [x], [solution])
    validity = nan_unless(cs.norm_inf(stage_residual) < 1e-8)  # largest residual of the scaled equations
    stage = cs.Function("stage", stage_inputs, [end * validity for end in stage_end])

    outputs: list[cs.MX] = []  # q and v at the last stage
    rates: list[tuple[cs.MX, cs.MX]] = []  # v and a at all stages

    def change(weights: Sequence[float]) -> list[cs.MX]:
        """Return h times a weighted sum of the rates of q and v."""
        return [sum((w * h * rate[j] for w, rate in zip(weights, rates, strict=True)), cs.MX(0)) for j in range(2)]

    for k, (*earlier_weights, diagonal_weight) in enumerate(tableau):
        if rhs is not None and not diagonal_weight:
            rates = [(v, rhs(q, v, motion[:, k], p))]
            continue
        increments = change(earlier_weights)
        *outputs, a_k = stage(q + increments[0], v + increments[1], motion[:, k], p, h)
        rates.append((outputs[1], a_k))
    if error:
        outputs += change(error)
    labels = ["q_next", "v_next", "q_error", "v_error"][: len(outputs)]
    return cs.Function("step", [q, v, motion, p, h], outputs, [*names, "h"], labels)
