"""A small model of the beam, made from the full one: a few bending modes, fast enough for real time."""

from ancf_casadi.reduction.reduced import ReducedModel, reduce_model
from ancf_casadi.reduction.stepping import ReducedTrajectory, simulate_reduced

__all__ = ["ReducedModel", "ReducedTrajectory", "reduce_model", "simulate_reduced"]
