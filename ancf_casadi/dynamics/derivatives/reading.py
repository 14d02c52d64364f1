"""Readings of sensors on a beam, as expressions of its motion.

With coordinates e, velocities e_t and accelerations e_tt, a sensor at the arc length s, with the unit vector d, reads

    position            d . S e                       S interpolates positions, S' slopes, Eq. (2)
    velocity            d . S e_t
    acceleration        d . (S e_tt - g)              g only for an accelerometer that responds to gravity
    slope               angle of S' e from the axis: the sum of the turns from node to node, so beyond pi too
    surface strain      eps - z (kappa - kappa_0)     z along the normal, half the depth of the section if not given
    clamp force         d . sum of R over the nodes   R = M e_tt + Q_damp - Q_g - Q_tip
    clamp moment        sum of (r - r_0) x R_r + tau x R_tau over the nodes

In the body frame, d turns with the tangent at s.  The clamp force and moment are those of the whole beam in balance:
elastic forces have no resultant.  The balance of the clamped node alone gives the same result in theory, but it
contains the axial force E A eps, in which small errors of the positions are large forces.  It serves at rest before
the start, where positions are those of an equilibrium, and a load that R does not contain may hold the beam.

Measured accuracy, relative to the standard deviation of a signal, of strips of silicone (0.2 m) and steel (0.5 m) that
swing by up to a third of their length, at the tolerances 1e-6 and 1e-8 of the motion: positions 1e-7 and 4e-9,
velocities 1e-5 and 1e-7, accelerations 3e-4 and 2e-5, forces 2e-4 and 1e-5 (from the clamped node alone 2e-2 and 2e-4),
moments 2e-5 and 4e-7.  Modes of the mesh that a stop of the base excites and no damping removes are an exception: the
accelerations then have errors of 6e-2 and 1e-2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import casadi as cs

from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model, curvature_at, neighbouring_axial_strains
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.records.sensor import AT_CLAMP, Sensor
from ancf_casadi.support.arrays import Array


def derivative_orders(sensor: Sensor) -> int:
    """Return the number of time derivatives that a sensor needs: 1 for the coordinates alone."""
    return 3 if sensor.quantity in AT_CLAMP else 1 + sensor.derivatives


@dataclass(frozen=True, eq=False)
class SampledMotion:
    """Samples of a motion as expressions."""

    model: Model
    properties: cs.MX  # of the elements, (4, n)
    e: cs.MX  # coordinates at s samples, (4 n + 4, s)
    e_t: cs.MX  # velocities there; without rows if no sensor needs them
    e_tt: cs.MX  # accelerations there; without rows if no sensor needs them
    natural_curvature: cs.MX  # the largest one of the beam, 1/m; 0 if the beam is straight
    balance: Callable[[], cs.MX]  # returns R and the elastic forces at all nodes, (4 n + 4, s), if a sensor reads them

    @staticmethod
    def of(equations: Equations, e: cs.MX, e_t: cs.MX, e_tt: cs.MX, load: cs.MX, parameters: cs.MX) -> SampledMotion:
        """Return samples under the tip loads (3, s), with parameters in the order of ``Equations.parameters``."""
        terms = equations.balance(parameters)
        curvature = terms.lumped.get("natural_curvature", cs.MX(0))
        return SampledMotion(
            equations.model, terms.properties, e, e_t, e_tt, curvature, lambda: terms.forces(e, e_t, e_tt, load)
        )

    def read(self, sensor: Sensor) -> cs.MX:
        """Return the readings of a sensor, (1, s)."""
        model = self.model
        s = model.beam.length if sensor.point is None else sensor.point
        match sensor.quantity:
            case "position" | "displacement":
                return self._along(sensor, s, self._rows(model.interpolation(s), self.e))
            case "velocity":
                return self._along(sensor, s, self._rows(model.interpolation(s), self.e_t))
            case "acceleration":
                x, y = self._rows(model.interpolation(s), self.e_tt)
                gx, gy = model.beam.gravity if sensor.gravity else (0.0, 0.0)
                return self._along(sensor, s, (x - gx, y - gy))
            case "slope":
                return self._angle(s)
            case "strain":
                return self._strain(s, sensor.distance)
            case "force":
                x, y = (self._of_clamp(cs.sum1(self._forces[k::NODE, :]), self._on_base[k, :]) for k in range(2))
                return self._along(sensor, 0.0, (x, y))
            case "moment":
                return self._moment
            case _:
                raise InputError("a signal has no scale that a beam could be compared with; give its unit", "sensor")

    @cached_property
    def _forces(self) -> cs.MX:
        return self.balance()

    @cached_property
    def _on_base(self) -> cs.MX:
        """The generalized force of the base on the beam, (4, s)."""
        return self.model.of_base(self._forces)

    @cached_property
    def _moment(self) -> cs.MX:
        """The moment of the base on the beam about the clamp, (1, s)."""
        x, y, slope_x, slope_y = (self.e[k::NODE, :] for k in range(NODE))
        fx, fy, hx, hy = (self._forces[k::NODE, :] for k in range(NODE))
        x, y = (positions - cs.repmat(positions[0, :], positions.size1(), 1) for positions in (x, y))
        nodal_moments = slope_x * hy - slope_y * hx
        base, (_, _, hx, hy) = self.e[2:NODE, :], cs.vertsplit(self._on_base)
        return self._of_clamp(cs.sum1(x * fy - y * fx + nodal_moments), base[0, :] * hy - base[1, :] * hx)

    def _of_clamp(self, of_beam: cs.MX, of_node: cs.MX) -> cs.MX:
        """Return the balance of the whole beam or, at rest, where a load may hold the beam, of the clamped node."""
        still: cs.MX = cs.sum1(self.e_t**2) + cs.sum1(self.e_tt**2) == 0.0
        balance: cs.MX = cs.if_else(still, of_node, of_beam)
        return balance

    def _angle(self, s: float) -> cs.MX:
        """Return the angle from the axis of the straight beam, (1, s); the base may turn the beam by up to pi more."""
        model, (nx, ny) = self.model, self.model.beam.across
        nodes = slice(NODE * model.root, NODE * (model.element_at(s) + model.root + 1))
        at_point = self._rows(model.slope_interpolation(s), self.e)
        x, y = (cs.vertcat(self.e[nodes, :][2 + k :: NODE, :], at_point[k]) for k in range(2))
        first = cs.atan2(nx * x[0, :] + ny * y[0, :], ny * x[0, :] - nx * y[0, :])
        cross = x[:-1, :] * y[1:, :] - y[:-1, :] * x[1:, :]
        turns = cs.atan2(cross, x[:-1, :] * x[1:, :] + y[:-1, :] * y[1:, :])
        angle: cs.MX = model.beam.begin_angle + first + cs.sum1(turns)
        return angle

    def _strain(self, s: float, distance: float | None) -> cs.MX:
        """Return the strain on the surface, (1, s)."""
        model, at = self.model, partial(self._rows, vectors=self.e)
        k = model.element_at(s)
        z = self.properties[1, k] * model.beam.shapes[k].extent("depth") / 2 if distance is None else distance
        axial = sum(weight * strain for weight, _, strain in neighbouring_axial_strains(model, s, at))
        bent = curvature_at(model, s, at)
        if model.beam.natural_curvature:
            natural = model.beam.natural_curvature[model.element_at(s)] / model.lumped["natural_curvature"]
            bent -= natural * self.natural_curvature
        strain: cs.MX = axial - z * bent
        return strain

    def _along(self, sensor: Sensor, s: float, components: tuple[cs.MX, cs.MX]) -> cs.MX:
        """Return the component of a vector in the direction of a sensor at arc length ``s``, (1, s)."""
        (dx, dy), (x, y) = sensor.unit_direction, components
        if sensor.frame == "inertial":
            return dx * x + dy * y
        tx, ty = self._rows(self.model.slope_interpolation(s), self.e)
        return (dx * (tx * x + ty * y) + dy * (tx * y - ty * x)) / cs.sqrt(tx**2 + ty**2)

    @staticmethod
    def _rows(matrix: Array, vectors: cs.MX) -> tuple[cs.MX, cs.MX]:
        """Return the x and the y components, (1, s), of an interpolation."""
        x, y = cs.vertsplit(cs.sparsify(cs.DM(matrix)) @ vectors)  # of the coordinates that the reading needs
        return x, y
