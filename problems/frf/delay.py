"""Delay of measured functions beside their modes, as of a trigger or of a filter.

A delay tau multiplies all functions by exp(-i omega tau): their phase falls in proportion to the frequency, which modes
and residual terms imitate badly.  If a fit needs more than the fewest residual terms, or leaves more than noise, delays
on both sides of zero are tried.  With the modes of the fit and the fewest residual terms, the sum of squares of the
delayed values follows from one factorisation; the best of its minima is refined, with all modes.  Complex modal
constants imitate a small delay; of the delays that fit, that with the most real constants is taken.  A delay counts if
the criterion BIC of this fit is clearly below that of the fit without it,

    N ln(S_0/S_1) + (K_0 - K_1 - 1) ln N > 10.

and if it is at least a tenth of the period that belongs to the width of the band.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from ancf_casadi.estimation.noise.series import MOST_CONCENTRATION, concentration
from ancf_casadi.support.arrays import Array, ComplexArray
from ancf_casadi.support.tall import inner
from problems.frf.modal_sum import RESIDUAL_POWERS, TrialFit, quick_fit, stack_parts
from problems.frf.selection import VERY_STRONG

DELAY_GRID = np.arange(-80, 81)  # delays in tenths of a period of the band


def remove_delay(values: ComplexArray, frequencies: Array, delay: float) -> ComplexArray:
    """Remove a delay, s, from functions (..., k) at frequencies, Hz."""
    return np.asarray(values * np.exp(2j * np.pi * frequencies * delay))


def remaining_delay(fit: TrialFit, *, required: bool = False) -> float:
    """Return the delay, s, that explains the functions of a fit clearly better than its residual terms do; 0 if none.

    Unless a delay is ``required``, a fit with the fewest residual terms and residuals like noise has none.
    """
    lines = fit.model.frequencies
    like_noise = concentration(fit.weighted_residuals, *fit.series) <= MOST_CONCENTRATION
    if like_noise and fit.model.powers == RESIDUAL_POWERS[0] and not required:
        return 0.0
    undelayed_squares = _squares(fit)
    fewest = replace(fit, model=replace(fit.model, powers=RESIDUAL_POWERS[0]))

    def fit_without(delay: float) -> TrialFit | None:
        return quick_fit(replace(fewest, values=remove_delay(fewest.values.T, lines, delay).T))

    def cost(delay: float) -> float:
        trial = fit_without(delay)
        return undelayed_squares if trial is None else _squares(trial)

    step = 0.1 / float(lines[-1] - lines[0])
    squares = _projected_squares(fewest, np.array(step * DELAY_GRID, dtype=float))
    minima = 1 + np.flatnonzero((squares[1:-1] <= squares[:-2]) & (squares[1:-1] <= squares[2:]))
    if not len(minima):
        return 0.0
    start = step * float(DELAY_GRID[minima[np.argmin(squares[minima])]])
    delay = float(minimize_scalar(cost, bounds=(start - step, start + step), method="bounded").x)
    trial = fit_without(delay)
    if trial is not None:
        delay += _phase_delay(trial, 3 * step)
        trial = fit_without(delay)
    if trial is None or (abs(delay) < step and not required):  # so small a delay may be that of any misfit
        return 0.0
    samples = 2 * fit.values.size
    gain = samples * math.log(undelayed_squares / _squares(trial))
    gain += (fit.parameters - trial.parameters - 1) * math.log(samples)
    return delay if gain > VERY_STRONG else 0.0


def _squares(fit: TrialFit) -> float:
    """Return the weighted sum of squares of the residuals, above 0."""
    return max(float(fit.weighted_residuals @ fit.weighted_residuals), np.finfo(float).tiny)


def _phase_delay(fit: TrialFit, largest: float) -> float:
    """Return the delay, s, up to a largest one, whose removal makes the modal constants of a fit the most real."""
    constants = fit.model.constants(fit.frequencies, fit.ratios, fit.coefficients)
    sizes = np.linalg.norm(constants, axis=1)[:, None]
    turns = 2j * np.pi * (fit.frequencies * np.sqrt(1 - fit.ratios**2))[:, None]
    optimum = minimize_scalar(
        lambda delay: np.sum((constants / sizes * np.exp(turns * delay)).imag ** 2),
        bounds=(-largest, largest),
        method="bounded",
    )
    return float(optimum.x)


def _projected_squares(fit: TrialFit, delays: Array) -> Array:
    """Return the sums of squares of the residuals for delays (d,), with the modes of a fit."""
    squares, phase_factors = np.zeros(len(delays)), np.exp(2j * np.pi * fit.model.frequencies[:, None] * delays)
    for (q, _), weight, values in zip(fit.factors, fit.weights.T, fit.values.T, strict=True):
        delayed_values = stack_parts((weight * values)[:, None] * phase_factors)
        squares += np.sum(delayed_values**2, axis=0) - np.sum(inner(q, delayed_values) ** 2, axis=0)
    return squares
