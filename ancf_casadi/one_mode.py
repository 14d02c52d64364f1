"""The free decay of one mode under linear and quadratic damping, integrated.

    r'' + eta1 r' + eta2 r' |r'| + omega^2 r = 0                                                         Eq. (26)

Eq. (27) solves this to first order in the damping; here it is solved itself, also where damping is strong.  Within a
step from t0, s = t - t0, the motion is stated by the free oscillation it is on at each instant,

    r = p cos(omega s) + q/omega sin(omega s),    v = r' = -p omega sin(omega s) + q cos(omega s)

    p' = sin(omega s)/omega f,    q' = -cos(omega s) f,    f = eta1 v + eta2 v |v|

so that p and q change with the damping only, and the oscillation itself costs no accuracy.  They are integrated by the
classical Runge-Kutta method of order 4; the kink of |v| at each turn takes that down to 3 there.

References
----------
"Comparison of external damping models in a large deformation problem", Eq. (26).
E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, Springer (1993), Section II.1.
"""

from __future__ import annotations

import casadi as cs
import numpy as np
from numpy.typing import NDArray


def one_mode_decay(
    time: NDArray[np.float64], ω: cs.MX, η1: cs.MX, η2: cs.MX, r0: cs.MX, v0: cs.MX, *, longest_step: float
) -> cs.MX:
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
        Longest step of the integration, s; 0.1/omega is good to 1e-6 of the amplitude where the damping ratio is 0.1.
    """
    instants, where = np.unique(time, return_inverse=True)
    intervals = np.diff(instants, prepend=0.0)
    counts = np.maximum(1, np.ceil(intervals / longest_step)).astype(int)
    steps = np.repeat(intervals / counts, counts)
    march = _step().mapaccum("march", len(steps))
    states = march(cs.vertcat(r0, v0), cs.DM(steps).T, cs.repmat(cs.vertcat(ω, η1, η2), 1, len(steps)))
    return states[0, (np.cumsum(counts) - 1)[where].tolist()].T


def _step() -> cs.Function:
    """(displacement and velocity, length of the step, parameters) -> displacement and velocity after it."""
    x, h, parameters = cs.SX.sym("x", 2), cs.SX.sym("h"), cs.SX.sym("parameters", 3)
    ω, η1, η2 = cs.vertsplit(parameters)

    def rates(s: cs.SX, z: cs.SX) -> cs.SX:
        v = z[1] * cs.cos(ω * s) - z[0] * ω * cs.sin(ω * s)
        f = η1 * v + η2 * v * cs.fabs(v)
        return cs.vertcat(cs.sin(ω * s) / ω * f, -cs.cos(ω * s) * f)

    k1 = rates(cs.SX(0), x)
    k2 = rates(h / 2, x + h / 2 * k1)
    k3 = rates(h / 2, x + h / 2 * k2)
    k4 = rates(h, x + h * k3)
    p, q = cs.vertsplit(x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
    cosine, sine = cs.cos(ω * h), cs.sin(ω * h)
    after = cs.vertcat(p * cosine + q / ω * sine, q * cosine - p * ω * sine)
    return cs.Function("step", [x, h, parameters], [after])
