"""Error of an oscillation that was rounded to steps, such as those of a converter or of pixels.

Rounding adds the sawtooth sum_n (-1)^n/(pi n) sin(2 pi n x) to values x in steps.  Of x = d + a cos(theta)
with a slow amplitude, the means over a period change amplitude and rest position by

    sum_n 2 (-1)^n/(pi n) J1(2 pi n a) cos(2 pi n d),    sum_n (-1)^n/(pi n) J0(2 pi n a) sin(2 pi n d),

which do not average out, since they vary with the amplitude alone.  For n = 1, both Bessel functions are cosines of
2 pi a over pi a^1/2; further terms add a tenth.  A fit follows such errors, so that its residuals do not show them.
Noise of the standard deviation s, in steps, multiplies the terms by exp(-2 pi^2 n^2 s^2).

References
----------
B. Widrow, I. Kollar, Quantization Noise, Cambridge University Press (2008).
"""

from __future__ import annotations

import math

import numpy as np

from ancf_casadi.support.arrays import Array

LARGEST = 2.2 / math.pi**2  # error of the amplitude times a^1/2, in steps; that of the rest position is half of it


def rounding_errors(amplitude: Array, cosine: Array, step: float, residual_rms: float) -> Array:
    """Return curves (m, 4) whose independent normal multiples are the errors of rounding in m values.

    The values have the amplitudes (m,) and the cosines (m,) of their phases; the amplitudes, the step and the root mean
    square of the residuals have one unit.  The phases of the errors count as unknown.
    """
    a = np.maximum(amplitude / step, 1e-3)
    noise = max((residual_rms / step) ** 2 - 1 / 12, 0.0)
    size = step * LARGEST * math.exp(-2 * math.pi**2 * noise) / np.sqrt(2 * a)
    waves = size[:, None] * np.column_stack([np.cos(2 * math.pi * a), np.sin(2 * math.pi * a)])
    return np.hstack([waves * cosine[:, None], waves / 2])
