"""Time integration by IDAS, the variable-step backward differentiation formulas of SUNDIALS.

Form.  With the accelerations as algebraic unknowns, the Jacobian is as sparse as the mesh.  For the same reason, the
low-rank part R B diag(d) B^T R^T e_t of the damping force is written R B (d * w) with the further unknowns
w = B^T R^T e_t.

Scaling.  The unknowns are x = (displacement/S, v/(S W)) and z = (a/(S W^2), w/(L W)), with S the length L of the beam
for positions and 1/2 for slopes, and W the bending frequency of a single element.  One tolerance, relative to L, then
serves all unknowns.  Without the scaling, the noise that Newton's method leaves in the positions, divided by the step,
would become a velocity error that makes every other step fail.  The force balance is divided by diag(M) S W^2, so that
a sparse factorisation finds its pivots on the diagonal and stays within the band of the mesh.

Time.  Each smooth piece of the excitation is divided into segments t = begin + span s with s from 0 to 1.  IDAS
restarts on each with consistent accelerations; begin and span are parameters, so that one integrator serves all
segments.

Order.  Undamped high modes lie on the imaginary axis, where backward differentiation formulas of order 3 to 5 are
unstable, so the order is limited to 2.

Relaxation.  The internal strains of a law with Maxwell branches (``damping.viscoelastic``) are further differential
unknowns, each in units of the largest strain that displacement unknowns up to 1 cause.

Energy.  The three powers of ``Balance.powers`` are integrated with the motion, so that its balance can be checked.

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
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np
import scipy.sparse.linalg

from ancf_casadi.dynamics.dense_output import SegmentSolution, Slopes, Steps
from ancf_casadi.dynamics.equations import Balance, Equations, as_they_are, scaled_matrix
from ancf_casadi.dynamics.excitation import EXCITATION, Excitation, Segment
from ancf_casadi.exceptions import InputError, SimulationError
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.state import State
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
    """The scaled equation of motion with the accelerations as algebraic unknowns."""

    equations: Equations

    @cached_property
    def element_frequency(self) -> float:
        """W, the highest bending frequency of a single pinned element, pi^2 (E I/mu)^1/2/l^2, rad/s."""
        model = self.equations.model
        _, thickness, density, elastic_modulus = model.properties
        stiffness = np.sqrt(elastic_modulus / density) * thickness / math.sqrt(12)
        return float(math.pi**2 * stiffness.max() / model.beam.element_lengths.min() ** 2)

    @cached_property
    def residual(self) -> cs.Function:
        """(x, z, excitation) -> x_t, residual of the algebraic equations; differentiable in x and z."""
        x, z, excitation = self._symbols
        model, free, W = self.equations.model, self.equations.free, self.element_frequency
        e, e_t, e_tt = self._motion
        overstrains = self._overstrains
        forces = self._balance.local(e, e_t, e_tt, excitation[3 * NODE :], overstrains)
        w = model.beam.length * W * z[free:]
        if w.numel():
            forces += self._balance.modal_damping(e[2:NODE], w)
        modal = (self._balance.modal_velocities(e[2:NODE], e_t) - w) / (model.beam.length * W)
        motion = cs.vertcat(W * x[free : 2 * free], W * z[:free])
        _, times, units = self._of_branches
        internal_rates = cs.MX(0, 1) if overstrains is None else cs.vec(overstrains) / cs.DM(times * units)
        outputs = [cs.vertcat(motion, internal_rates), cs.vertcat(model.of_free(forces) / self._divisors, modal)]
        options: Any = {"is_diff_in": [True, True, False], "custom_jacobian": self._jacobian}
        options |= {"enable_forward": False, "enable_reverse": False}  # all derivatives come from the Jacobian
        names = ["x", "z", "excitation"], ["x_t", "alg"]
        return cs.Function("residual", [x, z, excitation], outputs, *names, options)

    @cached_property
    def powers(self) -> cs.Function:
        """(x, z, excitation) -> powers as in ``Balance.powers``."""
        powers = self._balance.powers(*self._motion, self._symbols[2][3 * NODE :], self._overstrains)
        return cs.Function("powers", self._symbols, [powers], {"is_diff_in": [False] * 3})

    @cached_property
    def motion(self) -> cs.Function:
        """(x, z, excitation) -> e, e_t and e_tt."""
        return cs.Function("motion", self._symbols, [*self._motion], {"is_diff_in": [False] * 3})

    def unknowns_at(self, state: State) -> Array:
        """Return x of a state."""
        model = self.equations.model
        displacement = (state.coordinates - model.straight) / model.scale
        velocity = state.velocities / (model.scale * self.element_frequency)
        internal = self.equations.internal(state, self.equations.parameters) / self._of_branches[-1]
        return np.concatenate([model.of_free(displacement), model.of_free(velocity), internal])

    def internal(self, x: Array) -> Array:
        """Return the internal strains of x."""
        return np.asarray(x[2 * self.equations.free :] * self._of_branches[-1])

    @cached_property
    def _of_branches(self) -> tuple[Array, Array, Array]:
        """Relative moduli, relaxation times, s, and units of the internal strains, (m b n,) each."""
        equations, model = self.equations, self.equations.model
        if not equations.branches:
            return (np.zeros(0),) * 3
        rows, elements = equations.internal_shape
        strains, units = rows // equations.branches, abs(self._gradients(model.straight).full()) @ model.free_scale
        moduli, times = (np.tile(np.repeat(values, strains), elements) for values in equations.law.branch_values)
        return moduli, times, units

    @cached_property
    def _overstrains(self) -> cs.MX | None:
        """The overstrains, (m b, n); None if the law does not relax."""
        _, _, units = self._of_branches
        return self._balance.overstrains(self._motion[0], self._symbols[0][2 * self.equations.free :] * cs.DM(units))

    @cached_property
    def _gradients(self) -> cs.Function:
        """(e) -> Jacobian of the internal strains of a relaxed beam for the free coordinates, (m b n, N), sparse."""
        equations, e = replace(self.equations, make=as_they_are), cs.MX.sym("e", self.equations.model.size)
        by_all = cs.jacobian(equations.relaxed(e, equations.parameters), e)
        return cs.Function("gradients", [e], [by_all @ equations.model.whole_of_free])

    @cached_property
    def _jacobian(self) -> cs.Function:
        """The Jacobian of ``residual``; CasADi alone would take columns beside the dense ones of B one at a time."""
        x, z, excitation = self._symbols
        model, free, m = self.equations.model, self.equations.free, self.equations.projection.shape[1]
        W, divisors, balance, (e, e_t, _) = self.element_frequency, self._divisors, self._balance, self._motion
        scale = cs.MX(cs.DM(model.free_scale))
        tangents = balance.tangents(e, e_t, excitation[3 * NODE :], self._overstrains)
        k, d, mass = map(model.free_matrix, tangents)
        moduli, times, units = map(cs.DM, self._of_branches)
        size, by_q, by_internal = units.numel(), cs.MX(0, free), cs.MX(free, 0)
        if size:
            gradients = self._gradients(e)
            k += gradients.T @ cs.diag(moduli) @ gradients
            by_q = scaled_matrix(gradients, 1 / (times * units), scale)
            by_internal = scaled_matrix(-gradients.T, 1 / divisors, moduli * units)
        length, B, identity = model.beam.length, model.of_free(balance.turned_projection(e)), cs.MX.eye(free)
        none = cs.MX(free, free)
        w_by_v, by_w = scaled_matrix(B.T, cs.MX.ones(m) / length, scale), balance.modal_coefficients * length * W
        jacobians = [
            cs.vertcat(
                cs.horzcat(cs.MX(2 * free, free), cs.vertcat(W * identity, none), cs.MX(2 * free, size)),
                cs.horzcat(by_q, cs.MX(size, free), -cs.diag(1 / times)),
            ),
            cs.horzcat(cs.vertcat(none, W * identity, cs.MX(size, free)), cs.MX(2 * free + size, m)),
            cs.MX(2 * free + size, excitation.numel()),
            cs.vertcat(
                cs.horzcat(
                    scaled_matrix(k, 1 / divisors, scale), scaled_matrix(d, 1 / divisors, scale * W), by_internal
                ),
                cs.horzcat(cs.MX(m, free), w_by_v, cs.MX(m, size)),
            ),
            cs.vertcat(
                cs.horzcat(scaled_matrix(mass, 1 / divisors, scale * W**2), scaled_matrix(B, 1 / divisors, by_w)),
                cs.horzcat(cs.MX(m, free), -cs.DM.eye(m)),
            ),
            cs.MX(free + m, excitation.numel()),
        ]
        unused = [cs.MX.sym("out_x_t", cs.Sparsity(2 * free + size, 1)), cs.MX.sym("out_alg", cs.Sparsity(free + m, 1))]
        ins = ["x", "z", "excitation", "out_x_t", "out_alg"]
        outs = [f"jac_{of}_{by}" for of in ("x_t", "alg") for by in ins[:3]]
        return cs.Function("jac_residual", [x, z, excitation, *unused], jacobians, ins, outs)

    @cached_property
    def _symbols(self) -> tuple[cs.MX, cs.MX, cs.MX]:
        free, m = self.equations.free, self.equations.projection.shape[1]
        unknowns = 2 * free + self.equations.internal_size
        return cs.MX.sym("x", unknowns), cs.MX.sym("z", free + m), cs.MX.sym("excitation", EXCITATION)

    @cached_property
    def _balance(self) -> Balance:
        return self.equations.balance(cs.MX(cs.DM(self.equations.parameters)))

    @cached_property
    def _divisors(self) -> cs.MX:
        """Divisors of the force balance, diag(M) S W^2."""
        model = self.equations.model
        diagonal = model.weights**2 * model.mass(model.properties).sparse().diagonal()
        free_mass = np.bincount(model.free_of[model.weights != 0.0], diagonal[model.weights != 0.0])
        return cs.MX(cs.DM(free_mass * model.free_scale * self.element_frequency**2))

    @cached_property
    def _motion(self) -> tuple[cs.MX, cs.MX, cs.MX]:
        """The coordinates e, e_t and e_tt."""
        x, z, excitation = self._symbols
        model, free, W = self.equations.model, self.equations.free, self.element_frequency
        scale, origin = cs.DM(model.free_scale), cs.DM(model.of_free(model.straight))
        moved = (
            origin + scale * x[:free],
            scale * W * x[free : 2 * free],
            scale * W**2 * z[:free],
        )
        node = cs.vertsplit(excitation[: 3 * NODE], NODE)
        e, e_t, e_tt = (model.whole(base, free) for free, base in zip(node, moved, strict=True))
        return e, e_t, e_tt


def integrate_by_idas(
    equations: Equations,
    piece: Excitation,
    start: State,
    segments: Iterable[Segment],
    tolerance: float,
    largest_step: float,
    options: Mapping[str, Any],
) -> Iterator[SegmentSolution]:
    """Integrate over a smooth piece of the excitation, and yield the solution on each segment."""
    form, excitation = SemiExplicit(equations), piece.function
    settings = {**DEFAULTS, "abstol": tolerance, **options}
    s, interval = cs.MX.sym("s"), cs.MX.sym("interval", 2)
    x, z = cs.MX.sym("x", form.residual.size1_in(0)), cs.MX.sym("z", form.residual.size1_in(1))
    begin, span = cs.vertsplit(interval)
    x_t, alg = form.residual(x, z, excitation(begin + span * s))
    powers = form.powers(x, z, excitation(begin + span * s))
    motion = list(form.motion(x, z, excitation(begin + span * s)))
    dae = {"t": s, "x": x, "z": z, "p": interval, "ode": span * x_t, "alg": alg, "quad": span * powers}
    linear = cs.Function("linear", [s, x, z, interval], [alg, cs.jacobian(alg, z)])  # alg is linear in z
    samples, slopes = cs.Function("samples", [x, z, s, interval], motion), Slopes(equations.model)

    @functools.cache
    def solver(points: int, length: float) -> cs.Function:
        grid = np.linspace(0.0, 1.0, points + 1)[1:]
        bound = {} if largest_step == math.inf else {"max_step_size": largest_step / length}
        try:
            with _capture_output():
                return cs.integrator("integrator", "idas", dae, 0.0, grid, {**bound, **settings})
        except RuntimeError as error:
            raise InputError(_refusal(str(error)), "options") from None

    x0 = form.unknowns_at(start)
    for segment in segments:
        p = [segment.start, segment.length]
        constant, matrix = linear(0.0, x0, 0.0, p)
        z0 = -scipy.sparse.linalg.splu(matrix.sparse()).solve(constant.full().ravel())
        run = solver(segment.points, segment.length if largest_step < math.inf else 1.0)
        with _capture_output() as printed:
            try:
                result = run(x0=x0, z0=z0, p=p)
            except RuntimeError as error:
                raise _failure(printed.getvalue() + str(error), segment) from None
        states = np.vstack([x0, result["xf"].full().T])
        unknowns = np.vstack([z0, result["zf"].full().T])
        motions = samples(states.T, unknowns.T, np.linspace(0.0, 1.0, segment.points + 1)[None, :], p)
        ends = np.array([columns.full().T for columns in motions]).swapaxes(0, 1)
        steps = Steps(slopes, segment.instants, ends, work=np.diff(result["qf"].full().T, axis=0, prepend=0.0))
        end = State(ends[-1, 0], ends[-1, 1], segment.end, form.internal(states[-1]))
        yield SegmentSolution(segment, steps, end, int(run.stats()["nsteps"]))
        x0 = states[-1]


@contextlib.contextmanager
def _capture_output() -> Iterator[io.StringIO]:
    """Collect what CasADi prints, and keep it off the terminal."""
    text = io.StringIO()
    with contextlib.redirect_stdout(text), contextlib.redirect_stderr(text):
        yield text


def _refusal(message: str) -> str:
    """Return one line that names the option refused by CasADi's IDAS interface."""
    reasons = r"Unknown option: .+|Illegal type for .+|Cannot load shared library \S+'|IDA\w+ returned .\w+."
    reason = re.search(reasons, message)
    return f"CasADi's IDAS interface refuses them: {reason[0] if reason else message.strip().splitlines()[0]}"


def _failure(message: str, segment: Segment) -> SimulationError:
    """Return an error with a message of one line: how and when IDAS failed, a possible cause, and what to try."""
    instant = re.search(r"[Aa]t t = ([-+.\de]+)(?: and h = ([-+.\de]+))?", message)
    time = segment.start + segment.length * (float(instant[1]) if instant else 0.0)
    step = f" with a step of {segment.length * float(instant[2]):.1e} s" if instant and instant[2] else ""
    if "TOO_MUCH_WORK" in message:
        failure = "took too many steps between two samples"
        why = "modes of the mesh may vibrate undamped, perhaps after an impact on the clamp or a blow on the tip"
    elif "CONV_FAIL" in message:
        failure = "could not solve the equations of a step"
        why = "the beam may bend more sharply than its elements can follow, or the tolerance may be below rounding"
    else:
        failure = "could not meet the tolerance"
        why = "the tolerance may be below rounding, or the clamp may have suffered an impact"
    return SimulationError(
        f"IDAS {failure} at {time:.6g} s{step}: {why}; try method='radau', another tolerance, a little damping "
        "proportional to the strain rate, or more elements",
        time,
    )
