"""Refinement of all modal parameters by weighted least squares.

Frequencies and damping ratios x are fitted with the residuals and derivatives of ``modal_sum``.  Real and imaginary
parts are series of residuals in the order of the frequencies.

The covariance of x is that of ``ancf_casadi.estimation``, which allows for noise that is coloured along the frequency.
Its variance is increased from N - n to N - n - F c degrees of freedom, for F functions with c coefficients each.  Noise
that functions share, such as that of the force, makes their residuals r_o, r_p at line k correlate,

    E(r_ko conj(r_kp)) = s^2 rho_kop,    rho_kop = alpha + beta W_ko H_ko conj(W_kp H_kp),

with constants alpha and beta for each pair of functions, which follow from the products of the residuals and count if
they are significant.  The covariance
H S H' of x, with the derivatives J of the residuals and H H' = (J' J)^-1, becomes

    S -> S^1/2 (1 + X) S^1/2,    X = sum_k sum_(o != p) Re(conj(J_ko H)' rho_kop J_kp H),

as far as X increases it.  The coefficients have the covariance of the linear problem plus that due to x.

Weights.  The variance of a measured value at line k of function o is taken as

    v_ko = (A_o + B_o |H_ko|^2) g_k,

with the fitted H, so that chance in a measured value does not change its own weight.  A is the noise of the response
sensor over a constant force, B that of the force and of all errors proportional to H, and g changes slowly with the
frequency, as the force does; near an antiresonance, A dominates and the relative error grows.  A and B are those of
greatest likelihood, which minimise sum (ln v + |r|^2/v).  g is the mean over neighbouring lines and all functions, and
1 unless these means differ by more than chance.  Residuals r are enlarged by 1/(1 - h)^1/2 for the share h of a value
that the fit follows (leverage).

If the functions were estimated from K blocks, of which K_e are independent, with deviations e_j from their mean, the
estimates of the blocks differ to first order by d_j = (J' J)^-1 J' W e_j, and the covariance of x is

    sum_j d_j d_j'/(K (K_e - 1)),

with K_e - 1 degrees of freedom.  It needs no assumption on the noise along the frequency.  Leakage, which correlates
successive blocks otherwise than noise does, is removed before (``leakage``).

If the coherence gamma^2 is measured, the variance is proportional to |H|^2 (1 - gamma^2)/gamma^2.

References
----------
J. S. Bendat, A. G. Piersol, Random Data: Analysis and Measurement Procedures, Wiley (2010), Chapter 9.
M. Davidian, R. J. Carroll, Variance function estimation, Journal of the American Statistical Association 82 (1987).
"""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as cs
import numpy as np
from scipy.special import chdtri

from ancf_casadi.estimation.fit import Fit, SolverSettings
from ancf_casadi.estimation.noise.proportional import proportional_variance
from ancf_casadi.estimation.noise.series import MOST_CONCENTRATION, concentration
from ancf_casadi.estimation.noise.stated import AssumedNoise
from ancf_casadi.estimation.solver.least_squares import least_squares
from ancf_casadi.estimation.solver.unknown import Unknown
from ancf_casadi.support.arrays import Array, ComplexArray
from ancf_casadi.support.callbacks import Differentiable, callback_function
from ancf_casadi.support.tall import tall_qr
from problems.decay.limitations import IMPRECISE, MAX_ORDER
from problems.frf.modal_sum import LARGEST_RATIO, RESIDUAL_POWERS, TrialFit, stack_parts
from problems.frf.record import BlockScatter, FrfRecord, least_std, moving_mean
from problems.frf.window import BlockWindow

FRF_ADVICE = "give approximate frequencies, ask for fewer modes, or choose a band"
LEAST_REMAINDER = 0.05  # least 1 - h
SIGNIFICANT_SHARE = 8.0  # least squared size of alpha and beta, in their standard errors; 1 in 3000 by chance
FEWEST_LINES = 3.0  # least number of lines in the half-power bandwidth
FEWEST_MODELLED_LINES = 0.3  # the same, if the window of the blocks is modelled
LARGEST_REMAINDER = 0.02  # of a vibration at the end of a block, relative to its begin
TIMES_PER_LINE = 4  # instants of a sum over time
COHERENCE_LINES = 4  # lines on either side over which a variance from the coherence is averaged
SLOW_VALUES = 100  # complex values in each mean of g, times their relative variance
CHANCE = 1e-4  # probability below which differences of the means in g are not due to chance
HARMONIC_DISTANCE = 3e-3  # largest relative distance of a harmonic from a multiple of the frequency of a mode


