"""Effect of the window of the blocks on frequency response functions that were estimated from time records.

Exponential window.  The factor exp(-a t) on force and response shifts the Laplace variable: the functions are those at
s = a + i omega, exactly.

Ends of a block.  A free vibration that is left from an earlier hit, or cut off at the end, adds to the spectrum at the
lines n/T of a block of T seconds the same poles with other residues.  After the division by the spectrum of a short
force near the begin of the block, which is smooth, poles and damping stay.  Modal constants change, after rest by the
factor 1 - exp((s_k - a) T).

Hann window.  If the power of a random force is even over the width of a line, the mean of the cross-spectrum over
blocks is that of the impulse response times the autocorrelation of the window,

    r(x) = (1 - x) (2/3 + cos(2 pi x)/3) + sin(2 pi x)/(2 pi),    x = tau/T,

so that the resonance 1/(s - s_k) of each pole becomes R(s - s_k) with the Laplace transform R of r (leakage).  With
u = z T, E(u) = (1 - exp(-u))/u and L(u) = (1 - E(u))/u,

    R(z)/T = 2/3 L(u) + (L(u - 2 pi i) + L(u + 2 pi i))/6 + (E(u - 2 pi i) - E(u + 2 pi i))/(4 pi i).

References
----------
J. S. Bendat, A. G. Piersol, Random Data: Analysis and Measurement Procedures, Wiley (2010), Chapters 8 and 11.
R. Pintelon, J. Schoukens, System Identification: A Frequency Domain Approach, Wiley (2012), Chapter 2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.polynomial.polynomial import polyval
from scipy.special import factorial

from ancf_casadi.support.arrays import Array, ComplexArray

SHIFTS = 2j * np.pi * np.array([0, -1, 1])  # of u in R
SERIES_RADIUS = 0.02  # |u| below which E and L follow from their power series
ORDERS = np.arange(1, 9)
E_SERIES = (-1.0) ** np.arange(10) / factorial(np.arange(1, 11))  # coefficients of E, which give those of E', L and L'
MOMENT_SERIES = np.array([E_SERIES[:8], ORDERS * E_SERIES[1:9], -E_SERIES[1:9], -ORDERS * E_SERIES[2:]]).T


def hann_window(size: int) -> Array:
    """Return a Hann window over some samples."""
    return np.asarray(0.5 - 0.5 * np.cos(2 * np.pi * np.arange(size) / size))


@dataclass(frozen=True)
class BlockWindow:
    """Window of the blocks from which functions were estimated."""

    duration: float  # of a block, s
    rate: float = 0.0  # of an exponential window, 1/s
    hann: bool = False  # whether it is a Hann window over random vibration
    estimator: Literal["H1", "H2", "Hv"] = "H1"

    @property
    def leakage(self) -> bool:
        """True if a fit accounts for leakage by R: with a Hann window and the estimator H1."""
        return self.hann and self.estimator == "H1"

    @property
    def noise_factor(self) -> float:
        """Power of white noise under an exponential window as the modes meet it, over that which its parts show.

        The noise, like the vibration, has most power at the begin of a block.  Its real and imaginary parts, each for
        itself, show the mean of the powers at the times t and T - t.
        """
        return 2 / (1 + math.exp(-2 * self.rate * self.duration))

    def resonance(self, z: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Return R and its derivative by z."""
        moments = _moments(np.add.outer(SHIFTS, z * self.duration))
        value, slope = (
            2 / 3 * l[0] + (l[1] + l[2]) / 6 + (e[1] - e[2]) / (4j * np.pi) for e, l in (moments[::2], moments[1::2])
        )
        return self.duration * value, self.duration**2 * slope


def _moments(u: ComplexArray) -> ComplexArray:
    """Return E, its derivative, L and its derivative; along the first axis, u differs by multiples of 2 pi i."""
    is_small, decay = np.abs(u) < SERIES_RADIUS, np.exp(-u[0])
    inverse = 1 / np.where(is_small, 1.0, u)
    e = (1 - decay) * inverse
    e_slope = (decay - e) * inverse
    l = (1 - e) * inverse
    moments = np.array([e, e_slope, l, -(e_slope + l) * inverse])
    moments[:, is_small] = polyval(u[is_small], MOMENT_SERIES)
    return moments
