"""C source and header of the exported Functions.

The source needs only the C library.  Each Function becomes ``int NAME_FUNCTION(inputs, outputs)`` with plain arrays,
matrices by columns.  A sparse matrix is an array of its nonzeros, and the header lists their places by compressed
columns.  No call allocates: work arrays are on the stack, or static if they are large, which the header states.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.signals import MotionFunctions, Signal, values
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.solved_functions import GAMMA
from ancf_casadi.support.arrays import Array, Index

TABLE_NAMES = ("parameters", "rest")
UNUSED_ALLOWED = """#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#pragma GCC diagnostic ignored "-Wunused-function"
#endif
"""
C_TIP, C_MARKERS, C_ENERGIES = "r: x and y, m", "r: x and y of each point, m", "T kinetic, U strain, V of gravity, J"
NOTES = {
    "residual": "r: N for positions, N m for slopes; zero in a motion",
    "residual_jacobians": "Jacobians of r, nonzeros by columns",
    "rhs": "a: accelerations, m/s2 for positions, 1/s2 for slopes",
    "mass": "M: nonzeros by columns, kg, kg m, kg m2",
    "tangent_stiffness": "K: Jacobian of the elastic force, nonzeros by columns, N/m, N, N m",
    "damping_force": "Q: on the left of the equation of motion, N and N m",
    "tip": C_TIP,
    "markers": C_MARKERS,
    "energies": C_ENERGIES,
    "equilibrium": "q_out or q: free coordinates at rest, m and 1",
    "frequencies": "f: lowest natural frequencies, Hz",
    "step": f"state after the time h, s; base: at {GAMMA!r} h and at h; order 2, stiffly stable",
    "reduced_rhs": "a: accelerations of q, m kg^0.5/s2",
    "reduced_step": "state after the time h, s; base: at 0, h/2 and h; order 4, h at most 1/20 of the shortest period",
    "reduced_tip": C_TIP,
    "reduced_markers": C_MARKERS,
    "reduced_energies": C_ENERGIES,
    "reduced_mass": "M: of the modal coordinates, 1",
    "reduced_coordinates": "e: nodal coordinates of the full model, m and 1; e_t: their velocities",
}


def source(name: str, functions: MotionFunctions, every: Mapping[str, cs.Function]) -> str:
    """Return CasADi's C of all Functions, the calls with plain arrays, and the tables, from within the first comment.

    ``name`` is the first part of every name in C, and ``every`` holds all Functions by their names in C.
    """
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
        raise InputError("contain a linear solver without C code; use 'ldl' or 'qr'", "functions")
    tables = zip(TABLE_NAMES, (functions.parameters, functions.states), strict=True)
    parts = [f"see {name}.h. */\n", UNUSED_ALLOWED, code, f'#include "{name}.h"\n', *calls]
    parts += [_table(f"const double {name}_{table}", values(signals)) for table, signals in tables]
    parts += [_table(f"const int {label}", data) for pair in every.items() for label, data in _patterns(*pair)]
    return "\n".join(parts)


def header(name: str, functions: MotionFunctions, every: Mapping[str, cs.Function]) -> str:
    """Return the declarations and the meaning of every number, from within the first comment; see ``source``."""
    guard, upper = f"{name.upper()}_H", name.upper()
    lines = [
        "a beam with its damping law.  SI units; arrays, matrices by columns.",
        " *",
        " * Each call returns 0 on success.  A value that could not be found is NAN.  No call allocates.",
        f" * Compile:  cc -std=c99 -O2 main.c {name}.c -lm",
        " */",
        f"#ifndef {guard}",
        f"#define {guard}",
        "",
        f"#define {upper}_FREE {functions.free}  /* coordinates q, and as many velocities v */",
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
        if note := NOTES.get(function.name()):
            lines.append(f"/* {note} */")
        lines.append(f"{_signature(called, function)};")
        lines += [f"extern const int {label}[{len(data)}];" for label, data in _patterns(called, function)]
        lines.append("")
    return "\n".join([*lines, "#endif", ""])


def _call(called: str, function: cs.Function, raw: cs.Function) -> str:
    """Return the C function with plain arrays that calls CasADi's."""
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
    return bool(function.sz_w() > 65536)  # numbers, half a megabyte


def _output_names(function: cs.Function) -> list[str]:
    """Return the names of the outputs, each different from those of the inputs."""
    taken = function.name_in()
    return [f"{label}_out" if label in taken else label for label in function.name_out()]


def _signature(called: str, function: cs.Function) -> str:
    inputs = [f"const double {label}[{function.nnz_in(k)}]" for k, label in enumerate(function.name_in())]
    outputs = [f"double {label}[{max(function.nnz_out(k), 1)}]" for k, label in enumerate(_output_names(function))]
    return f"int {called}({', '.join([*inputs, *outputs])})"


def _patterns(called: str, function: cs.Function) -> list[tuple[str, Index]]:
    """Return column starts and rows of the sparse outputs."""
    found = []
    for label, k in zip(_output_names(function), range(function.n_out()), strict=True):
        pattern = function.sparsity_out(k)
        if not pattern.is_dense():
            found += [(f"{called}_{label}_colind", np.array(pattern.colind(), dtype=np.int64))]
            found += [(f"{called}_{label}_row", np.array(pattern.row(), dtype=np.int64))]
    return found


def _table(declaration: str, data: Array | Index) -> str:
    entries = [repr(entry) for entry in data.tolist()]
    lines = [", ".join(entries[k : k + 6]) for k in range(0, len(entries), 6)]
    return f"{declaration}[{len(entries)}] = {{\n  " + ",\n  ".join(lines) + "\n};\n"


def _comment(title: str, signals: Sequence[Signal]) -> str:
    rows = [f" *  {k:5d}  {s.name:<24}  {s.unit:<10}  {s.value: .8e}  {s.description}" for k, s in enumerate(signals)]
    return "\n".join([f"/* {title}", *rows, " */"])
