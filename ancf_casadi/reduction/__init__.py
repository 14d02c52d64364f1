"""Reduced model of the beam: a few bending modes, fast enough for real time.

The full model has a stiff axial direction, whose waves limit the steps of an explicit integrator.  The reduced model
bends in the lowest modes of the full beam.  Its equation of motion M(q) q_tt = -h(q, q_t, base, p) is the full one,
Eq. (6) with the damping forces of Eqs. (14), (23) and (32), projected on these motions.

A beam that one clamp or pin holds at its beginning does not stretch, and may bend far (``bending``).  A beam that
supports hold at more places, or that may slide, stretches as it bends; its shapes are quadratic functions of the modal
coordinates, for moderate amplitudes (``condensed``).  Both have the same forces (``forces``), CasADi Functions
(``reduced``) and time integration (``stepping``).
"""

from ancf_casadi.reduction.reduced import ReducedModel, reduce_model
from ancf_casadi.reduction.stepping import ReducedTrajectory, simulate_reduced

__all__ = ["ReducedModel", "ReducedTrajectory", "reduce_model", "simulate_reduced"]
