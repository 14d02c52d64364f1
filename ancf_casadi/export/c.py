"""The model as C99: a source, a header, and a small program that integrates a decay.

CasADi translates expressions, loops over the elements, linear solvers and Newton's method to C.  A Function that
contains an integrator with adaptive steps, or calls Python, cannot be translated and is refused.

The source needs only the C library.  Each Function becomes ``int NAME_FUNCTION(inputs, outputs)`` with plain arrays,
matrices by columns.  A sparse matrix is an array of its nonzeros, and the header lists their places by compressed
columns.  No call allocates: work arrays are on the stack, or static if they are large, which the header states.

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
from ancf_casadi.export.motion_functions import BeamFunctions
from ancf_casadi.export.solved_functions import GAMMA
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.reduction.stepping import STEPS_PER_PERIOD
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.files import check_folder, check_ours, filled_template, write_files
from ancf_casadi.support.inputs import check_instance, instances, matches, shown

TABLE_NAMES = ("parameters", "rest")
MARK = "/* Written by ancf-casadi"
NAME_PATTERN = r"[a-z][a-z0-9]*(_[a-z0-9]+)*"
LONGEST_NAME = 60
TRANSLATED = {"MXFunction", "SXFunction", "Map", "MapSum", "FastNewton", "Switch", "BSplineInterpolant"}
C_KEYWORDS = {"arg", "res", "iw", "w", "NAN", "INFINITY"} | set(
    "auto break case char const continue default do double else enum extern float for goto if inline int long register "
    "restrict return short signed sizeof static struct switch typedef union unsigned void volatile while".split()
)
PROGRAM_STEP, PROGRAM_SAMPLES = 5e-3, 400  # seconds between two lines of output, and number of lines after the first
DEFLECTION = 0.1  # largest one before the release, to first order, per distance from the origin to the tip


def _translated(name: str, every: Mapping[str, cs.Function]) -> tuple[str, dict[str, cs.Function]]:
    """Return CasADi's C of Functions by their names in C, for a file, and the Functions that it defines."""
    generator, raws = cs.CodeGenerator(f"{name}.c", {"with_header": False}), {}
    for called, function in every.items():
        inputs = function.mx_in()
        outputs = function.call(inputs, True, False)
        raws[called] = cs.Function(f"{called}_raw", inputs, outputs, function.name_in(), function.name_out())
        generator.add(raws[called])
    code = generator.dump()
    if "#error" in code:
        raise InputError("contain a linear solver without C code; use 'ldl' or 'qr'", "functions")
    return code, raws


def _is_static(function: cs.Function) -> bool:
    return bool(function.sz_w() > 65536)  # numbers, half a megabyte


def _output_names(function: cs.Function) -> list[str]:
    """Return the names of the outputs, each different from those of the inputs."""
    taken = function.name_in()
    return [f"{label}_out" if label in taken else label for label in function.name_out()]


def _signature(called: str, function: cs.Function) -> str:
    inputs = [f"const double {label}[{function.nnz_in(k)}]" for k, label in enumerate(function.name_in())]
    outputs = [f"double {label}[{max(function.nnz_out(k), 1)}]" for k, label in enumerate(_output_names(function))]
    return f"int {called}({', '.join([*inputs, *outputs])})"


def _patterns(called: str, function: cs.Function) -> list[tuple[str, list[int]]]:
    """Return column starts and rows of the sparse outputs."""
    found = []
    for label, k in zip(_output_names(function), range(function.n_out()), strict=True):
        pattern = function.sparsity_out(k)
        if not pattern.is_dense():
            found += [(f"{called}_{label}_colind", pattern.colind()), (f"{called}_{label}_row", pattern.row())]
    return found


def _table(data: Iterable[float]) -> str:
    """Return the length of a table, and its definition."""
    entries = [repr(entry) for entry in data]
    lines = [", ".join(entries[k : k + 6]) for k in range(0, len(entries), 6)]
    return f"[{len(entries)}] = {{\n  " + ",\n  ".join(lines) + "\n};"


def _rows(signals: Sequence[Signal]) -> str:
    """Return lines of a comment on signals."""
    rows = (f" *  {k:5d}  {s.name:<24}  {s.unit:<10}  {s.value: .8e}  {s.description}" for k, s in enumerate(signals))
    return "\n".join(rows)


def _release(functions: MotionFunctions) -> dict[str, Any]:
    """Return the release in the program: steps per sample, and the pull (m/s^2) or the deflection in mode 1."""
    if isinstance(functions, BeamFunctions):
        p = cs.MX.sym("p", len(functions.parameters))
        q = functions.equilibrium(p)
        tip = functions.tip(q, cs.MX(len(functions.base), 1))
        found, change = _value_and_jacobian(cs.vertcat(tip, q), p, values(functions.parameters))
        x, y = found[:2]
        across = np.array([-y, x]) / np.hypot(x, y)
        places = [k for k, signal in enumerate(functions.states[: functions.free], start=2) if signal.unit == "m"]
        farthest = np.abs(change[places, :2] @ across).max()
        pull = (DEFLECTION * np.hypot(x, y) / farthest * across).tolist()
        return {"each": 10, "pull": pull}
    q, still = cs.MX.sym("q", functions.free), cs.MX(len(functions.base), 1)
    e, _ = functions.named["coordinates"](q, cs.MX(functions.free, 1), still)
    found, change = _value_and_jacobian(cs.vertcat(functions.tip(q, still), e), q, np.zeros(functions.free))
    moved = np.linalg.norm(change[2:, 0].reshape(-1, NODE)[:, :2], axis=1)
    first = DEFLECTION * np.linalg.norm(found[:2]) / moved.max()
    each = math.ceil(PROGRAM_STEP * STEPS_PER_PERIOD * _highest_frequency(functions))
    return {"each": each, "pull": (), "deflection": float(first)}


def _highest_frequency(functions: MotionFunctions) -> float:
    """Return the highest natural frequency about rest, Hz."""
    q, n = cs.MX.sym("q", functions.free), functions.free
    still = cs.MX(n, 1), cs.MX(len(functions.base), 1), cs.MX(cs.DM(values(functions.parameters)))
    _, jacobian = _value_and_jacobian(functions.rhs(q, *still), q, values(functions.states)[:n])
    return float(np.sqrt(np.abs(np.linalg.eigvals(jacobian)).max()) / (2 * np.pi))


def _value_and_jacobian(expression: cs.MX, symbol: cs.MX, at: Array) -> list[Array]:
    found = cs.Function("found", [symbol], [expression, cs.jacobian(expression, symbol)])(at)
    value, jacobian = (part.full() for part in found)
    return [value.ravel(), jacobian]


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
    code, raws = _translated(name, every)
    given = {
        "name": name, "functions": functions, "every": every, "code": code, "raws": raws, "gamma": GAMMA,
        "interval": PROGRAM_STEP, "samples": PROGRAM_SAMPLES, **_release(functions),
        "rows": _rows, "signature": _signature, "output_names": _output_names, "patterns": _patterns,
        "is_static": _is_static, "table": _table,
    }  # fmt: skip
    templates = {f"{name}.c": "beam.c.jinja", f"{name}.h": "beam.h.jinja", "main.c": "main.c.jinja"}
    contents = {target / own: filled_template("ancf_casadi.export", form, given) for own, form in templates.items()}
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
