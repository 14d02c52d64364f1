"""The first state of a motion, and its Jacobian with respect to the parameters.

A start at rest depends on the properties P of the elements, the lumped properties, and the load that holds the beam,
through the static equilibrium.  Unless it is an impact, the beam moves with its clamp as one rigid body (``start``), so
that its velocities depend on the parameters b of the base motion as well.

A load p = (Fx, Fy, m) at the tip holds the beam in q(p, x), where the forces R(q, p, x) on the free coordinates vanish;
x are the properties P of the elements and the lumped properties that the model has.  If the load changes slowly, at the
rate p', the beam moves through these shapes with the velocity v,

    R(q, p, x) = 0,    h = R_q v + R_p p' = 0,    K = R_q,

and is released with this shape and velocity, which bend the beam without stretching it, unlike a linear mode shape.
For a hanging beam, Fx and Fx' set the amplitude and phase of the first mode; force and moment set those of the first
two.  By the implicit function theorem,

    dq = -K^-1 (R_p dp + R_x dx),    dv = -K^-1 (h_q dq + h_p dp + h_x dx + R_p dp'),

in which h_q, h_p and h_x are the derivatives of K, R_p and R_x along the change (v, p') of q and p.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from ancf_casadi.damping import RayleighDamping
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.excitation import Excitation
from ancf_casadi.dynamics.start import Start, check_clamp, initial_state, rigid_motion
from ancf_casadi.dynamics.tip_load import LOAD_SIZE, equilibrium_under
from ancf_casadi.dynamics.trajectory import State
from ancf_casadi.mechanics.model import NODE, Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.layout import Layout
from ancf_casadi.vibration.equilibrium import Equilibrium

LOAD_NAMES = ("force_x", "force_y", "moment")  # N, N, N m
START_LOAD_NAMES = (*LOAD_NAMES, *(f"{name}_rate" for name in LOAD_NAMES))


@dataclass(frozen=True, eq=False)
class DifferentiableStart:
    """The start of a motion as a function of b, P, the lumped properties and s.

    Parameters
    ----------
    model : Model
        The beam, with its nominal properties.
    start : str, Equilibrium or State
        The start.
    layout : Layout
        Layout of the values: ``damping`` (theta), ``base`` (b), ``properties`` (P), ``lumped`` (their values in the
        order of ``Model.lumped``, or nothing) and ``start`` (s, or nothing).
    """

    model: Model
    start: Start | Equilibrium | State
    layout: Layout

    def state(self, model: Model, excitation: Excitation, load: Array) -> tuple[State, Array]:
        """Return the first state, and the Jacobian of q and v with respect to the values, (2 N, ...).

        The model has the properties P and the lumped properties; the load s is empty if it is not a parameter.

        Raises
        ------
        InputError
            As in ``initial_state``.
        EquilibriumError
            If there is no equilibrium to start from.
        """
        free = model.size - NODE
        jacobian = np.zeros((2 * free, self.layout.size))
        if isinstance(self.start, State):
            return initial_state(model, excitation, self.start), jacobian
        check_clamp(model, excitation.at(0.0)[:NODE])
        state = State(model.straight, np.zeros(model.size))
        if self.start != "straight":
            state, held = held_start(model, self._jacobians, load if load.size else self._own_load(excitation))
            sizes = {
                "properties": model.properties.size,
                "lumped": len(self.model.lumped),
                "start": len(START_LOAD_NAMES),
            }
            for (name, _), part in zip(sizes.items(), Layout.of(**sizes).split(held.T), strict=True):
                own = self.layout[name]
                jacobian[:, own] = part.T[:, : own.stop - own.start]
        if self.start == "impact":
            return state, jacobian
        found = self._rigid_velocities(state.coordinates, excitation.at(0.0)[NODE : 2 * NODE])
        rigid, by_coordinates, by_velocity = (part.full() for part in found)
        jacobian[free:] += by_coordinates @ jacobian[:free]
        jacobian[free:, self.layout["base"]] += by_velocity @ excitation.jacobian(0.0)[NODE : 2 * NODE]
        return State(state.coordinates, state.velocities + rigid.ravel()), jacobian

    def _own_load(self, excitation: Excitation) -> Array:
        """Return the load that holds the beam, and its rate, if they are not parameters."""
        load = np.zeros(len(START_LOAD_NAMES))
        if isinstance(self.start, Equilibrium):
            load[:LOAD_SIZE] = *self.start.tip_force, self.start.tip_moment
        else:
            load[:LOAD_SIZE] = excitation.at(0.0)[3 * NODE :]
        return load

    @cached_property
    def _jacobians(self) -> tuple[cs.Function, cs.Function]:
        return start_jacobians(self.model)

    @cached_property
    def _rigid_velocities(self) -> cs.Function:
        """(e, velocity of the clamped node) -> rigid velocities, and Jacobians of the free ones by q and by it."""
        e, clamp_velocity = cs.MX.sym("e", self.model.size), cs.MX.sym("clamp_velocity", NODE)
        moved = rigid_motion(self.model)(e, clamp_velocity)
        jacobians = [cs.jacobian(moved[NODE:], e)[:, NODE:], cs.jacobian(moved[NODE:], clamp_velocity)]
        return cs.Function("rigid_velocities", [e, clamp_velocity], [moved, *jacobians])


def held_start(model: Model, jacobians: tuple[cs.Function, cs.Function], load: Array) -> tuple[State, Array]:
    """Return the state in which a beam is released from (p, p') in the order of ``START_LOAD_NAMES``, and its Jacobian.

    ``jacobians`` are those of the beam, or of one that differs in its properties P and its lumped properties alone.
    The Jacobian (2 N, 4 n + k + 6) is that of the free coordinates and velocities with respect to P, element by
    element, the lumped properties, and (p, p').

    Raises
    ------
    EquilibriumError
        If there is no equilibrium under the load.
    """
    p, rate = np.split(load, [len(LOAD_NAMES)])
    coordinates = equilibrium_under(model, p).coordinates
    lumped = [getattr(model.beam, name) for name in jacobians[0].name_in()[3:]]
    given = coordinates, p, model.properties, *lumped
    found = stiffness, by_p, by_x = jacobians[0](*given)
    factors = scipy.sparse.linalg.splu(scipy.sparse.csc_array(stiffness.sparse()))
    q_p, q_x = -factors.solve(by_p.full()), -factors.solve(by_x.full())
    velocities = np.concatenate([np.zeros(NODE), q_p @ rate])
    change = velocities, rate, *(np.zeros_like(x) for x in given[2:])
    h_q, h_p, h_x = (part.full() for part in jacobians[1](*given, *found, *change))
    v_p, v_x = -factors.solve(h_q @ q_p + h_p), -factors.solve(h_q @ q_x + h_x)
    return State(coordinates, velocities), np.block([[q_x, q_p, np.zeros_like(q_p)], [v_x, v_p, q_p]])


def start_jacobians(model: Model) -> tuple[cs.Function, cs.Function]:
    """(e, p, P, each lumped property by its name) -> K, R_p, R_x of the free coordinates; its forward derivative."""
    e, load, still = cs.MX.sym("e", model.size), cs.MX.sym("load", len(LOAD_NAMES)), cs.MX.zeros(model.size)
    properties, lumped = cs.MX.sym("P", *model.properties.shape), [cs.MX.sym(name) for name in model.lumped]
    equations = Equations(model, RayleighDamping())
    parameters = equations.given(properties=cs.vec(properties), lumped=cs.vertcat(cs.MX(0, 1), *lumped))
    forces = equations.balance(parameters).local(e, still, still, load)[0][model.free]
    by_x = cs.horzcat(*(cs.jacobian(forces, x) for x in (properties, *lumped)))
    outputs = [cs.jacobian(forces, e)[:, model.free], cs.jacobian(forces, load), by_x]
    names = ["e", "load", "P", *model.lumped], ["K", "R_p", "R_x"]
    jacobians = cs.Function("start_jacobians", [e, load, properties, *lumped], outputs, *names)
    return jacobians, jacobians.forward(1)
