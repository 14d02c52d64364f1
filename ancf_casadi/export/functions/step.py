"""One time step as a CasADi Function, for C and for programs without an integrator.

The method of Alexander is singly diagonally implicit, of order 2, L-stable (motion too fast for the step decays) and
stiffly accurate.  With g = 1 - 1/2^(1/2), two stages at the times g h and h solve, one after the other,

    r(q_i, v_i, a_i) = 0,    v_i = v^ + g h a_i,    q_i = q^ + g h v_i,
    q^ = q, v^ = v  (i = 1),        q^ = q + (1 - g) h v_1, v^ = v + (1 - g) h a_1  (i = 2).

The second stage is the end of the step.  The unknown is the scaled change x in q_i = q^ + g h v^ + c x; the scale c and
that of the equations follow from diag(M/(g h)^2 + K) of the model.  If Newton's method does not converge, the result is
nan.

References
----------
R. Alexander, Diagonally implicit Runge-Kutta methods for stiff O.D.E.'s, SIAM Journal on Numerical Analysis 14 (1977).
"""

from __future__ import annotations

import math

import casadi as cs

from ancf_casadi.export.functions.newton import certain, newton, scaled
from ancf_casadi.vibration.modes import Modes

GAMMA = 1 - 1 / math.sqrt(2)
SDIRK_STAGES = (GAMMA, 1.0)  # instants of a step at which the base motion is needed, in steps


def step_function(residual: cs.Function, jacobians: cs.Function, modes: Modes) -> cs.Function:
    """Return (q, v, base, p, h) -> q_next, v_next.

    Parameters
    ----------
    residual : Function
        (q, v, a, base, p) -> r.
    jacobians : Function
        (q, v, a, base, p) -> dr_dq, dr_dv, dr_da.
    modes : Modes
        Modes of the model at its equilibrium.
    """
    model = modes.model
    mass = model.mass(model.properties)[model.free, model.free]
    names = ("q", "v", "base", "p")
    q, v, base, p = (cs.MX.sym(name, residual.size1_in(name)) for name in names)
    h, x, motion = cs.MX.sym("h"), cs.MX.sym("x", q.numel()), cs.MX.sym("base", base.numel(), len(SDIRK_STAGES))
    s = 1 / (GAMMA * h)
    scale = 1 / cs.sqrt(cs.diag(mass) * s**2 + cs.DM(modes.equilibrium.stiffness.diagonal()))
    shift = model.beam.length * scale / cs.mmax(scale)
    rows = scale**2 / shift

    state = (q + v / s + shift * x, v + s * shift * x, s**2 * shift * x)
    dr_dq, dr_dv, dr_da = jacobians(*state, base, p)
    known = [q, v, base, p, h]
    unbalance = rows * residual(*state, base, p)
    solve = newton("step_newton", [x, *known], scaled(dr_dq + s * dr_dv + s**2 * dr_da, rows, shift), unbalance)
    found = solve(cs.MX(x.numel(), 1), *known)
    *ends, left = cs.graph_substitute([*state, unbalance], [x], [found])
    sure = certain(cs.norm_inf(left) < 1e-8)  # largest residual of the scaled equations
    stage = cs.Function("stage", known, [end * sure for end in ends])

    _, v1, a1 = stage(q, v, motion[:, 0], p, h)
    q_next, v_next, _ = stage(q + (1 - GAMMA) * h * v1, v + (1 - GAMMA) * h * a1, motion[:, 1], p, h)
    return cs.Function("step", [q, v, motion, p, h], [q_next, v_next], [*names, "h"], ["q_next", "v_next"])
