"""Time integration by IDAS, the variable-step backward differentiation formulas of SUNDIALS, with exact Jacobians.

Form.  With the accelerations as algebraic unknowns the Jacobian stays as sparse as the mesh; the part B diag(d) B^T e_t
of a damping force, B turned with the clamp, is written B (d * w) with the further unknowns w = B^T e_t for the same
reason.

Scaling.  The unknowns are x = (displacement/S, v/(S W)) and z = (a/(S W^2), w/(L W)), with S the length L of the beam
for positions and 1/2 for slopes, and W the bending frequency of a single element.  One tolerance, relative to L, then
serves them all, and the noise that Newton's method leaves in the positions is not divided by the step into a velocity
error that fails every other step.  The balance of forces is divided by diag(M) S W^2; a sparse factorisation then finds
its pivots on the diagonal, where they leave the band of the mesh alone.

Time.  Each smooth piece of the base motion is cut into segments t = start + span s with s from 0 to 1, and IDAS
restarted on each with consistent accelerations; start and span are parameters, so that one integrator serves all.

Order.  Undamped high modes lie on the imaginary axis, where backward differentiation formulas of order 3 to 5 are
unstable; the order is 2.

Energy.  The power of the base, the force on the clamped node times its velocity, and the power lost to damping are
integrated along, so that every motion can be held against its balance of energy.

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
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np
import scipy.sparse.linalg

from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.segments import InitialValueProblem, Segment, SegmentSolution
from ancf_casadi.dynamics.trajectory import State
from ancf_casadi.exceptions import InputError, SimulationError
from ancf_casadi.mechanics.model import NODE
from ancf_casadi.support.arrays import Array

DEFAULTS: Mapping[str, Any] = {
    "reltol": 1e-12,
    "max_multistep_order": 2,
    "linear_solver": "csparse",
    "cj_scaling": True,
    "suppress_algebraic": True,
    "calc_ic": False,
    "max_num_steps": 200_000,  # between two samples
}


@dataclass(frozen=True, eq=False)
class SemiExplicit:
    """The scaled equation of motion with the accelerations as algebraic unknowns.

    Parameters
    ----------
    equations : Equations
        The equation of motion.
    """

    equations: Equations

    @cached_property
    def rate(self) -> float:
        """W, the highest bending frequency of a single pinned element, pi^2 (E I/mu)^1/2/l^2, rad/s."""
        model = self.equations.model
        _, thickness, density, elastic_modulus = model.properties
        stiffness = np.sqrt(elastic_modulus / density) * thickness / math.sqrt(12)
        return float(math.pi**2 * stiffness.max() / model.beam.element_length**2)

    @cached_property
    def parameters(self) -> Array:
        """W, the divisors of the force balance diag(M) S W^2, and the parameters of the forces."""
        model = self.equations.model
        diagonal = model.mass(model.properties).sparse().diagonal()[model.free]
        weights = diagonal * model.scale[model.free] * self.rate**2
        return np.concatenate([[self.rate], weights, self.equations.parameters])

    @cached_property
    def residual(self) -> cs.Function:
        """(x, z, clamp, parameters) -> x_t and the residual of z; differentiable in x and z.

        ``clamp`` is the clamped node's position, velocity and acceleration, (12,).
        """
        inputs = self._symbols
        outputs = self._write(*inputs)
        names = ["x", "z", "clamp", "parameters"], ["x_t", "alg"]
        options: Any = {"is_diff_in": [True, True, False, False], "custom_jacobian": self._jacobian}
        options |= {"enable_forward": False, "enable_reverse": False}  # every derivative is made of the Jacobian
        return cs.Function("residual", list(inputs), [outputs.x_t, outputs.remainder], *names, options)

    @cached_property
    def energetics(self) -> cs.Function:
        """(x, z, clamp, parameters) -> powers and reaction.

        The powers are those lost to damping and put in by the base, W; the reaction is the generalized force of the
        base on the clamped node, (4,).
        """
        inputs = self._symbols
        outputs = self._write(*inputs)
        options = {"is_diff_in": [False] * 4}
        return cs.Function("energetics", list(inputs), [outputs.powers, outputs.forces[:NODE]], options)

    def scaled(self, state: State) -> Array:
        """Return x of a state."""
        model = self.equations.model
        displacement = (state.coordinates - model.straight) / model.scale
        rates = state.velocities / (model.scale * self.rate)
        return np.concatenate([displacement[model.free], rates[model.free]])

    def unscaled(self, x: Array, clamps: Array) -> tuple[Array, Array]:
        """Return all coordinates and their rates from x, (k, 2 N), and the clamped nodes, (k, 12)."""
        model = self.equations.model
        displacement, rates = np.split(x, 2, axis=-1)
        scale = model.scale[model.free]
        coordinates = model.straight[model.free] + scale * displacement
        position, velocity, _ = np.split(clamps, 3, axis=-1)
        return np.hstack([position, coordinates]), np.hstack([velocity, scale * self.rate * rates])

    @cached_property
    def _jacobian(self) -> cs.Function:
        """The Jacobian of the residual, written block by block.

        Rows and columns of B are full; with them, CasADi would find all other columns one at a time.
        """
        x, z, clamp, parameters = self._symbols
        model, free, m = self.equations.model, self.equations.free, self.equations.projection.shape[1]
        rate, weights, rest = cs.vertsplit(parameters, [0, 1, 1 + free, parameters.numel()])
        balance, scale = self.equations.balance(rest), cs.MX(cs.DM(model.scale[model.free]))
        e, e_t = self._coordinates(x, rate, clamp)
        k, d, mass = (model.matrix(values, NODE) for values in balance.tangents(e, e_t))
        length, B, identity = model.beam.length, balance.turned_projection(e)[NODE:, :], cs.DM.eye(free)
        none = cs.DM(free, free)
        w_by_v, by_w = _scaled(B.T, cs.MX.ones(m) / length, scale), balance.modal_coefficients * length * rate
        jacobians = [
            cs.horzcat(cs.DM(2 * free, free), cs.vertcat(rate * identity, none)),
            cs.horzcat(cs.vertcat(none, rate * identity), cs.DM(2 * free, m)),
            cs.MX(2 * free, clamp.numel()),
            cs.MX(2 * free, parameters.numel()),
            cs.vertcat(
                cs.horzcat(_scaled(k, 1 / weights, scale), _scaled(d, 1 / weights, scale * rate)),
                cs.horzcat(cs.MX(m, free), w_by_v),
            ),
            cs.vertcat(
                cs.horzcat(_scaled(mass, 1 / weights, scale * rate**2), _scaled(B, 1 / weights, by_w)),
                cs.horzcat(cs.MX(m, free), -cs.DM.eye(m)),
            ),
            cs.MX(free + m, clamp.numel()),
            cs.MX(free + m, parameters.numel()),
        ]
        unused = [cs.MX.sym("out_x_t", cs.Sparsity(2 * free, 1)), cs.MX.sym("out_alg", cs.Sparsity(free + m, 1))]
        ins = ["x", "z", "clamp", "parameters", "out_x_t", "out_alg"]
        outs = [f"jac_{of}_{by}" for of in ("x_t", "alg") for by in ins[:4]]
        return cs.Function("jac_residual", [x, z, clamp, parameters, *unused], jacobians, ins, outs)

    @cached_property
    def _symbols(self) -> tuple[cs.MX, cs.MX, cs.MX, cs.MX]:
        free, m = self.equations.free, self.equations.projection.shape[1]
        sizes = {"x": 2 * free, "z": free + m, "clamp": 3 * NODE, "parameters": self.parameters.size}
        x, z, clamp, parameters = (cs.MX.sym(name, size) for name, size in sizes.items())
        return x, z, clamp, parameters

    def _coordinates(self, x: cs.MX, rate: cs.MX, clamp: cs.MX) -> tuple[cs.MX, cs.MX]:
        """Return e and e_t."""
        model, free = self.equations.model, self.equations.free
        scale = model.scale[model.free]
        q, v = model.straight[model.free] + scale * x[:free], scale * rate * x[free:]
        return cs.vertcat(clamp[:NODE], q), cs.vertcat(clamp[NODE : 2 * NODE], v)

    def _write(self, x: cs.MX, z: cs.MX, clamp: cs.MX, parameters: cs.MX) -> _Outputs:
        """Write the equation of motion in the scaled unknowns."""
        model, free = self.equations.model, self.equations.free
        rate, weights, rest = cs.vertsplit(parameters, [0, 1, 1 + free, parameters.numel()])
        balance, scale = self.equations.balance(rest), model.scale[model.free]
        e, e_t = self._coordinates(x, rate, clamp)
        a, w = scale * rate**2 * z[:free], model.beam.length * rate * z[free:]
        e_tt, velocity = cs.vertcat(clamp[2 * NODE :], a), clamp[NODE : 2 * NODE]
        forces, lost = balance.local(e, e_t, e_tt)
        if w.numel():
            further = balance.modal_damping(e, w)
            forces, lost = forces + further, lost + cs.dot(e_t, further)
        excess = balance.modal_velocities(e, e_t) - w
        return _Outputs(
            x_t=cs.vertcat(rate * x[free:], rate * z[:free]),
            forces=forces,
            remainder=cs.vertcat(forces[model.free] / weights, excess / (model.beam.length * rate)),
            powers=cs.vertcat(lost, cs.dot(velocity, forces[:NODE])),
        )


@dataclass(frozen=True)
class _Outputs:
    """The symbols of the equation of motion: rates of x, forces at all nodes, residual of z, powers."""

    x_t: cs.MX
    forces: cs.MX
    remainder: cs.MX
    powers: cs.MX


def _scaled(matrix: cs.MX, left: cs.MX, right: cs.MX) -> cs.MX:
    """Return diag(left) matrix diag(right)."""
    rows, columns = matrix.sparsity().get_triplet()
    factors = cs.vec(cs.MX(left)[rows]) * cs.vec(cs.MX(right)[columns])
    return cs.MX(matrix.sparsity(), cs.vec(matrix.nz[:]) * factors)


def integrate_by_idas(problem: InitialValueProblem) -> Iterator[SegmentSolution]:
    """Integrate over a smooth piece of the base motion, and yield the solution on each segment.

    The options of the problem override ``DEFAULTS``.

    Raises
    ------
    InputError
        If IDAS refuses an option.
    SimulationError
        If IDAS fails.
    """
    clamp, largest_step = problem.clamp, problem.largest_step
    form = SemiExplicit(problem.equations)
    residual, energetics = form.residual, form.energetics
    settings = {**DEFAULTS, "abstol": problem.tolerance, **problem.options}
    s, time_span = cs.MX.sym("s"), cs.MX.sym("time", 2)
    x, z = cs.MX.sym("x", residual.size1_in(0)), cs.MX.sym("z", residual.size1_in(1))
    begin, span = cs.vertsplit(time_span)
    x_t, alg = residual(x, z, clamp(begin + span * s), form.parameters)
    powers, reaction = energetics(x, z, clamp(begin + span * s), form.parameters)
    dae = {"t": s, "x": x, "z": z, "p": time_span, "ode": span * x_t, "alg": alg, "quad": span * powers}
    slope = cs.jacobian(alg, z)
    linear = cs.Function("linear", [s, x, z, time_span], [alg, slope])  # alg is linear in z
    forces = cs.Function("forces", [x, z, s, time_span], [reaction])

    @functools.cache
    def solver(points: int, length: float) -> cs.Function:
        grid = np.linspace(0.0, 1.0, points + 1)[1:]
        bound = {} if largest_step == math.inf else {"max_step_size": largest_step / length}
        try:
            with _quiet():
                return cs.integrator("integrator", "idas", dae, 0.0, grid, {**bound, **settings})
        except RuntimeError as error:
            raise InputError(_refusal(str(error)), "options") from None

    x0 = form.scaled(problem.start)
    for segment in problem.segments:
        p = [segment.start, segment.length]
        constant, matrix = linear(0.0, x0, 0.0, p)
        z0 = -scipy.sparse.linalg.splu(matrix.sparse()).solve(constant.full().ravel())
        run = solver(segment.points, segment.length if largest_step < math.inf else 1.0)
        printed = io.StringIO()
        try:
            with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
                result = run(x0=x0, z0=z0, p=p)
        except RuntimeError as error:
            raise _failure(printed.getvalue() + str(error), segment) from None
        states = np.vstack([x0, result["xf"].full().T])
        unknowns = np.vstack([z0, result["zf"].full().T])
        clamps = clamp(segment.instants[None, :]).full().T
        coordinates, velocities = form.unscaled(states, clamps)
        energies = np.vstack([np.zeros(2), result["qf"].full().T])
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
def _quiet() -> Iterator[None]:
    """Keep what CasADi prints off the terminal."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        yield


