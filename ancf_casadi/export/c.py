"""The model as C99: a source, a header, and a small program that integrates a decay.

The source needs nothing but the C library.  Each Function becomes ``int NAME_FUNCTION(inputs, outputs)`` of plain
arrays, matrices by columns; a sparse matrix gives its nonzeros, whose places the header lists by compressed columns.
No call allocates: work arrays are on the stack, or static where they are large, and then the header says so.

CasADi makes C of expressions, loops over the elements, linear solvers and Newton's method.  Of what integrates in time
with an adaptive step, or calls Python, it makes none: such a Function is refused.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import casadi as cs
import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.export.functions import BeamFunctions
from ancf_casadi.export.signals import Signal, values
from ancf_casadi.report import check_folder, remove_file, write_file

MARK = "/* Written by ancf-casadi"
TRANSLATED = {"MXFunction", "SXFunction", "Map", "MapSum", "FastNewton", "Switch", "BSplineInterpolant"}
LARGEST_ON_STACK = 65536  # numbers, half a megabyte
KEEP_QUIET = """#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#pragma GCC diagnostic ignored "-Wunused-function"
#endif
"""
DECAY_STEP, DECAY_STEPS, DECAY_EVERY = 5e-4, 4000, 10
DEFLECTION = 0.1  # of the distance from clamp to tip: how far the tip is drawn aside, in proportion, before the decay


def write_c(
    functions: BeamFunctions, folder: str | Path, *, name: str = "beam", also: Sequence[cs.Function] = ()
) -> tuple[Path, Path, Path]:
    """Write the Functions as C: NAME.c, NAME.h and main.c, all of them or none.

    Parameters
    ----------
    functions : BeamFunctions
        The model.
    folder : path
        Where to; made if it is not there.
    name : str
        Name of the files, and beginning of every name in C: small letters, digits and underscores.
    also : sequence of Function
        Functions of one's own to go with them.

    Returns
    -------
    (Path, Path, Path)
        The source, the header and the program.

    Raises
    ------
    InputError
        If the name is no name in C, a Function has no C, a file of that name is there that is not of this kind, or one
        cannot be written.
    """
    if not re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", name) or name == "main":
        raise InputError(f"must be small letters, digits and single underscores, and not main, got {name!r}", "name")
    target = check_folder(folder)
    every = (*functions.functions, *also)
    for function in every:
        _check_translated(function)
    contents = {
        target / f"{name}.c": _source(name, functions, every),
        target / f"{name}.h": _header(name, functions, every),
        target / "main.c": _program(name, functions),
    }
    for path in contents:
        if path.exists() and not path.read_text(encoding="utf-8", errors="replace").startswith(MARK):
            raise InputError("is there already, and was not written by this; choose another folder", str(path))
    written: list[Path] = []
    try:
        for path, content in contents.items():
            write_file(path, content)
            written.append(path)
    except InputError:
        for path in written:
            remove_file(path)
        raise
    source, header, program = contents
    return source, header, program


def _check_translated(function: cs.Function) -> None:
    for inner in (function, *function.find_functions()):
        if inner.class_name() not in TRANSLATED:
            raise InputError(
                f"holds '{inner.name()}' ({inner.class_name()}), of which there is no C: what integrates in time "
                "with an adaptive step, or calls another program, cannot be written",
                function.name(),
            )


def _source(name: str, functions: BeamFunctions, every: Sequence[cs.Function]) -> str:
    """Return CasADi's C of all Functions, the calls with plain arrays, and the tables."""
    generator = cs.CodeGenerator(f"{name}.c", {"with_header": False})
    raw = []
    for function in every:
        inputs = function.mx_in()
        outputs = function.call(inputs, True, False)
        names = function.name_in(), function.name_out()
        raw.append(cs.Function(f"{name}_raw_{function.name()}", inputs, outputs, *names))
        generator.add(raw[-1])
    code = generator.dump()
    if "#error" in code:
        raise InputError("holds a linear solver of which there is no C; 'ldl' and 'qr' have one", "functions")
    parts = [f"{MARK}: see {name}.h. */\n", KEEP_QUIET, code, f'#include "{name}.h"\n']
    parts += [_call(name, *pair) for pair in zip(every, raw, strict=True)]
    parts += [_table(f"const double {label}", data) for label, data in _numbers(name, functions)]
    parts += [_table(f"const int {label}", data) for function in every for label, data in _patterns(name, function)]
    return "\n".join(parts)


def _call(name: str, function: cs.Function, raw: cs.Function) -> str:
    work = "static " if _is_static(raw) else ""
    lines = [f"{_signature(name, function)} {{"]
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


def _signature(name: str, function: cs.Function) -> str:
    inputs = [f"const double {label}[{function.nnz_in(k)}]" for k, label in enumerate(function.name_in())]
    outputs = [f"double {label}[{max(function.nnz_out(k), 1)}]" for k, label in enumerate(_output_names(function))]
    return f"int {name}_{function.name()}({', '.join([*inputs, *outputs])})"


def _numbers(name: str, functions: BeamFunctions) -> list[tuple[str, np.ndarray]]:
    return [(f"{name}_parameters", values(functions.parameters)), (f"{name}_rest", values(functions.states))]


