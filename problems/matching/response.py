"""Which modes of a beam the measured ones are, how far they differ, and how that changes with the unknowns.

Targets with shapes belong to the modes of the given beam that look most like them (the assignment with the largest sum
of MAC values), targets without to the lowest ones by their order.  From there each mode is followed by its own shape
(``ancf_casadi.vibration.following``), so that no crossing makes two of them change places.

Residuals are f_k/target_k - 1 and what ``measured_modes`` leaves of each shape, all in units of the relative standard
deviation of the best known frequency: 1 where none is given.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import casadi as cs
import numpy as np
import scipy.sparse
from scipy.optimize import linear_sum_assignment

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.vibration.following import follow, followed_modes
from ancf_casadi.vibration.modal_state import ModalState
from ancf_casadi.vibration.modes import Modes, natural_modes
from ancf_casadi.vibration.second_derivatives import hessian
from ancf_casadi.vibration.sensitivities import gradient
from problems.matching.design_space import DesignSpace
from problems.matching.measured_modes import MeasuredModes
from problems.matching.preference import WEIGHT, LeastChange, Preference

Objective = Literal["least-squares", "worst-error"]

ALIKE = 0.5  # MAC below which no mode of the beam is the measured one
FURTHER = 6  # modes looked through for a measured shape, beyond twice the number of shapes


@dataclass(frozen=True)
class Matching:
    """What is to be matched to what, and how.

    Parameters
    ----------
    space : DesignSpace
        The beam, and what may change of it.
    measured : MeasuredModes
        What was measured.
    preference : Preference
        Which of the beams that fit is meant.
    objective : {"least-squares", "worst-error"}
        Whether to minimise the squared residuals or the largest relative frequency error.
    """

    space: DesignSpace
    measured: MeasuredModes
    preference: Preference = field(default_factory=LeastChange)
    objective: Objective = "least-squares"

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel between processes without the modes, which are computed again there."""
        return Matching, (self.space, self.measured, self.preference, self.objective)

    @property
    def model(self) -> Model:
        """The given beam as a model."""
        return self.standard_modes.model

    @cached_property
    def standard_modes(self) -> Modes:
        """The lowest modes of the given beam, the targets among them."""
        model = Model(self.space.beam)
        count = self.measured.count
        if self.measured.shapes:
            count = min(2 * count + FURTHER, model.size - model.free.start)
        return natural_modes(model, count=count)

    @cached_property
    def standard(self) -> ModalState:
        """The modes of the given beam that the targets belong to."""
        return followed_modes(self.standard_modes, self.numbers)

    @cached_property
    def observer(self) -> Array:
        """Displacements at the measured points by nodal coordinates, (k, 4 n + 4)."""
        return self.measured.observer(self.model)

    @cached_property
    def numbers(self) -> Index:
        """Numbers, from 0, of the modes of the given beam that the targets belong to, (m,).

        Raises
        ------
        InputError
            If no mode has the shape of a target.
        """
        if not self.measured.shapes:
            return np.arange(self.measured.count)
        mac = self.measured.mac(self.observer @ self.standard_modes.shapes)
        targets, modes = linear_sum_assignment(-mac)
        for target, mode in zip(targets.tolist(), modes.tolist(), strict=True):
            if mac[target, mode] < ALIKE:
                raise InputError(
                    f"no mode of the beam has the shape of target {target + 1} "
                    f"({self.measured.frequencies[target]:g} Hz): the nearest has a MAC of "
                    f"{mac[target].max():.2f}",
                    "shapes",
                )
        return np.asarray(modes, dtype=np.int64)

    @property
    def unit(self) -> float:
        """Relative standard deviation of the best known frequency, the unit of the residuals."""
        return float(self.measured.relative_std.min())

    @cached_property
    def weights(self) -> Array:
        """Matrix of the preference against half the sum of squared residuals in units of their deviations, (N, N)."""
        return self.preference.matrix(self.space, WEIGHT / self.unit**2)

    def response(self, objective: Objective | None = None) -> Response:
        """Return the residuals and their derivatives, of another objective if one is given."""
        return Response(self, objective or self.objective)


