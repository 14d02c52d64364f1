"""Identification of damping and properties of very flexible beams, and simulation of their large motion."""

from typing import TYPE_CHECKING

from ancf_casadi.support.lazy import lazy_exports
from ancf_casadi.version import __version__ as __version__

if TYPE_CHECKING:
    from ancf_casadi.animation.footage import Footage as Footage
    from ancf_casadi.damping import DampingLaw as DampingLaw
    from ancf_casadi.damping import FrictionDamping as FrictionDamping
    from ancf_casadi.damping import ModalDamping as ModalDamping
    from ancf_casadi.damping import Parameter as Parameter
    from ancf_casadi.damping import QuadraticDamping as QuadraticDamping
    from ancf_casadi.damping import RayleighDamping as RayleighDamping
    from ancf_casadi.damping import ViscoelasticDamping as ViscoelasticDamping
    from ancf_casadi.decay.envelope import DampingCurve as DampingCurve
    from ancf_casadi.decay.envelope import LawCurve as LawCurve
    from ancf_casadi.decay.envelope import damping_curve as damping_curve
    from ancf_casadi.decay.release import separate_takes as separate_takes
    from ancf_casadi.dynamics.base_motion import BaseMotion as BaseMotion
    from ancf_casadi.dynamics.base_motion import FixedBase as FixedBase
    from ancf_casadi.dynamics.base_motion import HarmonicBase as HarmonicBase
    from ancf_casadi.dynamics.base_motion import SampledBase as SampledBase
    from ancf_casadi.dynamics.base_motion import SweepBase as SweepBase
    from ancf_casadi.dynamics.damped_modes import CriticalLoad as CriticalLoad
    from ancf_casadi.dynamics.damped_modes import DampedModes as DampedModes
    from ancf_casadi.dynamics.damped_modes import critical_load as critical_load
    from ancf_casadi.dynamics.damped_modes import damped_modes as damped_modes
    from ancf_casadi.dynamics.derivatives.differentiable import motion as motion
    from ancf_casadi.dynamics.simulation import simulate as simulate
    from ancf_casadi.dynamics.tip_load import HarmonicLoad as HarmonicLoad
    from ancf_casadi.dynamics.tip_load import MovingForce as MovingForce
    from ancf_casadi.dynamics.tip_load import SampledLoad as SampledLoad
    from ancf_casadi.dynamics.tip_load import TipLoad as TipLoad
    from ancf_casadi.dynamics.trajectory import Trajectory as Trajectory
    from ancf_casadi.exceptions import AncfError as AncfError
    from ancf_casadi.exceptions import ContinuationError as ContinuationError
    from ancf_casadi.exceptions import EquilibriumError as EquilibriumError
    from ancf_casadi.exceptions import FitError as FitError
    from ancf_casadi.exceptions import InputError as InputError
    from ancf_casadi.exceptions import NumericsError as NumericsError
    from ancf_casadi.exceptions import SimulationError as SimulationError
    from ancf_casadi.mechanics.attachments import Attachment as Attachment
    from ancf_casadi.mechanics.attachments import Dashpot as Dashpot
    from ancf_casadi.mechanics.attachments import PointMass as PointMass
    from ancf_casadi.mechanics.attachments import RotationalSpring as RotationalSpring
    from ancf_casadi.mechanics.attachments import Spring as Spring
    from ancf_casadi.mechanics.beam import Beam as Beam
    from ancf_casadi.mechanics.loads import LineLoad as LineLoad
    from ancf_casadi.mechanics.loads import PointLoad as PointLoad
    from ancf_casadi.mechanics.model import Model as Model
    from ancf_casadi.mechanics.section import Section as Section
    from ancf_casadi.mechanics.state import State as State
    from ancf_casadi.mechanics.strain import StrainMeasures as StrainMeasures
    from ancf_casadi.mechanics.supports import Clamp as Clamp
    from ancf_casadi.mechanics.supports import Guide as Guide
    from ancf_casadi.mechanics.supports import Pin as Pin
    from ancf_casadi.mechanics.supports import Roller as Roller
    from ancf_casadi.mechanics.supports import Support as Support
    from ancf_casadi.records.channel import Recording as Recording
    from ancf_casadi.records.layout import TableLayout as TableLayout
    from ancf_casadi.records.measurement import Measurement as Measurement
    from ancf_casadi.records.recording import read_recording as read_recording
    from ancf_casadi.records.sensor import Sensor as Sensor
    from ancf_casadi.records.video.recording import track_video as track_video
    from ancf_casadi.reduction import ReducedModel as ReducedModel
    from ancf_casadi.reduction import ReducedTrajectory as ReducedTrajectory
    from ancf_casadi.reduction import reduce_model as reduce_model
    from ancf_casadi.reduction import simulate_reduced as simulate_reduced
    from ancf_casadi.response.backbone import Backbone as Backbone
    from ancf_casadi.response.backbone import backbone as backbone
    from ancf_casadi.response.curve import ResponseCurve as ResponseCurve
    from ancf_casadi.response.differentiable import motion_function as motion_function
    from ancf_casadi.response.harmonic_balance.system import HarmonicForce as HarmonicForce
    from ancf_casadi.response.harmonic_balance.system import SecondOrderSystem as SecondOrderSystem
    from ancf_casadi.response.linear_frf import LinearFrf as LinearFrf
    from ancf_casadi.response.linear_frf import linear_frf as linear_frf
    from ancf_casadi.response.onset import periodic_motion as periodic_motion
    from ancf_casadi.response.periodic import PeriodicMotion as PeriodicMotion
    from ancf_casadi.response.tracing import amplitude_response as amplitude_response
    from ancf_casadi.response.tracing import frequency_response as frequency_response
    from ancf_casadi.response.tracing import parameter_response as parameter_response
    from ancf_casadi.support.parallel import run_all as run_all
    from ancf_casadi.vibration.equilibrium import Equilibrium as Equilibrium
    from ancf_casadi.vibration.modes import Modes as Modes
    from ancf_casadi.vibration.modes import mac as mac
    from ancf_casadi.vibration.modes import natural_modes as natural_modes
    from ancf_casadi.vibration.paths import CriticalPoint as CriticalPoint
    from ancf_casadi.vibration.paths import EquilibriumPath as EquilibriumPath
    from ancf_casadi.vibration.paths import equilibrium_path as equilibrium_path
    from ancf_casadi.vibration.statics import static_equilibrium as static_equilibrium
else:
    __getattr__, __dir__, __all__ = lazy_exports(__name__)
