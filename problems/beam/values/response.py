"""Values of a beam at rest and in small vibration as functions of factors on its properties, with exact derivatives.

Each factor multiplies the properties that it owns (``problems.beam.properties``); the loads stay as they are.  Every
response starts from the given beam: Newton's method starts from its equilibrium, and its modes are followed by their
shapes.  The result therefore depends on the factors alone, and not on the path of an optimiser.  The derivatives are
those of ``ancf_casadi.vibration.modal_state``; with f the generalized forces on the clamped coordinates,

    K dq = -R_p dp,    dy = y_q dq + y_f (f_q dq + f_p dp) + y_p dp.

The readings y are those of a motion (``dynamics.derivatives.reading``) without velocities; a displacement is the change
from rest without the loads.  Force F and moment M that the base exerts on the beam follow from the generalized forces
f = G^T (Q_e - Q_g) on the base (r_b, tau_b): F = (f_1, f_2) and M = tau_b x (f_3, f_4), because a rotation of the base
by dtheta turns tau_b by dtheta (-tau_y, tau_x).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.derivatives.reading import SampledMotion
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.loads import PointLoad
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.vibration.assembly import per_element, scatter, structure_properties
from ancf_casadi.vibration.equilibrium import Equilibrium, neighbouring_equilibrium
from ancf_casadi.vibration.modal_state import ModalState, coordinate_derivatives, follow, gradient, modal_state
from ancf_casadi.vibration.modes import natural_modes
from ancf_casadi.vibration.statics import stable_position, static_equilibrium
from problems.beam.properties import scale_properties, scaled_model

Respond = Callable[[Array], tuple[Array, Array]]  # factors (p,) -> values (m,) and their Jacobian (m, p)

STATIC_QUANTITIES = ("position", "displacement", "slope", "strain", "force", "moment")


def modal_response(model: Model, numbers: Index, owners: Index) -> Respond:
    """Return the function from factors to the natural frequencies (Hz) of modes, from 0, and their Jacobian."""
    standard = modal_state(natural_modes(model, count=int(numbers.max()) + 1), numbers)

    def respond(factors: Array) -> tuple[Array, Array]:
        properties, directions = scale_properties(standard.properties, owners, factors)
        state = follow(standard, properties)
        count = len(numbers)
        of_eigenvalues = gradient(state, np.eye(count), np.zeros((count, model.size, count)))
        chain = state.frequencies / (2 * state.eigenvalues)
        return state.frequencies, chain[:, None] * (of_eigenvalues.T @ directions)

    return respond


def static_response(
    model: Model,
    cases: Sequence[Sequence[PointLoad]],
    sensors: Sequence[Sensor],
    tared: bool,
    owners: Index,
    present: Index,
) -> Respond:
    """Return the function from factors to the readings that are present, case by case, and their Jacobian."""
    equilibria = [static_equilibrium(model, loads=loads) for loads in ((), *cases)]
    read = readings(model, sensors)
    from_rest = np.array([float(tared or sensor.quantity == "displacement") for sensor in sensors])

    def respond(factors: Array) -> tuple[Array, Array]:
        readings_by_case = [_read_at_rest(model, read, equilibrium, owners, factors) for equilibrium in equilibria]
        values, jacobians = (np.array(column) for column in zip(*readings_by_case, strict=True))
        values = values[1:] - from_rest * values[0]
        jacobians = jacobians[1:] - from_rest[:, None] * jacobians[0]
        return values.ravel()[present], jacobians.reshape(values.size, len(factors))[present]

    return respond


def _read_at_rest(
    model: Model, read: cs.Function, equilibrium: Equilibrium, owners: Index, factors: Array
) -> tuple[Array, Array]:
    """Return the readings in one case, (k,), and their Jacobian, (k, p), from the equilibrium of the given beam."""
    changed_properties, directions = scale_properties(equilibrium.structure.properties, owners, factors)
    structure = replace(equilibrium.structure, properties=changed_properties)
    at = neighbouring_equilibrium(structure, equilibrium.exact)
    if at is None:
        at = stable_position(scaled_model(model, owners, factors), equilibrium.all_loads, side=1)
    state = ModalState(structure, at, np.arange(0), np.zeros(0), np.zeros((model.size, 0)))  # without modes
    dq = coordinate_derivatives(state, directions)
    force, change = _base_forces(state, dq, directions)
    size = len(owners)
    y, by_e, by_force, by_p = (output.full() for output in read(at.coordinates, force, changed_properties[:size]))
    return y.ravel(), by_e @ dq + by_force @ change + by_p @ directions[:size]


def _base_forces(state: ModalState, dq: Array, directions: Array) -> tuple[Array, Array]:
    """Return the generalized forces on the base, (4,), and their derivatives, (4, N)."""
    size = state.model.size
    force, change = np.zeros((size, 1)), np.zeros(dq.shape)
    for elements in state.structure.groups:
        forces, by_coordinate, by_property, _ = per_element(elements.balance.linearisation, *state.inputs(elements))
        force += scatter(elements.coordinates, forces, size)
        moved = by_coordinate @ dq[elements.coordinates] + by_property @ directions[elements.properties]
        change += scatter(elements.coordinates, moved, size)
    return state.model.of_base(force)[:, 0], state.model.of_base(change)


def readings(model: Model, sensors: Sequence[Sensor]) -> cs.Function:
    """Return (e, f, properties) -> the readings of k sensors, and their Jacobians by e, f and the properties.

    f are the generalized forces on the base, (4,); the properties those of the beam, (4 n + lumped,), in the order of
    ``structure_properties``.
    """
    for sensor in sensors:
        if sensor.quantity not in STATIC_QUANTITIES:
            quantities = ", ".join(STATIC_QUANTITIES)
            raise InputError(f"{sensor.quantity} has no reading at rest; use one of {quantities}", "sensors")
        if sensor.frame != "inertial":
            raise InputError("the direction must be in the laboratory (frame='inertial') at rest", "sensors")
    sizes = {"e": model.size, "f": NODE, "p": structure_properties(model).size}
    e, f, properties = (cs.MX.sym(name, size) for name, size in sizes.items())
    rows = cs.reshape(properties[: model.properties.size], model.beam.elements, -1).T
    forces, still = cs.vertcat(f, cs.MX(model.size - NODE, 1)), cs.MX.zeros(model.size)
    lumped = dict(zip(model.lumped, cs.vertsplit(properties[model.properties.size :]), strict=True))
    curvature = lumped.get("natural_curvature", cs.MX(0))
    motion = SampledMotion(model, rows, e, still, still, curvature, lambda: forces)
    y = cs.vertcat(*(motion.read(sensor) for sensor in sensors))
    jacobians = [cs.densify(cs.jacobian(y, x)) for x in (e, f, properties)]
    return cs.Function("readings", [e, f, properties], [cs.densify(y), *jacobians])


def place(model: Model, sensor: Sensor) -> float:
    """Return the arc length of a sensor, m."""
    return model.beam.length if sensor.point is None else sensor.point
