"""Choice of the modes that frequency response functions show.

Candidates of poles are those of the least-squares complex frequency-domain method (LSCF) of sdypy-EMA.  The method fits
a common-denominator model in discrete time to equally spaced lines; its order grows step by step, as in a stability
chart.  All poles of all orders are candidates.

The choice begins with the poles that recur in the chart, and with many residual terms, so that no mode has to stand for
those out of the band.  Modes that the functions do not need are removed one by one, the least important first, and
second poles of modes; then candidates are added, those first whose columns explain most of the residuals; at last,
residual terms that are not needed are removed.  After each change all parameters are refined.  The larger of two fits
is needed if

    n/N (S_1 - S_2)/s^2 > (K_2 - K_1) ln n + 10,

with the weights (``refinement``) by its residuals and the larger amplitude of the two, the sums of squares
S_1 of the smaller and S_2 of the larger fit, K parameters, and s^2 = S_2/(N - K_2): a clear difference of BIC.  The N
residuals are worth n independent ones (``TrialFit.effective_samples``).  Modes out of the band, narrower than the lines
can show, overdamped or equal are dropped.

A nonlinear motion or leakage deforms a resonance, and a second pole imitates this.  Two poles closer than the mean of
their half-power bandwidths would not beat in a decay.  They are one mode, unless several functions prove two: their
modal constants differ in more than a factor (modal assurance criterion).  A candidate that turns out to be a second
pole leaves with all others within the bandwidth of its mode.

References
----------
Y. C. Pati, R. Rezaiifar, P. S. Krishnaprasad, Orthogonal matching pursuit, 27th Asilomar Conference on Signals, Systems
and Computers (1993).
G. Schwarz, Estimating the dimension of a model, Annals of Statistics 6 (1978).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ancf_casadi.exceptions import FitError
from ancf_casadi.support.arrays import Array, ComplexArray, Index, Mask
from ancf_casadi.support.optional import library
from ancf_casadi.support.tall import inner, tall_qr, tall_times, tall_triangle
from problems.frf.modal_sum import RESIDUAL_POWERS, ModalSum, TrialFit, quick_fit, stack_parts
from problems.frf.record import FrfRecord
from problems.frf.refinement import fitted_deviations, stated_deviations

VERY_STRONG = 10.0  # difference of BIC that is very strong evidence
RATIO_RANGE = (1e-5, 0.6)  # least and largest damping ratio of a candidate
RATIO_GRID = (3e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1, 0.25)  # damping ratios to try at a given frequency
POLE_WIDTHS, POLE_DISTANCE = 0.3, 2e-3  # distance of equal poles, relative to their half-width, and to their frequency
LEAST_ORDERS, LEAST_ORDER_SHARE = 4, 0.25  # orders at which a recurring pole occurs, and their share of all orders
LEAST_BANDWIDTH = 0.1  # half-power bandwidth of a mode, in distances of lines
LARGEST_MODE_RATIO = 0.5  # damping ratio beyond which a pole is no mode
EQUAL_POLES = 0.2  # distance of two poles, in half-power half-widths, below which they are one mode
TRIED_CANDIDATES = 3  # candidates that are tried before the modes count as complete
MODULE = "sdypy.EMA"
MOST_FRF_MODES = 20
TRIAL_TOLERANCE = 1e-6  # of trial fits, relative; a mode that is needed changes the sum of squares by 1e-3 and more
# Tests that fail if these are changed to 0.75 or 0.99, or to 3.5 or 10:
# test_two_poles_within_a_bandwidth_are_two_modes_if_their_shapes_differ,
# test_bins_are_few_and_lose_three_percent_of_the_precision_at_most.
SAME_SHAPE = 0.9  # modal assurance criterion of two close poles, above which their modal constants are proportional
LINES_PER_BANDWIDTH = 5.0  # half-power bandwidth, in bins


@dataclass(frozen=True, eq=False)
class Candidates:
    """Poles that may be modes."""

    frequencies: Array  # natural frequencies, Hz, (c,)
    ratios: Array  # damping ratios, (c,)
    recurring: Index  # indices of the modes that recur in the chart, most often first


@dataclass(frozen=True, eq=False)
class StabilityChart(Candidates):
    """Poles of models of all orders, by frequency and order."""

    orders: Index  # of the model with each pole: its number of pairs of poles, (c,)
    is_stable: Mask  # whether a pole recurs at other orders, (c,)

    def matches(self, pole: int, frequencies: Sequence[float]) -> Mask:
        """Return which natural frequencies, Hz, are that of a pole, given by its index."""
        f, ζ = float(self.frequencies[pole]), float(self.ratios[pole])
        return np.asarray(np.abs(np.array(frequencies) - f) < f * (POLE_WIDTHS * ζ + POLE_DISTANCE))


def stability_chart(record: FrfRecord) -> StabilityChart:
    """Return the poles from which ``fit_frf`` chooses the modes of a record.

    Raises
    ------
    InputError
        If sdypy-EMA is missing.
    FitError
        If there is no pole in the band.

    Examples
    --------
    >>> import numpy as np
    >>> from problems import FrfRecord
    >>> from problems.frf.selection import stability_chart
    >>> f, rng = np.linspace(1.0, 3.0, 401), np.random.default_rng(0)
    >>> values = 1.0 / (2.0**2 - f**2 + 0.04j * f) + rng.normal(0.0, 0.05, (2, 401)).T @ [1, 1j]
    >>> chart = stability_chart(FrfRecord(f, values, "receptance"))
    >>> print(f"{np.median(chart.frequencies[chart.is_stable]):.2f} Hz")
    2.00 Hz
    """
    deviations = np.sqrt(np.median(stated_deviations(record) ** 2, axis=0))
    return candidate_poles(
        record.frequencies, record.columns / deviations, record.window.rate if record.window else 0.0
    )


def candidate_poles(frequencies: Array, values: ComplexArray, window_rate: float = 0.0) -> StabilityChart:
    """Find the poles of all orders in the band, and those that recur, without the damping of an exponential window."""
    ema = library(MODULE, "finds the poles", "sdypy-EMA, or give approximate frequencies", "sdypy-EMA")
    f, rows = _interpolate_lines(frequencies, values.T)
    order = max(2, min(40, len(f) // 3))  # at least three lines per order
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            model = ema.Model(rows, f, lower=f[0], upper=2 * f[-1], pol_order_high=order)
            model.get_poles(method="lscf", show_progress=False)
        except np.linalg.LinAlgError:
            raise FitError("sdypy-EMA finds no poles; give approximate frequencies") from None
    f_k, ζ = np.concatenate(model.pole_freq).astype(float), np.concatenate(model.pole_xi).astype(float)
    if window_rate:
        poles = 2 * np.pi * f_k * (-ζ + 1j * np.sqrt(np.maximum(1 - ζ**2, 0.0))) + window_rate
        f_k, ζ = np.abs(poles) / (2 * np.pi), np.maximum(-poles.real / np.abs(poles), 2 * RATIO_RANGE[0])
    orders = np.repeat(1 + np.arange(len(model.pole_freq)), list(map(len, model.pole_freq)))
    inside = (f_k >= f[0]) & (f_k <= f[-1]) & (ζ > RATIO_RANGE[0]) & (ζ < RATIO_RANGE[1])
    if not inside.any():
        raise FitError("sdypy-EMA finds no poles in the band; give approximate frequencies")
    poles = f_k[inside], ζ[inside]
    recurring, is_stable = _find_recurring(*poles, orders[inside])
    return StabilityChart(*poles, recurring, orders[inside], is_stable)


def _find_recurring(frequencies: Array, ratios: Array, orders: Index) -> tuple[Index, Mask]:
    """Return the indices of poles that occur at many orders, most often first, one for each group of near ones.

    The mask has all poles of these groups.
    """
    poles = frequencies * (-ratios + 1j * np.sqrt(1 - ratios**2))
    width = frequencies * ratios
    distance = np.abs(poles[:, None] - poles)
    is_near = distance < POLE_WIDTHS * width[:, None] + POLE_DISTANCE * frequencies[:, None]
    order_counts = np.array([len(np.unique(orders[row])) for row in is_near])
    is_stable = order_counts >= max(LEAST_ORDERS, LEAST_ORDER_SHARE * orders.max())
    recurring: list[int] = []
    for k in np.argsort(-order_counts, kind="stable").tolist():
        if is_stable[k] and (distance[k, recurring] > width[k] + POLE_DISTANCE * frequencies[k]).all():
            recurring.append(k)
    return np.array(recurring, dtype=np.int64), is_stable


def poles_near(model: ModalSum, values: ComplexArray, frequencies: Array) -> Candidates:
    """Return one mode for each given frequency, Hz, with the damping ratio of a grid that explains the values best."""
    measured, ratios = stack_parts(values), np.full(len(frequencies), RATIO_GRID[len(RATIO_GRID) // 2])
    for k in list(range(len(frequencies))) * 2:  # two sweeps over the modes
        squares = []
        for ζ in RATIO_GRID:
            ratios[k] = ζ
            columns = stack_parts(model.columns(frequencies, ratios))
            triangle = tall_triangle(np.hstack([columns / np.linalg.norm(columns, axis=0), measured]))
            squares.append(np.sum(triangle[columns.shape[1] :] ** 2))
        ratios[k] = RATIO_GRID[int(np.argmin(squares))]
    return Candidates(frequencies, ratios, np.arange(len(frequencies)))


def _interpolate_lines(frequencies: Array, rows: ComplexArray) -> tuple[Array, ComplexArray]:
    """Return equally spaced lines, interpolated if those given are not."""
    even = np.linspace(frequencies[0], frequencies[-1], len(frequencies))
    # largest deviation of lines from equal spacing, relative to the spacing
    if np.abs(frequencies - even).max() <= 1e-3 * (even[1] - even[0]):
        return frequencies, rows
    steps = round((frequencies[-1] - frequencies[0]) / float(np.median(np.diff(frequencies))))
    even = np.linspace(frequencies[0], frequencies[-1], 1 + min(steps, 20 * len(frequencies)))  # at most 20 per line
    return even, np.array([np.interp(even, frequencies, row) for row in rows])


@dataclass(frozen=True)
class SecondPole:
    """A pole that would imitate the deformation of a resonance."""

    mode: float  # frequency of the mode, Hz
    frequency: float  # of the second pole, Hz

    def is_near(self, fit: TrialFit, mode: int) -> bool:
        """Return whether the pole belongs to a mode of a fit, by its frequency."""
        f = float(fit.frequencies[mode])
        return abs(self.mode - f) < f * float(fit.ratios[mode])


@dataclass(frozen=True, eq=False)
class Selection:
    """The functions, their standard deviations, and the rules by which modes are chosen."""

    values: ComplexArray  # measured, one column per function, (k, F)
    deviations: Array  # their standard deviations, as given by the record, or to begin with, (k, F)
    estimated: bool  # standard deviations follow from the residuals of each fit
    candidates: Candidates
    count: int | None  # of the modes; if None, as many as are needed, each distinct from noise by its damping alone

    def fit(self, start: TrialFit, deviations: Array | None = None) -> TrialFit | None:
        """Fit the modes of a start, and drop those that are not distinct; return None if the fit fails."""
        start = replace(start, weights=1 / (self.deviations if deviations is None else deviations))
        while self.has_room(start.model, len(start.frequencies)):
            fit = quick_fit(start, TRIAL_TOLERANCE)
            if fit is None:
                return None
            is_distinct = self._distinct_modes(fit)
            if is_distinct.all():
                return fit
            start = replace(start, frequencies=fit.frequencies[is_distinct], ratios=fit.ratios[is_distinct])
        return None

    def has_room(self, model: ModalSum, modes: int) -> bool:
        """Return whether there are enough residuals for some modes."""
        count: int = self.values.shape[1]
        parameters = 2 * modes + count * (2 * modes + len(model.powers))
        return parameters <= 0.5 * 2 * self.values.size  # share of the residuals that parameters may be

    def reweight(self, fit: TrialFit) -> TrialFit:
        """Return the fit with the weights that follow from its residuals; the fit itself if that fails."""
        return self.fit(fit, self.estimate_deviations(fit)) or fit

    def estimate_deviations(self, fit: TrialFit, amplitude: Array | None = None) -> Array:
        """Return the standard deviations that follow from the residuals of a fit, or those given.

        The amplitudes on which they depend are those of the fit, if not given.
        """
        if not self.estimated:
            return self.deviations
        level = (np.abs(fit.fitted) if amplitude is None else amplitude) / np.sqrt(fit.model.bin_sizes)[:, None]
        return fitted_deviations(fit.residuals, level, fit.leverage)

    def is_needed(self, larger: TrialFit, start: TrialFit) -> bool:
        """Return whether a fit is clearly better than the smaller one from a start."""
        smaller = self.fit(start, self.estimate_deviations(larger))
        if smaller is None:
            return True
        deviations = self.estimate_deviations(larger, np.maximum(np.abs(larger.fitted), np.abs(smaller.fitted)))
        refined, smaller = self.fit(larger, deviations), self.fit(smaller, deviations) or smaller
        if refined is None or len(refined.frequencies) < len(larger.frequencies):
            return False
        samples = 2 * self.values.size
        squares = [float(np.sum(np.abs(fit.residuals / deviations) ** 2)) for fit in (smaller, refined)]
        effective = max(min(refined.effective_samples, samples), 2.0)
        scale = max(squares[1] / (samples - refined.parameters), np.finfo(float).tiny)
        gain = effective / samples * (squares[0] - squares[1]) / scale
        threshold = (refined.parameters - smaller.parameters) * math.log(effective) + VERY_STRONG
        return bool(gain > threshold)

    def _distinct_modes(self, fit: TrialFit) -> Mask:
        """Return True for the modes of a fit within the band, visible at its lines, and different from one another."""
        f, ζ, lines = fit.frequencies, fit.ratios, fit.model.frequencies
        is_distinct = (f >= lines[0]) & (f <= lines[-1])
        if self.count is None:
            place = np.clip(np.searchsorted(lines, f), 1, len(lines) - 1)
            is_distinct &= (2 * ζ * f > LEAST_BANDWIDTH * (lines[place] - lines[place - 1])) & (ζ < LARGEST_MODE_RATIO)
        poles = f * (-ζ + 1j * np.sqrt(1 - ζ**2))
        width = np.maximum(f * ζ, np.finfo(float).tiny)
        close = np.abs(poles[:, None] - poles) < EQUAL_POLES * np.minimum(width[:, None], width)
        return np.asarray(is_distinct & ~np.tril(close, -1).any(axis=1))


def bins(frequencies: Array, candidates: Candidates) -> Index | None:
    """Return the first line of each bin of a record that has far more lines than its modes need; None for others.

    A fifth of the half-power bandwidth of the least damped candidate is a bin.  The model is averaged like the values,
    so that nothing is lost but what changes within a bin.
    """
    chosen = candidates.recurring
    if not len(chosen):
        return None
    ratio = float(candidates.ratios[chosen].min())
    width = 2 * ratio * frequencies / LINES_PER_BANDWIDTH
    place = np.cumsum(np.gradient(frequencies) / width)
    starts = np.flatnonzero(np.diff(np.floor(place), prepend=-1.0))
    return starts if 2 * len(starts) < len(frequencies) else None


def select_modes(selection: Selection, model: ModalSum) -> tuple[TrialFit, list[str]]:
    """Choose and fit the modes that the functions show, or a given number; return the fit and notes of second poles."""
    for powers in RESIDUAL_POWERS:
        larger_model = replace(model, powers=powers)
        if selection.has_room(larger_model, len(selection.candidates.recurring) or (selection.count or 1)):
            model = larger_model
    best, second_poles = _remove_modes(selection, _start_fit(selection, model)), list[SecondPole]()
    if selection.count is None:
        best = _merge_second_poles(selection, best, second_poles)
    best = _add_candidates(selection, best, second_poles)
    if not len(best.frequencies):
        raise FitError("no mode was found in the band; give approximate frequencies, or a band with a resonance")
    for powers in RESIDUAL_POWERS[: RESIDUAL_POWERS.index(best.model.powers)][::-1]:
        fewer = replace(best, model=replace(best.model, powers=powers))
        if selection.is_needed(best, fewer):
            break
        best = selection.fit(fewer, selection.estimate_deviations(best)) or best
    return best, second_poles_note(second_poles)


def second_poles_note(second_poles: Sequence[SecondPole]) -> list[str]:
    """Return one note that names all second poles; an empty list without any."""
    if not second_poles:
        return []
    places = ", ".join(f"near {pole.mode:.4g} Hz (second pole at {pole.frequency:.4g} Hz)" for pole in second_poles)
    return [
        f"one mode {places}: second poles within the half-power bandwidth would imitate a nonlinear motion or leakage; "
        "measure at a smaller level, or give both frequencies if these are two modes"
    ]


def _merge_second_poles(selection: Selection, best: TrialFit, second_poles: list[SecondPole]) -> TrialFit:
    """Remove the second poles of modes from a fit, and add them to the list."""
    while (pair := _find_second_pole(best)) is not None:
        fewer = selection.fit(best.without(pair[1]), selection.estimate_deviations(best))
        if fewer is None:
            break
        second_poles.append(SecondPole(*best.frequencies[list(pair)].tolist()))
        best = selection.reweight(fewer)
    return best


def _find_second_pole(fit: TrialFit) -> tuple[int, int] | None:
    """Return the positions of a mode and of its second pole; None if all are modes."""
    f, width, importance = fit.frequencies, fit.frequencies * fit.ratios, _importance(fit)
    constants = fit.model.constants(f, fit.ratios, fit.coefficients)
    sizes = np.sum(np.abs(constants) ** 2, axis=1)
    assurance = np.abs(constants @ constants.conj().T) ** 2 / np.outer(sizes, sizes)
    close = (np.abs(f[:, None] - f) < width[:, None] + width) & (assurance > SAME_SHAPE) & ~np.eye(len(f), dtype=bool)
    if not close.any():
        return None
    second = int(np.argmin(np.where(close.any(axis=0), importance, np.inf)))
    return int(np.argmax(np.where(close[second], importance, -np.inf))), second


def _start_fit(selection: Selection, model: ModalSum) -> TrialFit:
    """Fit the recurring poles, as many as possible."""
    candidates, weights = selection.candidates, 1 / selection.deviations
    chosen = candidates.recurring[:MOST_FRF_MODES]
    while True:
        start = TrialFit(model, selection.values, weights, candidates.frequencies[chosen], candidates.ratios[chosen])
        if not len(chosen):
            return start
        fit = selection.fit(start)
        if fit is not None:
            return selection.reweight(fit)
        chosen = chosen[:-1]


def _remove_modes(selection: Selection, best: TrialFit) -> TrialFit:
    """Remove modes that are not needed, or those beyond a given number, the least important first."""
    while len(best.frequencies) > (selection.count or 0):
        start = best.without(int(np.argmin(_importance(best))))
        if selection.count is None and selection.is_needed(best, start):
            break
        smaller = selection.fit(start, selection.estimate_deviations(best))
        if smaller is None:
            break
        best = selection.reweight(smaller)
    return best


def _importance(fit: TrialFit) -> Array:
    """Return the increase of the sum of squares of the residuals when the terms of each mode are left out."""
    importance = np.zeros(len(fit.frequencies))
    for (_, triangle), c in zip(fit.factors, fit.coefficients.T, strict=True):
        inverse = np.linalg.inv(triangle)
        covariance = inverse @ inverse.T
        for k in range(len(importance)):
            pair = slice(2 * k, 2 * k + 2)
            importance[k] += c[pair] @ np.linalg.solve(covariance[pair, pair], c[pair])
    return importance


def _add_candidates(selection: Selection, best: TrialFit, second_poles: list[SecondPole]) -> TrialFit:
    """Return the fit with the candidates that it needs, or that make up the number of modes.

    Candidates that are second poles of modes are left out, and the first of each mode is added to the list.
    """
    f, ζ = selection.candidates.frequencies, selection.candidates.ratios
    while len(best.frequencies) < (selection.count or MOST_FRF_MODES):
        for k in _rank_candidates(best, f, ζ):
            start = replace(best, frequencies=np.append(best.frequencies, f[k]), ratios=np.append(best.ratios, ζ[k]))
            trial = selection.fit(start)
            if trial is None or len(trial.frequencies) <= len(best.frequencies):
                continue
            trial = selection.reweight(trial)
            pair = None if selection.count else _find_second_pole(trial)
            if pair is not None and any(pole.is_near(trial, pair[0]) for pole in second_poles):
                continue
            if selection.count or selection.is_needed(trial, best):
                break
        else:
            return best
        if len(trial.frequencies) <= len(best.frequencies):
            return best
        if pair is None:
            best = trial
        else:
            second_poles.append(SecondPole(*trial.frequencies[list(pair)].tolist()))
            mode, width = trial.frequencies[pair[0]], trial.frequencies[pair[0]] * trial.ratios[pair[0]]
            apart = np.abs(f - mode) > width + f * ζ
            f, ζ = f[apart], ζ[apart]
    return best


def _rank_candidates(fit: TrialFit, frequencies: Array, ratios: Array) -> list[int]:
    """Return the positions of the candidates that explain most of the residuals, best first, close ones once."""
    level = np.sqrt(np.median(fit.weights**2, axis=0))
    residuals = stack_parts(fit.residuals * level)
    q = tall_qr(stack_parts(fit.columns))[0]
    explained = []
    for f, ζ in zip(frequencies, ratios, strict=True):
        mode_columns = stack_parts(fit.model.modal(np.array([f]), np.array([ζ])))
        mode_columns = mode_columns / np.linalg.norm(mode_columns, axis=0)
        mode_columns -= tall_times(q, inner(q, mode_columns))
        explained.append(float(np.sum(inner(tall_qr(mode_columns)[0], residuals) ** 2)))
    ranked: list[int] = []
    width = frequencies * ratios
    for k in np.argsort(explained)[::-1].tolist():
        # distance of two different candidates, in sums of half-power half-widths
        if (np.abs(frequencies[k] - frequencies[ranked]) > width[k] + width[ranked]).all():
            ranked.append(k)
        if len(ranked) == TRIED_CANDIDATES:
            break
    return ranked
