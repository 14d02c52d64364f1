"""The steady motion of a driven beam at a fixed frequency: harmonic balance, the reading of a sensor, all derivatives.

The balance F(C, l, s) of the coefficients C is that of ``ancf_casadi.response``.  The reading h at the N samples tau_j
of the motion q = E C has the fundamental

    Y exp(i phi) = sum_j 2/N (sin tau_j + i cos tau_j) h_j.

Its derivatives by C are sums over the samples, such as 2/N sum_j sin tau_j dh/dq E_j, and those by l and s likewise.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np

from ancf_casadi.response.harmonic_balance.balance import BalanceDerivatives, HarmonicBalance, Setting
from ancf_casadi.response.harmonic_balance.fourier import Fourier, fourier
from ancf_casadi.support.arrays import Array
from problems.beam.curves.driven import Driven


@dataclass(frozen=True, eq=False)
class DrivenBalance:
    """Harmonic balance of a driven beam with the reading of its sensor.

    Parameters
    ----------
    driven : Driven
        The beam, its excitation and its sensor.
    harmonics : int
        Number H of harmonics.
    size : float
        Amplitude of the excitation at level 1.
    """

    driven: Driven
    harmonics: int
    size: float

    @cached_property
    def fourier(self) -> Fourier:
        """The Fourier series, with enough samples for the products of a few harmonics, and for the kink of |v| v."""
        return fourier(self.harmonics, max(32, 6 * self.harmonics + 2))

    @property
    def unknowns(self) -> int:
        """Number of coefficients."""
        return self.fourier.size * self.driven.modes

    @cached_property
    def reading(self) -> cs.Function:
        """The reading at all samples."""
        return self.driven.reading.map(self.fourier.samples)

    def at(self, coefficients: Array, level: float, omega: float, s: Array) -> Linearised:
        """Return the balance at coefficients (d,), a level, an angular frequency and the unknowns s."""
        system = self.driven.system.with_values(s)
        setting = Setting(omega, self.size * level)
        return Linearised(self, HarmonicBalance(system, self.driven.drive, self.fourier), coefficients, setting)


@dataclass(frozen=True, eq=False)
class Linearised:
    """Balance and reading at one point, and their derivatives by coefficients, level and unknowns.

    Parameters
    ----------
    driven : DrivenBalance
        The driven beam.
    balance : HarmonicBalance
        Its equations for the values of the unknowns s.
    coefficients : array (d,)
        Fourier coefficients C, for d = (2 H + 1) n.
    setting : Setting
        Frequency and amplitude of the excitation.
    """

    driven: DrivenBalance
    balance: HarmonicBalance
    coefficients: Array
    setting: Setting

    @cached_property
    def forces(self) -> Array:
        """F, (d,)."""
        return np.asarray(self.balance.residual(self._C, self.setting).ravel())

    @property
    def by_coefficients(self) -> Array:
        """Derivatives of F by C, (d, d)."""
        return self._linear.by_coefficients

    @property
    def by_level(self) -> Array:
        """Derivatives of F by the level, (d,)."""
        return np.asarray(self.driven.size * self._linear.by_amplitude)

    @cached_property
    def by_unknowns(self) -> Array:
        """Derivatives of F by s, (d, s)."""
        return self.balance.by_parameters(self._C, self.setting, np.eye(self.driven.driven.shared))

    @cached_property
    def polar(self) -> Array:
        """Amplitude Y and phase phi of the fundamental of the reading, (2,)."""
        parts = self._fundamental
        return np.array([np.hypot(*parts), np.arctan2(parts[1], parts[0])])

    @cached_property
    def polar_by_coefficients(self) -> Array:
        """Derivatives of Y and phi by C, (2, d)."""
        series, omega = self.balance.fourier, self.setting.omega
        factors = (series.basis, omega * series.slope, omega**2 * series.curvature)
        rows = zip(factors, self._readings[1:4], strict=True)
        sums = sum(np.einsum("kj,jl,ji->kli", self._weights, E, J.reshape(len(E), -1)) for E, J in rows)
        return np.asarray(self._to_polar @ np.reshape(sums, (2, -1)))

    @property
    def polar_by_level(self) -> Array:
        """Derivatives of Y and phi by the level, (2,)."""
        return np.asarray(self.driven.size * self._to_polar @ (self._weights @ self._readings[4].ravel()))

    @property
    def polar_by_unknowns(self) -> Array:
        """Derivatives of Y and phi by s, (2, s)."""
        samples = self.balance.fourier.samples
        return np.asarray(self._to_polar @ (self._weights @ self._readings[5].reshape(samples, -1)))

    @property
    def _C(self) -> Array:
        return self.coefficients.reshape(-1, self.driven.driven.modes)

    @cached_property
    def _linear(self) -> BalanceDerivatives:
        return self.balance.linearised(self._C, self.setting)

    @cached_property
    def _readings(self) -> list[Array]:
        """The reading at the samples, and its Jacobians by q, v, a, the amplitude of the excitation and s."""
        q, v, a, _ = self.balance.motion(self._C, self.setting)
        inputs = (q, v, a, self.balance.fourier.phases[None], self.setting.omega, self.setting.amplitude)
        return [one.full() for one in self.driven.reading(*inputs, self.balance.system.values)]

    @property
    def _weights(self) -> Array:
        """Rows that give the sine and the cosine of the fundamental, (2, N)."""
        return self.balance.fourier.analysis[[2, 1]]

    @cached_property
    def _fundamental(self) -> Array:
        """Sine and cosine of the fundamental of the reading, (2,)."""
        return np.asarray(self._weights @ self._readings[0].ravel())

    @cached_property
    def _to_polar(self) -> Array:
        """Derivatives of Y and phi by sine and cosine, (2, 2)."""
        x, y = self._fundamental
        return np.asarray(np.array([[x, y], [-y, x]]) / np.array([[np.hypot(x, y)], [x**2 + y**2]]))
