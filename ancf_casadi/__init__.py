"""Damping and property identification, and large-motion simulation, of very flexible beams."""

from ancf_casadi.beam import Beam, Section
from ancf_casadi.damping import DampingLaw, ModalDamping, QuadraticDamping, RayleighDamping
from ancf_casadi.differentiable import motion
from ancf_casadi.element import StrainMeasures
from ancf_casadi.equilibrium import Equilibrium, static_equilibrium
from ancf_casadi.exceptions import (
    AncfError,
    EquilibriumError,
    FitError,
    InputError,
    NumericsError,
    SimulationError,
)
from ancf_casadi.excitation import BaseMotion, FixedBase, HarmonicBase, SampledBase, SweepBase
from ancf_casadi.measurement import Measurement
from ancf_casadi.model import Model
from ancf_casadi.modes import Modes, modal_assurance, natural_modes
from ancf_casadi.parallel import run_all
from ancf_casadi.reduction import ReducedModel, ReducedTrajectory, reduce_model, simulate_reduced
from ancf_casadi.simulate import simulate
from ancf_casadi.trajectory import State, Trajectory
from ancf_casadi.version import __version__

__all__ = [
    "AncfError",
    "BaseMotion",
    "Beam",
    "DampingLaw",
    "Equilibrium",
    "EquilibriumError",
    "FitError",
    "FixedBase",
    "HarmonicBase",
    "InputError",
    "Measurement",
    "ModalDamping",
    "Model",
    "Modes",
    "NumericsError",
    "QuadraticDamping",
    "RayleighDamping",
    "ReducedModel",
    "ReducedTrajectory",
    "SampledBase",
    "Section",
    "SimulationError",
    "State",
    "StrainMeasures",
    "SweepBase",
    "Trajectory",
    "__version__",
    "modal_assurance",
    "motion",
    "natural_modes",
    "reduce_model",
    "run_all",
    "simulate",
    "simulate_reduced",
    "static_equilibrium",
]
