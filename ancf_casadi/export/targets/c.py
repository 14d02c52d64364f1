"""The model as C99: a source, a header, and a small program that integrates a decay.

The source needs nothing but the C library.  Each Function becomes ``int NAME_FUNCTION(inputs, outputs)`` of plain
arrays, matrices by columns; a sparse matrix gives its nonzeros, whose places the header lists by compressed columns.
No call allocates: work arrays are on the stack, or static where they are large, and then the header says so.

CasADi makes C of expressions, loops over the elements, linear solvers and Newton's method.  Of what integrates in time
with an adaptive step, or calls Python, it makes none: such a Function is refused.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.signals import MotionFunctions, Signal, values
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.targets.decay_program import decay_program
from ancf_casadi.support.files import check_folder, remove_file, write_file
from ancf_casadi.support.inputs import shown

MARK = "/* Written by ancf-casadi"
NAME = r"[a-z][a-z0-9]*(_[a-z0-9]+)*"
LONGEST_NAME = 60
TRANSLATED = {"MXFunction", "SXFunction", "Map", "MapSum", "FastNewton", "Switch", "BSplineInterpolant"}
LARGEST_ON_STACK = 65536  # numbers, half a megabyte
TABLES = ("parameters", "rest")
RESERVED = {"arg", "res", "iw", "w", "NAN", "INFINITY"} | set(
    "auto break case char const continue default do double else enum extern float for goto if inline int long register "
    "restrict return short signed sizeof static struct switch typedef union unsigned void volatile while".split()
)
KEEP_QUIET = """#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#pragma GCC diagnostic ignored "-Wunused-function"
#endif
"""


def write_c(
    functions: MotionFunctions, folder: str | Path, *, name: str = "beam", also: Sequence[cs.Function] = ()
) -> tuple[Path, Path, Path]:
    """Write the Functions as C: NAME.c, NAME.h and main.c, all of them or none.

    Parameters
    ----------
    functions : BeamFunctions, ReducedModel or ReducedFunctions
        The model, full or reduced.
    folder : path
        Where to; made if it is not there.
    name : str
        Name of the files, and beginning of every name in C: small letters, digits and underscores.
    also : sequence of Function
        Functions of one's own to go with them, or those of the reduced model with the full one.

    Returns
    -------
    (Path, Path, Path)
        The source, the header and the program.

    Raises
    ------
    InputError
        If the name is no name in C, a Function has no C or the name of another one, a file of that name is there that
        is not of this kind, or one cannot be written.
    """
    if not isinstance(name, str) or not re.fullmatch(NAME, name) or len(name) > LONGEST_NAME or name == "main":
        raise InputError(
            f"must be small letters, digits and single underscores, {LONGEST_NAME} at most, and not main, got "
            f"{shown(name)}",
            "name",
        )
    target = check_folder(folder)
    every = {f"{name}_{own}": function for own, function in functions.named.items()}
    for function in also:
        own = function.name()
        if every.setdefault(f"{name}_{own}", function) is not function or own in TABLES or own.endswith("_raw"):
            raise InputError("is the name of another Function or table; give it one of its own", own)
    for function in every.values():
        _check_translated(function)
    contents = {
        target / f"{name}.c": _source(name, functions, every),
        target / f"{name}.h": _header(name, functions, every),
        target / "main.c": f"{MARK}: {decay_program(name, functions)}",
    }
    for path in contents:
        if path.exists() and not _is_ours(path):
            raise InputError("is there already, and was not written by this; choose another folder", str(path))
    written: list[Path] = []
    try:
        for path, content in contents.items():
            write_file(path, content)
            written.append(path)
    except BaseException:
        for path in written:
            remove_file(path)
        raise
    source, header, program = contents
    return source, header, program


def _is_ours(path: Path) -> bool:
    try:
        with open(path, "rb") as file:
            return file.read(len(MARK)) == MARK.encode()
    except OSError:
        return False


def _check_translated(function: cs.Function) -> None:
    if function.has_free():
        raise InputError(f"depends on {', '.join(function.get_free())}, which is no input", function.name())
    for label in (*function.name_in(), *function.name_out()):
        if label in RESERVED or label.startswith("casadi"):
            raise InputError(f"{label} has a meaning of its own in C; call it otherwise", function.name())
    for inner in (function, *function.find_functions()):
        if inner.class_name() not in TRANSLATED:
            raise InputError(
                f"holds '{inner.name()}' ({inner.class_name()}), of which there is no C: what integrates in time "
                "with an adaptive step, or calls another program, cannot be written",
                function.name(),
            )


def _source(name: str, functions: MotionFunctions, every: Mapping[str, cs.Function]) -> str:
    """Return CasADi's C of all Functions, the calls with plain arrays, and the tables."""
    generator = cs.CodeGenerator(f"{name}.c", {"with_header": False})
    calls = []
    for called, function in every.items():
        inputs = function.mx_in()
        outputs = function.call(inputs, True, False)
        raw = cs.Function(f"{called}_raw", inputs, outputs, function.name_in(), function.name_out())
        generator.add(raw)
        calls.append(_call(called, function, raw))
    code = generator.dump()
    if "#error" in code:
        raise InputError("holds a linear solver of which there is no C; 'ldl' and 'qr' have one", "functions")
    parts = [f"{MARK}: see {name}.h. */\n", KEEP_QUIET, code, f'#include "{name}.h"\n', *calls]
    parts += [_table(f"const double {label}", data) for label, data in _numbers(name, functions)]
    parts += [_table(f"const int {label}", data) for pair in every.items() for label, data in _patterns(*pair)]
    return "\n".join(parts)


