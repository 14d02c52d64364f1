"""Estimation problems of the paper and related ones, stated with the tools of ``ancf_casadi``."""

from typing import TYPE_CHECKING

from ancf_casadi.support.lazy import on_first_use

if TYPE_CHECKING:
    from ancf_casadi.estimation.comparison import LawComparison
    from ancf_casadi.estimation.posterior.log_density import LogDensity
    from ancf_casadi.estimation.posterior.sampling import corner_figure
    from ancf_casadi.estimation.prediction import RecordPrediction
    from ancf_casadi.estimation.resampling import MonteCarlo, monte_carlo
    from ancf_casadi.estimation.saved import SavedFit, load_fit
    from problems.beam.curves.record import ResponseRecord
    from problems.beam.fitting import compare_laws, fit_beam
    from problems.beam.motions.marker_record import MarkerRecord
    from problems.beam.motions.record import Camera, Channel, MotionRecord
    from problems.beam.result import BeamFit
    from problems.beam.values.records import FrequencyRecord, StaticRecord
    from problems.decay.comparison import compare_decay_laws
    from problems.decay.fitting import fit_decay, fit_decays
    from problems.decay.law_curve import amplitude_table, law_curve
    from problems.decay.mode_separation import IsolatedMode, fit_modes, isolate_mode
    from problems.decay.result import DecayFit
    from problems.decay.takes import DecayFits, DecayModes
    from problems.frf.fitting import fit_frf
    from problems.frf.record import FrfRecord
    from problems.frf.result import FrfFit
    from problems.matching.design_space import LeastChange, Smoothness
    from problems.matching.frequency_matching import match_frequencies
    from problems.matching.measured_modes import MeasuredModes
    from problems.matching.result import FrequencyMatch
    from problems.matching.unknowns import Global, PerElement, Smooth
    from problems.modal_damping.rayleigh import RayleighFit, fit_rayleigh
    from problems.mode.fitting import fit_mode
    from problems.mode.result import ModeFit
    from problems.paper.reproduce import reproduce
    from problems.planning.comparison import PlannedComparison, plan_comparison
    from problems.planning.experiments import plan
    from problems.planning.record import PlannedRecord
    from problems.planning.result import Plan
    from problems.study.study import StudyReport, run_study
else:
    __getattr__, __dir__ = on_first_use(__name__)

__all__ = [
    "BeamFit",
    "Camera",
    "Channel",
    "DecayFit",
    "DecayFits",
    "DecayModes",
    "FrequencyMatch",
    "FrequencyRecord",
    "FrfFit",
    "FrfRecord",
    "Global",
    "IsolatedMode",
    "LawComparison",
    "LeastChange",
    "LogDensity",
    "MarkerRecord",
    "MeasuredModes",
    "ModeFit",
    "MonteCarlo",
    "MotionRecord",
    "PerElement",
    "Plan",
    "PlannedComparison",
    "PlannedRecord",
    "RayleighFit",
    "RecordPrediction",
    "ResponseRecord",
    "SavedFit",
    "Smooth",
    "Smoothness",
    "StaticRecord",
    "StudyReport",
    "amplitude_table",
    "compare_decay_laws",
    "compare_laws",
    "corner_figure",
    "fit_beam",
    "fit_decay",
    "fit_decays",
    "fit_frf",
    "fit_mode",
    "fit_modes",
    "fit_rayleigh",
    "isolate_mode",
    "law_curve",
    "load_fit",
    "match_frequencies",
    "monte_carlo",
    "plan",
    "plan_comparison",
    "reproduce",
    "run_study",
]
