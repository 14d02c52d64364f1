"""Smooth functions of the amplitude without a law, for the frequency and for the damping ratio.

A quantity g with the value g_2 at the amplitude A_2 is

    g(A) = g_2 (1 + sum_j c_j (s_j(A) - s_j(A_2))),    s_j = A^2/(A^2 + C_j^2),

with steps s_j evenly in ln A from 1.5 R to R/S.  R is an amplitude of reference, and S the span of the amplitudes, the
largest over the smallest.  The unknowns are the relative changes at A_k = R S^(-k/6), k = 0 to 6.  Steps less than 2
apart in ln A add up without ripples: six follow a logarithm over three decades to 0.5 % of its change.

The differences between neighbouring A_k have a normal prior with mean 0.  Its standard deviation begins with a first
value, becomes the one that the differences show, and is no less than a least value, below which a change that the
record does not show would count as none.  It matters where the record ends in noise, which g would follow, and between
the amplitudes of response curves, where g would swing.

The slow flow A' = -zeta(A) omega A has no closed form under a smooth damping ratio.  ``flow_amplitude`` integrates ln A
by the classical Runge-Kutta method in steps that end at T, T/2, T/4, ... and between, and interpolates by the cubic
polynomials through values and slopes, to about 1e-6 of the amplitude.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as cs
import numpy as np

from ancf_casadi.support.arrays import Array

NODES = 7
MIDDLE = 2  # A_2 is within the record, where it determines frequency and damping ratio best
AMPLITUDE_SPAN = 50.0  # S, if the amplitudes are not known
# of the integration, and steps in a panel (test_the_flow_of_a_damping_ratio_without_a_closed_form)
PANELS, STEPS = 8, 12


@dataclass(frozen=True)
class SmoothTerms:
    """The unknowns of a smooth function, and the standard deviation of the prior of their differences."""

    names: tuple[str, ...]
    first_deviation: float
    least_deviation: float


def _names(quantity: str) -> tuple[str, ...]:
    return tuple(f"{quantity}_at_{k}" for k in range(NODES) if k != MIDDLE)


# (test_a_prior_holds_a_smooth_frequency_where_noise_hides_it,
# test_the_bands_of_a_smooth_frequency_hold_what_a_short_record_hides)
SMOOTH_FREQUENCY = SmoothTerms(_names("frequency"), 0.02, 0.0025)
SMOOTH_DAMPING = SmoothTerms(_names("damping_ratio"), 0.5, 0.1)


def smooth_change(amplitude: cs.MX, terms: Sequence[cs.MX], reference: float, span: float) -> cs.MX:
    """Return the relative change of a smooth function at amplitudes (m,), from its value at A_2."""
    square = (amplitude / reference) ** 2
    nodes, steps = smooth_nodes(1.0, span) ** 2, np.geomspace(1.5, 1 / span, len(terms)) ** 2
    values = nodes[:, None] / (nodes[:, None] + steps)
    middle = values[MIDDLE]
    heights = np.linalg.inv(np.delete(values - middle, MIDDLE, axis=0))
    shape = [square / (square + step) - at for step, at in zip(steps.tolist(), middle.tolist(), strict=True)]
    return cs.mtimes([cs.horzcat(*shape), cs.DM(heights), cs.vertcat(*terms)])


def smooth_steps(terms: Sequence[cs.MX]) -> cs.MX:
    """Return the differences of a smooth function between its neighbouring nodes, (6,)."""
    values = cs.vertcat(*terms[:MIDDLE], 0.0, *terms[MIDDLE:])
    return values[1:] - values[:-1]


def smooth_nodes(reference: float, span: float) -> Array:
    """Return the amplitudes (7,), m, at which a smooth function has its unknowns, from that of reference on."""
    return np.asarray(reference * span ** (-np.arange(NODES) / (NODES - 1)))


def flow_amplitude(
    ratio: Callable[[cs.MX, cs.MX], cs.MX], time: Array, e0: cs.MX, ω: cs.MX, terms: Sequence[cs.MX]
) -> cs.MX:
    """Return the amplitude (m,) at times (s) after the release, where it is e0.

    The damping ratio is a function of the amplitude and of terms (n,), by which the result can be differentiated.
    """
    steps, values, slopes = _interpolation(np.ascontiguousarray(time, dtype=float).tobytes())
    level, step, x = cs.MX.sym("level"), cs.MX.sym("step"), cs.MX.sym("x", 1 + len(terms))

    def rate(level: cs.MX) -> cs.MX:
        return -x[0] * ratio(cs.exp(level), x[1:])

    k1 = rate(level)
    k2 = rate(level + step / 2 * k1)
    k3 = rate(level + step / 2 * k2)
    k4 = rate(level + step * k3)
    next_level = level + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    runge_kutta_step = cs.Function("step", [level, step, x], [next_level, k1]).expand()
    count = steps.numel() + 1  # the last step has no length, and gives the slope at the end
    unknowns = cs.vertcat(ω, *terms)
    levels, rates = runge_kutta_step.mapaccum("flow", count)(
        cs.log(e0), cs.horzcat(steps.T, 0.0), cs.repmat(unknowns, 1, count)
    )
    return cs.exp(cs.mtimes(values, cs.horzcat(cs.log(e0), levels[:-1]).T) + cs.mtimes(slopes, rates.T))


def panel_edges(t: Array, panels: int) -> Array:
    """Return the edges of panels from 0 to the last time T (1 if there is none) that end at T, T/2, T/4, ..."""
    return np.append(0.0, (float(t.max(initial=0.0)) or 1.0) * 0.5 ** np.arange(panels - 1, -1, -1))


@lru_cache(maxsize=4)  # a fit needs those of a record several times
def _interpolation(time: bytes) -> tuple[cs.DM, cs.DM, cs.DM]:
    """Return the steps (n,) of the integration, and the weights of its results for cubic interpolation.

    The weights (m, n + 1) are those of the values and of the slopes at the ends of the steps for times (m,), which come
    as bytes, so that the results can be kept.
    """
    t = np.frombuffer(time)
    edges = panel_edges(t, PANELS)
    grid = np.interp(np.arange(PANELS * STEPS + 1) / STEPS, np.arange(PANELS + 1), edges)
    begin = np.clip(np.searchsorted(grid, t, side="right") - 1, 0, len(grid) - 2)
    steps = np.diff(grid)
    h, s = steps[begin], (t - grid[begin]) / steps[begin]
    places = np.tile(np.arange(len(t)), 2).tolist(), np.concatenate([begin, begin + 1]).tolist()
    rise = s**2 * (3 - 2 * s)  # Hermite's polynomials of the position s in a step
    pairs = (1 - rise, rise), (h * s * (1 - s) ** 2, -h * s**2 * (1 - s))
    values, slopes = (cs.DM.triplet(*places, cs.DM(np.concatenate(pair)), len(t), len(grid)) for pair in pairs)
    return cs.DM(steps), values, slopes