def _patterns(name: str, function: cs.Function) -> list[tuple[str, np.ndarray]]:
    """Return column starts and rows of the sparse outputs."""
    found = []
    for label, k in zip(_output_names(function), range(function.n_out()), strict=True):
        pattern = function.sparsity_out(k)
        if not pattern.is_dense():
            where = f"{name}_{function.name()}_{label}"
            found += [(f"{where}_colind", np.array(pattern.colind())), (f"{where}_row", np.array(pattern.row()))]
    return found


def _table(declaration: str, data: np.ndarray) -> str:
    entries = [repr(entry) for entry in data.tolist()]
    lines = [", ".join(entries[k : k + 6]) for k in range(0, len(entries), 6)]
    return f"{declaration}[{len(entries)}] = {{\n  " + ",\n  ".join(lines) + "\n};\n"


def _comment(title: str, signals: Sequence[Signal]) -> str:
    rows = [f" *  {k:5d}  {s.name:<24}  {s.unit:<7}  {s.value: .8e}  {s.description}" for k, s in enumerate(signals)]
    return "\n".join([f"/* {title}", *rows, " */"])


def _header(name: str, functions: BeamFunctions, every: Sequence[cs.Function]) -> str:
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
        f"#define {upper}_FREE {functions.free}  /* free coordinates q, and as many rates v */",
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
    for function in every:
        if _is_static(function):
            lines.append("/* its work arrays are static: one call at a time */")
        if note := UNITS.get(function.name()):
            lines.append(f"/* {note} */")
        lines.append(f"{_signature(name, function)};")
        for label, data in _patterns(name, function):
            lines.append(f"extern const int {label}[{len(data)}];")
        lines.append("")
    return "\n".join([*lines, "#endif", ""])


UNITS = {
    "residual": "r: N for positions, N m for slopes; zero in a motion",
    "residual_jacobians": "derivatives of r, nonzeros by columns",
    "rhs": "a: accelerations, m/s2 for positions, 1/s2 for slopes",
    "mass": "M: nonzeros by columns, kg, kg m, kg m2",
    "tangent_stiffness": "K: derivative of the elastic force, nonzeros by columns, N/m, N, N m",
    "damping_force": "Q: on the left of the equation of motion, N and N m",
    "tip": "r: x and y, m",
    "markers": "r: x and y of each point, m",
    "energies": "T kinetic, U strain, V of gravity, J",
    "equilibrium": "q_out or q: free coordinates at rest, m and 1",
    "frequencies": "f: lowest natural frequencies, Hz",
    "step": "state after the time h, s; base: at 0.29289321881345254 h and at h; order 2, stiffly stable",
}


def _pull(functions: BeamFunctions) -> np.ndarray:
    """Return the acceleration across the beam that draws it aside, m/s^2."""
    p = cs.MX.sym("p", len(functions.parameters))
    tip = functions.tip(functions.equilibrium(p), cs.MX(len(functions.base), 1))
    place, change = cs.Function("tip", [p], [tip, cs.jacobian(tip, p)[:, :2]])(values(functions.parameters))
    x, y = place.full().ravel()
    across = np.array([-y, x]) / np.hypot(x, y)
    return np.asarray(DEFLECTION * np.hypot(x, y) / np.linalg.norm(change.full() @ across) * across)


def _program(name: str, functions: BeamFunctions) -> str:
    upper, (pull_x, pull_y) = name.upper(), _pull(functions).tolist()
    return f"""{MARK}: the decay of a beam that gravity held aside and that is let go.
 *
 * Prints CSV: time in s, position of the tip in m, kinetic, strain and gravity energy in J.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "{name}.h"

int main(void) {{
  const double h = {DECAY_STEP!r};  /* s */
  const double pull[2] = {{{pull_x!r}, {pull_y!r}}};  /* added to gravity before time 0, m/s2 */
  double p[{upper}_PARAMETERS], base[2 * {upper}_BASE] = {{0.0}};
  double q[{upper}_FREE], v[{upper}_FREE], q_next[{upper}_FREE], v_next[{upper}_FREE];
  double tip[2], kinetic[1], strain[1], gravity[1];
  int k;
  memcpy(p, {name}_parameters, sizeof(p));
  p[0] += pull[0];
  p[1] += pull[1];
  if ({name}_equilibrium(p, q) || isnan(q[0])) {{
    fprintf(stderr, "no equilibrium was found\\n");
    return 1;
  }}
  memset(v, 0, sizeof(v));
  printf("time_s,tip_x_m,tip_y_m,kinetic_j,strain_j,gravity_j\\n");
  for (k = 0; k <= {DECAY_STEPS}; ++k) {{
    if (k % {DECAY_EVERY} == 0) {{
      if ({name}_tip(q, base, tip)) return 1;
      if ({name}_energies(q, v, base, {name}_parameters, kinetic, strain, gravity)) return 1;
      printf("%.17g,%.17g,%.17g,%.17g,%.17g,%.17g\\n", k * h, tip[0], tip[1], kinetic[0], strain[0], gravity[0]);
    }}
    if ({name}_step(q, v, base, {name}_parameters, &h, q_next, v_next) || isnan(q_next[0])) {{
      fprintf(stderr, "the step at %g s did not converge\\n", k * h);
      return 1;
    }}
    memcpy(q, q_next, sizeof(q));
    memcpy(v, v_next, sizeof(v));
  }}
  return 0;
}}
"""
