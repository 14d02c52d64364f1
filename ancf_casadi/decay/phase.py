"""Phase of a free decay whose frequency depends on the amplitude.

Averaged over a period, the free oscillation r = A cos(theta) of one mode turns at

    theta' = omega (1 + delta(A)),        theta = phi + omega (t + int delta(A) dt),

with the relative change delta of the frequency:

    constant       0
    linear         k A                           joints and clamps: micro-slip, contacts that open
    quadratic      k A^2                         geometry and elasticity: for r'' + omega^2 r + alpha r^3 = 0,
                                                 k = 3 alpha/(8 omega^2)
    power          k (A/R)^q                     a free exponent
    logarithmic    k ln((A + A_s)/(R + A_s))     clamps, joints and fillings over decades of the amplitude; below the
                                                 corner A_s the frequency is linear in A, so that it stays bounded
    smooth         no law: a sum of steps          (``smooth``)

R is an amplitude of reference, which keeps the unknowns apart: omega is the frequency at zero amplitude, at R under the
logarithmic law, and at A_2 without a law.
All is of first order in the damping and in delta: the coefficients of the damping take omega.

The integral is one quadrature for all laws of the amplitude.  The time from 0 to the last instant T is divided into
panels that end at T, T/2, T/4, ..., so that a decay is resolved at any rate up to about 1e4/T.  The integral of the
polynomial through the values at the Gauss points of a panel, expanded in Legendre polynomials, is taken up to each
instant:

    int_-1^x P_n = (P_(n+1)(x) - P_(n-1)(x))/(2 n + 1).

References
----------
A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations, Wiley (1979), Sections 2.3, 3.3.
P. J. Davis, P. Rabinowitz, Methods of Numerical Integration, Academic Press (1984), Section 2.7.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Literal

import casadi as cs
import numpy as np
import scipy  # its packages are imported on first use
from numpy.polynomial import legendre

from ancf_casadi.decay.smooth import AMPLITUDE_SPAN, SMOOTH_FREQUENCY, panel_edges, smooth_change
from ancf_casadi.support.arrays import Array

FrequencyLaw = Literal["constant", "linear", "quadratic", "power", "logarithmic", "smooth"]

FREQUENCY_TERMS: Mapping[FrequencyLaw, tuple[str, ...]] = {  # unknowns: k, then q, or the logarithm of A_s/R
    "constant": (),
    "linear": ("frequency_slope",),
    "quadratic": ("frequency_curvature",),
    "power": ("frequency_change", "frequency_exponent"),
    "logarithmic": ("frequency_log_slope", "log_corner"),
    "smooth": SMOOTH_FREQUENCY.names,
}
PANELS = 15  # of the quadrature
POINTS = 16  # in a panel


def frequency_change(
    law: FrequencyLaw, amplitude: cs.MX, terms: Sequence[cs.MX], reference: float, span: float = AMPLITUDE_SPAN
) -> cs.MX:
    """Return the relative change delta of the frequency at amplitudes (m), given the values of ``FREQUENCY_TERMS``."""
    if law == "constant":
        return 0 * amplitude
    if law == "smooth":
        return smooth_change(amplitude, terms, reference, span)
    k, *shape = terms
    if law == "power":
        return k * cs.fmax(amplitude / reference, 1e-12) ** shape[0]  # whose derivative at 0 is infinite for q < 1
    if law == "logarithmic":
        corner = cs.exp(shape[0])
        return k * cs.log((amplitude / reference + corner) / (1 + corner))
    return k * amplitude ** (1 if law == "linear" else 2)


def integral(function: Callable[[cs.MX], cs.MX], time: Array) -> cs.MX:
    """Return the integrals (m,) of a function, smooth in time, from 0 to times (m,), none negative."""
    points, within, panel, before = _quadrature(time.tobytes())
    values = function(cs.MX(points))
    return cs.mtimes(within, values) + cs.mtimes(before, values)[panel]


@lru_cache(maxsize=4)  # a fit needs those of a record several times
def _quadrature(time: bytes) -> tuple[cs.DM, cs.DM, list[int], cs.DM]:
    """Return the Gauss points of all panels, and what integrates values there up to each of the times (m,).

    That is the weights (m, n) within the panel of each time, the number of this panel, and the weights of all panels
    before a panel.  The times come as bytes, so that the results can be kept.
    """
    t = np.frombuffer(time)
    edges = panel_edges(t, PANELS)
    points, weights = legendre.leggauss(POINTS)
    half = np.diff(edges)[:, None] / 2
    panel = np.maximum(np.searchsorted(edges, t) - 1, 0)
    P = legendre.legvander((t - edges[panel]) / half[panel, 0] - 1, POINTS)
    antiderivative = np.column_stack([P[:, 0] + P[:, 1], (P[:, 2:] - P[:, :-2]) / (2 * np.arange(1, POINTS) + 1)])
    expansion = (np.arange(POINTS)[:, None] + 0.5) * legendre.legvander(points, POINTS - 1).T * weights
    columns = POINTS * panel[:, None] + np.arange(POINTS)
    within = scipy.sparse.csr_array(
        ((half[panel] * (antiderivative @ expansion)).ravel(), columns.ravel(), POINTS * np.arange(len(t) + 1)),
        shape=(len(t), PANELS * POINTS),
    )
    before = np.kron(np.tril(np.ones((PANELS, PANELS)), -1) * half.T, weights)
    return cs.DM((edges[:-1, None] + half * (1 + points)).ravel()), cs.DM(within.tocsc()), panel.tolist(), cs.DM(before)
