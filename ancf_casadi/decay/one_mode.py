"""The free decay of one mode under linear and quadratic damping, integrated.

    r'' + eta1 r' + eta2 r' |r'| + omega^2 r = 0                                                         Eq. (26)

Eq. (27) solves this to first order in the damping; the integration also holds for strong damping.  Within a step from
t0, with s = t - t0, the motion is described by the undamped oscillation that has its displacement and velocity,

    r = p cos(omega s) + q/omega sin(omega s),    v = r' = -p omega sin(omega s) + q cos(omega s)

    p' = sin(omega s)/omega f,    q' = -cos(omega s) f,    f = eta1 v + eta2 v |v|

so that only the damping changes p and q, and the oscillation itself causes no error.  The classical Runge-Kutta method
of order 4 integrates p and q.  The kink of |v| at each turning point adds an error of about zeta h^4 A of either sign,
with h the step in rad, which dominates.  A decay has about 1/zeta turning points, so that the error is proportional to
zeta^1/2 h^4 A.  Measured for zeta = 0.001 to 0.1 and h = 0.1 to 0.4, the factor is 0.01 in the median and at most 0.07.

A step x_n+1 = g(x_n, c) of the state x depends on c = (omega, eta1, eta2).  The sensitivities S_n = dx_n/du to all
unknowns u = (c, r0, v0) follow

    S_n+1 = dg/dx S_n + dg/dc dc/du,

which is computed along with the state.  This takes a third of the time of general forward differentiation.

References
----------
"Comparison of external damping models in a large deformation problem", Eq. (26).
E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, Springer (1993), Section II.1.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.support.arrays import Array

ERROR = 0.07  # relative to the amplitude, over zeta^1/2 and the fourth power of the step in rad
UNKNOWNS = 5


def one_mode_decay(time: Array, ω: cs.MX, η1: cs.MX, η2: cs.MX, r0: cs.MX, v0: cs.MX, *, longest_step: float) -> cs.MX:
    """Return the free decay under linear and quadratic damping, Eq. (26).

    Parameters
    ----------
    time : ndarray
        Times after the release (m,), s, none negative, in any order.
    ω, η1, η2 : MX
        Natural frequency (rad/s), linear (1/s) and quadratic (1/m) damping coefficient.
    r0, v0 : MX
        Displacement (m) and velocity (m/s) at the release.
    longest_step : float
        Longest integration step, s; with 0.1/omega and a damping ratio of 0.1, the error is at most 2e-6 of
        the amplitude.
    """
    instants, where = np.unique(time, return_inverse=True)
    intervals = np.diff(instants, prepend=0.0)
    counts = np.maximum(1, np.ceil(intervals / longest_step)).astype(int)
    ends = (np.cumsum(counts) - 1)[where].tolist()
    steps, count = cs.DM(np.repeat(intervals / counts, counts)).T, int(counts.sum())
    step = _step()

    x = cs.MX.sym("x", UNKNOWNS)  # ω, η1, η2, r0, v0
    parameters, release = cs.repmat(x[:3], 1, count), x[3:]
    by_x = cs.MX.eye(UNKNOWNS)[3:, :]
    states = step.mapaccum("states", count)(release, steps, parameters)
    sensitive = _sensitive(step).mapaccum("sensitivities", count)(cs.vertcat(release, by_x[:]), steps, parameters)
    jacobian = cs.reshape(sensitive[2::2, ends], UNKNOWNS, len(ends)).T  # of the displacements
    options: dict[str, Any] = {
        "custom_jacobian": cs.Function("jac_one_mode", [x, cs.MX.sym("r", cs.Sparsity(len(ends), 1))], [jacobian]),
        "jac_penalty": 0.0,
        "enable_forward": False,
        "enable_reverse": False,
        "never_inline": True,
    }
    return cs.Function("one_mode", [x], [states[0, ends].T], options)(cs.vertcat(ω, η1, η2, r0, v0))


def longest_step(ω: float, ζ: float, error: float) -> float:
    """Return the step (s) at which the integration has at most a given error relative to the amplitude.

    Parameters
    ----------
    ω, ζ : float
        Natural frequency (rad/s) and damping ratio at the release.
    error : float
        Largest error; the step stays between 0.1 and 0.4 rad.
    """
    turns = ERROR * math.sqrt(max(ζ, 1e-4))  # below this ratio, the kinks no longer dominate the error
    return float(np.clip((error / turns) ** 0.25, 0.1, 0.4) / ω)


def _step() -> cs.Function:
    """Return the Function (state before a step, step, parameters) -> state after it, displacement and velocity."""
    x, h, parameters = cs.SX.sym("x", 2), cs.SX.sym("h"), cs.SX.sym("parameters", 3)
    ω, η1, η2 = cs.vertsplit(parameters)
    half_cosine, half_sine = cs.cos(ω * h / 2), cs.sin(ω * h / 2)
    cosine, sine = half_cosine**2 - half_sine**2, 2 * half_sine * half_cosine

    def derivatives(cosine: cs.SX, sine: cs.SX, z: cs.SX) -> cs.SX:
        v = z[1] * cosine - z[0] * ω * sine
        f = (η1 + η2 * cs.fabs(v)) * v
        return cs.vertcat(sine / ω * f, -cosine * f)

    k1 = derivatives(cs.SX(1), cs.SX(0), x)
    k2 = derivatives(half_cosine, half_sine, x + h / 2 * k1)
    k3 = derivatives(half_cosine, half_sine, x + h / 2 * k2)
    k4 = derivatives(cosine, sine, x + h * k3)
    p, q = cs.vertsplit(x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
    after = cs.vertcat(p * cosine + q / ω * sine, q * cosine - p * ω * sine)
    return cs.Function("step", [x, h, parameters], [after])


def _sensitive(step: cs.Function) -> cs.Function:
    """Return the step of the state and of its sensitivities to ω, η1, η2, r0 and v0, column by column."""
    x, S = cs.SX.sym("x", 2), cs.SX.sym("S", 2, UNKNOWNS)
    h, parameters = cs.SX.sym("h"), cs.SX.sym("parameters", 3)
    after = step(x, h, parameters)
    S_after = cs.mtimes(cs.jacobian(after, x), S) + cs.horzcat(cs.jacobian(after, parameters), cs.SX(2, 2))
    return cs.Function("sensitive", [cs.vertcat(x, S[:]), h, parameters], cs.cse([cs.vertcat(after, S_after[:])]))
