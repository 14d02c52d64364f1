"""The model for other programs: CasADi Functions, C, and the table that describes their entries."""

from ancf_casadi.export.c import write_c
from ancf_casadi.export.functions import BeamFunctions, beam_functions
from ancf_casadi.export.signals import Signal, values
from ancf_casadi.export.storage import load_functions, save_functions

__all__ = ["BeamFunctions", "Signal", "beam_functions", "load_functions", "save_functions", "values", "write_c"]
