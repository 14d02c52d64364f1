"""Time integration by IDAS, the variable-step backward differentiation formulas of SUNDIALS.

``semi_explicit`` states the equation of motion with the scaled unknowns x and z, and its exact Jacobian.

Time.  Each smooth piece of the excitation is divided into segments t = begin + span s with s from 0 to 1.  IDAS
restarts on each with consistent accelerations; begin and span are parameters, so that one integrator serves all
segments.

Order.  Undamped high modes lie on the imaginary axis, where backward differentiation formulas of order 3 to 5 are
unstable, so the order is limited to 2.

Energy.  Three powers are integrated with the motion, so that its energy balance can be checked: the power lost to
damping, the power of the base, which is the force on the clamped node times the velocity of this node, and the power of
the tip load.

References
----------
Hindmarsh et al. 2005, "SUNDIALS: Suite of nonlinear and differential/algebraic equation solvers".
"""

from __future__ import annotations

import contextlib
import functools
import io
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

import casadi as cs
import numpy as np
import scipy.sparse.linalg

from ancf_casadi.dynamics.segments import ENERGY_STATES, InitialValueProblem, Segment, SegmentSolution
from ancf_casadi.dynamics.semi_explicit import SemiExplicit
from ancf_casadi.dynamics.trajectory import State
from ancf_casadi.exceptions import InputError, SimulationError

DEFAULTS: Mapping[str, Any] = {
    "reltol": 1e-12,
    "max_multistep_order": 2,
    "linear_solver": "csparse",
    "cj_scaling": True,
    "suppress_algebraic": True,
    "calc_ic": False,
    "max_num_steps": 200_000,  # between two samples
}


def integrate_by_idas(problem: InitialValueProblem) -> Iterator[SegmentSolution]:
    """Integrate over a smooth piece of the excitation, and yield the solution on each segment.

    The options of the problem override ``DEFAULTS``.

    Raises
    ------
    InputError
        If IDAS refuses an option.
    SimulationError
        If IDAS fails.
    """
    form, excitation, largest_step = SemiExplicit(problem.equations), problem.excitation, problem.largest_step
    settings = {**DEFAULTS, "abstol": problem.tolerance, **problem.options}
    s, interval = cs.MX.sym("s"), cs.MX.sym("interval", 2)
    x, z = cs.MX.sym("x", form.residual.size1_in(0)), cs.MX.sym("z", form.residual.size1_in(1))
    begin, span = cs.vertsplit(interval)
    x_t, alg = form.residual(x, z, excitation(begin + span * s), form.parameters)
    powers, reaction = form.energetics(x, z, excitation(begin + span * s), form.parameters)
    dae = {"t": s, "x": x, "z": z, "p": interval, "ode": span * x_t, "alg": alg, "quad": span * powers}
    linear = cs.Function("linear", [s, x, z, interval], [alg, cs.jacobian(alg, z)])  # alg is linear in z
    forces = cs.Function("forces", [x, z, s, interval], [reaction])

    @functools.cache
    def solver(points: int, length: float) -> cs.Function:
        grid = np.linspace(0.0, 1.0, points + 1)[1:]
        bound = {} if largest_step == math.inf else {"max_step_size": largest_step / length}
        try:
            with _printed():
                return cs.integrator("integrator", "idas", dae, 0.0, grid, {**bound, **settings})
        except RuntimeError as error:
            raise InputError(_refusal(str(error)), "options") from None

    x0 = form.scaled(problem.start)
    for segment in problem.segments:
        p = [segment.start, segment.length]
        constant, matrix = linear(0.0, x0, 0.0, p)
        z0 = -scipy.sparse.linalg.splu(matrix.sparse()).solve(constant.full().ravel())
        run = solver(segment.points, segment.length if largest_step < math.inf else 1.0)
        with _printed() as printed:
            try:
                result = run(x0=x0, z0=z0, p=p)
            except RuntimeError as error:
                raise _failure(printed.getvalue() + str(error), segment) from None
        states = np.vstack([x0, result["xf"].full().T])
        unknowns = np.vstack([z0, result["zf"].full().T])
        coordinates, velocities = form.unscaled(states, excitation(segment.instants[None, :]).full().T)
        energies = np.vstack([np.zeros(ENERGY_STATES), result["qf"].full().T])
        kept = segment.kept
        yield SegmentSolution(
            coordinates=coordinates[kept],
            velocities=velocities[kept],
            forces=forces(states.T, unknowns.T, np.linspace(0.0, 1.0, segment.points + 1)[None, :], p).full().T[kept],
            energies=energies[kept],
            end=State(coordinates[-1], velocities[-1], segment.end),
            end_energies=energies[-1],
            segment=segment,
            steps=int(run.stats()["nsteps"]),
        )
        x0 = states[-1]


@contextlib.contextmanager
def _printed() -> Iterator[io.StringIO]:
    """Collect what CasADi prints, and keep it off the terminal."""
    text = io.StringIO()
    with contextlib.redirect_stdout(text), contextlib.redirect_stderr(text):
        yield text


def _refusal(message: str) -> str:
    """Return one line that names the option refused by CasADi's IDAS interface."""
    reasons = r"Unknown option: .+|Illegal type for .+|Cannot load shared library \S+'|IDA\w+ returned .\w+."
    said = re.search(reasons, message)
    return f"CasADi's IDAS interface refuses them: {said[0] if said else message.strip().splitlines()[0]}"


def _failure(message: str, segment: Segment) -> SimulationError:
    """Return an error with a message of one line: how and when IDAS failed, a possible cause, and what to try."""
    said = re.search(r"[Aa]t t = ([-+.\de]+)(?: and h = ([-+.\de]+))?", message)
    time = segment.start + segment.length * (float(said[1]) if said else 0.0)
    step = f" with a step of {segment.length * float(said[2]):.1e} s" if said and said[2] else ""
    if "TOO_MUCH_WORK" in message:
        what = "took too many steps between two samples"
        why = "modes of the mesh may vibrate undamped, perhaps after an impact on the clamp or a blow on the tip"
    elif "CONV_FAIL" in message:
        what = "could not solve the equations of a step"
        why = "the beam may bend more sharply than its elements can follow, or the tolerance may be below rounding"
    else:
        what = "could not meet the tolerance"
        why = "the tolerance may be below rounding, or the clamp may have suffered an impact"
    return SimulationError(
        f"IDAS {what} at {time:.6g} s{step}: {why}; try method='radau', another tolerance, a little damping "
        "proportional to the strain rate, or more elements",
        time,
    )
