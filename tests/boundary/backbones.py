"""Free vibration of beams whose ends cannot move, computed for the reference cases.

Each function returns the numbers of the case of its name in ``references.json``, in the same order.  A load like the
lowest symmetric modes bends the beam, which is then released.  Its motion is periodic if all modes pass through rest
at the same instant, a quarter of a period later.
"""

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import fsolve

from ancf_casadi import Clamp, Model, Pin, PointLoad, natural_modes, simulate, static_equilibrium
from tests.boundary.unit_beam import AXIAL, unit_beam


def hardening(ends, n, ratios):
    """Return omega of mode 1 over that of small motion, for amplitudes at the centre in radii of gyration."""
    model = Model(unit_beam(n, supports=(ends(0.0), ends(1.0))))
    modes = natural_modes(model, count=5)
    slow, points = modes.angular_frequencies[0], [k / n for k in range(1, n)]
    symmetric = [0, 2, 4]
    patterns = modes.angular_frequencies[symmetric] ** 2 * modes.along(points)[symmetric, :, 1].T / n

    def released(sizes):
        """Return amplitude and quarter of a period, and the coordinates of the other modes at its end."""
        loads = [PointLoad((0.0, force), point=s) for force, s in zip(patterns @ sizes, points, strict=True)]
        start = static_equilibrium(model, loads=loads)
        run = simulate(model, start=start, duration=1.7 / slow, sample_rate=100 * slow)
        moved = [CubicSpline(run.time, modes.modal_coordinate(run.coordinates, k)) for k in symmetric]
        quarter = moved[0].roots(extrapolate=False)[0]
        return start.position(0.5)[1], quarter, *(float(curve(quarter)) for curve in moved[1:])

    found, unit = [], np.zeros(3)
    for ratio in ratios:
        amplitude = ratio / np.sqrt(AXIAL)

        def unbalance(sizes, amplitude=amplitude):
            reached, _, *others = released(sizes * amplitude)
            return np.array([reached / amplitude - 1, *(q / amplitude for q in others)])

        unit = fsolve(unbalance, np.array([1 + ratio**2 / 4, 0.0, 0.0]), xtol=1e-6, epsfcn=1e-6)
        found.append(np.pi / 2 / released(unit * amplitude)[1] / slow)
    return found


def backbone_pp(n):
    return hardening(Pin, n, (0.5, 1.0, 2.0, 3.0, 5.0))


def backbone_cc(n):
    return hardening(Clamp, n, (0.5, 1.0, 1.5))
