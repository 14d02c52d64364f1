"""A small model of the beam, made from the full one: a few bending modes, fast enough for real time."""

from ancf_casadi.reduction.motion import ReducedTrajectory, simulate_reduced
from ancf_casadi.reduction.reduced import ReducedModel, reduce_model

__all__ = ["ReducedModel", "ReducedTrajectory", "reduce_model", "simulate_reduced"]
