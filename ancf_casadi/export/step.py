"""One step of time as a Function: for programs that have no integrator, and for C.

The method is Alexander's, singly diagonally implicit, of order 2, L-stable (what is too fast for the step dies down)
and stiffly accurate.  With g = 1 - 1/2^(1/2), its two stages at the times g h and h solve one after the other

    r(q_i, v_i, a_i) = 0,    v_i = v^ + g h a_i,    q_i = q^ + g h v_i,
    q^ = q, v^ = v  (i = 1),        q^ = q + (1 - g) h v_1, v^ = v + (1 - g) h a_1  (i = 2),

and the second is the end of the step.  The unknown is the change x of q_i = q^ + g h v^ + c x, in which c, like the
scale of the equations, comes from diag(M/(g h)^2 + K) of the model.  Where Newton's method does not converge the result
is nan.

References
----------
R. Alexander, Diagonally implicit Runge-Kutta methods for stiff O.D.E.'s, SIAM Journal on Numerical Analysis 14 (1977).
"""

from __future__ import annotations

import math

import casadi as cs

from ancf_casadi.export.statics import NEWTON, certain
from ancf_casadi.modes import Modes

GAMMA = 1 - 1 / math.sqrt(2)
STAGES = (GAMMA, 1.0)  # where the base motion is asked for, in steps
BALANCED = 1e-8  # what may be left of the scaled equations


def step_function(residual: cs.Function, modes: Modes) -> cs.Function:
    """Return (q, v, base, p, h) -> q_next, v_next.

    Parameters
    ----------
    residual : Function
        (q, v, a, base, p) -> r.
    modes : Modes
        Of the model, at its equilibrium.
    """
    model = modes.model
    mass = model.mass(model.properties)[model.free, model.free]
    names = ("q", "v", "base", "p")
    q, v, base, p = (cs.MX.sym(name, residual.size1_in(name)) for name in names)
    h, x, motion = cs.MX.sym("h"), cs.MX.sym("x", q.numel()), cs.MX.sym("base", base.numel(), len(STAGES))
    scale = 1 / cs.sqrt(cs.diag(mass) / (GAMMA * h) ** 2 + cs.DM(modes.equilibrium.stiffness.diagonal()))
    shift = model.beam.length * scale / cs.mmax(scale)

    v_new = v + shift * x / (GAMMA * h)
    q_new = q + GAMMA * h * v + shift * x
    a_new = shift * x / (GAMMA * h) ** 2
    unbalance = residual(q_new, v_new, a_new, base, p) * scale**2 / shift
    equations = cs.Function("unbalance", [x, q, v, base, p, h], [unbalance])
    newton = cs.rootfinder("stage_newton", "fast_newton", equations, NEWTON)
    found = newton(cs.MX.zeros(x.numel()), q, v, base, p, h)
    sure = certain(cs.norm_inf(equations(found, q, v, base, p, h)) < BALANCED)
    ends = [cs.graph_substitute(end, [x], [found]) * sure for end in (q_new, v_new, a_new)]
    stage = cs.Function("stage", [q, v, base, p, h], ends)

    _, v1, a1 = stage(q, v, motion[:, 0], p, h)
    q_next, v_next, _ = stage(q + (1 - GAMMA) * h * v1, v + (1 - GAMMA) * h * a1, motion[:, 1], p, h)
    return cs.Function("step", [q, v, motion, p, h], [q_next, v_next], [*names, "h"], ["q_next", "v_next"])
