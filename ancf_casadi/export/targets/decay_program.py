"""C program that integrates a decay with the exported step: an example of the calls, and a first check of the export.

The full beam is released from its equilibrium under a sideways pull, which is added to gravity.  The reduced beam is
released from a deflection in mode 1, with ``STEPS_PER_PERIOD`` steps per period of its highest mode.
"""

from __future__ import annotations

import math

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.signals import MotionFunctions, values
from ancf_casadi.export.motion_functions import BeamFunctions
from ancf_casadi.reduction.stepping import STEPS_PER_PERIOD
from ancf_casadi.support.arrays import Array

PROGRAM_STEP, PROGRAM_SAMPLES = 5e-3, 400  # seconds between two lines of output, and number of lines after the first
DEFLECTION = 0.1  # of the tip before the release, to first order, per distance from clamp to tip


def decay_program(name: str, functions: MotionFunctions) -> str:
    """Return the program for the Functions that ``write_c`` writes under a name, from within its first comment."""
    if isinstance(functions, BeamFunctions):
        every, start = 10, _pull(name, functions)  # steps of the full beam per sample
    else:
        every, start = (
            math.ceil(PROGRAM_STEP * STEPS_PER_PERIOD * _highest_frequency(functions)),
            _deflection(functions),
        )
    upper, stages = name.upper(), functions.step.size2_in("base")
    return f"""the free decay of a beam after its release.
 *
 * Prints CSV: time in s, position of the tip in m, kinetic, strain and gravity energy in J.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "{name}.h"

int main(void) {{
  const double h = {PROGRAM_STEP / every!r};  /* s */
  const double base[{stages} * {upper}_BASE] = {{0.0}};
  double q[{upper}_FREE] = {{0.0}}, v[{upper}_FREE] = {{0.0}}, q_next[{upper}_FREE], v_next[{upper}_FREE];
  double tip[2], kinetic[1], strain[1], gravity[1];
  int k;
{start}
  printf("time_s,tip_x_m,tip_y_m,kinetic_j,strain_j,gravity_j\\n");
  for (k = 0; k <= {PROGRAM_SAMPLES * every}; ++k) {{
    if (k % {every} == 0) {{
      if ({name}_tip(q, base, tip)) return 1;
      if ({name}_energies(q, v, base, {name}_parameters, kinetic, strain, gravity)) return 1;
      printf("%.17g,%.17g,%.17g,%.17g,%.17g,%.17g\\n", k * h, tip[0], tip[1], kinetic[0], strain[0], gravity[0]);
    }}
    if ({name}_step(q, v, base, {name}_parameters, &h, q_next, v_next) || isnan(q_next[0])) {{
      fprintf(stderr, "the step at %g s failed\\n", k * h);
      return 1;
    }}
    memcpy(q, q_next, sizeof(q));
    memcpy(v, v_next, sizeof(v));
  }}
  return 0;
}}
"""


def _pull(name: str, functions: BeamFunctions) -> str:
    """Return C code that finds the equilibrium under a pull."""
    p = cs.MX.sym("p", len(functions.parameters))
    tip = functions.tip(functions.equilibrium(p), cs.MX(len(functions.base), 1))
    place, change = _value_and_jacobian(tip, p, values(functions.parameters))
    x, y = place
    across = np.array([-y, x]) / np.hypot(x, y)
    pull = DEFLECTION * np.hypot(x, y) / np.linalg.norm(change[:, :2] @ across) * across
    pull_x, pull_y = pull.tolist()
    return f"""  const double pull[2] = {{{pull_x!r}, {pull_y!r}}};  /* added to gravity before time 0, m/s2 */
  double p[{name.upper()}_PARAMETERS];
  memcpy(p, {name}_parameters, sizeof(p));
  p[0] += pull[0];
  p[1] += pull[1];
  if ({name}_equilibrium(p, q) || isnan(q[0])) {{
    fprintf(stderr, "no equilibrium was found\\n");
    return 1;
  }}"""


def _deflection(functions: MotionFunctions) -> str:
    """Return C code that deflects the beam in mode 1."""
    q = cs.MX.sym("q", functions.free)
    tip = functions.tip(q, cs.MX(len(functions.base), 1))
    place, change = _value_and_jacobian(tip, q, np.zeros(functions.free))
    first = DEFLECTION * np.linalg.norm(place) / np.linalg.norm(change[:, 0])
    return f"  q[0] = {float(first)!r};  /* deflection in mode 1, m kg^0.5 */"


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
