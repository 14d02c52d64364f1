"""Export of a model to other programs.

``motion_functions`` holds the equation of motion, Eq. (6) with damping, as CasADi Functions of all parameters: residual
and accelerations; ``solved_functions`` one time step, equilibrium and natural frequencies, Eq. (30).  These Functions,
or those of the reduced model, are written to a CasADi file, by ``c`` as C code with a header and a test program, and by
``fmu`` as an FMU.  ``model_document`` writes and reads the durable form, a JSON document with the beam, its damping
law, its identifications and its provenance (``identification``); the schema follows from the declaration of its
layout.  ``simulators`` writes the beam for programs that simulate many bodies.  No other folder of the
package imports this one.
"""

from ancf_casadi.dynamics.signals import MotionFunctions, Signal, values
from ancf_casadi.export.c import write_c
from ancf_casadi.export.fmu import write_fmu
from ancf_casadi.export.identification import DataFile, Identification, Provenance
from ancf_casadi.export.model_document import Document, read_document, schema, write_document
from ancf_casadi.export.motion_functions import BeamFunctions, beam_functions, load_functions, save_functions
from ancf_casadi.export.simulators.exudyn import write_exudyn
from ancf_casadi.export.simulators.mujoco import write_mujoco
from ancf_casadi.export.simulators.newton import write_newton
from ancf_casadi.export.simulators.pyelastica import write_pyelastica
from ancf_casadi.export.simulators.settings import ExportedBeam
from ancf_casadi.reduction.reduced import ReducedFunctions

__all__ = [
    "BeamFunctions",
    "DataFile",
    "Document",
    "ExportedBeam",
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
    "write_exudyn",
    "write_fmu",
    "write_mujoco",
    "write_newton",
    "write_pyelastica",
]
