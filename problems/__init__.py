"""Estimation problems of the paper and related ones, stated with the tools of ``ancf_casadi``."""

from typing import TYPE_CHECKING

from ancf_casadi.support.lazy import lazy_exports

if TYPE_CHECKING:
    from ancf_casadi.estimation.comparison import LawComparison as LawComparison
    from ancf_casadi.estimation.posterior.log_density import LogDensity as LogDensity
    from ancf_casadi.estimation.posterior.sampling import corner_figure as corner_figure
    from ancf_casadi.estimation.prediction import RecordPrediction as RecordPrediction
    from ancf_casadi.estimation.resampling import MonteCarlo as MonteCarlo
    from ancf_casadi.estimation.resampling import monte_carlo as monte_carlo
    from ancf_casadi.estimation.saved import SavedFit as SavedFit
    from ancf_casadi.estimation.saved import load_fit as load_fit
    from problems.beam.curves.record import ResponseRecord as ResponseRecord
    from problems.beam.fitting import compare_laws as compare_laws
    from problems.beam.fitting import fit_beam as fit_beam
    from problems.beam.fitting import fit_transient as fit_transient
    from problems.beam.motions.marker_record import MarkerRecord as MarkerRecord
    from problems.beam.motions.record import Camera as Camera
    from problems.beam.motions.record import Channel as Channel
    from problems.beam.motions.record import MotionRecord as MotionRecord
    from problems.beam.result import BeamFit as BeamFit
    from problems.beam.values.records import FrequencyRecord as FrequencyRecord
    from problems.beam.values.records import StaticRecord as StaticRecord
    from problems.decay.amplitudes import AmplitudeFit as AmplitudeFit
    from problems.decay.comparison import compare_decay_laws as compare_decay_laws
    from problems.decay.fitting import fit_decay as fit_decay
    from problems.decay.fitting import fit_decays as fit_decays
    from problems.decay.law_curve import amplitude_table as amplitude_table
    from problems.decay.law_curve import law_curve as law_curve
    from problems.decay.mode_separation import IsolatedMode as IsolatedMode
    from problems.decay.mode_separation import fit_modes as fit_modes
    from problems.decay.mode_separation import isolate_mode as isolate_mode
    from problems.decay.result import DecayFit as DecayFit
    from problems.decay.takes import DecayFits as DecayFits
    from problems.decay.takes import DecayModes as DecayModes
    from problems.frf.estimators import frf_of as frf_of
    from problems.frf.fitting import fit_frf as fit_frf
    from problems.frf.record import FrfRecord as FrfRecord
    from problems.frf.result import FrfFit as FrfFit
    from problems.matching.design_space import LeastChange as LeastChange
    from problems.matching.design_space import Smoothness as Smoothness
    from problems.matching.frequency_matching import match_frequencies as match_frequencies
    from problems.matching.measured_modes import MeasuredModes as MeasuredModes
    from problems.matching.result import FrequencyMatch as FrequencyMatch
    from problems.matching.unknowns import Global as Global
    from problems.matching.unknowns import PerElement as PerElement
    from problems.matching.unknowns import Smooth as Smooth
    from problems.modal_damping.rayleigh import RayleighFit as RayleighFit
    from problems.modal_damping.rayleigh import fit_rayleigh as fit_rayleigh
    from problems.mode.fitting import fit_mode as fit_mode
    from problems.mode.result import ModeFit as ModeFit
    from problems.paper.reproduce import reproduce as reproduce
    from problems.planning.comparison import PlannedComparison as PlannedComparison
    from problems.planning.comparison import plan_comparison as plan_comparison
    from problems.planning.experiments import plan as plan
    from problems.planning.record import PlannedRecord as PlannedRecord
    from problems.planning.result import Plan as Plan
    from problems.study.study import StudyReport as StudyReport
    from problems.study.study import run_study as run_study
else:
    __getattr__, __dir__, __all__ = lazy_exports(__name__)
