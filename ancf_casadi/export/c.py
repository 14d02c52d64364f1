"""The model as C99: a source, a header, and a small program that integrates a decay.

CasADi translates expressions, loops over the elements, linear solvers and Newton's method to C.  A Function that
contains an integrator with adaptive steps, or calls Python, cannot be translated and is refused.

The source needs only the C library.  Each Function becomes ``int NAME_FUNCTION(inputs, outputs)`` with plain arrays,
matrices by columns.  A sparse matrix is an array of its nonzeros, whose pattern the header lists by compressed columns.
No call allocates memory: work arrays are on the stack, or static if they are large, as the header states.

The program is an example of the calls, and a first check of the export.  The full beam is released from its equilibrium
under a sideways pull, which is added to gravity.  The reduced beam is released from a deflection in mode 1, with
``STEPS_PER_PERIOD`` steps per period of its highest mode.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.signals import MotionFunctions, Signal, values
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.motion_functions import BeamFunctions, jacobian_at_rest, value_and_jacobian
from ancf_casadi.export.solved_functions import GAMMA
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.reduction.stepping import STEPS_PER_PERIOD
from ancf_casadi.support.files import check_folder, check_ours, fill_template, write_files
from ancf_casadi.support.inputs import check_instance, instances, matches, shown

TABLE_NAMES = ("parameters", "rest")
MARK = "/* Written by ancf-casadi"
NAME_PATTERN = r"[a-z][a-z0-9]*(_[a-z0-9]+)*"
LONGEST_NAME = 60
TRANSLATABLE_CLASSES = {"MXFunction", "SXFunction", "Map", "MapSum", "FastNewton", "Switch", "BSplineInterpolant"}
C_KEYWORDS = {"arg", "res", "iw", "w", "NAN", "INFINITY"} | set(
    "auto break case char const continue default do double else enum extern float for goto if inline int long register "
    "restrict return short signed sizeof static struct switch typedef union unsigned void volatile while".split()
)
PROGRAM_STEP, PROGRAM_SAMPLES = 5e-3, 400  # seconds between two lines of output, and number of lines after the first
DEFLECTION = 0.1  # largest linear deflection at the release, per length of the beam


def _generate_c(name: str, c_functions: Mapping[str, cs.Function]) -> tuple[str, dict[str, cs.Function]]:
    """Return the C code that CasADi generates for Functions with their C names, and the Functions in that code."""
    generator, generated = cs.CodeGenerator(f"{name}.c", {"with_header": False}), {}
    for c_name, function in c_functions.items():
        inputs = function.mx_in()
        outputs = function.call(inputs, True, False)
        generated[c_name] = cs.Function(f"{c_name}_raw", inputs, outputs, function.name_in(), function.name_out())
        generator.add(generated[c_name])
    code = generator.dump()
    if "#error" in code:
        raise InputError("contain a linear solver without C code; use 'ldl' or 'qr'", "functions")
    return code, generated


def _is_static(function: cs.Function) -> bool:
    return bool(function.sz_w() > 65536)  # numbers, half a megabyte


def _output_names(function: cs.Function) -> list[str]:
    """Return the names of the outputs, with the suffix ``_out`` if an input has the same name."""
    input_names = function.name_in()
    return [f"{label}_out" if label in input_names else label for label in function.name_out()]


def _signature(c_name: str, function: cs.Function) -> str:
    inputs = [f"const double {label}[{function.nnz_in(k)}]" for k, label in enumerate(function.name_in())]
    outputs = [f"double {label}[{max(function.nnz_out(k), 1)}]" for k, label in enumerate(_output_names(function))]
    return f"int {c_name}({', '.join([*inputs, *outputs])})"


def _patterns(c_name: str, function: cs.Function) -> list[tuple[str, list[int]]]:
    """Return column starts and rows of the sparse outputs."""
    tables = []
    for label, k in zip(_output_names(function), range(function.n_out()), strict=True):
        pattern = function.sparsity_out(k)
        if not pattern.is_dense():
            tables += [(f"{c_name}_{label}_colind", pattern.colind()), (f"{c_name}_{label}_row", pattern.row())]
    return tables


def _table(data: Iterable[float]) -> str:
    """Return the length of a table, and its definition."""
    entries = [repr(entry) for entry in data]
    lines = [", ".join(entries[k : k + 6]) for k in range(0, len(entries), 6)]
    return f"[{len(entries)}] = {{\n  " + ",\n  ".join(lines) + "\n};"


def _rows(signals: Sequence[Signal]) -> str:
    """Return the signals as lines of a C comment."""
    rows = (f" *  {k:5d}  {s.name:<24}  {s.unit:<10}  {s.value: .8e}  {s.description}" for k, s in enumerate(signals))
    return "\n".join(rows)


def _release(functions: MotionFunctions) -> dict[str, Any]:
    """Return the template values of the release: steps per sample, and the pull (m/s^2) or the deflection in mode 1."""
    if isinstance(functions, BeamFunctions):
        p = cs.MX.sym("p", len(functions.parameters))
        q = functions.equilibrium(p)
        coordinates, jacobian = value_and_jacobian(q, p, values(functions.parameters))
        if np.isnan(coordinates).any():
            message = "can move rigidly, and the program has no equilibrium to release it from; hold it by a spring"
            raise InputError(message, "functions")
        rows = [k for k, signal in enumerate(functions.states[: functions.free]) if signal.unit == "m"]
        side_direction = np.linalg.svd(jacobian[rows, :2])[2][0]  # in which gravity moves the nodes most
        max_displacement = np.abs(jacobian[rows, :2] @ side_direction).max()
        pull = (DEFLECTION * functions.length / max_displacement * side_direction).tolist()
        return {"steps_per_sample": 10, "pull": pull}
    q, base_at_rest = cs.MX.sym("q", functions.free), cs.MX(len(functions.base), 1)
    e, _ = functions.named["coordinates"](q, cs.MX(functions.free, 1), base_at_rest)
    _, jacobian = value_and_jacobian(e, q, np.zeros(functions.free))
    node_displacements = np.linalg.norm(jacobian[:, 0].reshape(-1, NODE)[:, :2], axis=1)
    deflection = DEFLECTION * functions.length / node_displacements.max()
    highest_frequency = np.sqrt(np.abs(np.linalg.eigvals(jacobian_at_rest(functions))).max()) / (2 * np.pi)
    steps_per_sample = math.ceil(PROGRAM_STEP * STEPS_PER_PERIOD * highest_frequency)
    return {"steps_per_sample": steps_per_sample, "pull": (), "deflection": float(deflection)}


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
        If the name cannot be used in C, the beam can move rigidly, a Function cannot be translated or has the name of
        another one, another program's file would be overwritten, or a file cannot be written.

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
    c_functions = {f"{name}_{function_name}": function for function_name, function in functions.named.items()}
    for function in instances(also, "also", cs.Function, minimum=0):
        label = function.name()
        registered = c_functions.setdefault(f"{name}_{label}", function)
        if registered is not function or label in TABLE_NAMES or label.endswith("_raw"):
            raise InputError("is the name of another Function or table; rename the Function", label)
    for function in c_functions.values():
        _check_translatable(function)
    code, generated = _generate_c(name, c_functions)
    template_values = {
        "name": name, "functions": functions, "c_functions": c_functions, "code": code,
        "generated": generated, "gamma": GAMMA,
        "interval": PROGRAM_STEP, "samples": PROGRAM_SAMPLES, **_release(functions),
        "rows": _rows, "signature": _signature, "output_names": _output_names, "patterns": _patterns,
        "is_static": _is_static, "table": _table,
    }  # fmt: skip
    templates = {f"{name}.c": "beam.c.jinja", f"{name}.h": "beam.h.jinja", "main.c": "main.c.jinja"}
    contents = {target / file: fill_template("ancf_casadi.export", form, template_values)
                for file, form in templates.items()}  # fmt: skip
    for path in contents:
        check_ours(path, MARK)
    write_files(contents)
    source_path, header_path, program_path = contents
    return source_path, header_path, program_path


def _check_translatable(function: cs.Function) -> None:
    """Check that CasADi can translate a Function and that its names can be used in C."""
    if function.has_free():
        raise InputError(f"depends on {', '.join(function.get_free())}, which is not an input", function.name())
    for label in (*function.name_in(), *function.name_out()):
        if label in C_KEYWORDS or label.startswith("casadi"):
            raise InputError(f"{label} is a reserved name in C; rename it", function.name())
    for inner in (function, *function.find_functions()):
        if inner.class_name() not in TRANSLATABLE_CLASSES:
            raise InputError(
                f"contains '{inner.name()}' ({inner.class_name()}), and there is no C for it: integrators with "
                "adaptive steps and calls of other programs cannot be written",
                function.name(),
            )