def refine(start: TrialFit) -> tuple[TrialFit, Fit]:
    """Refine the modes of a start; return them, and the fit of their frequencies and damping ratios in turn."""
    unknowns, numbers = [], zip(start.bounded.tolist(), start.scales.tolist(), strict=True)
    for mode in range(1, len(start.frequencies) + 1):
        unknowns.append(Unknown(f"frequency_{mode}", *next(numbers), lower=0.0, unit="Hz"))
        unknowns.append(Unknown(f"damping_ratio_{mode}", *next(numbers), lower=0.0, upper=LARGEST_RATIO))

    def project_residuals(x: Array) -> tuple[Array, Array]:
        trial = start.with_modes(x)
        return trial.weighted_residuals, trial.jacobian

    residuals = callback_function(Differentiable(project_residuals, 2 * start.values.size, len(unknowns)), "projected")
    series, times = start.series
    fit = least_squares(
        lambda *x: residuals(cs.vertcat(*x)),
        unknowns,
        noise=AssumedNoise(series, times),
        settings=SolverSettings(closed_form=False, advice=FRF_ADVICE),
    )
    return start.with_modes(fit.values), fit


def inflation(trial: TrialFit, fit: Fit) -> float:
    """Return the factor of the variances that allows for the fitted coefficients."""
    samples = 2 * trial.values.size
    return (samples - len(fit.names)) / (samples - trial.parameters)


def correct_covariance(trial: TrialFit, fit: Fit, scatter: BlockScatter | None = None) -> Fit:
    """Correct the covariance of a fit for the fitted coefficients and for noise that functions share.

    If the scatter of blocks is known, the covariance is that of the estimates which they give to first order.
    """
    free = ~fit.active_bounds
    if scatter is not None and free.any():
        covariance = np.zeros_like(fit.covariance)
        covariance[np.ix_(free, free)] = _block_covariance(trial, fit.jacobian[:, free], scatter)
        return replace(fit, covariance=covariance, noise=replace(fit.noise, freedom=scatter.averages - 1))
    covariance = inflation(trial, fit) * fit.covariance
    if trial.model.window is not None and trial.model.window.rate:
        windowed = _windowed_covariance(trial, fit.jacobian[:, free], trial.model.window)
        covariance[np.ix_(free, free)] = inflation(trial, fit) * fit.noise.variance * windowed
    if trial.values.shape[1] > 1 and free.any() and fit.residual_rms > 0.0:
        q, triangle = tall_qr(fit.jacobian[:, free] * fit.scale[free])
        scaled = triangle / fit.scale[free]
        power = scaled @ covariance[np.ix_(free, free)] @ scaled.T
        inverse = np.linalg.inv(scaled)
        eigenvalues, vectors = np.linalg.eigh((power + power.T) / 2)
        root = (vectors * np.sqrt(np.maximum(eigenvalues, 0.0))) @ vectors.T
        larger = root @ (np.eye(len(root)) + _shared_noise(trial, q)) @ root
        covariance[np.ix_(free, free)] = inverse @ larger @ inverse.T
    return replace(fit, covariance=covariance)


def _block_covariance(trial: TrialFit, jacobian: Array, scatter: BlockScatter) -> Array:
    """Return the covariance of the estimates from those of the blocks to first order, for derivatives (N, n)."""
    weighted = scatter.deviations * trial.weights.T
    rows = np.concatenate([weighted.real, weighted.imag], axis=2).reshape(len(weighted), -1)
    changes = np.linalg.lstsq(jacobian, rows.T)[0]
    return np.asarray(changes @ changes.T / len(weighted) / (scatter.averages - 1))


def _windowed_covariance(trial: TrialFit, jacobian: Array, window: BlockWindow) -> Array:
    """Return the covariance of the estimates for white noise under an exponential window, and residuals of variance 1.

    With the weights q of the residuals in an estimate, it changes by Re sum_k q_k e_k.  The noise e_k is the transform
    of noise over time with the variance exp(-2 a t), and so the variance is a sum over time.
    """
    k, count = trial.values.shape
    inverse = np.linalg.pinv(jacobian).reshape(-1, count, 2, k)
    time = window.duration * np.arange(TIMES_PER_LINE * k) / (TIMES_PER_LINE * k)
    over_time = np.fft.fft(inverse[:, :, 0] - 1j * inverse[:, :, 1], len(time))
    over_time = (over_time * np.exp(-2j * np.pi * trial.model.frequencies[0] * time)).real
    power = np.exp(-2 * window.rate * time)
    return np.asarray(2 * np.einsum("aft,bft,t->ab", over_time, over_time, power / power.sum()))


