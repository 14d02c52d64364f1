"""Coordinates without bounds, for samplers.

    y = z                                                    without bounds,
    y = a + s log(1 + e^z)       or    b - s log(1 + e^z)    with one,
    y = a + s log((1 + e^z)/(1 + e^(z - R))),    R = (b - a)/s    with two,

with s the standard error of y, at most a quarter of b - a.  Within less than s of a bound this is the transformation by
the logarithm; far from bounds it is linear, and leaves a normal distribution as it is.

References
----------
B. Carpenter et al., Stan: A probabilistic programming language, Journal of Statistical Software 76 (2017).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # its packages are imported on first use

from ancf_casadi.support.arrays import Array


@dataclass(frozen=True, eq=False)
class BoundTransformation:
    """Coordinates z without bounds in place of n coordinates y between bounds."""

    lower: Array  # a, (n,); minus infinity without one
    upper: Array  # b, (n,)
    units: Array  # s, (n,)

    @cached_property
    def _sign(self) -> Array:
        """1 where y counts from its lower bound, -1 from its upper one, 0 without bounds, (n,)."""
        return np.where(np.isfinite(self.lower), 1.0, np.where(np.isfinite(self.upper), -1.0, 0.0))

    @cached_property
    def _origin(self) -> Array:
        """The bound that y counts from, or 0, (n,)."""
        return np.select([self._sign > 0.0, self._sign < 0.0], [self.lower, self.upper], 0.0)

    @cached_property
    def _range(self) -> Array:
        """R, (n,)."""
        return (self.upper - self.lower) / self.units

    def bounded(self, z: Array) -> Array:
        """Return y (..., n) at z."""
        with np.errstate(invalid="ignore"):
            distance = np.logaddexp(0.0, z) - np.logaddexp(0.0, z - self._range)
        return np.asarray(np.where(self._sign == 0.0, z, self._origin + self._sign * self.units * distance))

    def unbounded(self, y: Array) -> Array:
        """Return z (..., n) at y."""
        distance = np.where(self._sign == 0.0, 1.0, self._sign * (y - self._origin) / self.units)
        z = distance + np.log1p(-np.exp(-distance)) - np.log1p(-np.exp(distance - self._range))
        return np.asarray(np.where(self._sign == 0.0, y, z))

    def slopes(self, z: Array) -> Array:
        """Return the derivatives dy/dz (n,)."""
        slope = scipy.special.expit(z) * scipy.special.expit(self._range - z) * -np.expm1(-self._range)
        return np.asarray(np.where(self._sign == 0.0, 1.0, self._sign * self.units * slope))

    def log_slope_derivatives(self, z: Array) -> Array:
        """Return the derivatives of log |dy/dz| by z, (n,)."""
        return np.where(self._sign == 0.0, 0.0, scipy.special.expit(-z) - scipy.special.expit(z - self._range))
