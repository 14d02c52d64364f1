"""Residuals between the modes of a beam and the measured ones, and their derivatives by the unknowns.

Targets with shapes are assigned to the modes of the given beam by the largest sum of MAC values; targets without shapes
to the lowest modes that are no rigid motions, in their order.  As the beam changes, each mode is followed by its shape
(``ancf_casadi.vibration.modal_state``), so that modes that cross are not exchanged.

The residuals are (u/sigma_k) (f_k/target_k - 1), with the relative standard deviations sigma_k of the frequencies and
the smallest of them, u, and u times the residuals of the shapes (``measured_modes``).  Without standard deviations they
are the relative errors f_k/target_k - 1.  A prior of a property adds u times its distance in standard deviations.
They are functions r(x) of the observations x, the eigenvalues, the displacements v = H phi of the measured points, and
the properties with priors, so that

    dr/dm = r_x x_m,    d2(y^T r)/dm2 = (r_x^T y) x_mm + x_m^T (y^T r)_xx x_m.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import casadi as cs
import numpy as np
import scipy  # its packages are imported on first use
import scipy.sparse

from ancf_casadi.estimation.solver.unknown import Priors, Unknown
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.vibration.modal_state import ModalState, follow, gradient, hessian, modal_state
from ancf_casadi.vibration.modes import Modes, natural_modes, rigid_modes
from problems.matching.design_space import WEIGHT, DesignSpace, LeastChange
from problems.matching.measured_modes import MeasuredModes

Objective = Literal["least-squares", "worst-error"]
FURTHER_MODES = 6  # modes searched for a measured shape, beyond twice the number of shapes
LEAST_MAC = 0.5  # MAC below which a mode of the beam is not the measured one


@dataclass(frozen=True)
class Matching:
    """The statement of a matching, with its residuals r(m) and their derivatives."""

    space: DesignSpace
    measured: MeasuredModes
    preference: LeastChange = field(default_factory=LeastChange)
    objective: Objective = "least-squares"
    priors: tuple[Unknown, ...] = ()  # the properties with priors, by the names of their factors

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle without the modes, which the other process computes again."""
        return Matching, (self.space, self.measured, self.preference, self.objective, self.priors)

    @property
    def model(self) -> Model:
        """The model of the given beam."""
        return self.standard_modes.model

    @cached_property
    def standard_modes(self) -> Modes:
        """The lowest modes of the given beam, among them the modes of the targets."""
        model = Model(self.space.beam)
        count, rigid = self.measured.count, rigid_modes(model)
        if self.measured.shapes:
            count = min(2 * count + FURTHER_MODES, model.freedoms - rigid)
        return natural_modes(model, count=rigid + count)

    @cached_property
    def standard(self) -> ModalState:
        """The modes of the given beam to which the targets are assigned."""
        return modal_state(self.standard_modes, self.numbers)

    @cached_property
    def observer(self) -> Array:
        """Matrix H from nodal coordinates to the displacements of the measured points, (k, 4 n + 4)."""
        return self.measured.observer(self.model)

    @cached_property
    def numbers(self) -> Index:
        """Numbers, from 0, of the modes of the given beam to which the targets are assigned, (m,)."""
        if not self.measured.shapes:
            return rigid_modes(self.model) + np.arange(self.measured.count)
        mac = self.measured.mac(self.observer @ self.standard_modes.shapes)
        targets, modes = scipy.optimize.linear_sum_assignment(-mac)
        for target, mode in zip(targets.tolist(), modes.tolist(), strict=True):
            if mac[target, mode] < LEAST_MAC:
                raise InputError(
                    f"no mode of the beam has the shape of target {target + 1} "
                    f"({self.measured.frequencies[target]:g} Hz): the largest MAC is {mac[target].max():.2f}. Check "
                    "the points and the order of the displacements",
                    "shapes",
                )
        return np.asarray(modes, dtype=np.int64)

    @property
    def noisy(self) -> bool:
        """True if the standard deviations of the data are known."""
        return self.measured.frequency_std is not None

    @property
    def weighted(self) -> bool:
        """True if known standard deviations weigh the residuals, so that standard errors follow."""
        return self.noisy and self.objective == "least-squares"

    @property
    def unit(self) -> float:
        """Smallest relative standard deviation u of a frequency; 1 if none is given."""
        return float(self.measured.relative_std.min())

    @cached_property
    def preference_matrix(self) -> Array:
        """Matrix of the preference, to be added to half the sum of the squared weighted residuals, (N, N).

        Its default weight is small beside those of the frequencies and of the priors.
        """
        widest = max([self.unit, *(prior.prior_std / abs(prior.guess) for prior in self.priors)])
        return self.preference.matrix(self.space, WEIGHT / (self.unit * widest))

    @cached_property
    def _last(self) -> dict[bytes, ModalState]:
        return {}

    def state(self, m: Array) -> ModalState:
        """Return the followed modes of the beam with the unknowns m; those of the last m are kept."""
        if m.tobytes() not in self._last:
            self._last.clear()
            self._last[m.tobytes()] = follow(self.standard, self.space.properties(m))
        return self._last[m.tobytes()]

    def synthetic(self, m: Array, noise: Array) -> MeasuredModes:
        """Return the modes of the beam with the unknowns m, plus noise (R,) in units of the standard deviations."""
        measured, state = self.measured, self.state(m)
        frequencies = state.frequencies + np.array(measured.frequency_std) * noise[: measured.count]
        shapes = np.array(measured.shapes)
        if measured.shape_std is not None:
            stds, displacements = np.array(measured.shape_std), (self.observer @ state.shapes).T
            shape_noise = np.split(noise[measured.count :], np.cumsum(measured.measured.sum(axis=1)))[:-1]
            for k, row in enumerate(measured.measured):
                psi, σ, v = shapes[k, row], stds[k, row], displacements[k, row]
                weights = v / σ**2
                shapes[k, row] = v * (weights @ psi) / (weights @ v) + σ * shape_noise[k]
        rows = tuple(map(tuple, shapes.tolist()))
        return replace(measured, frequencies=tuple(frequencies.tolist()), shapes=rows)

    def synthetic_priors(self, m: Array, noise: Array) -> Priors:
        """Return priors whose means are the properties of the unknowns m, plus the last of the noise (R,)."""
        values = dict(zip(self.space.factor_names, self.space.given_values * (1 + self.space.changes(m)), strict=True))
        return {
            prior.name: prior.with_mean(float(values[prior.name]), deviation)
            for prior, deviation in zip(self.priors, noise[len(noise) - len(self.priors) :].tolist(), strict=True)
        }

    @property
    def relative(self) -> Array:
        """Factors of the first m residuals that make them relative errors f_k/target_k - 1, (m,)."""
        return self.measured.relative_std / self.unit

    def residuals(self, m: Array) -> Array:
        """Return r, (R,)."""
        return np.asarray(self._functions[0](self._observations(m)).full().ravel())

    def jacobian(self, m: Array) -> Array:
        """Return dr/dm, (R, N)."""
        return np.asarray(self._functions[1](self._observations(m)).full() @ self._observation_jacobian(self.state(m)))

    def curvature(self, m: Array, y: Array) -> Array:
        """Return the second derivatives of y^T r, (N, N)."""
        state, count = self.state(m), self.measured.count
        x, x_m = self._observations(m), self._observation_jacobian(state)
        _, r_x, r_xx = self._functions
        weights = r_x(x).full().T @ y
        shape_weights = weights[count : count + count * len(self.observer)].reshape(count, -1) @ self.observer
        observation_curvature = hessian(state, self.space.directions, weights[:count], shape_weights)
        return np.asarray(observation_curvature + x_m.T @ r_xx(x, y).full() @ x_m)

    @cached_property
    def _prior_derivatives(self) -> Array:
        """Derivatives of the properties with priors by the unknowns, (p, N)."""
        rows = [self.space.factor_names.index(prior.name) for prior in self.priors]
        return np.asarray(self.space.given_values[rows, None] * self.space.map[rows])

    def _observations(self, m: Array) -> Array:
        """Return x: eigenvalues, displacements of the points mode by mode, and properties with priors."""
        state = self.state(m)
        prior_properties = [p.guess for p in self.priors] + self._prior_derivatives @ (m - self.space.standard)
        return np.concatenate([state.eigenvalues, (self.observer @ state.shapes).T.ravel(), prior_properties])

    def _observation_jacobian(self, state: ModalState) -> Array:
        """Return dx/dm, (m + m k + p, N)."""
        count, points = len(state.eigenvalues), len(self.observer)
        eigenvalue_weights = np.eye(count, count + count * points)
        shape_weights = np.zeros((count, state.model.size, count + count * points))
        for k in range(count):
            first = count + k * points
            shape_weights[k, :, first : first + points] = self.observer.T
        by_property = gradient(state, eigenvalue_weights, shape_weights)
        by_unknown = scipy.sparse.csr_array(self.space.directions).T @ by_property
        return np.vstack([np.asarray(by_unknown.T), self._prior_derivatives])

    @cached_property
    def _functions(self) -> tuple[cs.Function, cs.Function, cs.Function]:
        """Functions r, dr/dx and d2(y^T r)/dx2 of the observations x (and of y)."""
        measured = self.measured
        eigenvalues = cs.SX.sym("lambda", measured.count)
        displacements = cs.SX.sym("v", len(measured.points), measured.count)
        relative = cs.sqrt(eigenvalues) / (2 * np.pi * cs.DM(measured.frequencies)) - 1
        r = [relative * cs.DM(self.unit / measured.relative_std)]
        if measured.shape_std is not None:
            rows = zip(measured.shapes, measured.shape_std, measured.measured, strict=True)
            for k, (shape, std, is_measured) in enumerate(rows):
                σ = np.array(std)[is_measured]
                psi = cs.DM(np.array(shape)[is_measured] / σ)
                v = displacements[np.flatnonzero(is_measured).tolist(), k] / cs.DM(σ)
                r.append(self.unit * (psi - v * (cs.dot(v, psi) / cs.dot(v, v))))
        prior_properties = cs.SX.sym("p", len(self.priors))
        r += [self.unit * prior.prior_residual(prior_properties[k]) for k, prior in enumerate(self.priors)]
        x, residuals = cs.vertcat(eigenvalues, cs.vec(displacements), prior_properties), cs.vertcat(*r)
        y = cs.SX.sym("y", residuals.numel())
        return (
            cs.Function("r", [x], [residuals]),
            cs.Function("r_x", [x], [cs.densify(cs.jacobian(residuals, x))]),
            cs.Function("r_xx", [x, y], [cs.densify(cs.hessian(cs.dot(y, residuals), x)[0])]),
        )
