"""A motion that depends on parameters, and its exact derivatives, forward and in reverse; release from a load.

The parameters are theta of the law, b of the base motion, the properties P of the elements, the lumped properties m
(mass at the tip, stiffness of the clamp), for a beam released from an unknown load, this load and its rate, s, and the
shifts d of the clocks by which the motion was sampled.  A start at rest depends on P, m, s and, in a flow, on theta
through the static equilibrium; unless it is an impact, the beam moves with its clamp as one rigid body
(``dynamics.start``), so that its velocities depend on b as well.  The derivatives are those of the Radau steps that
were taken, with fixed lengths: exact for the computed motion, and as accurate as this motion.  They are chained through
the linearised steps (``tangent``), forward for few parameters and in reverse for few results.  Samples are the quintic
polynomials through the ends of the steps, and their time derivatives (``tangent``): linear in the ends, and within
twice the tolerance of those of ``simulate`` (``dense_output``).

Release.  A load p = (Fx, Fy, m) at the tip holds the beam in q(p, x), where the forces R(q, p, x) on the free
coordinates vanish; x are the parameters of the law if it has a flow, the properties P of the elements and the lumped
properties that the model has.  If the load changes slowly, at the rate p', the beam moves through these shapes with the
velocity v,

    R(q, p, x) = 0,    h = R_q v + R_p p' = 0,    K = R_q,

and is released with this shape and velocity, which bend the beam without stretching it, unlike a linear mode shape.
For a hanging beam, Fx and Fx' set the amplitude and phase of the first mode; force and moment set those of the first
two.  By the implicit function theorem,

    dq = -K^-1 (R_p dp + R_x dx),    dv = -K^-1 (h_q dq + h_p dp + h_x dx + R_p dp'),

in which h_q, h_p and h_x are the derivatives of K, R_p and R_x along the change (v, p') of q and p.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from ancf_casadi.damping import DampingLaw, RayleighDamping
from ancf_casadi.dynamics.base_motion import BaseMotion
from ancf_casadi.dynamics.derivatives.tangent import (
    MotionRun,
    Passage,
    Tangent,
    forward,
    reverse,
    sample_motion,
    sample_weights,
    samples_by_step,
    shared_tangent,
    stop_if_interrupted,
)
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.excitation import SAME_TIME, Excitation, excitation_pieces
from ancf_casadi.dynamics.limits import check_clamp, check_start, check_supports
from ancf_casadi.dynamics.placed_load import LOAD_SIZE, TIP, coordinates_at_rest
from ancf_casadi.dynamics.radau.stepper import RadauSteps, Stepper
from ancf_casadi.dynamics.start import (
    AT_REST,
    LOAD_NAMES,
    START_LOAD_NAMES,
    Start,
)
from ancf_casadi.dynamics.tip_load import TipLoad
from ancf_casadi.exceptions import InputError, SimulationError
from ancf_casadi.mechanics.loads import PointLoad
from ancf_casadi.mechanics.model import Model, check_curvature, model_with_properties
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.state import State
from ancf_casadi.support.arrays import Array, Index, Layout
from ancf_casadi.support.last_calls import keep_last
from ancf_casadi.vibration.equilibrium import Equilibrium

STILL_AIR = RayleighDamping()
MOST_KEPT_STEPS = 100_000  # these take a minute or two, and 0.4 GB at 20 elements


@dataclass(frozen=True, eq=False)
class SensitivityProblem:
    """A motion that depends on theta, b, P, m, s and d."""

    equations: Equations  # with the nominal parameters
    base: BaseMotion
    start: Start | Equilibrium | State
    times: Array  # the samples (k,), s, in any order
    tolerance: float  # of the steps
    largest_step: float = math.inf  # s
    held: bool = False  # whether s, in the order of ``START_LOAD_NAMES``, is a parameter
    most_steps: int = MOST_KEPT_STEPS  # which are all kept in memory
    load: TipLoad | None = None  # a given function of time
    orders: int = 1  # time derivatives to sample: 1 for e alone, 2 with e_t, 3 with e_tt
    # index of the shift that is added to each sample, (k,); none if empty
    clocks: Index = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    span: tuple[float, float] | None = None  # first and last instant of the motion, s; if None, of the samples
    lumped: bool = False  # whether m, in the order of ``Model.lumped``, is a parameter
    rows: Index = field(default_factory=lambda: np.zeros(0, dtype=np.int64))  # coordinates to sample; all if empty

    def __post_init__(self) -> None:
        """Validate."""
        if isinstance(self.start, Equilibrium) and self.start.loads:
            raise InputError(
                "only a load at the tip has derivatives here; give it as tip_force and tip_moment, or give a State",
                "start",
            )
        if self.lumped and not self.equations.model.lumped:
            raise InputError(
                "the beam has no mass, spring, dashpot, elastic clamp, natural curvature or prestress", "lumped"
            )
        if self.lumped and "natural_curvature" in self.equations.model.lumped:
            check_curvature(self.equations.model.beam)

    @cached_property
    def layout(self) -> Layout:
        """Layout of the values: theta, b, P, one element after the other, m, s and d."""
        return Layout.of(
            damping=len(self.equations.law.parameters),
            base=len(self.base.parameters),
            properties=self.equations.model.properties.size,
            lumped=len(self.equations.model.lumped) * self.lumped,
            start=len(START_LOAD_NAMES) * self.held,
            shifts=int(self.clocks.max(initial=-1)) + 1,
        )

    def solve(self, values: Array, most_steps: int | None = None) -> MotionRun:
        """Compute the motion for the values of theta, b, P, m, s and d, or raise an AncfError if there is none."""
        theta, b, properties, lumped, start_load, shifts = self.layout.split(values)
        model, parameters = self._model(properties, lumped), self.equations.parameters.copy()
        for name, values_of_name in self._parts(values).items():
            parameters[self.equations.layout[name]] = values_of_name
        first, last = self.span or (float(self.times[0]), float(self.times[-1]))
        times = self.times + shifts[self.clocks] if shifts.size else self.times
        if times.max() > last + SAME_TIME * (last - first):
            raise SimulationError(f"a sample at {times.max():g} s is after the end of the motion", last)
        pieces = excitation_pieces(self.equations.model, self.base, self.load, first, last, b)
        state, start_jacobian = self._first(model, pieces[0], start_load, theta)
        relaxed_jacobian = self._tangent.relaxed_jacobian(state, parameters)
        passages: list[Passage] = []
        steps_left = self.most_steps if most_steps is None else most_steps
        for piece in pieces:
            steps, jacobian, state = self._pass(piece, state, parameters, max(steps_left, 1))
            samples = samples_by_step(times, steps.instants, first=not passages)
            passages.append(Passage(piece, jacobian, steps, samples))
            steps_left -= steps.lengths.size
        before_start = np.flatnonzero(times < first - SAME_TIME * (last - first))
        weights = sample_weights(passages, times, self.orders + bool(shifts.size))
        motion = sample_motion(self.maps, passages, weights, times, before_start)
        return MotionRun(
            parameters=parameters,
            times=times,
            rest=before_start,
            start_jacobian=start_jacobian,
            relaxed_jacobian=relaxed_jacobian,
            passages=passages,
            samples=motion[:, : self.orders],
            rates=motion[:, 1:] if shifts.size else np.zeros(0),
            maps=self.maps,
            weights=weights[:, : self.orders],
        )

    def forward(self, run: MotionRun, directions: Array) -> Array:
        """Return the derivatives of the samples, (k, orders, rows, d), along directions of the values, (..., d)."""
        b, shifts = (directions[self.layout[name]] for name in ("base", "shifts"))
        parameters = self.equations.layout.join(directions.shape[1], **self._parts(directions))
        derivatives = forward(self._tangent, run, run.start_jacobian @ directions, b, parameters)
        if shifts.size:
            derivatives += run.rates[..., None] * shifts[self.clocks][:, None, None, :]
        return derivatives

    def reverse(self, run: MotionRun, weights: Array) -> Array:
        """Return the derivatives (..., d), by the values, of d sums of the samples, weights (k, orders, rows, d)."""
        start, b, parameters = reverse(self._tangent, run, weights)
        direct = self.layout.join(weights.shape[3], base=b)
        for name, derivatives in self._parts(direct).items():
            derivatives[:] = parameters[self.equations.layout[name]]
        if self.clocks.size:
            np.add.at(direct[self.layout["shifts"]], self.clocks, np.einsum("kon,kond->kd", run.rates, weights))
        return np.asarray(direct + run.start_jacobian.T @ start)

    @cached_property
    def maps(self) -> tuple[Array, Array]:
        """Maps from the free coordinates and from the base to the sampled coordinates, (rows, N) and (rows, 4)."""
        model, rows = self.equations.model, self.rows if self.rows.size else slice(None)
        of_base = model.whole(np.zeros((model.freedoms, NODE)), np.eye(NODE))
        return model.with_fixed_base(np.eye(model.freedoms))[rows], of_base[rows]

    @property
    def _tangent(self) -> Tangent:
        return shared_tangent(self.equations)

    @property
    def _start_jacobians(self) -> tuple[cs.Function, cs.Function]:
        return start_jacobians(self.equations.model, self._held_at, self._flowing)

    @property
    def _flowing(self) -> DampingLaw:
        """The law whose flow acts on the beam in its start."""
        return flowing(self.equations.law, self.equations.model, self.start)

    @property
    def _held_at(self) -> PointLoad:
        """The place of the load that holds the beam until its release."""
        if self.held or isinstance(self.start, Equilibrium) or self.load is None:
            return TIP
        return self.load.place or PointLoad(point=self.load.point)

    def _first(self, model: Model, excitation: Excitation, load: Array, theta: Array) -> tuple[State, Array]:
        """Return the first state of a beam, and the Jacobian of q and v with respect to the values, (2 N, ...)."""
        free, layout = self.equations.free, self.layout
        jacobian, start = np.zeros((2 * free, layout.size)), self.start
        if isinstance(start, State):
            check_start(model, excitation, start)
            return start, jacobian
        first_excitation = excitation.at(0.0)
        check_clamp(model, first_excitation)
        _, velocity, _, load_at_start = np.split(first_excitation, [NODE, 2 * NODE, 3 * NODE])
        state = State(model.straight_at_support, np.zeros(model.size))
        if start == "straight":
            check_supports(model, state.coordinates)
        else:
            if not self.held:
                if isinstance(start, Equilibrium):
                    load_at_start = np.array([*start.tip_force, start.tip_moment])
                load = np.concatenate([load_at_start[:LOAD_SIZE], np.zeros(LOAD_SIZE)])
            law = self._flowing
            used = len(law.parameters)
            law = law.with_parameters(theta[:used])
            state, start_jacobian = held_start(model, self._start_jacobians, load, self._held_at, law)
            sizes = model.properties.size, len(self.equations.model.lumped), len(START_LOAD_NAMES)
            is_variable = np.repeat([True, self.lumped, self.held], sizes)
            jacobian[:, :used] = start_jacobian[:, :used]
            jacobian[:, layout["properties"].start : layout["start"].stop] = start_jacobian[:, used:][:, is_variable]
        if start == "impact":
            return state, jacobian
        rigid_motion = self.equations.model.rigid_motion
        moved = rigid_motion(state.coordinates, velocity)
        by_coordinates, by_velocity = rigid_motion.jacobian()(state.coordinates, velocity, moved)
        jacobian[free:] += model.of_free(by_coordinates.full() @ model.with_fixed_base(jacobian[:free]))
        by_base = model.of_free(by_velocity.full()) @ excitation.jacobian(0.0)[NODE : 2 * NODE]
        jacobian[free:, layout["base"]] += by_base
        rigid = model.whole(model.of_free(moved.full().ravel()), velocity)
        return State(state.coordinates, state.velocities + rigid), jacobian

    def _parts(self, values: Array) -> dict[str, Array]:
        """Return views of the parts of values, or of directions, that are parameters of the equation of motion."""
        shared = {"law": "damping", "properties": "properties"} | ({"lumped": "lumped"} if self.lumped else {})
        return {name: values[self.layout[value_name]] for name, value_name in shared.items()}

    def _model(self, properties: Array, lumped: Array) -> Model:
        """Return the beam with other properties."""
        model = self.equations.model
        rows = properties.reshape(model.properties.shape, order="F")
        return model_with_properties(
            model, np.concatenate([rows.ravel(), lumped if self.lumped else [*model.lumped.values()]])
        )

    def _pass(
        self, excitation: Excitation, state: State, parameters: Array, most_steps: int
    ) -> tuple[RadauSteps, Array, State]:
        """Return at most ``most_steps`` over a smooth piece, ``Passage.acceleration_jacobian``, and the last state."""
        largest_step = min(self.largest_step, excitation.largest_step)
        stepper = Stepper(self._tangent.form, parameters, excitation, state, self.tolerance, largest_step)
        ends = [stepper.end]
        for _ in stepper.steps_to(excitation.end):
            ends.append(stepper.end)
            if stepper.steps >= most_steps and stepper.now < excitation.end:
                raise SimulationError(
                    f"the motion takes too many steps: {stepper.steps} up to {stepper.now:g} s, the last of them "
                    f"{stepper.now - ends[-2][0]:.1e} s long; try a larger tolerance",
                    stepper.now,
                )
            stop_if_interrupted()
        steps, node = RadauSteps.of(self.equations.model, ends), excitation.at(excitation.begin)
        forces = self._tangent.force_jacobian(*ends[0][1], node, parameters, ends[0][4].T).full()
        jacobian = -np.linalg.solve(self._tangent.form.mass(parameters).full(), forces)
        return steps, jacobian, stepper.state


def flowing(law: DampingLaw, model: Model, start: Start | Equilibrium | State) -> DampingLaw:
    """Return the law whose flow acts on a beam in a start at rest; if there is none, a law without a force."""
    return law if start in AT_REST and law.loads(model.beam) else STILL_AIR


def held_start(
    model: Model,
    jacobians: tuple[cs.Function, cs.Function],
    load: Array,
    place: PointLoad = TIP,
    law: DampingLaw = STILL_AIR,
) -> tuple[State, Array]:
    """Return the state in which a beam is released from (p, p') in the order of ``START_LOAD_NAMES``, and its Jacobian.

    ``jacobians`` are those of the beam, or of one that differs in its properties P and its lumped properties alone.
    The Jacobian (2 N, l + 4 n + k + 6) is that of the free coordinates and velocities with respect to the parameters of
    the law, P, element by element, the lumped properties, and (p, p').
    """
    p, rate = np.split(load, [len(LOAD_NAMES)])
    coordinates = coordinates_at_rest(model, p, place, law.loads(model.beam))
    theta = np.array([parameter.value for parameter in law.parameters])
    point: Any = coordinates, p, theta, model.properties, *model.lumped.values()
    jacobians_of_forces = stiffness, by_p, by_x = jacobians[0](*point)
    factors = scipy.sparse.linalg.splu(scipy.sparse.csc_array(stiffness.sparse()))
    q_p, q_x = -factors.solve(by_p.full()), -factors.solve(by_x.full())
    velocities = model.with_fixed_base(q_p @ rate)
    change = velocities, rate, *(np.zeros_like(x) for x in point[2:])
    h_q, h_p, h_x = (jacobian.full() for jacobian in jacobians[1](*point, *jacobians_of_forces, *change))
    v_p, v_x = -factors.solve(h_q @ q_p + h_p), -factors.solve(h_q @ q_x + h_x)
    return State(coordinates, velocities), np.block([[q_x, q_p, np.zeros_like(q_p)], [v_x, v_p, q_p]])


@keep_last(8)
def start_jacobians(
    model: Model, place: PointLoad = TIP, law: DampingLaw = STILL_AIR
) -> tuple[cs.Function, cs.Function]:
    """(e, p, law, P, each lumped property) -> K, R_p, R_x of the free coordinates; its forward derivative."""
    theta = cs.MX.sym("theta", len(law.parameters))
    e, load, still = cs.MX.sym("e", model.size), cs.MX.sym("load", len(LOAD_NAMES)), cs.MX.zeros(model.size)
    properties, lumped = cs.MX.sym("P", *model.properties.shape), [cs.MX.sym(name) for name in model.lumped]
    equations = Equations(model, law, place=place)
    parameters = equations.parameters_with(
        law=theta, properties=cs.vec(properties), lumped=cs.vertcat(cs.MX(0, 1), *lumped)
    )
    forces = equations.balance(parameters).local(e, still, still, load)
    forces = model.of_free(forces)
    by_x = cs.horzcat(*(cs.jacobian(forces, x) for x in (theta, properties, *lumped)))
    outputs = [cs.jacobian(forces, e) @ model.whole_of_free, cs.jacobian(forces, load), by_x]
    names = ["e", "load", "law", "P", *model.lumped], ["K", "R_p", "R_x"]
    jacobians = cs.Function("start_jacobians", [e, load, theta, properties, *lumped], outputs, *names)
    return jacobians, jacobians.forward(1)
