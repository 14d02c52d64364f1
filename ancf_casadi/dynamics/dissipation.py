"""Check that a damping law has taken energy out of a motion.

The power lost to damping is e_t . Q_damp.  It is never negative under the laws of the toolkit, with one exception:
damping by the tangent stiffness K loses

    beta e_t^T K e_t,

which is negative if K is indefinite in the direction of motion: when a beam buckles, or falls from an unstable
position, this law drives the motion.
"""

from __future__ import annotations

import warnings

import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.trajectory import Trajectory


def warn_of_energy_gain(run: Trajectory, law: DampingLaw) -> None:
    """Warn if the damping law has added more energy to a motion than the error of the energy balance.

    Parameters
    ----------
    run : Trajectory
        The motion.
    law : DampingLaw
        Its damping law.
    """
    lost = run.dissipated_energy
    gained = np.maximum.accumulate(lost) - lost
    if law.dissipative or not gained.any() or gained.max() <= np.abs(run.balance_error).max():
        return
    end = int(gained.argmax())
    begin = int(lost[: end + 1].argmax())
    warnings.warn(
        f"damping added {gained[end]:.2g} J to the motion from {run.time[begin]:g} s to {run.time[end]:g} s: the "
        "tangent stiffness is indefinite there, as in a beam that buckles; use RayleighDamping(..., "
        "stiffness='strain-rate'), which never adds energy",
        stacklevel=3,
    )
