"""Identification of damping and properties of very flexible beams, and simulation of their large motion."""

from typing import TYPE_CHECKING

from ancf_casadi.support.lazy import on_first_use
from ancf_casadi.version import __version__

if TYPE_CHECKING:
    from ancf_casadi.animation.footage import Footage
    from ancf_casadi.damping import (
        DampingLaw,
        FrictionDamping,
        ModalDamping,
        Parameter,
        QuadraticDamping,
        RayleighDamping,
    )
    from ancf_casadi.decay.envelope import DampingCurve, LawCurve, damping_curve
    from ancf_casadi.dynamics.base_motion import BaseMotion, FixedBase, HarmonicBase, SampledBase, SweepBase
    from ancf_casadi.dynamics.damped_modes import CriticalLoad, DampedModes, critical_load, damped_modes
    from ancf_casadi.dynamics.derivatives.differentiable import motion
    from ancf_casadi.dynamics.simulation import simulate
    from ancf_casadi.dynamics.tip_load import HarmonicLoad, MovingForce, SampledLoad, TipLoad
    from ancf_casadi.dynamics.trajectory import State, Trajectory
    from ancf_casadi.exceptions import (
        AncfError,
        ContinuationError,
        EquilibriumError,
        FitError,
        InputError,
        NumericsError,
        SimulationError,
    )
    from ancf_casadi.mechanics.attachments import Attachment, Dashpot, PointMass, RotationalSpring, Spring
    from ancf_casadi.mechanics.beam import Beam
    from ancf_casadi.mechanics.loads import LineLoad, PointLoad
    from ancf_casadi.mechanics.model import Model
    from ancf_casadi.mechanics.section import Section
    from ancf_casadi.mechanics.strain import StrainMeasures
    from ancf_casadi.mechanics.supports import Clamp, Guide, Pin, Roller, Support
    from ancf_casadi.records.measurement import Measurement
    from ancf_casadi.records.recording import Recording, read_recording
    from ancf_casadi.records.sensor import Sensor
    from ancf_casadi.records.video.recorded import track_video
    from ancf_casadi.reduction import ReducedModel, ReducedTrajectory, reduce_model, simulate_reduced
    from ancf_casadi.response.backbone import Backbone, backbone
    from ancf_casadi.response.curve import ResponseCurve
    from ancf_casadi.response.differentiable import motion_function
    from ancf_casadi.response.harmonic_balance.system import HarmonicForce, SecondOrderSystem
    from ancf_casadi.response.linear_frf import LinearFrf, linear_frf
    from ancf_casadi.response.onset import periodic_motion
    from ancf_casadi.response.periodic import PeriodicMotion
    from ancf_casadi.response.tracing import amplitude_response, frequency_response, parameter_response
    from ancf_casadi.support.parallel import run_all
    from ancf_casadi.vibration.equilibrium import Equilibrium, static_equilibrium
    from ancf_casadi.vibration.modes import Modes, mac, natural_modes
    from ancf_casadi.vibration.paths import CriticalPoint, EquilibriumPath, equilibrium_path
else:
    __getattr__, __dir__ = on_first_use(__name__)

__all__ = [
    "AncfError",
    "Attachment",
    "Backbone",
    "BaseMotion",
    "Beam",
    "Clamp",
    "ContinuationError",
    "CriticalLoad",
    "CriticalPoint",
    "DampedModes",
    "DampingCurve",
    "DampingLaw",
    "Dashpot",
    "Equilibrium",
    "EquilibriumError",
    "EquilibriumPath",
    "FitError",
    "FixedBase",
    "Footage",
    "FrictionDamping",
    "Guide",
    "HarmonicBase",
    "HarmonicForce",
    "HarmonicLoad",
    "InputError",
    "LawCurve",
    "LineLoad",
    "LinearFrf",
    "Measurement",
    "ModalDamping",
    "Model",
    "Modes",
    "MovingForce",
    "NumericsError",
    "Parameter",
    "PeriodicMotion",
    "Pin",
    "PointLoad",
    "PointMass",
    "QuadraticDamping",
    "RayleighDamping",
    "Recording",
    "ReducedModel",
    "ReducedTrajectory",
    "ResponseCurve",
    "Roller",
    "RotationalSpring",
    "SampledBase",
    "SampledLoad",
    "SecondOrderSystem",
    "Section",
    "Sensor",
    "SimulationError",
    "Spring",
    "State",
    "StrainMeasures",
    "Support",
    "SweepBase",
    "TipLoad",
    "Trajectory",
    "__version__",
    "amplitude_response",
    "backbone",
    "critical_load",
    "damped_modes",
    "damping_curve",
    "equilibrium_path",
    "frequency_response",
    "linear_frf",
    "mac",
    "motion",
    "motion_function",
    "natural_modes",
    "parameter_response",
    "periodic_motion",
    "read_recording",
    "reduce_model",
    "run_all",
    "simulate",
    "simulate_reduced",
    "static_equilibrium",
    "track_video",
]