def _call(called: str, function: cs.Function, raw: cs.Function) -> str:
    work = "static " if _is_static(raw) else ""
    lines = [f"{_signature(called, function)} {{"]
    lines.append(f"  {work}double w[{raw.sz_w() + 1}];")
    lines.append(f"  {work}casadi_int iw[{raw.sz_iw() + 1}];")
    lines.append(f"  const double* arg[{raw.sz_arg() + 1}];")
    lines.append(f"  double* res[{raw.sz_res() + 1}];")
    lines += [f"  arg[{k}] = {label};" for k, label in enumerate(function.name_in())]
    lines += [f"  res[{k}] = {label};" for k, label in enumerate(_output_names(function))]
    return "\n".join([*lines, f"  return {raw.name()}(arg, res, iw, w, 0);", "}", ""])


def _is_static(function: cs.Function) -> bool:
    return bool(function.sz_w() > LARGEST_ON_STACK)


def _output_names(function: cs.Function) -> list[str]:
    """Return the names of the outputs, told apart from the inputs."""
    taken = function.name_in()
    return [f"{label}_out" if label in taken else label for label in function.name_out()]


def _signature(called: str, function: cs.Function) -> str:
    inputs = [f"const double {label}[{function.nnz_in(k)}]" for k, label in enumerate(function.name_in())]
    outputs = [f"double {label}[{max(function.nnz_out(k), 1)}]" for k, label in enumerate(_output_names(function))]
    return f"int {called}({', '.join([*inputs, *outputs])})"


def _numbers(name: str, functions: MotionFunctions) -> list[tuple[str, np.ndarray]]:
    return [(f"{name}_parameters", values(functions.parameters)), (f"{name}_rest", values(functions.states))]


def _patterns(called: str, function: cs.Function) -> list[tuple[str, np.ndarray]]:
    """Return column starts and rows of the sparse outputs."""
    found = []
    for label, k in zip(_output_names(function), range(function.n_out()), strict=True):
        pattern = function.sparsity_out(k)
        if not pattern.is_dense():
            found += [(f"{called}_{label}_colind", np.array(pattern.colind()))]
            found += [(f"{called}_{label}_row", np.array(pattern.row()))]
    return found


