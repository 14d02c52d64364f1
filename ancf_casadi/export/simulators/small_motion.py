"""Small motion of a discretised beam, continuous in time and in the steps of an integrator.

The coordinates q place the masses at r(q) and store the energy V(q).  About the equilibrium V'(q) = 0, small motion is

    M q_tt + D q_t + K q = 0,    M = J^T m J,    D = J^T c J + T^T (b k) T,    K = V'',    J = dr/dq,

with dampers c at the masses and dampers b k at the joints, whose turns are T q.  One step of an integrator of the
length h takes (q, v) to Z (q, v).  Its eigenvalues z are those of a motion exp(s t) with s = log(z)/h, which has the
frequency |s|/2 pi and the damping ratio -Re s/|s| that a user of the program sees, errors of the step included.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as cs
import numpy as np
import scipy.linalg

from ancf_casadi.exceptions import EquilibriumError
from ancf_casadi.support.arrays import Array

SLOWEST = 1e-6  # 1/s; slower poles are those of motion that does not oscillate


@dataclass(frozen=True)
class Energy:
    """Coordinates of a discretised beam, the places of its masses, its turns, and its energies, symbolic."""

    coordinates: cs.SX
    places: cs.SX  # x, y, angle of each mass
    inertias: Array
    turns: cs.SX  # of the joints
    elastic: cs.SX
    weights: cs.DM  # forces of gravity on the places
    tip: cs.SX

    def about(self, first: Array) -> Discrete:
        """Return small motion about the equilibrium next to some coordinates; refuse one that is not found."""
        q = self.coordinates
        hessian, gradient = cs.hessian(self.elastic - cs.dot(self.weights, self.places), q)
        balance = cs.Function("balance", [q], [gradient, hessian])
        at = first
        for _ in range(100):
            force, stiffness = (one.full() for one in balance(at))
            step = -np.linalg.solve(stiffness, force)[:, 0]
            at = at + step * min(1.0, 0.3 / np.abs(step).max(initial=1e-300))
            if np.abs(step).max() < 1e-10:
                break
        else:
            raise EquilibriumError("no equilibrium of the discretised beam was found; use more segments")
        changes = [cs.jacobian(one, q) for one in (self.places, self.turns, self.tip)]
        found = cs.Function("found", [q], [changes[0], changes[1], hessian, self.places, changes[2]])
        jacobian, turns, stiffness, places, tip = (one.full() for one in found(at))
        c, s = np.cos(places[2::3]), np.sin(places[2::3])
        x, y = jacobian[0::3].copy(), jacobian[1::3].copy()
        jacobian[0::3], jacobian[1::3] = c * x + s * y, c * y - s * x
        return Discrete(at, jacobian, self.inertias, turns, stiffness, tip)


@dataclass(frozen=True)
class Discrete:
    """Small motion about an equilibrium."""

    rest: Array
    jacobian: Array  # J of the places, along and across the beam there, and of the angle
    inertias: Array
    turns: Array  # T
    stiffness: Array  # K
    tip: Array  # Jacobian of the position of the tip

    @property
    def mass(self) -> Array:
        """The mass matrix M."""
        return np.asarray((self.jacobian.T * self.inertias) @ self.jacobian)

    def damping(self, places: Array, joints: Array | float = 0.0) -> Array:
        """Return D of dampers at the places (N s/m, N m s/rad) and at the joints (N m s/rad)."""
        return np.asarray((self.jacobian.T * places) @ self.jacobian + (self.turns.T * joints) @ self.turns)

    def modes(self, count: int) -> tuple[Array, Array]:
        """Return angular frequencies (rad/s) and shapes of the lowest modes, whose tip moves by 1."""
        values, shapes = scipy.linalg.eigh(self.stiffness, self.mass, subset_by_index=(0, count - 1))
        if values[0] <= 0.0:
            raise EquilibriumError("the equilibrium of the discretised beam is unstable; use more segments")
        moved = self.tip @ shapes
        larger = np.abs(moved).argmax(axis=0)
        signs = np.sign(moved[larger, np.arange(count)])
        return np.sqrt(values), shapes * signs / np.linalg.norm(moved, axis=0)

    def ratio(self, damping: Array, mode: int) -> float:
        """Return the damping ratio of a mode (number from 0) under light damping D."""
        omega, shapes = self.modes(mode + 1)
        phi = shapes[:, mode]
        return float(phi @ damping @ phi / (2 * omega[mode] * (phi @ self.mass @ phi)))


def poles(matrix: Array, step: float, count: int) -> tuple[Array, Array, bool]:
    """Return frequencies (Hz) and damping ratios of the slowest poles of a step matrix, and whether no motion grows."""
    z = np.linalg.eigvals(matrix)
    s = np.log(z.astype(complex)) / step
    s = s[s.imag > SLOWEST]
    s = s[np.argsort(np.abs(s))][:count]
    return np.abs(s) / (2 * math.pi), -s.real / np.abs(s), bool(np.abs(z).max() <= 1.0 + 1e-9)  # rounding


def implicit_in_velocity(mass: Array, damping: Array, stiffness: Array, step: float) -> Array:
    """Return Z of semi-implicit Euler steps with implicit damping, (M + h D) v' = M v - h K q, q' = q + h v'."""
    return np.asarray(drift(len(mass), step) @ kick(mass + step * damping, mass, stiffness, step))


def drift(count: int, step: float) -> Array:
    """Return the matrix of q' = q + h v for a number of coordinates."""
    eye = np.eye(count)
    return np.block([[eye, step * eye], [0.0 * eye, eye]])


def kick(after: Array, before: Array, stiffness: Array, step: float) -> Array:
    """Return the matrix of A v' = B v - h K q."""
    inverse, eye = np.linalg.inv(after), np.eye(len(after))
    return np.block([[eye, 0.0 * eye], [-step * inverse @ stiffness, inverse @ before]])
