"""The model for other programs: CasADi Functions, C and FMU; and its durable form, a JSON document."""

from ancf_casadi.dynamics.signals import MotionFunctions, Signal, values
from ancf_casadi.export.document.identification import DataFile, Identification, Provenance
from ancf_casadi.export.document.layout import schema
from ancf_casadi.export.document.model_document import Document, read_document, write_document
from ancf_casadi.export.functions.motion_functions import BeamFunctions, beam_functions
from ancf_casadi.export.targets.c import write_c
from ancf_casadi.export.targets.fmu import write_fmu
from ancf_casadi.export.targets.storage import load_functions, save_functions
from ancf_casadi.reduction.reduced import ReducedFunctions

__all__ = [
    "BeamFunctions",
    "DataFile",
    "Document",
    "Identification",
    "MotionFunctions",
    "Provenance",
    "ReducedFunctions",
    "Signal",
    "beam_functions",
    "load_functions",
    "read_document",
    "save_functions",
    "schema",
    "values",
    "write_c",
    "write_document",
    "write_fmu",
]
