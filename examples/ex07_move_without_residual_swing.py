"""
A move without residual swing
=============================

Shooting and IPOPT find a base motion that moves a hanging strip 0.1 m sideways in 0.9 s and leaves it at rest.

The base follows x = 0.1 m (t'^3 (10 - 15 t' + 6 t'^2) + t'^4 (1 - t')^4 c(t')), t' = t/0.9 s: a smooth step with four
free coefficients in c.  The exported time step integrates the motion.  IPOPT minimises the mean square acceleration of
the base under the condition that the first mode is at rest at the end.  ``simulate`` then checks the result
independently: the residual swing is tens of times smaller than after the smooth step alone.
"""

import math
from dataclasses import dataclass

import casadi as cs
import numpy as np

from ancf_casadi import BaseMotion, Beam, Model, RayleighDamping, natural_modes, simulate
from ancf_casadi.dynamics.base_motion import Piece
from ancf_casadi.export import beam_functions, values
from ancf_casadi.export.solved_functions import SDIRK_STAGES

DISTANCE, TIME, STEPS, COEFFICIENTS = 0.1, 0.9, 120, 4  # m, s


def position(t, c):
    """Displacement of the base, m."""
    s = t / TIME
    more = sum(c[k] * cs.cos(math.pi * k * s) for k in range(COEFFICIENTS))
    return DISTANCE * (s**3 * (10 - 15 * s + 6 * s**2) + 256 * (s * (1 - s)) ** 4 * more)


@dataclass(frozen=True)
class PlannedBase(BaseMotion):
    """The motion with the given coefficients, then the hold."""

    coefficients: tuple[float, ...]

    def pieces(self):
        """Return the motion and the hold."""
        c = self.coefficients
        return (
            Piece(TIME, lambda t, p: cs.vertcat(position(t, c), 0.0, 0.0)),
            Piece(math.inf, lambda t, p: cs.MX(cs.DM([DISTANCE, 0.0, 0.0]))),
        )


beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9, elements=4)
model, damping = Model(beam), RayleighDamping(beta=1e-5)
functions = beam_functions(model, damping, modes=1)
p, start = values(functions.parameters), values(functions.states)

# input of the time step: displacement, rotation, velocities and accelerations of the base at its stages
t, c = cs.SX.sym("t"), cs.SX.sym("c", COEFFICIENTS)
x = position(t, c)
x_t = cs.jacobian(x, t)
x_tt = cs.jacobian(x_t, t)
clamp = cs.Function("clamp", [t, c], [cs.vertcat(x, 0, 0, x_t, 0, 0, x_tt, 0, 0)])

# final state as a Function of the coefficients
h = TIME / STEPS
state, base = cs.MX.sym("state", start.size), cs.MX.sym("base", 9, len(SDIRK_STAGES))
following = functions.step(*cs.vertsplit(state, functions.free), base, p, h)
march = cs.Function("march", [state, base], [cs.vertcat(*following)]).mapaccum(STEPS)
c = cs.MX.sym("c", COEFFICIENTS)
motion = cs.horzcat(*(clamp((k + stage) * h, c) for k in range(STEPS) for stage in SDIRK_STAGES))
end = march(start, motion)[:, -1]

# condition: the first mode is at rest about the beam moved by the distance
modes = natural_modes(model, count=1)
mass = model.mass(model.properties).sparse()[4:, 4:]
projector = cs.DM(modes.shapes[4:].T @ mass) / modes.tip_amplitudes().max()
carried = start + DISTANCE * np.tile([1.0, 0.0, 0.0, 0.0], 2 * beam.elements)
carried[functions.free :] = 0.0
swing = cs.vertcat(*(projector @ part for part in cs.vertsplit(end - carried, functions.free)))
effort = cs.sumsqr(motion[6, :]) / motion.shape[1]

sigma, multipliers, none = cs.MX.sym("sigma"), cs.MX.sym("multipliers", swing.numel()), cs.MX.sym("none", 0)
hessian = cs.Function("hessian", [c, none, sigma, multipliers], [cs.triu(sigma * cs.hessian(effort, c)[0])])
options = {"hess_lag": hessian, "print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-6}
solver = cs.nlpsol("solver", "ipopt", {"x": c, "f": effort, "g": swing}, options)
solution = solver(x0=0.0, lbg=0.0, ubg=0.0)

planned = PlannedBase(tuple(solution["x"].full().ravel().tolist()))
plain = PlannedBase((0.0,) * COEFFICIENTS)
runs = [simulate(model, damping=damping, base=base, duration=TIME + 1.0) for base in (plain, planned)]
swings = [float(np.ptp(run.tip[run.time >= TIME, 0])) for run in runs]

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    print("coefficients", *(f"{value:.4f}" for value in planned.coefficients))
    print(f"residual swing of the tip: {1e3 * swings[0]:.2f} mm (smooth step), {1e3 * swings[1]:.4f} mm (optimised)")
    for run, label in zip(runs, ("smooth step", "optimised"), strict=True):
        plt.plot(run.time, 1e3 * (run.tip[:, 0] - run.position(0.0)[:, 0]), label=label)
    plt.axvline(TIME, color="gray", linestyle=":", label="end of the motion of the base")
    plt.gca().set(xlabel="time, s", ylabel="tip relative to base, mm")
    plt.legend()
    plt.show()
