"""Release of a beam from a load at its tip: the first state and its derivatives.

A load p = (Fx, Fy, m) at the tip holds the beam in q(p, P), where the forces R(q, p, P) on the free coordinates vanish.
If the load changes slowly, at the rate p', the beam moves through these shapes with the velocity v,

    R(q, p, P) = 0,    h = K v - L p' = 0,    K = dR/dq,    L = -dR/dp,

and is released with this shape and velocity, which bend the beam without stretching it, unlike a linear mode shape.
For a hanging beam, Fx and Fx' set the amplitude and phase of the first mode; force and moment set those of the first
two.  By the implicit function theorem,

    dq = -K^-1 (R_p dp + R_P dP),    dv = -K^-1 (h_q dq + h_p dp + h_P dP - L dp').
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as cs
import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from ancf_casadi.dynamics.tip_load import equilibrium_under
from ancf_casadi.mechanics.model import NODE, Model
from ancf_casadi.support.arrays import Array

LOAD = ("force_x", "force_y", "moment")  # N, N, N m
START = (*LOAD, *(f"{name}_rate" for name in LOAD))


@dataclass(frozen=True, eq=False)
class HeldStart:
    """State of a beam released from a changing load, with its derivatives.

    Parameters
    ----------
    coordinates, velocities : array (4 n + 4,)
        Nodal coordinates and velocities.
    by_properties, by_load : array (2 N, 4 n), (2 N, 6)
        Derivatives of the free coordinates and velocities with respect to P, element by element, and (p, p').
    """

    coordinates: Array
    velocities: Array
    by_properties: Array
    by_load: Array


def held_start(model: Model, jacobians: cs.Function, load: Array) -> HeldStart:
    """Return the state in which a beam is released from a load with a rate of change.

    Parameters
    ----------
    model : Model
        The beam.
    jacobians : Function
        ``start_jacobians`` of the beam, or of one that differs in its properties alone.
    load : array (6,)
        The load and its rate of change, in the order of ``START``.

    Raises
    ------
    InputError
        If a load is not finite.
    EquilibriumError
        If there is no equilibrium under the load.
    """
    p, rate = np.split(load, [len(LOAD)])
    coordinates = equilibrium_under(model, p).coordinates
    given = model.properties, np.array(model.beam.gravity), p, rate
    stiffness, by_p, by_P, *_ = jacobians(coordinates, np.zeros(model.size), *given)
    factors = scipy.sparse.linalg.splu(scipy.sparse.csc_array(stiffness.sparse()))
    q_p, q_P = -factors.solve(by_p.full()), -factors.solve(by_P.full())
    velocities = np.concatenate([np.zeros(NODE), q_p @ rate])
    h_q, h_p, h_P = (part.full() for part in jacobians(coordinates, velocities, *given)[3:])
    v_p, v_P = -factors.solve(h_q @ q_p + h_p), -factors.solve(h_q @ q_P + h_P)
    by_load = np.block([[q_p, np.zeros_like(q_p)], [v_p, q_p]])
    return HeldStart(coordinates, velocities, np.vstack([q_P, v_P]), by_load)


def start_jacobians(model: Model) -> cs.Function:
    """(e, e_t, P, g, p, p') -> K, R_p, R_P, h_q, h_p, h_P of the free coordinates."""
    e, e_t = cs.MX.sym("e", model.size), cs.MX.sym("e_t", model.size)
    properties, gravity = cs.MX.sym("P", *model.properties.shape), cs.MX.sym("g", 2)
    load, rate = cs.MX.sym("load", len(LOAD)), cs.MX.sym("rate", len(LOAD))
    turn = cs.gradient(cs.atan2(e[-1], e[-2]), e)
    held = cs.DM(model.interpolation(model.beam.length).T) @ load[:2] + load[2] * turn
    forces = model.elastic_force(e, properties) - model.gravity_force(properties, gravity) - held
    change = model.tangent_force(e, e_t, properties) - load[2] * cs.jtimes(turn, e, e_t) - cs.jtimes(held, load, rate)
    free = model.free
    outputs = [cs.jacobian(part[free], x) for part in (forces, change) for x in (e, load, properties)]
    for k in (0, 3):
        outputs[k] = outputs[k][:, free]
    return cs.Function("start_jacobians", [e, e_t, properties, gravity, load, rate], outputs)
