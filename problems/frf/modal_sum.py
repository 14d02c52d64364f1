"""Frequency response functions as a sum over modes.

With the undamped natural frequency omega_k and the damping ratio zeta_k of mode k, shared by all functions, each
function is

    H(omega) = (i omega)^d (sum_k (a_k + i omega b_k)/(omega_k^2 - omega^2 + 2 i zeta_k omega_k omega)
                            + sum_p c_p (i omega)^p),

with d = 0 for receptance, 1 for mobility, and 2 for accelerance and transmissibility.  The coefficients are real and
differ from function to function.  The pair a_k, b_k stands for the residue A_k of the pole s_k = -zeta_k omega_k +
i omega_k (1 - zeta_k^2)^1/2 in A_k/(i omega - s_k) + conj(A_k)/(i omega - conj(s_k)): a_k = -2 Re(A_k conj(s_k)), b_k =
2 Re A_k.  The modal constant of mode k is

    C_k = 2 i omega_k (1 - zeta_k^2)^1/2 A_k,

the product of the mass-normalised shape at output and input, phi_o phi_i (1/kg), and real, if the mode is.  The powers
p stand for the modes below the band (p = -2, -1) and above it (0, 1); further powers follow if a mode is close to it.

References
----------
N. M. M. Maia, J. M. M. Silva, Theoretical and Experimental Modal Analysis, Research Studies Press (1997), Chapter 4.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np

from ancf_casadi.support.arrays import Array, ComplexArray

MODAL_SUM_POWERS = {
    "receptance": 0, "mobility": 1, "accelerance": 2, "transmissibility": 2, "relative-transmissibility": 2
}  # fmt: skip
RESIDUAL_POWERS = tuple(
    tuple(range(-size, size)) for size in (2, 4, 6)
)  # of i omega: few, more and many residual terms


@dataclass(frozen=True, eq=False)
class ModalSum:
    """The functions of the coefficients, at given frequencies.

    Parameters
    ----------
    frequencies : array (k,)
        Frequencies, Hz.
    derivatives : int
        The power d.
    powers : tuple of int
        The powers p of the residual terms.
    reference : float
        Angular frequency, rad/s, that makes the powers dimensionless.
    """

    frequencies: Array
    derivatives: int
    powers: tuple[int, ...]
    reference: float

    @classmethod
    def of(cls, frequencies: Array, derivatives: int, powers: tuple[int, ...]) -> ModalSum:
        """Return the model for the frequencies of a record."""
        return cls(frequencies, derivatives, powers, 2 * math.pi * float(np.sqrt(frequencies[0] * frequencies[-1])))

    def modal(self, frequencies: Array, ratios: Array) -> ComplexArray:
        """Return the columns of modes, (k, 2 m): those of a and b of each mode."""
        iω = 2j * np.pi * self.frequencies[:, None]
        ω_k = 2 * np.pi * frequencies
        resonance = iω**self.derivatives / (ω_k**2 + iω**2 + 2 * ratios * ω_k * iω)
        return np.stack([resonance, iω * resonance], axis=2).reshape(len(iω), -1)

    def residual_terms(self) -> ComplexArray:
        """Return the columns of the residual terms, (k, powers)."""
        iω = 2j * np.pi * self.frequencies[:, None]
        return np.asarray(iω**self.derivatives * (iω / self.reference) ** np.array(self.powers))

    def columns(self, frequencies: Array, ratios: Array) -> ComplexArray:
        """Return the columns of all coefficients, (k, 2 m + powers)."""
        return np.hstack([self.modal(frequencies, ratios), self.residual_terms()])

    def slopes(self, frequencies: Array, ratios: Array, coefficients: Array) -> ComplexArray:
        """Return the derivatives of the functions by frequency and damping ratio of each mode in turn, (F, k, 2 m)."""
        iω = 2j * np.pi * self.frequencies[:, None]
        ω_k = 2 * np.pi * frequencies
        square = ω_k**2 + iω**2 + 2 * ratios * ω_k * iω
        by_frequency = -(iω**self.derivatives) * 4 * np.pi * (ω_k + ratios * iω) / square**2
        by_ratio = -(iω**self.derivatives) * 2 * ω_k * iω / square**2
        a, b = coefficients[0 : 2 * len(frequencies) : 2], coefficients[1 : 2 * len(frequencies) : 2]
        sizes = a.T[:, None, :] + iω * b.T[:, None, :]
        return np.stack([sizes * by_frequency, sizes * by_ratio], axis=3).reshape(*sizes.shape[:2], -1)

    def symbolic(self, frequencies: Sequence[cs.MX], ratios: Sequence[cs.MX]) -> cs.MX:
        """Return the columns with real parts above imaginary parts, (2 k, 2 m + powers)."""
        ω = 2 * np.pi * self.frequencies
        factors = [(1j * ω) ** (self.derivatives + power) for power in (0, 1)]
        found = []
        for frequency, ζ in zip(frequencies, ratios, strict=True):
            ω_k = 2 * math.pi * frequency
            real, imaginary = ω_k**2 - cs.DM(ω**2), 2 * ζ * ω_k * cs.DM(ω)
            square = real**2 + imaginary**2
            for factor in factors:  # factor (real - i imaginary)/square
                x, y = cs.DM(factor.real), cs.DM(factor.imag)
                found.append(cs.vertcat((x * real + y * imaginary) / square, (y * real - x * imaginary) / square))
        return cs.horzcat(*found, cs.DM(stacked(self.residual_terms())))

    def constants(self, frequencies: Array, ratios: Array, coefficients: Array) -> ComplexArray:
        """Return the modal constants C (m, F) from the coefficients (2 m + powers, F)."""
        a, b = coefficients[0 : 2 * len(frequencies) : 2], coefficients[1 : 2 * len(frequencies) : 2]
        ω_k = 2 * np.pi * frequencies[:, None]
        ζ = ratios[:, None]
        return np.asarray(a - ζ * ω_k * b + 1j * ω_k * np.sqrt(1 - ζ**2) * b)


def stacked(values: ComplexArray) -> Array:
    """Return real parts above imaginary parts."""
    return np.concatenate([values.real, values.imag])
