"""Reduced model of the beam: a few bending modes, fast enough for real time.

The full model has a stiff axial direction, whose waves limit the steps of an explicit integrator.  The reduced model
bends in the lowest modes of the full beam and does not stretch.  Its equation of motion M(q) q_tt = -h(q, q_t, base, p)
is the full one, Eq. (6) with the damping forces of Eqs. (14), (23) and (32), projected on these bending motions.  The
steps of the theory: ``projection`` (shapes and constants of the full model), ``forces`` (terms of the equation of
motion), ``reduced`` (CasADi Functions) and ``stepping`` (time integration).
"""

from ancf_casadi.reduction.reduced import ReducedModel, reduce_model
from ancf_casadi.reduction.stepping import ReducedTrajectory, simulate_reduced

__all__ = ["ReducedModel", "ReducedTrajectory", "reduce_model", "simulate_reduced"]
