"""A family of periodic motions with one free dimension, as equations for the continuation.

The unknowns z = (C, y) are the coefficients of the motion that are not zero by symmetry, and some entries y of its
setting: the frequency, the amplitude of the drive, a parameter of the system, or the negative damping.  With k entries
in y, the equations are those of harmonic balance and k - 1 constraints g(C) = 0.  Their solutions form a curve.

    curve                       y                   constraint
    frequency response          omega               -
    amplitude response          A                   -
    held response amplitude     omega, A            |first harmonic| = constant
    backbone                    omega, xi           phase of the mode

Lengths along the curve are measured in z/s with the scale s of each unknown.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ancf_casadi.response.harmonic_balance.balance import BalanceDerivatives, HarmonicBalance, Setting
from ancf_casadi.response.harmonic_balance.fourier import fourier, resized
from ancf_casadi.response.systems.system import NO_CORRECTIONS
from ancf_casadi.support.arrays import Array

Constraint = Callable[[Array], tuple[float, Array]]  # C -> g and dg/dC


@dataclass(frozen=True, eq=False)
class Family:
    """The equations of a curve of periodic motions.

    Parameters
    ----------
    balance : HarmonicBalance
        The equations of harmonic balance.
    setting : Setting
        The values that stay as they are.
    free : tuple of str
        Names of the fields of the setting that are unknown.
    scales : tuple of float
        Typical change of each of them.
    size : float
        Typical size of the motion, relative to the scale of the system.
    constraints : tuple of callable
        As many as there are free entries, less one.
    """

    balance: HarmonicBalance
    setting: Setting
    free: tuple[str, ...]
    scales: tuple[float, ...]
    size: float
    constraints: tuple[Constraint, ...] = ()

    @property
    def scale(self) -> Array:
        """Scale s of the unknowns."""
        coefficients = np.tile(self.size * self.balance.system.scale, (self.balance.fourier.size, 1))[
            self.balance.allowed
        ]
        return np.concatenate([coefficients, self.scales])

    @property
    def cheap(self) -> bool:
        """True if the matrices are small."""
        return len(self.scale) <= 400  # unknowns

    def place(self, name: str) -> int:
        """Return the place of a free entry of the setting among the unknowns."""
        return len(self.scale) - len(self.free) + self.free.index(name)

    def joined(self, C: Array, setting: Setting) -> Array:
        """Return the unknowns of a motion."""
        return np.concatenate([C[self.balance.allowed], [getattr(setting, name) for name in self.free]])

    def split(self, z: Array) -> tuple[Array, Setting]:
        """Return coefficients and setting of the unknowns."""
        count = len(self.free)
        values = dict(zip(self.free, z[-count:].tolist(), strict=True))
        C = np.zeros(self.balance.allowed.shape)
        C[self.balance.allowed] = z[:-count]
        return C, replace(self.setting, **values)

    def moved(self, z: Array, change: Array) -> Array:
        """Return the unknowns moved by a change."""
        if self.plain:
            return z + change
        end = z + change
        q, carried = self._relative(z), self._carried(end)
        moved = self.balance.system.corrections.moved(q, self._sampled(end) - carried - q)
        return self._analysed(moved + carried, end[-len(self.free) :])

    def forth(self, reference: Array, z: Array, change: Array) -> Array:
        """Return the change at z that corresponds to a change at a reference."""
        if self.plain or reference is z:
            return change
        forth = self.balance.system.corrections.forth
        turned = forth(self._relative(reference), self._relative(z), self._sampled(change))
        return self._analysed(turned, change[-len(self.free) :])

    def back(self, reference: Array, z: Array, residual: Array) -> Array:
        """Return the left sides at a reference that correspond to those at z."""
        if self.plain or reference is z:
            return residual
        count = int(self.balance.allowed.sum())
        padded = np.append(residual[:count], np.zeros(len(self.free)))
        back = self.balance.system.corrections.back
        turned = back(self._relative(reference), self._relative(z), self._sampled(padded))
        return self._analysed(turned, residual[count:])

    @property
    def plain(self) -> bool:
        """True if corrections are simply added."""
        return self.balance.system.corrections is NO_CORRECTIONS

    def _sampled(self, z: Array) -> Array:
        """Return the coordinates at the samples, (n, N)."""
        return np.asarray((self.balance.fourier.basis @ self.split(z)[0]).T)

    def _carried(self, z: Array) -> Array:
        """Return the rigid displacements due to the excitation at the samples."""
        _, setting = self.split(z)
        u, _, _ = self.balance.drive.samples(self.balance.fourier.phases, setting.omega, setting.amplitude)
        return self.balance.system.corrections.carried(u)

    def _relative(self, z: Array) -> Array:
        """Return the coordinates at the samples relative to the rigid displacements."""
        return np.asarray(self._sampled(z) - self._carried(z))

    def _analysed(self, samples: Array, last: Array) -> Array:
        """Return the coefficients of sampled coordinates, followed by other entries."""
        C = self.balance.fourier.analysis @ samples.T
        return np.concatenate([C[self.balance.allowed], last])

    def residual(self, z: Array) -> Array:
        """Return the left sides of all equations."""
        C, setting = self.split(z)
        F = self.balance.residual(C, setting)[self.balance.allowed]
        return np.concatenate([F, [g(C)[0] for g in self.constraints]])

    def jacobian(self, z: Array) -> tuple[Array, BalanceDerivatives]:
        """Return the derivatives of all equations, with one column more than rows, and those of harmonic balance."""
        C, setting = self.split(z)
        linear = self.balance.linearised(C, setting)
        columns = [getattr(linear, f"by_{name}") for name in self.free]
        J = np.hstack([linear.by_coefficients, np.stack(columns, axis=1)])
        rows = [np.append(g(C)[1][self.balance.allowed], np.zeros(len(self.free))) for g in self.constraints]
        return np.vstack([J, *rows]), linear

    def with_series(self, harmonics: int, samples: int) -> Family:
        """Return the family with other numbers of harmonics and samples."""
        series = fourier(harmonics, samples, self.balance.fourier.half)
        return replace(self, balance=replace(self.balance, fourier=series))

    def resized(self, z: Array, harmonics: int) -> Array:
        """Return the unknowns with another number of harmonics."""
        (C, _), series = self.split(z), self.balance.fourier
        allowed = fourier(harmonics, 4 * harmonics + 2, series.half).allowed(self.balance.system.mirror)
        return np.append(resized(C, harmonics)[allowed], z[-len(self.free) :])