def _shared_noise(trial: TrialFit, basis: Array) -> Array:
    """Return X, as far as it is positive, for an orthonormal basis of the columns of J (N, n)."""
    k, count = trial.values.shape
    residuals = trial.weights * trial.residuals / np.sqrt(np.maximum(1 - trial.leverage, LEAST_REMAINDER))
    fitted = trial.weights * trial.fitted
    level = float(np.mean(np.abs(residuals) ** 2))
    blocks = basis.reshape(count, 2, k, -1)
    columns = blocks[:, 0] + 1j * blocks[:, 1]
    x = np.zeros((basis.shape[1], basis.shape[1]))
    for first in range(count):
        for second in range(first):
            product = residuals[:, first] * residuals[:, second].conj() / level
            relative = fitted[:, first] * fitted[:, second].conj()
            q = np.linalg.qr(np.column_stack([np.ones(k), relative / np.linalg.norm(relative)]))[0]
            share = q.conj().T @ product
            share[np.abs(share) ** 2 < SIGNIFICANT_SHARE] = 0.0
            if share.any():
                x += 2 * ((columns[first].conj() * (q @ share)[:, None]).T @ columns[second]).real
    eigenvalues, vectors = np.linalg.eigh((x + x.T) / 2)
    return np.asarray((vectors * np.maximum(eigenvalues, 0.0)) @ vectors.T)


def coefficient_covariance(trial: TrialFit, fit: Fit, function: int) -> Array:
    """Return the covariance of the coefficients of a function, numbered from 0, (c, c), by a corrected fit."""
    (q, triangle), k = trial.factors[function], len(trial.values)
    rows = slice(2 * k * function, 2 * k * (function + 1))
    scatter = fit.noise.variance * np.eye(len(triangle))
    if fit.noise.spectra:
        padded = np.zeros((len(fit.residuals), q.shape[1]))
        padded[rows] = q
        spectra = [spectrum for spectrum in fit.noise.spectra if rows.start <= spectrum.rows.start < rows.stop]
        scatter = sum((spectrum.form(padded) for spectrum in spectra), 0 * scatter)
    inverse, free = np.linalg.inv(triangle), ~fit.active_bounds
    slopes = trial.model.slopes(trial.frequencies, trial.ratios, trial.coefficients[:, function, None])[0]
    change = -inverse @ (q.T @ stack_parts(trial.weights[:, function, None] * slopes))[:, free]
    shared = change @ fit.covariance[np.ix_(free, free)] @ change.T
    return np.asarray(inflation(trial, fit) * inverse @ scatter @ inverse.T + shared)


def limitations(trial: TrialFit, fit: Fit) -> list[str]:
    """Return the limitations of a fit, one sentence each."""
    f, notes = trial.model.frequencies, []
    for k, (frequency, ζ) in enumerate(zip(trial.frequencies.tolist(), trial.ratios.tolist(), strict=True), start=1):
        width = 2 * ζ * frequency
        place = int(np.clip(np.searchsorted(f, frequency), 1, len(f) - 1))
        spacing = float(f[place] - f[place - 1])
        window = trial.model.window
        is_modelled = window is not None and (window.leakage or not window.hann)
        if width < (FEWEST_MODELLED_LINES if is_modelled else FEWEST_LINES) * spacing:
            notes.append(
                f"mode {k}: its half-power bandwidth of {width:.3g} Hz holds few frequencies, which are {spacing:.3g} "
                "Hz apart; leakage in the measurement may add to the damping, and a finer resolution would show it"
            )
        if window is not None and not window.hann:
            remainder = math.exp(-(window.rate + math.pi * width) * window.duration)
            if remainder > LARGEST_REMAINDER:
                notes.append(
                    f"mode {k}: {100 * remainder:.2g} % of its vibration is left at the end of a block of "
                    f"{window.duration:.3g} s; frequency and damping allow for it, but modal constants are off by as "
                    "much: wait longer between hits"
                )
        if frequency - width / 2 < f[0] or frequency + width / 2 > f[-1]:
            notes.append(f"mode {k}: its resonance at {frequency:.4g} Hz is at the end of the band; widen the band")
        error = fit.standard_errors[f"damping_ratio_{k}"]
        if error > IMPRECISE * ζ:
            notes.append(
                f"mode {k}: the damping ratio has a standard error of {100 * error / ζ:.2g} %; less noise, or a finer "
                "resolution, would help"
            )
    notes += harmonics_notes(trial.frequencies)
    if trial.model.powers == RESIDUAL_POWERS[-1]:
        notes.append(
            "many residual terms are needed: the functions show a mode close to the band, or a mode within it that was "
            "not found; widen the band"
        )
    focus = concentration(fit.residuals, fit.series, fit.times)
    if focus > MOST_CONCENTRATION:
        notes.append(
            f"the residuals are not noise: their power is concentrated {focus:.2g} times as much; a mode may be "
            "missing, the motion may be nonlinear, or there may be leakage; the errors allow for this in part only"
        )
    return notes


