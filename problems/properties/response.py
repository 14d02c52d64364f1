"""Equilibria and natural frequencies of a beam as functions of factors on its properties, with exact derivatives.

The factors multiply width, thickness, density, elastic modulus, tip mass and clamp stiffness of the beam, in the order
of ``FACTORS``; the loads stay as they are.  Every response starts from the given beam: Newton's method starts from its
equilibrium, and its modes are followed by their shapes.  The result therefore depends on the factors alone, and not on
the path of an optimiser.  The derivatives are those of ``ancf_casadi.vibration.sensitivities``; with f the generalized
forces on the clamped coordinates,

    K dq = -R_p dp,    dy = y_q dq + y_f (f_q dq + f_p dp) + y_p dp.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.mechanics.beam import LUMPED, PROPERTIES
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
from problems.properties.observation import FACTORS, readings

Respond = Callable[[Array], tuple[Array, Array]]  # factors (6,) -> values (m,) and their Jacobian (m, 6)


def changed(model: Model, factors: Array) -> Model:
    """Return a model with factors on its properties, in the order of ``FACTORS``."""
    by_name = dict(zip(FACTORS, factors.tolist(), strict=True))
    values: dict[str, Any] = {name: tuple(by_name[name] * v for v in getattr(model.beam, name)) for name in PROPERTIES}
    values |= {name: by_name[name] * getattr(model.beam, name) for name in LUMPED}
    return Model(model.beam.with_(**values), model.measures)


def _owners(model: Model) -> Index:
    """Return the factor of each property, in the order of ``structure_properties``."""
    own = np.repeat(np.arange(len(PROPERTIES)), model.beam.elements)
    return np.concatenate([own, len(PROPERTIES) + np.arange(len(LUMPED))])


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
    """

    model: Model
    cases: tuple[tuple[PointLoad, ...], ...]
    sensors: tuple[Sensor, ...]
    tared: bool

    def __call__(self, factors: Array) -> tuple[Array, Array]:
        """Return the readings case by case, (c k,), and their Jacobian by the factors, (c k, 6).

        Raises
        ------
        EquilibriumError
            If the beam has no equilibrium.
        """
        cases = [self._case(rest, factors) for rest in self._standard]
        values, jacobians = np.array([value for value, _ in cases]), np.array([jacobian for _, jacobian in cases])
        values = values[1:] - self._from_rest * values[0]
        jacobians = jacobians[1:] - self._from_rest[:, None] * jacobians[0]
        return values.ravel(), jacobians.reshape(-1, len(FACTORS))

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
        """Return the readings in one case, (k,), and their Jacobian, (k, 6)."""
        given, owners = rest.structure, _owners(self.model)
        properties, directions = given.properties.copy(), np.zeros((len(given.properties), len(FACTORS)))
        properties[: len(owners)] *= factors[owners]
        directions[np.arange(len(owners)), owners] = given.properties[: len(owners)]
        structure = replace(given, properties=properties)
        at = neighbour(structure, rest.exact)
        if at is None:
            at = static_equilibrium(changed(self.model, factors), loads=rest.loads).exact
        state = ModalState(structure, at, np.arange(0), np.zeros(0), np.zeros((self.model.size, 0)))
        dq = coordinate_derivatives(state, directions)
        force, change = _clamp_forces(state, dq, directions)
        y, by_e, by_force, by_factors = (part.full() for part in self._readings(at.coordinates, force, factors))
        return y.ravel(), by_e @ dq + by_force @ change + by_factors


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
    """

    model: Model
    numbers: Index

    def __call__(self, factors: Array) -> tuple[Array, Array]:
        """Return the frequencies, Hz (m,), and their Jacobian by the factors, (m, 6).

        Raises
        ------
        EquilibriumError
            If the beam has no stable equilibrium.
        """
        given, owners = self._standard.properties, _owners(self.model)
        state = follow(self._standard, factors[owners] * given)
        directions = np.zeros((len(given), len(FACTORS)))
        directions[np.arange(len(given)), owners] = given
        count = len(self.numbers)
        of_eigenvalues = gradient(state, np.eye(count), np.zeros((count, self.model.size, count)))
        chain = state.frequencies / (2 * state.eigenvalues)
        return state.frequencies, chain[:, None] * (of_eigenvalues.T @ directions)

    @cached_property
    def _standard(self) -> ModalState:
        return followed_modes(natural_modes(self.model, count=int(self.numbers.max()) + 1), self.numbers)
