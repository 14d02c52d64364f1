"""A family of periodic motions with one free dimension, and Newton's method for its points.

The unknowns z = (C, y) are the coefficients of the motion that are not zero by symmetry, and some entries y of its
setting: the frequency, the amplitude of the drive, a parameter of the system, or the negative damping.

    curve                       y                   further equation
    frequency response          omega               -
    amplitude response          A                   -
    backbone                    omega, xi           phase of the mode

Lengths along the curve are measured in z/s with the scale s of each unknown.

One more equation, row . (z - guess)/s = 0, selects a point of the curve: the row is the tangent (pseudo-arclength), the
unit vector of an entry that is prescribed, or any other row across the curve.  The derivatives cost more than ten
residuals.  They are reused, also from the last point of a curve, as long as each step of Newton's method reduces the
error fivefold; large matrices are reused as long as it reduces it twofold.  For a beam that turns, residuals are turned
back to the motion at which the derivatives were evaluated, and corrections forth (``beams``).
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import scipy.linalg

from ancf_casadi.response.floquet import floquet_multipliers
from ancf_casadi.response.harmonic_balance.balance import (
    BalanceDerivatives,
    Errors,
    HarmonicBalance,
    Setting,
    estimate_errors,
    fourier,
    resize,
)
from ancf_casadi.support.arrays import Array, ComplexArray

if TYPE_CHECKING:
    from ancf_casadi.response.harmonic_balance.beams import SlopeCorrections

NEWTON_ERROR = 1e-11  # error of the unknowns relative to their scales
ROUNDING = 1e-13  # error of the unknowns by rounding, relative to the scale of the system
LARGEST_NEWTON_STEP = 100.0  # largest step, relative to the scales


class NotFound(Exception):
    """No point was found near a guess; the continuation shortens its step."""


@dataclass(frozen=True, eq=False)
class Family:
    """The equations of a curve of periodic motions."""

    balance: HarmonicBalance
    setting: Setting  # values of the fixed fields
    free: tuple[str, ...]  # fields of the setting that are unknown
    scales: tuple[float, ...]  # typical change of each
    size: float  # typical size of the motion, relative to the scale of the system
    tolerance: float  # of the error relative to the size; if infinite, harmonics and samples stay as they are
    phase: Array | None = None  # with two free entries, the functional (n,) without cosine in the first harmonic

    @cached_property
    def scale(self) -> Array:
        """Scale s of the unknowns."""
        coefficients = np.tile(self.size * self.balance.system.scale, (self.balance.fourier.size, 1))
        return np.concatenate([coefficients[self.balance.allowed], self.scales])

    @property
    def rounding(self) -> float:
        """Error relative to the size that may be due to rounding if it does not decrease."""
        return max(1e-6, ROUNDING / self.size)

    def place(self, name: str) -> int:
        """Return the place of a free entry of the setting among the unknowns."""
        return len(self.scale) - len(self.free) + self.free.index(name)

    def unit(self, name: str) -> Array:
        """Return the unit vector of a free entry of the setting."""
        row = np.zeros(len(self.scale))
        row[self.place(name)] = 1.0
        return row

    def join(self, C: Array, setting: Setting) -> Array:
        """Return the unknowns of a motion."""
        return np.concatenate([C[self.balance.allowed], [getattr(setting, name) for name in self.free]])

    def split(self, z: Array) -> tuple[Array, Setting]:
        """Return coefficients and setting of the unknowns."""
        count = len(self.free)
        values = dict(zip(self.free, z[-count:].tolist(), strict=True))
        return self._all_coefficients(z[:-count]), replace(self.setting, **values)

    def _all_coefficients(self, coefficients: Array) -> Array:
        """Return C, (2 H + 1, n), of the coefficients that are not zero by symmetry."""
        C = np.zeros(self.balance.allowed.shape)
        C[self.balance.allowed] = coefficients
        return C

    def residual(self, z: Array) -> Array:
        """Return the residual of all equations except the row."""
        C, setting = self.split(z)
        F = self.balance.residual(C, setting)[self.balance.allowed]
        return F if self.phase is None else np.append(F, self.phase @ C[1])

    def at(self, z: Array, row: Array) -> Point:
        """Return the derivatives at z as a point with a row."""
        return Point(self, z, row, self.balance.linearise(*self.split(z)))

    def add_change(self, z: Array, change: Array) -> Array:
        """Return the unknowns after a change; the slopes of a beam turn."""
        end, corrections, count = z + change, self.balance.system.corrections, len(z) - len(self.free)
        if corrections is None:
            return end
        q, base_displacement = self._relative_samples(z, corrections), self._base_displacement(end, corrections)
        q_end = corrections.add_corrections(q, self._samples(end[:count]) - base_displacement - q)
        return self._analyse(q_end + base_displacement, end[count:])

    def turn_vector(self, reference: Array, z: Array, vector: Array, direction: Literal["forth", "back"]) -> Array:
        """Return the change at z that corresponds to one at a reference (forth), or the residual there (back)."""
        corrections, count = self.balance.system.corrections, len(z) - len(self.free)
        if corrections is None or reference is z:
            return vector
        before, after = (self._relative_samples(unknowns, corrections) for unknowns in (reference, z))
        samples = corrections.turn_vectors(before, after, self._samples(vector[:count]), direction)
        return self._analyse(samples, vector[count:])

    def _samples(self, coefficients: Array) -> Array:
        """Return the coordinates at the samples, (n, N), of the coefficients that are not zero by symmetry."""
        return np.asarray((self.balance.fourier.basis @ self._all_coefficients(coefficients)).T)

    def _base_displacement(self, z: Array, corrections: SlopeCorrections) -> Array:
        """Return the displacement of the base in the coordinates at the samples, (n, N)."""
        setting, series = self.split(z)[1], self.balance.fourier
        u, _, _ = self.balance.drive.samples(series.phases, setting.omega, setting.amplitude)
        return np.asarray(corrections.translation @ u[:2])

    def _relative_samples(self, z: Array, corrections: SlopeCorrections) -> Array:
        """Return the coordinates at the samples relative to the base."""
        return np.asarray(self._samples(z[: len(z) - len(self.free)]) - self._base_displacement(z, corrections))

    def _analyse(self, samples: Array, last: Array) -> Array:
        """Return the coefficients of sampled coordinates, followed by other entries."""
        C = self.balance.fourier.analysis @ samples.T
        return np.concatenate([C[self.balance.allowed], last])

    def with_series(self, harmonics: int, samples: int) -> Family:
        """Return the family with other numbers of harmonics and samples."""
        series = fourier(harmonics, samples, self.balance.fourier.half)
        return replace(self, balance=replace(self.balance, fourier=series))

    def resize(self, z: Array, harmonics: int) -> Array:
        """Return the unknowns with another number of harmonics."""
        (C, _), series = self.split(z), self.balance.fourier
        allowed = fourier(harmonics, 4 * harmonics + 2, series.half).symmetry_mask(self.balance.system.mirror)
        return np.append(resize(C, harmonics)[allowed], z[-len(self.free) :])


@dataclass(frozen=True, eq=False)
class Point:
    """A point on or near a curve of periodic motions, with the derivatives of the equations there."""

    family: Family
    z: Array
    row: Array  # across the curve, in scaled unknowns; completes the derivatives to a regular matrix
    linear: BalanceDerivatives

    @property
    def coefficients(self) -> Array:
        """C, (2 H + 1, n)."""
        return self.family.split(self.z)[0]

    @property
    def setting(self) -> Setting:
        """Frequency, amplitude of the drive and so on."""
        return self.family.split(self.z)[1]

    @cached_property
    def errors(self) -> Errors:
        """Estimated errors relative to the size of the motion."""
        family = self.family

        def shift(residual: Array) -> Array:
            right = np.zeros(len(family.scale))
            right[: family.balance.allowed.sum()] = residual[family.balance.allowed]
            return family.split(family.scale * self.solve(right))[0]

        matrices = self.linear.matrices
        return estimate_errors(family.balance, self.coefficients, self.setting, matrices, family.size, shift)

    @cached_property
    def multipliers(self) -> ComplexArray:
        """Floquet multipliers, the largest first."""
        system, setting = self.family.balance.system, self.setting
        K, D, M = (system.matrix(entries) for entries in self.linear.matrices)
        D = D - setting.growth * M
        period = 2 * np.pi / setting.omega
        if not self.family.balance.fourier.half:
            return floquet_multipliers(K, D, M, period)
        signs = system.mirror[:, None] * system.mirror
        K, D, M = (np.concatenate([matrix, signs * matrix]) for matrix in (K, D, M))
        return floquet_multipliers(K, D, M, period, mirror=system.mirror)

    def tangent(self, along: Array) -> Array:
        """Return the unit tangent of the curve in scaled unknowns, in the direction of another vector."""
        t = self.solve(np.append(np.zeros(len(self.z) - 1), 1.0))
        return np.asarray(np.copysign(1.0, t @ along) * t / np.linalg.norm(t))

    def solve(self, right: Array) -> Array:
        """Return the change of the scaled unknowns for a change of all equations, that of the row last."""
        factors, rows = self._factors
        return np.asarray(scipy.linalg.lu_solve(factors, (right.T / rows).T, check_finite=False))

    @cached_property
    def _factors(self) -> tuple[Any, Array]:
        """LU factors of the derivatives by the scaled unknowns, and the numbers by which their rows are divided."""
        family = self.family
        matrix = np.column_stack([self.linear.by_coefficients, *(self.linear.by[name] for name in family.free)])
        if family.phase is not None:
            gradient = np.zeros(family.balance.allowed.shape)
            gradient[1] = family.phase
            matrix = np.vstack([matrix, np.append(gradient[family.balance.allowed], np.zeros(len(family.free)))])
        matrix *= family.scale
        rows = np.append(np.abs(matrix).max(axis=1), 1.0)
        with warnings.catch_warnings(), np.errstate(divide="ignore", invalid="ignore"):
            warnings.simplefilter("ignore", scipy.linalg.LinAlgWarning)  # steps from a singular matrix are not finite
            return scipy.linalg.lu_factor(np.vstack([matrix, self.row]) / rows[:, None], check_finite=False), rows


def solve(family: Family, guess: Array, row: Array, nearby: Point | None = None) -> Array:
    """Return the unknowns of the point with row . (z - guess)/s = 0, beginning with the derivatives of a nearby point.

    Raise NotFound if the iteration does not converge.
    """
    scale, z, evaluations, last_length = family.scale, guess, 1, math.inf
    # with a slower decrease, the derivatives are evaluated again; the factors of a large matrix are expensive
    contraction = 0.2 if len(scale) <= 400 else 0.5
    is_fresh, distance = nearby is None, math.inf
    derivatives = family.at(z, row) if nearby is None else replace(nearby, family=family, row=row)
    for _ in range(30):
        gap = row @ ((z - guess) / scale)
        residual = family.turn_vector(derivatives.z, z, family.residual(z), "back")
        correction = scale * derivatives.solve(np.append(residual, gap))
        step = -family.turn_vector(derivatives.z, z, correction, "forth") / scale
        length = float(np.abs(step).max())
        if not np.isfinite(length) or (is_fresh and length > LARGEST_NEWTON_STEP):
            raise NotFound
        if length > min(LARGEST_NEWTON_STEP, contraction * last_length):
            # a short step stagnates by rounding, with derivatives from nearby
            if distance <= 1e3 * family.rounding and last_length <= family.rounding and length > last_length / 2:
                return z
            if evaluations == 10:
                raise NotFound
            derivatives, evaluations, last_length, is_fresh = family.at(z, row), evaluations + 1, math.inf, True
            continue
        distance = length if is_fresh else distance
        z, is_fresh = family.add_change(z, scale * step), False
        if min(length / last_length, 1.0) * length <= NEWTON_ERROR and (
            last_length < math.inf or length <= NEWTON_ERROR
        ):
            return z
        last_length = length
    raise NotFound
