"""Functions of the closed forms that are 0/0 at one point, written so that they and their derivatives are smooth there.

    m(x) = (1 - exp(-x))/x                   the mean of exp(-s) over s from 0 to x
    l(x) = ln(1 + x)/x                       the mean of 1/(1 + s)
    d(x) = (l(x) - 1/(1 + x))/x              the rest of l above its lower bound

Near x = 0 each is replaced by its series.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import casadi as cs

Value = TypeVar("Value", cs.MX, cs.SX, cs.DM)

SERIES_BELOW = 0.02  # |x| below which a series replaces the closed form
TERMS = 10  # 0.02^10 is 1e-17
MEAN_DECAY = [1.0]
for _k in range(2, TERMS + 1):
    MEAN_DECAY.append(-MEAN_DECAY[-1] / _k)
LOG_RATIO = [(-1) ** k / (k + 1) for k in range(TERMS)]
LOG_DEFECT = [(-1) ** k * (k + 1) / (k + 2) for k in range(TERMS)]


def mean_decay(x: Value) -> Value:
    """Return (1 - exp(-x))/x; 1 at x = 0."""
    near, away = _apart(x)
    return cs.if_else(near, polynomial(MEAN_DECAY, x), -cs.expm1(-away) / away)


def log_ratio(x: Value) -> Value:
    """Return ln(1 + x)/x for x > -1; 1 at x = 0."""
    near, away = _apart(x)
    return cs.if_else(near, polynomial(LOG_RATIO, x), cs.log1p(away) / away)


def log_defect(x: Value) -> Value:
    """Return (ln(1 + x)/x - 1/(1 + x))/x for x > -1; 1/2 at x = 0."""
    near, away = _apart(x)
    return cs.if_else(near, polynomial(LOG_DEFECT, x), (cs.log1p(away) / away - 1 / (1 + away)) / away)


def stopping(value: Value, band: Value) -> Value:
    """Return a falling value while above a band, 0 below the negative of the band, and a smooth transition between."""
    ratio = cs.fmin(cs.fmax(value / band, -1), 1)
    return cs.if_else(value > band, value, band * (3 - ratio) * (ratio + 1) ** 3 / 16)


def polynomial(coefficients: Sequence[float], x: Value) -> Value:
    """Return the polynomial with the given coefficients, that of the lowest power first."""
    value = 0 * x
    for coefficient in reversed(coefficients):
        value = coefficient + x * value
    return value


def _apart(x: Value) -> tuple[Value, Value]:
    """Return a mask of x near 0, and x with 1 in those places, which keeps the closed form and derivatives finite."""
    near = cs.fabs(x) < SERIES_BELOW
    return near, cs.if_else(near, 1, x)