def _refusal(message: str) -> str:
    """Say in a line which option CasADi's IDAS interface refuses."""
    reasons = r"Unknown option: .+|Illegal type for .+|Cannot load shared library \S+'|IDA\w+ returned .\w+."
    said = re.search(reasons, message)
    return f"CasADi's IDAS interface refuses them: {said[0] if said else message.strip().splitlines()[0]}"


def _failure(message: str, segment: Segment) -> SimulationError:
    """Say in a line when and how IDAS failed, why that may be, and what to try."""
    said = re.search(r"[Aa]t t = ([-+.\de]+)(?: and h = ([-+.\de]+))?", message)
    time = segment.start + segment.length * (float(said[1]) if said else 0.0)
    step = f" with a step of {segment.length * float(said[2]):.1e} s" if said and said[2] else ""
    if "TOO_MUCH_WORK" in message:
        what = "took too many steps between two samples"
        why = "modes of the mesh may ring with nothing to damp them, or an impact on the clamp have set them off"
    elif "CONV_FAIL" in message:
        what = "could not solve for a step"
        why = "the beam may bend more sharply than its elements can follow, or the tolerance be below rounding"
    else:
        what = "could not keep to the tolerance"
        why = "the tolerance may be below rounding, or the beam have been struck"
    return SimulationError(
        f"IDAS {what} at {time:.6g} s{step}: {why}; try method='radau', another tolerance, a little damping "
        "proportional to the strain rate, or more elements",
        time,
    )