def harmonics_notes(frequencies: Array) -> list[str]:
    """Return a note for each mode that has others at multiples of its frequency; frequencies ascend."""
    notes, listed = [], set[int]()
    for k, base in enumerate(frequencies.tolist()):
        orders = np.round(frequencies / base)
        is_multiple = np.abs(frequencies / (np.maximum(orders, 1.0) * base) - 1.0) < HARMONIC_DISTANCE
        multiples = [
            j for j in np.flatnonzero(is_multiple & (orders > 1.0) & (orders <= MAX_ORDER)).tolist() if j not in listed
        ]
        if k in listed or not multiples:
            continue
        listed.update(multiples)
        places = ", ".join(f"{frequencies[j]:.4g} Hz (mode {j + 1}, {orders[j]:.0f} times)" for j in multiples)
        notes.append(
            f"multiples of the {base:.4g} Hz of mode {k + 1} are listed as modes: {places}; they may be harmonics of "
            "its nonlinear motion, which fall faster than modes at a smaller level"
        )
    return notes


def stated_deviations(record: FrfRecord) -> Array:
    """Return the standard deviations (k, F) that a record states, up to a common factor; else those for a first fit."""
    if record.std is not None:
        return record.std.reshape(-1, len(record.frequencies)).T
    if record.coherence is None:
        return first_deviations(record.columns)
    coherence = np.clip(record.coherence, 1e-6, 1.0)
    variance = np.abs(record.values) ** 2 * (1 - coherence) / coherence
    smooth = np.sqrt(moving_mean(variance, COHERENCE_LINES)).reshape(-1, len(record.frequencies)).T
    floor = np.median(smooth, axis=0)
    return np.asarray(np.maximum(smooth, 1e-3 * np.where(floor > 0.0, floor, 1.0)))


def first_deviations(values: ComplexArray) -> Array:
    """Return standard deviations (k, F) for the first fit, one per function, from its second differences."""
    differences = np.abs(np.diff(values, n=2, axis=0)) ** 2
    variance = np.median(differences, axis=0) / (6 * math.log(2))
    level = np.maximum(np.sqrt(variance), least_std(values, axis=0))
    return np.tile(np.maximum(level, np.finfo(float).tiny), (len(values), 1))


def fitted_deviations(residuals: ComplexArray, amplitude: Array, leverage: Array) -> Array:
    """Return the standard deviations that residuals, absolute values and leverage of a fit show, all (k, F)."""
    squares = np.abs(residuals) ** 2 / np.maximum(1 - leverage, LEAST_REMAINDER)
    floor = np.maximum(least_std(amplitude, axis=0) ** 2, np.finfo(float).tiny)
    variance = np.column_stack([*map(proportional_variance, squares.T, amplitude.T**2)])
    variance = np.maximum(variance, floor)
    variance = variance * _slow_factor(np.mean(squares / variance, axis=1))[:, None]
    return np.sqrt(np.maximum(variance, floor))


def _slow_factor(ratio: Array) -> Array:
    """Return g (k,) from the mean ratio of squared residuals to variances over all functions."""
    scatter = float(np.var(ratio / ratio.mean())) if ratio.any() else 0.0
    if not scatter:
        return np.ones(len(ratio))
    half = max(math.ceil(SLOW_VALUES * min(scatter, 1.0) / 2), 3)
    blocks = len(ratio) // (2 * half + 1)
    if blocks < 2:
        return np.ones(len(ratio))
    means = np.array([block.mean() for block in np.array_split(ratio, blocks)])
    excess = float(np.sum((means / ratio.mean() - 1) ** 2)) * len(ratio) / blocks / scatter
    return moving_mean(ratio, half) if excess > chdtri(blocks - 1, CHANCE) else np.ones(len(ratio))
