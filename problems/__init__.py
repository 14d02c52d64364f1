"""Estimation problems of the paper and related ones, stated with the tools of ``ancf_casadi``."""

from typing import TYPE_CHECKING

from ancf_casadi.support.lazy import on_first_use

if TYPE_CHECKING:
    from ancf_casadi.estimation.comparison import LawComparison
    from ancf_casadi.estimation.resampling import MonteCarlo, monte_carlo
    from problems.decay.band import IsolatedMode, isolate_mode
    from problems.decay.comparison import compare_decay_laws
    from problems.decay.fitting import fit_decay, fit_decays
    from problems.decay.law_curve import law_curve
    from problems.decay.mode_separation import fit_modes
    from problems.decay.proportional import RayleighFit, fit_rayleigh
    from problems.decay.result import DecayFit
    from problems.decay.takes import DecayFits
    from problems.frf.fitting import fit_frf
    from problems.frf.record import FrfRecord
    from problems.frf.result import FrfFit
    from problems.matching.frequency_matching import match_frequencies
    from problems.matching.measured_modes import MeasuredModes
    from problems.matching.preference import LeastChange, Smoothness
    from problems.matching.result import FrequencyMatch
    from problems.matching.unknowns import Global, PerElement, Smooth
    from problems.properties.fitting import fit_properties
    from problems.properties.prediction import Prediction
    from problems.properties.records import FrequencyRecord, StaticRecord
    from problems.properties.result import PropertyFit
    from problems.response.comparison import compare_laws
    from problems.response.fitting import fit_response
    from problems.response.prediction import ResponsePrediction
    from problems.response.record import ResponseRecord
    from problems.response.result import ResponseFit
    from problems.study.study import StudyReport, run_study
    from problems.transient.fitting import fit_transient
    from problems.transient.marker_record import MarkerRecord
    from problems.transient.motion_record import Camera, Channel, MotionRecord
    from problems.transient.prediction import MotionPrediction
    from problems.transient.result import TransientFit
else:
    __getattr__, __dir__ = on_first_use(__name__)

__all__ = [
    "Camera",
    "Channel",
    "DecayFit",
    "DecayFits",
    "FrequencyMatch",
    "FrequencyRecord",
    "FrfFit",
    "FrfRecord",
    "Global",
    "IsolatedMode",
    "LawComparison",
    "LeastChange",
    "MarkerRecord",
    "MeasuredModes",
    "MonteCarlo",
    "MotionPrediction",
    "MotionRecord",
    "PerElement",
    "Prediction",
    "PropertyFit",
    "RayleighFit",
    "ResponseFit",
    "ResponsePrediction",
    "ResponseRecord",
    "Smooth",
    "Smoothness",
    "StaticRecord",
    "StudyReport",
    "TransientFit",
    "compare_decay_laws",
    "compare_laws",
    "fit_decay",
    "fit_decays",
    "fit_frf",
    "fit_modes",
    "fit_properties",
    "fit_rayleigh",
    "fit_response",
    "fit_transient",
    "isolate_mode",
    "law_curve",
    "match_frequencies",
    "monte_carlo",
    "run_study",
]