class Response:
    """Residuals r(m) in units of that of the best known frequency, and their derivatives; the last point is kept.

    Parameters
    ----------
    matching : Matching
        What is to be matched.
    objective : {"least-squares", "worst-error"}
        Whether shapes and deviations count, or relative frequency errors alone.
    """

    def __init__(self, matching: Matching, objective: Objective) -> None:
        self.matching = matching
        self._residuals, self._slopes, self._curvature = _residual_functions(matching, objective == "worst-error")
        self._along = scipy.sparse.csr_array(matching.space.directions).T
        self._at: tuple[Array, ModalState] | None = None

    @property
    def size(self) -> int:
        """Number of residuals."""
        return int(self._residuals.size1_out(0))

    def state(self, m: Array) -> ModalState:
        """Return the followed modes.

        Raises
        ------
        EquilibriumError
            If there is no stable equilibrium.
        """
        if self._at is None or not np.array_equal(self._at[0], m):
            space = self.matching.space
            self._at = m.copy(), follow(self.matching.standard, space.properties(m))
        return self._at[1]

    def residuals(self, m: Array) -> Array:
        """Return r, (R,)."""
        return np.asarray(self._residuals(self._seen(self.state(m))).full().ravel())

    def jacobian(self, m: Array) -> Array:
        """Return dr/dm, (R, N)."""
        state = self.state(m)
        return np.asarray(self._slopes(self._seen(state)).full() @ self._seen_slopes(state))

    def curvature(self, m: Array, y: Array) -> Array:
        """Return the second derivatives of y^T r, (N, N)."""
        state, space = self.state(m), self.matching.space
        seen, count = self._seen(state), self.matching.measured.count
        of_seen = self._slopes(seen).full().T @ y
        of_shapes = of_seen[count:].reshape(count, -1) @ self.matching.observer
        curved = hessian(state, space.directions, of_seen[:count], of_shapes)
        own = self._seen_slopes(state)
        return np.asarray(curved + own.T @ self._curvature(seen, y).full() @ own)

    def _seen(self, state: ModalState) -> Array:
        """Eigenvalues, and displacements of the points mode by mode."""
        return np.concatenate([state.eigenvalues, (self.matching.observer @ state.shapes).T.ravel()])

    def _seen_slopes(self, state: ModalState) -> Array:
        """Return the derivatives of what is seen by the unknowns, (m + m k, N)."""
        observer, count = self.matching.observer, len(state.eigenvalues)
        points = len(observer)
        of_eigenvalues = np.eye(count, count + count * points)
        of_shapes = np.zeros((count, state.model.size, count + count * points))
        for k in range(count):
            first = count + k * points
            of_shapes[k, :, first : first + points] = observer.T
        return np.asarray((self._along @ gradient(state, of_eigenvalues, of_shapes)).T)


def _residual_functions(matching: Matching, worst: bool) -> tuple[cs.Function, cs.Function, cs.Function]:
    """Return r, dr/dx and d2(y^T r)/dx2 as Functions of x, eigenvalues and displacements mode by mode."""
    measured = matching.measured
    points = len(measured.points) if measured.shapes else 0
    eigenvalues = cs.SX.sym("lambda", measured.count)
    displacements = cs.SX.sym("v", points, measured.count)
    relative = cs.sqrt(eigenvalues) / (2 * np.pi * cs.DM(measured.frequencies)) - 1
    r = [relative] if worst else [relative * cs.DM(matching.unit / measured.relative_std)]
    if measured.shape_std is not None and not worst:
        rows = zip(measured.shapes, measured.shape_std, measured.measured, strict=True)
        for k, (shape, std, known) in enumerate(rows):
            psi = cs.DM(np.array(shape)[known] / np.array(std)[known])
            v = displacements[np.flatnonzero(known).tolist(), k] / cs.DM(np.array(std)[known])
            r.append(matching.unit * (psi - v * (cs.dot(v, psi) / cs.dot(v, v))))
    x, residuals = cs.vertcat(eigenvalues, cs.vec(displacements)), cs.vertcat(*r)
    y = cs.SX.sym("y", residuals.numel())
    return (
        cs.Function("r", [x], [residuals]),
        cs.Function("dr", [x], [cs.densify(cs.jacobian(residuals, x))]),
        cs.Function("ddr", [x, y], [cs.densify(cs.hessian(cs.dot(y, residuals), x)[0])]),
    )
