"""Check that a damping law has taken energy out of a motion.

The power lost to damping is e_t . Q_damp.  Under all laws of the toolkit but one it is never negative.  Damping by the
tangent stiffness K loses

    beta e_t^T K e_t,

which is negative along a direction in which K is: where a beam buckles, or falls from an unstable position, the law
then drives the motion.
"""

from __future__ import annotations

import warnings

import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.trajectory import Trajectory


def warn_of_energy_gain(run: Trajectory, law: DampingLaw) -> None:
    """Warn if the damping law has added energy: more than the error of the energy balance.

    Parameters
    ----------
    run : Trajectory
        The motion.
    law : DampingLaw
        The law it was computed with.
    """
    lost = run.dissipated_energy
    gained = np.maximum.accumulate(lost) - lost
    if law.dissipative or not gained.any() or gained.max() <= np.abs(run.balance_error).max():
        return
    end = int(gained.argmax())
    begin = int(lost[: end + 1].argmax())
    warnings.warn(
        f"damping added {gained[end]:.2g} J to the motion from {run.time[begin]:g} s to {run.time[end]:g} s: the "
        "tangent stiffness is indefinite there, as where a beam buckles; use RayleighDamping(..., "
        "stiffness='strain-rate'), which takes energy out of every motion",
        stacklevel=3,
    )
