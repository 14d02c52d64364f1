"""Release of a beam from a load at its tip: the first state and its derivatives.

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

import casadi as cs
import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from ancf_casadi.damping import RayleighDamping
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.tip_load import equilibrium_under
from ancf_casadi.dynamics.trajectory import State
from ancf_casadi.mechanics.model import NODE, Model
from ancf_casadi.support.arrays import Array

LOAD_NAMES = ("force_x", "force_y", "moment")  # N, N, N m
START_LOAD_NAMES = (*LOAD_NAMES, *(f"{name}_rate" for name in LOAD_NAMES))


def held_start(model: Model, jacobians: tuple[cs.Function, cs.Function], load: Array) -> tuple[State, Array]:
    """Return the state in which a beam is released from (p, p') in the order of ``START_LOAD_NAMES``, and its Jacobian.

    ``jacobians`` are those of the beam, or of one that differs in its properties P and its lumped properties alone.
    The Jacobian (2 N, 4 n + k + 6) is that of the free coordinates and velocities with respect to P, element by
    element, the lumped properties, and (p, p').
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
