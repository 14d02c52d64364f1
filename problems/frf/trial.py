"""Fast fits of modal parameters, for the choice of modes and weights.

The same weighted least squares as in ``refinement``, as a Gauss-Newton method in numbers: with QR factors Q R of the
weighted columns of a function, the residuals are those of the linear fit, and their derivatives by frequencies and
damping ratios are (1 - Q Q') times the derivatives of the columns times the coefficients (Kaufman).

References
----------
L. Kaufman, A variable projection method for solving separable nonlinear least squares problems, BIT 15 (1975).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares

from ancf_casadi.estimation.solver.noise import estimated_noise
from ancf_casadi.support.arrays import Array, ComplexArray
from problems.frf.modal_sum import ModalSum, stacked

LARGEST_RATIO = 0.999
LEAST_SCALE = 1e-4  # damping ratio that sets the scale of nearly undamped modes
SOLVER_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class TrialFit:
    """A fit of some modes.

    Parameters
    ----------
    model : ModalSum
        The model.
    values, weights : array (k, F)
        Measured values and their weights, one column per function.
    frequencies, ratios : array (m,)
        Natural frequencies, Hz, and damping ratios.
    """

    model: ModalSum
    values: ComplexArray
    weights: Array
    frequencies: Array
    ratios: Array

    @cached_property
    def factors(self) -> list[tuple[Array, Array]]:
        """QR factors of the weighted columns, (2 k, c) and (c, c), for each function."""
        columns = stacked(self.model.columns(self.frequencies, self.ratios))
        return [np.linalg.qr(np.tile(weight, 2)[:, None] * columns) for weight in self.weights.T]

    @cached_property
    def coefficients(self) -> Array:
        """Coefficients (2 m + powers, F)."""
        weighted = np.tile(self.weights, (2, 1)) * stacked(self.values)
        found = []
        for (q, triangle), y in zip(self.factors, weighted.T, strict=True):
            size = np.linalg.norm(triangle, axis=0)
            found.append(np.linalg.lstsq(triangle / size, q.T @ y)[0] / size)
        return np.column_stack(found)

    @cached_property
    def fitted(self) -> ComplexArray:
        """Fitted values (k, F)."""
        return np.asarray(self.model.columns(self.frequencies, self.ratios) @ self.coefficients)

    def at(self, frequencies: Array) -> ComplexArray:
        """Return the fitted functions (k, F) at other frequencies, Hz."""
        model = replace(self.model, frequencies=frequencies, reference=self.model.reference)
        return np.asarray(model.columns(self.frequencies, self.ratios) @ self.coefficients)

    @property
    def residuals(self) -> ComplexArray:
        """Fitted less measured values (k, F)."""
        return self.fitted - self.values

    @property
    def weighted_residuals(self) -> Array:
        """Weighted residuals (2 k F,), function after function, real parts before imaginary parts."""
        return stacked(self.weights * self.residuals).T.ravel()

    @cached_property
    def jacobian(self) -> Array:
        """Derivatives of the weighted residuals by frequency and damping ratio of each mode in turn, (2 k F, 2 m)."""
        slopes, rows = self.model.slopes(self.frequencies, self.ratios, self.coefficients), []
        for (q, _), weight, own in zip(self.factors, self.weights.T, slopes, strict=True):
            change = stacked(weight[:, None] * own)
            rows.append(change - q @ (q.T @ change))
        return np.concatenate(rows)

    @property
    def parameters(self) -> int:
        """Number of all parameters."""
        return 2 * len(self.frequencies) + self.coefficients.size

    @cached_property
    def leverage(self) -> Array:
        """Share of each complex value that the fit follows (k, F), the mean over real and imaginary part."""
        k, count = self.values.shape
        own = np.column_stack([np.sum(q**2, axis=1) for q, _ in self.factors])
        own += np.sum(self._basis**2, axis=1).reshape(count, 2 * k).T
        return np.asarray((own[:k] + own[k:]) / 2)

    @property
    def effective_samples(self) -> float:
        """Number of residuals with white noise that would determine the modes as well."""
        k, count = self.values.shape
        times = np.tile(self.model.frequencies, 2 * count)
        noise = estimated_noise(self.weighted_residuals, self._basis, [k] * (2 * count), times)
        return float(2 * k * count / max(noise.growth, 1.0))

    @cached_property
    def _basis(self) -> Array:
        """Orthonormal basis of the columns of the Jacobian."""
        return np.linalg.qr(self.jacobian / np.linalg.norm(self.jacobian, axis=0))[0]


def quick_fit(
    model: ModalSum, values: ComplexArray, weights: Array, frequencies: Array, ratios: Array
) -> TrialFit | None:
    """Return the fit from a start; None if the functions do not determine the modes.

    Parameters
    ----------
    model : ModalSum
        The model.
    values, weights : array (k, F)
        Measured values and their weights, one column per function.
    frequencies, ratios : array (m,)
        Natural frequencies, Hz, and damping ratios at the start.
    """
    ratios = np.clip(ratios, 0.1 * LEAST_SCALE, 0.99 * LARGEST_RATIO)
    scale = np.column_stack([frequencies, np.ones_like(ratios)]) * np.maximum(ratios, LEAST_SCALE)[:, None]
    start = np.column_stack([frequencies, ratios]).ravel()
    last: dict[bytes, TrialFit] = {}

    def at(x: Array) -> TrialFit:
        if x.tobytes() not in last:
            last.clear()
            last[x.tobytes()] = TrialFit(model, values, weights, x[::2], x[1::2])
        return last[x.tobytes()]

    def residuals(x: Array) -> Array:
        return at(x).weighted_residuals

    def jacobian(x: Array) -> Array:
        return at(x).jacobian

    upper = np.tile([np.inf, LARGEST_RATIO], len(frequencies))
    try:
        found = least_squares(
            residuals, start, jacobian, (0.0, upper), x_scale=scale.ravel(),
            ftol=SOLVER_TOLERANCE, xtol=SOLVER_TOLERANCE, gtol=SOLVER_TOLERANCE, max_nfev=50 * len(start),
        )  # fmt: skip
    except (np.linalg.LinAlgError, ValueError):  # residuals that are not finite
        return None
    fit = at(found.x)
    columns = [np.abs(np.diag(triangle)) / np.linalg.norm(triangle, axis=0) for _, triangle in fit.factors]
    # least relative norm of a column beside the others
    return fit if np.min(columns) > 1e-10 and np.linalg.norm(fit.jacobian, axis=0).all() else None
