"""Allowance for a law that does not hold over the whole record: estimates that move if the record begins later.

If a law holds, the estimates from two parts of a record differ by noise alone.  Otherwise they scatter as estimates of
two records that do not agree (``agreement``), and so does the estimate from both.  With an orthonormal basis q of the
columns of the Jacobian by the n free unknowns, of which a part has the rows q_1, and its share H = q_1' q_1 of the
information, the scores

    v = (H (I - H))^-1/2 q_1' psi_1

have the covariance q' R q if the law holds, and g = v' (q' R q)^-1 v follows the chi-squared distribution with n
degrees of freedom.  If g is too large, q' R q becomes q' R q + (1 - 1/g) v v', which makes v one standard error in its
own direction: the scatter of two estimates about their weighted mean.  The residuals then count as fewer independent
ones, so that a law which does not hold is not chosen for the little that it explains beyond a simpler one.

References
----------
G. C. Chow, Tests of equality between sets of coefficients in two linear regressions, Econometrica 28 (1960).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy  # its packages are imported on first use

from ancf_casadi.estimation.agreement import DISAGREE
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.solver.loss import influence
from ancf_casadi.support.arrays import Mask

SHARED = 1e-3  # least product of the shares of the information in both parts for a direction to count fully


def allowing_for_later_starts(fit: Fit, late: Sequence[Mask]) -> Fit:
    """Return a fit whose covariance allows for the scatter of its estimates between late parts and the rest."""
    free, (psi, w) = ~fit.active_bounds, influence(fit.residuals, fit.huber)
    if not free.any() or not fit.noise.variance > 0.0:
        return fit
    basis, triangle = np.linalg.qr(fit.jacobian[:, free] * fit.scale[free])
    own = fit.noise.form(basis)
    form = own.copy()
    for mask in late:
        share, axes = np.linalg.eigh(basis[mask].T @ basis[mask])
        v = axes @ ((axes.T @ (basis[mask].T @ psi[mask])) / np.sqrt(np.maximum(share * (1 - share), SHARED)))
        g = float(v @ np.linalg.solve(form, v))
        if scipy.special.chdtrc(len(v), g) < DISAGREE:
            form += (1 - 1 / g) * np.outer(v, v)
    if np.array_equal(form, own):
        return fit
    passing = form - own
    root = fit.scale[free, None] * np.linalg.inv(triangle) / w
    covariance = fit.covariance.copy()
    covariance[np.ix_(free, free)] += root @ passing @ root.T
    if fit.noise.passing is not None and fit.noise.basis is not None:
        turn = basis.T @ fit.noise.basis
        passing = passing + turn @ fit.noise.passing @ turn.T
    growth = float(np.trace(form)) / (len(form) * fit.noise.variance)
    return replace(fit, covariance=covariance, noise=replace(fit.noise, passing=passing, basis=basis, growth=growth))