def _table(declaration: str, data: np.ndarray) -> str:
    entries = [repr(entry) for entry in data.tolist()]
    lines = [", ".join(entries[k : k + 6]) for k in range(0, len(entries), 6)]
    return f"{declaration}[{len(entries)}] = {{\n  " + ",\n  ".join(lines) + "\n};\n"


def _comment(title: str, signals: Sequence[Signal]) -> str:
    rows = [f" *  {k:5d}  {s.name:<24}  {s.unit:<10}  {s.value: .8e}  {s.description}" for k, s in enumerate(signals)]
    return "\n".join([f"/* {title}", *rows, " */"])


def _header(name: str, functions: MotionFunctions, every: Mapping[str, cs.Function]) -> str:
    guard, upper = f"{name.upper()}_H", name.upper()
    lines = [
        f"{MARK}: a beam under a damping law.  SI units; arrays, matrices by columns.",
        " *",
        " * Each call returns 0 if it was done.  A number that could not be found is NAN.  No call allocates.",
        f" * Compile:  cc -std=c99 -O2 main.c {name}.c -lm",
        " */",
        f"#ifndef {guard}",
        f"#define {guard}",
        "",
        f"#define {upper}_FREE {functions.free}  /* coordinates q, and as many rates v */",
        f"#define {upper}_PARAMETERS {len(functions.parameters)}  /* parameters p */",
        f"#define {upper}_BASE {len(functions.base)}  /* motion of the clamp */",
        "",
        _comment("Parameters p: index, name, unit, value in the model, meaning", functions.parameters),
        f"extern const double {name}_parameters[{len(functions.parameters)}];",
        "",
        _comment("States (q, v): index, name, unit, value at rest, meaning", functions.states),
        f"extern const double {name}_rest[{len(functions.states)}];",
        "",
        _comment("Motion of the clamp, base: index, name, unit, value, meaning", functions.base),
        "",
        _comment("Outputs of tip, markers and energies: index, name, unit, value, meaning", functions.outputs),
        "",
    ]
    for called, function in every.items():
        if _is_static(function):
            lines.append("/* its work arrays are static: one call at a time */")
        if note := UNITS.get(function.name()):
            lines.append(f"/* {note} */")
        lines.append(f"{_signature(called, function)};")
        for label, data in _patterns(called, function):
            lines.append(f"extern const int {label}[{len(data)}];")
        lines.append("")
    return "\n".join([*lines, "#endif", ""])


TIP, MARKERS, ENERGIES = "r: x and y, m", "r: x and y of each point, m", "T kinetic, U strain, V of gravity, J"
UNITS = {
    "residual": "r: N for positions, N m for slopes; zero in a motion",
    "residual_jacobians": "derivatives of r, nonzeros by columns",
    "rhs": "a: accelerations, m/s2 for positions, 1/s2 for slopes",
    "mass": "M: nonzeros by columns, kg, kg m, kg m2",
    "tangent_stiffness": "K: derivative of the elastic force, nonzeros by columns, N/m, N, N m",
    "damping_force": "Q: on the left of the equation of motion, N and N m",
    "tip": TIP,
    "markers": MARKERS,
    "energies": ENERGIES,
    "equilibrium": "q_out or q: free coordinates at rest, m and 1",
    "frequencies": "f: lowest natural frequencies, Hz",
    "step": "state after the time h, s; base: at 0.29289321881345254 h and at h; order 2, stiffly stable",
    "reduced_rhs": "a: second rates of q, m kg^0.5/s2",
    "reduced_step": "state after the time h, s; base: at 0, h/2 and h; order 4, h at most 1/20 of the shortest period",
    "reduced_tip": TIP,
    "reduced_markers": MARKERS,
    "reduced_energies": ENERGIES,
    "reduced_mass": "M: of the modal coordinates, 1",
    "reduced_coordinates": "e: nodal coordinates of the full model, m and 1; e_t: their rates",
}
