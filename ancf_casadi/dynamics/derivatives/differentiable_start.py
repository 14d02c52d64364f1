"""The first state of a motion, and its Jacobian with respect to the parameters.

A start at rest depends on the properties P of the elements, the lumped properties, and the load s that holds the beam,
through the static equilibrium (``release_load``).  Unless it is an impact, the beam moves with its clamp as one rigid
body (``start``), so that its velocities depend on the parameters b of the base motion as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np

from ancf_casadi.dynamics.derivatives.release_load import START_LOAD_NAMES, held_start, start_jacobians
from ancf_casadi.dynamics.derivatives.run import Excitation
from ancf_casadi.dynamics.start import Start, check_clamp, initial_state, rigid_motion
from ancf_casadi.dynamics.tip_load import LOAD_SIZE
from ancf_casadi.dynamics.trajectory import State
from ancf_casadi.mechanics.model import NODE, Model
from ancf_casadi.support.arrays import Array, Layout
from ancf_casadi.vibration.equilibrium import Equilibrium


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

        Parameters
        ----------
        model : Model
            The beam with the properties P and the lumped properties.
        excitation : Excitation
            Base motion and tip load.
        load : array (6,) or (0,)
            The load s; empty if the load at the start is not a parameter.

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
            return initial_state(model, excitation.function, self.start), jacobian
        check_clamp(model, excitation.at(0.0)[:NODE])
        coordinates, velocities = model.straight, np.zeros(model.size)
        if self.start != "straight":
            held = held_start(model, self._jacobians, load if load.size else self._own_load(excitation))
            coordinates, velocities = held.coordinates, held.velocities
            jacobian[:, self.layout["properties"]] = held.by_properties
            lumped = self.layout["lumped"]
            jacobian[:, lumped] = held.by_lumped[:, : lumped.stop - lumped.start]
            if load.size:
                jacobian[:, self.layout["start"]] = held.by_load
        if self.start == "impact":
            return State(coordinates, velocities), jacobian
        found = self._rigid_velocities(coordinates, excitation.at(0.0)[NODE : 2 * NODE])
        rigid, by_coordinates, by_velocity = (part.full() for part in found)
        jacobian[free:] += by_coordinates @ jacobian[:free]
        jacobian[free:, self.layout["base"]] += by_velocity @ excitation.jacobian(0.0)[NODE : 2 * NODE]
        return State(coordinates, velocities + rigid.ravel()), jacobian

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
