"""The estimation problems of the paper, and beyond it, stated on the tools of ``ancf_casadi``."""

from problems.damping_fitting import RayleighFit, fit_rayleigh
from problems.decay_comparison import DecayComparison, compare_decay_laws
from problems.decay_fitting import fit_decay, fit_decays
from problems.decay_result import DecayFit
from problems.frequency_matching import match_frequencies
from problems.law_comparison import LawComparison, compare_laws
from problems.marker_record import MarkerRecord
from problems.matching_preference import LeastChange, Smoothness
from problems.matching_result import FrequencyMatch
from problems.matching_unknowns import Global, PerElement, Smooth
from problems.measured_modes import MeasuredModes
from problems.mode_separation import fit_modes
from problems.monte_carlo import MonteCarlo, monte_carlo
from problems.transient_fitting import TransientFit, fit_transient

__all__ = [
    "DecayComparison",
    "DecayFit",
    "FrequencyMatch",
    "Global",
    "LawComparison",
    "LeastChange",
    "MarkerRecord",
    "MeasuredModes",
    "MonteCarlo",
    "PerElement",
    "RayleighFit",
    "Smooth",
    "Smoothness",
    "TransientFit",
    "compare_decay_laws",
    "compare_laws",
    "fit_decay",
    "fit_decays",
    "fit_modes",
    "fit_rayleigh",
    "fit_transient",
    "match_frequencies",
    "monte_carlo",
]
