"""Harmonic balance of a driven beam at a fixed frequency, with all derivatives (alternating frequency-time method).

With the matrices E, E', E'' and W of the Fourier series (``ancf_casadi.response``), the motion at N phases tau_j is

    q = E C,    v = omega E' C,    a = omega^2 E'' C,

and the balance of the forces R and the fundamental of the reading h
are

    F = W R(q, v, a, tau, omega, l, s),    Y exp(i phi) = sum_j 2/N (sin tau_j + i cos tau_j) h_j.

Their derivatives by C are sums over the samples, such as W diag(dR/dq) E, and those by l and s are W dR/dl and so on.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np

from ancf_casadi.response.harmonic_balance.fourier import Fourier, fourier
from ancf_casadi.support.arrays import Array
from problems.response.driven import Driven


@dataclass(frozen=True, eq=False)
class Linearised:
    """Balance and reading at one point, and their derivatives by coefficients, level and unknowns.

    Parameters
    ----------
    forces : array (d,)
        F, for d = (2 H + 1) n coefficients.
    by_coefficients, by_level, by_unknowns : array (d, d), (d,), (d, s)
        Derivatives of F.
    polar : array (2,)
        Amplitude Y and phase phi of the fundamental of the reading.
    polar_by_coefficients, polar_by_level, polar_by_unknowns : array (2, d), (2,), (2, s)
        Derivatives of Y and phi.
    """

    forces: Array
    by_coefficients: Array
    by_level: Array
    by_unknowns: Array
    polar: Array
    polar_by_coefficients: Array
    polar_by_level: Array
    polar_by_unknowns: Array


@dataclass(frozen=True, eq=False)
class HarmonicBalance:
    """Harmonic balance of a driven beam.

    Parameters
    ----------
    driven : Driven
        Forces and reading at one instant.
    harmonics : int
        Number H of harmonics.
    size : float
        Size of the excitation at level 1.
    """

    driven: Driven
    harmonics: int
    size: float = 1.0

    @cached_property
    def fourier(self) -> Fourier:
        """The Fourier series, with enough samples for the products of a few harmonics, and for the kink of |v| v."""
        return fourier(self.harmonics, max(32, 6 * self.harmonics + 2))

    @property
    def unknowns(self) -> int:
        """Number of coefficients."""
        return self.fourier.size * self.driven.modes

    @cached_property
    def _functions(self) -> tuple[cs.Function, cs.Function]:
        return self.driven.forces.map(self.fourier.samples), self.driven.reading.map(self.fourier.samples)

    def at(self, coefficients: Array, level: float, omega: float, s: Array) -> Linearised:
        """Return the balance at coefficients (d,), a level, an angular frequency and the unknowns s."""
        n, ns, N = self.driven.modes, self.driven.shared, self.fourier.samples
        series = self.fourier
        synthesis = series.basis, series.slope, series.curvature
        C = coefficients.reshape(-1, n)
        motion = [(omega**k * E @ C).T for k, E in enumerate(synthesis)]
        inputs = [*map(cs.DM, motion), cs.DM(series.phases[None]), cs.DM(omega), cs.DM(self.size * level), cs.DM(s)]
        forces, *jacobians = (one.full() for one in self._functions[0].call(inputs))
        reading, *slopes = (one.full() for one in self._functions[1].call(inputs))
        powers = (1.0, omega, omega**2)
        tangents = [J.reshape(n, N, n).transpose(1, 0, 2).reshape(N, -1) for J in jacobians[:3]]
        pairs = zip(series.products, powers, tangents, strict=True)
        blocks = np.asarray(sum(power * (product.reshape(N, -1).T @ tangent) for product, power, tangent in pairs))
        width = len(C)
        by_coefficients = blocks.reshape(width, width, n, n).transpose(0, 2, 1, 3).reshape(self.unknowns, self.unknowns)
        fundamental = series.analysis[[2, 1]]  # sine and cosine
        rows = zip(synthesis, powers, slopes[:3], strict=True)
        by_motion = sum(
            power * np.einsum("kj,jl,ji->kli", fundamental, E, J.reshape(N, n)) for E, power, J in rows
        ).reshape(2, -1)
        parts = fundamental @ reading.ravel()
        to_polar = np.array([parts, [-parts[1], parts[0]]]) / np.array([[np.hypot(*parts)], [parts @ parts]])
        return Linearised(
            forces=(series.analysis @ forces.T).ravel(),
            by_coefficients=by_coefficients,
            by_level=self.size * (series.analysis @ jacobians[3].T).ravel(),
            by_unknowns=np.einsum("kj,ijs->kis", series.analysis, jacobians[4].reshape(n, N, ns)).reshape(-1, ns),
            polar=np.array([np.hypot(*parts), np.arctan2(parts[1], parts[0])]),
            polar_by_coefficients=to_polar @ by_motion,
            polar_by_level=self.size * to_polar @ (fundamental @ slopes[3].ravel()),
            polar_by_unknowns=to_polar @ (fundamental @ slopes[4].reshape(N, ns)),
        )
