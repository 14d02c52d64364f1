"""The model as C99: a source, a header, and a small program that integrates a decay.

CasADi translates expressions, loops over the elements, linear solvers and Newton's method to C.  A Function that
contains an integrator with adaptive steps, or calls Python, cannot be translated and is refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import casadi as cs

from ancf_casadi.dynamics.signals import MotionFunctions
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.c_source import TABLE_NAMES, decay_program, header, source
from ancf_casadi.support.files import check_folder, check_ours, write_files
from ancf_casadi.support.inputs import check_instance, instances, matches, shown

MARK = "/* Written by ancf-casadi"
NAME_PATTERN = r"[a-z][a-z0-9]*(_[a-z0-9]+)*"
LONGEST_NAME = 60
TRANSLATED = {"MXFunction", "SXFunction", "Map", "MapSum", "FastNewton", "Switch", "BSplineInterpolant"}
C_KEYWORDS = {"arg", "res", "iw", "w", "NAN", "INFINITY"} | set(
    "auto break case char const continue default do double else enum extern float for goto if inline int long register "
    "restrict return short signed sizeof static struct switch typedef union unsigned void volatile while".split()
)


def write_c(
    functions: MotionFunctions, folder: str | Path, *, name: str = "beam", also: Sequence[cs.Function] = ()
) -> tuple[Path, Path, Path]:
    """Write the Functions as C files, and return their paths: NAME.c, NAME.h and main.c, all three or none.

    Parameters
    ----------
    functions : BeamFunctions, ReducedModel or ReducedFunctions
        The model, full or reduced.
    folder : path
        Folder of the files; created if it does not exist.
    name : str
        Name of the files and first part of every C name: small letters, digits and underscores.
    also : sequence of Function
        Further Functions to write, such as user Functions, or those of the reduced model beside the full one.

    Raises
    ------
    InputError
        If the name cannot be used in C, a Function cannot be translated or has the name of another one, another
        program's file would be overwritten, or a file cannot be written.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, reduce_model
    >>> from ancf_casadi.export import write_c
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> files = write_c(reduce_model(Model(beam), modes=2), "controller", name="strip")
    >>> [file.name for file in files]
    ['strip.c', 'strip.h', 'main.c']
    """
    if not matches(name, NAME_PATTERN) or len(name) > LONGEST_NAME or name == "main":
        raise InputError(
            f"must be small letters, digits and single underscores, {LONGEST_NAME} at most, and not main, got "
            f"{shown(name)}",
            "name",
        )
    check_instance(functions, "functions", MotionFunctions)
    target = check_folder(folder)
    every = {f"{name}_{own}": function for own, function in functions.named.items()}
    for function in instances(also, "also", cs.Function, least=0):
        own = function.name()
        if every.setdefault(f"{name}_{own}", function) is not function or own in TABLE_NAMES or own.endswith("_raw"):
            raise InputError("is the name of another Function or table; rename the Function", own)
    for function in every.values():
        _check_translated(function)
    contents = {
        target / f"{name}.c": f"{MARK}: {source(name, functions, every)}",
        target / f"{name}.h": f"{MARK}: {header(name, functions, every)}",
        target / "main.c": f"{MARK}: {decay_program(name, functions)}",
    }
    for path in contents:
        check_ours(path, MARK)
    write_files(contents)
    source_path, header_path, program_path = contents
    return source_path, header_path, program_path


def _check_translated(function: cs.Function) -> None:
    """Check that CasADi can translate a Function and that its names can be used in C."""
    if function.has_free():
        raise InputError(f"depends on {', '.join(function.get_free())}, which is not an input", function.name())
    for label in (*function.name_in(), *function.name_out()):
        if label in C_KEYWORDS or label.startswith("casadi"):
            raise InputError(f"{label} is a reserved name in C; rename it", function.name())
    for inner in (function, *function.find_functions()):
        if inner.class_name() not in TRANSLATED:
            raise InputError(
                f"contains '{inner.name()}' ({inner.class_name()}), and there is no C for it: integrators with "
                "adaptive steps and calls of other programs cannot be written",
                function.name(),
            )
