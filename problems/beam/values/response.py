"""Equilibria and natural frequencies of a beam as functions of factors on its properties, with exact derivatives.

Each factor multiplies the properties that it owns (``problems.beam.properties``); the loads stay as they are.  Every
response starts from the given beam: Newton's method starts from its equilibrium, and its modes are followed by their
shapes.  The result therefore depends on the factors alone, and not on the path of an optimiser.  The derivatives are
those of ``ancf_casadi.vibration.sensitivities``; with f the generalized forces on the clamped coordinates,

    K dq = -R_p dp,    dy = y_q dq + y_f (f_q dq + f_p dp) + y_p dp.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as cs
import numpy as np

from ancf_casadi.mechanics.model import NODE, Model
from ancf_casadi.mechanics.point_load import PointLoad
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.vibration.assembly import per_element, scatter
from ancf_casadi.vibration.equilibrium import Equilibrium, neighbour, static_equilibrium
from ancf_casadi.vibration.following import follow, followed_modes
from ancf_casadi.vibration.modal_state import ModalState
from ancf_casadi.vibration.modes import natural_modes
from ancf_casadi.vibration.sensitivities import coordinate_derivatives, gradient
from problems.beam.properties import Owners
from problems.beam.values.observation import readings

Respond = Callable[[Array], tuple[Array, Array]]  # factors (p,) -> values (m,) and their Jacobian (m, p)


@dataclass(frozen=True, eq=False)
class StaticResponse:
    """The readings of sensors under one load case after the other.

    Parameters
    ----------
    model : Model
        The beam.
    cases : tuple of tuples of PointLoad
        The loads of each case.
    sensors : tuple of Sensor
        The sensors.
    tared : bool
        Whether all sensors, not only those of displacement, read zero without the loads.
    owners : Owners
        The properties that each factor multiplies.
    """

    model: Model
    cases: tuple[tuple[PointLoad, ...], ...]
    sensors: tuple[Sensor, ...]
    tared: bool
    owners: Owners

    def __call__(self, factors: Array) -> tuple[Array, Array]:
        """Return the readings case by case, (c k,), and their Jacobian by the factors, (c k, p).

        Raises
        ------
        EquilibriumError
            If the beam has no equilibrium.
        """
        cases = [self._case(rest, factors) for rest in self._standard]
        values, jacobians = np.array([value for value, _ in cases]), np.array([jacobian for _, jacobian in cases])
        values = values[1:] - self._from_rest * values[0]
        jacobians = jacobians[1:] - self._from_rest[:, None] * jacobians[0]
        return values.ravel(), jacobians.reshape(-1, self.owners.count)

    @cached_property
    def _standard(self) -> list[Equilibrium]:
        """Equilibria of the given beam: without the loads, then case by case."""
        return [static_equilibrium(self.model, loads=loads) for loads in ((), *self.cases)]

    @cached_property
    def _readings(self) -> cs.Function:
        return readings(self.model, self.sensors)

    @cached_property
    def _from_rest(self) -> Array:
        """Ones for the sensors that read changes from rest without the loads, zeros for the others."""
        return np.array([float(self.tared or sensor.quantity == "displacement") for sensor in self.sensors])

    def _case(self, rest: Equilibrium, factors: Array) -> tuple[Array, Array]:
        """Return the readings in one case, (k,), and their Jacobian, (k, p)."""
        given = rest.structure
        own, directions = self.owners.applied(given.properties, factors)
        structure = replace(given, properties=own)
        at = neighbour(structure, rest.exact)
        if at is None:
            at = static_equilibrium(self.owners.changed(self.model, factors), loads=rest.loads).exact
        state = ModalState(structure, at, np.arange(0), np.zeros(0), np.zeros((self.model.size, 0)))
        dq = coordinate_derivatives(state, directions)
        force, change = _clamp_forces(state, dq, directions)
        size = len(self.owners.index)
        y, by_e, by_force, by_p = (part.full() for part in self._readings(at.coordinates, force, own[:size]))
        return y.ravel(), by_e @ dq + by_force @ change + by_p @ directions[:size]


def _clamp_forces(state: ModalState, dq: Array, directions: Array) -> tuple[Array, Array]:
    """Return the generalized forces on the clamped coordinates, (4,), and their derivatives, (4, N)."""
    size = state.model.size
    force, change = np.zeros((size, 1)), np.zeros(dq.shape)
    for part in state.structure.parts:
        own, by_coordinate, by_property, _ = per_element(part.balance.linearisation, *state.inputs(part))
        force += scatter(part.coordinates, own, size)
        moved = by_coordinate @ dq[part.coordinates] + by_property @ directions[part.properties]
        change += scatter(part.coordinates, moved, size)
    return force[:NODE, 0], change[:NODE]


@dataclass(frozen=True, eq=False)
class ModalResponse:
    """Natural frequencies.

    Parameters
    ----------
    model : Model
        The beam.
    numbers : array of int (m,)
        Numbers of the modes, from 0.
    owners : Owners
        The properties that each factor multiplies.
    """

    model: Model
    numbers: Index
    owners: Owners

    def __call__(self, factors: Array) -> tuple[Array, Array]:
        """Return the frequencies, Hz (m,), and their Jacobian by the factors, (m, p).

        Raises
        ------
        EquilibriumError
            If the beam has no stable equilibrium.
        """
        properties, directions = self.owners.applied(self._standard.properties, factors)
        state = follow(self._standard, properties)
        count = len(self.numbers)
        of_eigenvalues = gradient(state, np.eye(count), np.zeros((count, self.model.size, count)))
        chain = state.frequencies / (2 * state.eigenvalues)
        return state.frequencies, chain[:, None] * (of_eigenvalues.T @ directions)

    @cached_property
    def _standard(self) -> ModalState:
        return followed_modes(natural_modes(self.model, count=int(self.numbers.max()) + 1), self.numbers)
