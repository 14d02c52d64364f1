"""The noise of a fit: its spectrum near the frequencies of the fitted curve, from the residuals.

White noise has the same power at all frequencies, and the m residuals r of a fit with n unknowns give its variance
s^2 = r'r/(m - n).  The residuals of measured records are coloured: cameras and filters smooth them, other modes and
quantisation stand out as lines.  What counts for the estimates is the power S(f) at the frequencies f that the columns
of the Jacobian J contain, because with the covariance R of the noise

    cov(J'r) = J' R J = sum_f S(f) |J(f)|^2.

S is estimated in two steps.  First, an autoregressive process of order 1 is fitted (``autoregression``), R_ij =
rho^|i - j|, if this lowers the criterion BIC.  Second, the power P(f) of the residuals over that of this process, E(f),
is averaged over a band about each frequency,

    C(f) = sum P/E over the band / sum (1 - h),        S(f) = C(f) E(f).

The leverage h is the part of the noise that the fitted curve absorbs at a frequency, so that C is free of bias for
every band.  The band is the widest whose mean agrees with that of each narrower band, as far as the random errors of
these means tell (Lepski's method).  Lines then end the band, and white or autoregressive noise extends it to the whole
spectrum of all series, which leaves no more than the errors of s^2 and rho.  The degrees of freedom nu of Student's
distribution allow for both: for a small variance V of the logarithm of S due to the error of rho, 1/nu is that of s^2
plus V/(V + 2).  If no variance changes by more than a tenth, or than its random error, the noise counts as white, and
the errors are those of an ordinary fit.

A fit of an almost exact record leaves misfit, such as harmonics, instead of noise.  Misfit has no floor: between its
lines the power falls by orders of magnitude, and a low power beside a line says nothing of the misfit that the curve
has absorbed.  Where S exceeds ten times its median, it is therefore taken as the mean square of the residuals at least.

The spectrum is that of noise which lasts.  A disturbance that dies away, such as another mode, acts while the columns
of J are large, and may shift the estimates by more than J' R J says.  The sum of the products of r_i J_i and r_j J_j,
which are near in time, shows this.  With an orthonormal basis q of the columns of J and the quadratic spectral kernel
k,

    M_ij = sum_t sum_u k(t - u) q_ti r_t q_uj r_u,

and a width of the kernel of one mean period of the basis, so that other frequencies do not enter.  In directions in
which M exceeds q' R q by more than four standard errors of M, it replaces q' R q.

Samples that are missing leave zeros in an even grid of times.  E then is the expected power of the process with these
zeros.  Samples between the times of the grid are assigned to the nearest one.

Stated standard deviations.  Let Q be the sum of squares of the stated residuals, and M = I - B B' with the rows B of an
orthonormal basis of the columns of the Jacobian that belong to them.  If the stated variance sigma^2 is right,
Q/sigma^2 has the mean tr M and the variance 2 tr M^2, and is close to c chi^2 with nu degrees of freedom,

    c = tr M^2/tr M,    nu = (tr M)^2/tr M^2,

exactly if all residuals are stated: c = 1, nu = m - n.  The probability p of a larger Q decides what counts:

    p above 20 %    the stated variance sigma^2, which is known, with the quantile of the normal distribution
    p below 5 %     the residuals contradict it: the estimate Q/tr M, with that of Student's distribution for nu
    between         (Q/tr M)^l sigma^(2 (1 - l)), nu/l degrees of freedom, l = log(p/20 %)/log(5 %/20 %)

The width of an interval therefore is a continuous function of the residuals, at least as large as stated.  For one
unknown and nu = 1, 2, 4, 6, 10, 20, intervals of 95 % cover the truth in 95.9, 95.8, 95.7, 95.7, 95.6, 95.4 % if the
statement is right, and in 83, 87, 91, 93, 94, 95 % if it is too small by a factor of two, which few values do not
contradict.  The larger of both standard deviations with Student's quantile would cover in 99.6 % for nu = 4 if the
statement is right.

Stated values without an order, such as frequencies, count as white.  The other residuals of a fit have a noise of
their own, which shows in them.

References
----------
O. V. Lepskii, On a problem of adaptive estimation in Gaussian white noise, Theory of Probability and Its Applications
35 (1991).
E. Parzen, On spectral analysis with missing observations and amplitude modulation, Sankhya A 25 (1963).
D. W. K. Andrews, Heteroskedasticity and autocorrelation consistent covariance matrix estimation, Econometrica 59
(1991), for M.
H. White, A heteroskedasticity-consistent covariance matrix estimator, Econometrica 48 (1980), for the covariance of
estimates whose residuals are not white.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its packages are imported on first use

from ancf_casadi.estimation.solver.autoregression import FEWEST_RESIDUALS, correlations, grids_of, transform
from ancf_casadi.support.arrays import Array, Index, Mask

NARROWEST_BAND = 12  # half-width of the narrowest band, in cycles per length of the series
SAME_MEAN = 2.0  # difference of two means, in standard errors, up to which they agree
WHITE_CHANGE = 0.1  # change of a variance, relative to white noise, up to which the noise counts as white
PEAK_POWER = 10.0  # power over the median of the spectrum, beyond which it is not the floor of the noise
MOST_CONCENTRATION = 3.0  # concentration beyond which residuals are not noise; 1 for white noise
CLEAR_EXCESS = 4.0  # standard errors of M by which it is larger than q' R q where it replaces it
UNSEEN = 1e-6  # share of the noise that a fit leaves, below which the residuals show none of it
# Probabilities of larger residuals above which stated standard deviations count, and below which estimated ones do.
# test_stated_standard_deviations_are_known_until_residuals_contradict_them fails with 0.5 or with 0.05, 0.01.
DOUBTED, CONTRADICTED = 0.2, 0.05


@dataclass(frozen=True, eq=False)
class SeriesSpectrum:
    """Spectrum of the noise in one series of residuals."""

    rows: slice  # among all residuals
    slots: Index  # positions of the samples in an even grid of times
    power: Array  # power S (k,) times the weight of the frequency: 1 at both ends of the spectrum, 2 between them

    @property
    def length(self) -> int:
        """Length of the Fourier transform."""
        return 2 * (len(self.power) - 1)

    def form(self, columns: Array) -> Array:
        """Return X' R X (n, n) of columns X (m, n)."""
        spectra = transform(columns[self.rows], self.slots, self.length)
        product = spectra.conj().T @ (spectra * self.power[:, None])
        return np.asarray(product.real / self.length)


@dataclass(frozen=True, eq=False)
class Noise:
    """Covariance R of the noise in residuals."""

    variance: float  # variance s^2, as of white noise; nan for zero degrees of freedom
    freedom: float  # degrees of freedom of the estimated power, for Student's distribution
    spectra: tuple[SeriesSpectrum, ...] = ()  # spectrum of each series; none if the noise is white
    passing: Array | None = None  # significant part of the covariance of q'r (n, n) due to disturbances that die away
    basis: Array | None = None  # q (m, n) of the columns of the Jacobian, dual if not orthonormal, for ``passing``
    growth: float = 1.0  # mean variance in the directions of the fitted curve, relative to s^2
    parts: tuple[tuple[Mask, Noise], ...] = ()  # residuals with a noise of their own, all; s^2 is the mean
    chance: float = math.nan  # probability of larger residuals for stated standard deviations; nan without these
    excess: float = 1.0  # standard deviation over the stated one

    @property
    def white(self) -> bool:
        """True if the noise is white as far as the residuals tell."""
        return not self.spectra and self.passing is None and all(noise.white for _, noise in self.parts)

    def form(self, columns: Array) -> Array:
        """Return X' R X (n, n) of columns X (m, n)."""
        if self.parts:
            form = sum(noise.form(columns[rows]) for rows, noise in self.parts)
        elif self.spectra:
            form = sum(spectrum.form(columns) for spectrum in self.spectra)
        else:
            form = self.variance * (columns.T @ columns)
        if self.passing is None or self.basis is None:
            return np.asarray(form)
        inside = self.basis.T @ columns
        return np.asarray(form + inside.T @ self.passing @ inside)

    def at_least(self, deviation: float) -> Noise:
        """Return white noise of no less than a standard deviation."""
        return self if not self.white or self.variance >= deviation**2 else Noise(deviation**2, self.freedom)

    def along(self, column: Array) -> float:
        """Return the variance of the noise in the direction of a column (m,); s^2 if the column is zero."""
        size = float(column @ column)
        return float(self.form(column[:, None])[0, 0]) / size if size else self.variance


def estimated_noise(residuals: Array, basis: Array, series: Sequence[int], times: Array | None) -> Noise:
    """Return the noise of a fit with n free unknowns from its residuals (m,), the psi of a robust one.

    The orthonormal ``basis`` (m, n) spans the columns of the Jacobian; for a part of the residuals, it has the rows of
    these, and their leverage takes the place of n.  Without series, the residuals have no order and count as white
    noise; without times (m,), those of a series are equally spaced.
    """
    (m, n), gram = basis.shape, basis.T @ basis
    used = float(np.trace(gram))
    if m - used < UNSEEN * m:
        return Noise(math.nan, 0.0)
    white = Noise(float(residuals @ residuals) / (m - used), m - used)
    if not series or m < FEWEST_RESIDUALS or n == 0 or not white.variance > 0.0:
        return white
    grids = grids_of(series, times)
    coefficients, unsure = correlations(residuals, basis, grids)
    parts = [
        _relative_power(residuals[rows], basis[rows], places, ρ)
        for (rows, places), ρ in zip(grids, coefficients, strict=True)
    ]
    total, room = sum(part.power[-1] for part in parts), sum(part.room[-1] for part in parts)
    means = [
        _local_means(part, len(places), float(total), float(room))
        for part, (_, places) in zip(parts, grids, strict=True)
    ]
    spectra = tuple(
        SeriesSpectrum(rows, places, _with_misfit(part.process * mean, float(np.mean(residuals[rows] ** 2))))
        for (rows, places), part, (mean, _) in zip(grids, parts, means, strict=True)
    )
    share = np.concatenate([part.leverage for part in parts])
    uncertainty = float(share @ (1 / np.concatenate([freedom for _, freedom in means])))
    coloured = Noise(white.variance, 1 / (uncertainty / float(share.sum()) + unsure / (unsure + 2)), spectra)
    change = abs(np.linalg.eigvalsh(coloured.form(basis) / white.variance - gram)).max()
    lasting = white if change < max(WHITE_CHANGE, SAME_MEAN * math.sqrt(2 / coloured.freedom)) else coloured
    passing = _passing(residuals, basis, grids, parts, lasting.form(basis))
    if lasting is white and passing is None:
        return white
    noise = replace(lasting, passing=passing, basis=None if passing is None else basis @ np.linalg.pinv(gram))
    return replace(noise, growth=float(np.trace(noise.form(basis))) / (used * white.variance))


def _with_misfit(power: Array, variance: float) -> Array:
    """Return the power of a series (k,), at least that of white noise of its variance where it exceeds the floor.

    All but the frequencies at both ends have the weight 2.
    """
    weights = np.where(np.isin(np.arange(len(power)), [0, len(power) - 1]), 1.0, 2.0)
    misfit = power > PEAK_POWER * weights * np.median(power / weights)
    return np.where(misfit, np.maximum(power, weights * variance), power)


def _passing(
    residuals: Array,
    basis: Array,
    grids: Sequence[tuple[slice, Index]],
    parts: Sequence[_RelativePower],
    lasting: Array,
) -> Array | None:
    """Return the part of the covariance of q'r (n, n) due to disturbances that die away; None if not significant."""
    m, n = basis.shape
    products, cycles, energy = np.zeros((n, n)), 0.0, 0.0
    for part in parts:
        frequency = np.arange(len(part.leverage)) / (2 * (len(part.leverage) - 1))
        cycles, energy = cycles + float(frequency @ part.leverage), energy + float(part.leverage.sum())
    if not cycles > 0.0:
        return None
    period = energy / cycles
    for (rows, places), part in zip(grids, parts, strict=True):
        length = 2 * (len(part.leverage) - 1)
        lags = np.arange(1, int(places[-1]) + 1)
        angle = 1.2 * math.pi / period * lags
        kernel = np.concatenate([[1.0], 3 / angle**2 * (np.sin(angle) / angle - np.cos(angle))])
        window = _spectrum(kernel, length)
        window[1:-1] *= 2
        scores = transform(residuals[rows, None] * basis[rows], places, length)
        products += (scores.conj().T @ (scores * window[:, None])).real / length
    products *= m / (m - np.sum(basis**2))
    slots_per_sample = sum(int(places[-1]) + 1 for _, places in grids) / m
    least = np.finfo(float).eps * (float(np.trace(lasting)) + float(residuals @ residuals) / m)
    root = np.linalg.cholesky(lasting + least * np.eye(n))
    inverse = np.linalg.inv(root)
    ratios, directions = np.linalg.eigh(inverse @ products @ inverse.T)
    columns = basis @ (inverse.T @ directions)
    shares = columns**2 / np.sum(columns**2, axis=0)
    freedom = 1.5 / np.sum(shares**2, axis=0) * slots_per_sample / period  # m slots/period for a sine
    excess = np.where(ratios > 1 + CLEAR_EXCESS * np.sqrt(2 / freedom), ratios - 1, 0.0)
    if not excess.any():
        return None
    axes = root @ directions
    return np.asarray((axes * excess) @ axes.T)


def autocorrelation(residuals: Array, series: Sequence[int] = (), times: Array | None = None) -> Array:
    """Return the autocorrelation rho_0 = 1, rho_1, ... of residuals, one series if none is given; nan if all are zero.

    With the residuals r of several series, rho_k = sum r_i r_(i+k) / sum r_i^2, both sums over all series, and products
    within a series only.
    """
    grids = grids_of(tuple(series) or (len(residuals),), times)
    products = np.zeros(1 + max(int(places[-1]) for _, places in grids))
    for rows, places in grids:
        size = int(places[-1]) + 1
        power = np.abs(transform(residuals[rows, None], places, 2 * size)[:, 0]) ** 2
        products[:size] += np.fft.irfft(power, 2 * size)[:size]
    return products / products[0] if products[0] > 0.0 else np.full(len(products), math.nan)


def concentration(residuals: Array, series: Sequence[int] = (), times: Array | None = None) -> float:
    """Return (1 + 2 sum_k rho_k^2)/2, the mean square of the power spectrum over that of white noise; nan for zeros.

    It is about 1 for white noise, (1 + rho^2)/(1 - rho^2) for an autoregressive process of order 1, and of the order of
    the number of samples for a sine.
    """
    return float(np.sum(autocorrelation(residuals, series, times) ** 2)) - 0.5


@dataclass(frozen=True, eq=False)
class _RelativePower:
    """Power of a series of residuals relative to the autoregressive process, as sums from the lowest frequency on.

    ``power`` and ``room`` (k + 1,) are the sums of P/E and of 1 - h, ``leverage`` (k,) is h, and ``process`` (k,) the
    power of the process without gaps; all include the weights of the frequencies.
    """

    power: Array
    room: Array
    leverage: Array
    process: Array


def _relative_power(residuals: Array, basis: Array, places: Index, ρ: float) -> _RelativePower:
    """Return the power of a series relative to that of an autoregressive process with the coefficient ρ."""
    N = int(places[-1]) + 1
    length = 2 ** math.ceil(math.log2(2 * N))
    present = transform(np.ones((len(places), 1)), places, length)[:, 0]
    pairs = np.fft.irfft(np.abs(present) ** 2, length)[:N]
    correlation = ρ ** np.arange(N, dtype=float)
    expected = _spectrum(correlation * pairs, length) / len(places)
    weights = np.full(len(expected), 2.0)
    weights[[0, -1]] = 1.0
    own = np.abs(transform(np.column_stack([residuals, basis]), places, length)) ** 2 * (weights / length)[:, None]
    leverage = own[:, 1:].sum(axis=1)
    room = np.maximum(weights * len(places) / length - leverage, 0.0)
    floor = np.finfo(float).eps * expected.max()
    process = np.maximum(_spectrum(correlation, length), 0.0)
    return _RelativePower(
        power=np.concatenate([[0.0], np.cumsum(own[:, 0] / np.maximum(expected, floor))]),
        room=np.concatenate([[0.0], np.cumsum(room)]),
        leverage=leverage,
        process=weights * process,
    )


def _local_means(part: _RelativePower, samples: int, total: float, room: float) -> tuple[Array, Array]:
    """Return the mean C (k,) over the band of each frequency, and its degrees of freedom (k,).

    The widest band is the whole spectrum of all series, with the sums ``total`` and ``room``.
    """
    k = np.arange(len(part.leverage))
    bands = []
    half = NARROWEST_BAND * 2 * len(k) / max(2 * samples, 1)
    while half < len(k):
        low, high = np.maximum(k - int(half), 0), np.minimum(k + int(half) + 1, len(k))
        bands.append((part.power[high] - part.power[low], part.room[high] - part.room[low]))
        half *= 2
    one = np.ones(len(k))
    bands += [(part.power[-1] * one, part.room[-1] * one), (total * one, room * one)]
    mean, freedom = bands[-1][0] / bands[-1][1], bands[-1][1]
    lowest, highest, agrees = -np.inf * one, np.inf * one, np.ones(len(k), dtype=bool)
    for power, space in bands:
        usable = space > 1.0
        logarithm = np.log(np.maximum(power, np.finfo(float).tiny) / np.maximum(space, 1.0))
        error = SAME_MEAN * np.sqrt(2 / np.maximum(space, 1.0))
        agrees &= ~usable | ((logarithm + error >= lowest) & (logarithm - error <= highest))
        chosen = agrees & usable
        mean, freedom = np.where(chosen, np.exp(logarithm), mean), np.where(chosen, space, freedom)
        lowest = np.where(chosen, np.maximum(lowest, logarithm - error), lowest)
        highest = np.where(chosen, np.minimum(highest, logarithm + error), highest)
    return mean, freedom


def _spectrum(half: Array, length: int) -> Array:
    """Return the spectrum of an even function of the period ``length`` from its values at 0, 1, 2, ..."""
    return np.asarray(scipy.fft.dct(np.pad(half, (0, length // 2 + 1 - len(half))), type=1))


def noise_with_stated(
    residuals: Array, basis: Array, series: Sequence[int], times: Array | None, stated: Mask | None, deviation: float
) -> Noise:
    """Return the noise as ``estimated_noise`` does, with a standard deviation that the user states for some residuals.

    The mask ``stated`` (m,) selects these; None for no residual.
    """
    if stated is None or not stated.any():
        return estimated_noise(residuals, basis, series, times)
    own = stated_noise(residuals[stated], basis[stated], deviation)
    if stated.all():
        return own
    other, n = ~stated, basis.shape[1]
    count, leverage = int(np.count_nonzero(other)), float(np.sum(basis[other] ** 2))
    lengths = [int(np.count_nonzero(part)) for part in np.split(other, np.cumsum(series)[:-1])]
    columns, sizes, _ = np.linalg.svd(basis[other], full_matrices=False)
    rows = (columns * sizes)[:, sizes > UNSEEN]  # the same rows in coordinates of which none is zero
    rest = estimated_noise(residuals[other], rows, lengths, None if times is None else times[other])
    if not rest.freedom:
        return rest
    noise = Noise(
        variance=float(np.average([own.variance, rest.variance], weights=[len(other) - count, count])),
        freedom=n / ((n - leverage) / own.freedom + leverage / rest.freedom),
        parts=((stated, own), (other, rest)),
        chance=own.chance,
        excess=own.excess,
    )
    return replace(noise, growth=float(np.trace(noise.form(basis))) / (n * noise.variance))


def stated_noise(residuals: Array, basis: Array, deviation: float) -> Noise:
    """Return the noise of residuals (m,) with a stated standard deviation from the rows (m, n) of the basis."""
    m, gram = len(residuals), basis.T @ basis
    mean, square = m - float(np.trace(gram)), m - 2 * float(np.trace(gram)) + float(np.sum(gram**2))
    if mean < UNSEEN * m:
        return Noise(deviation**2, math.inf)
    ratio, freedom = float(residuals @ residuals) / (mean * deviation**2), mean**2 / square
    chance = float(scipy.special.chdtrc(freedom, ratio * freedom))
    share = math.log(max(chance, CONTRADICTED) / DOUBTED) / math.log(CONTRADICTED / DOUBTED)
    if share <= 0.0:
        return Noise(deviation**2, math.inf, chance=chance)
    growth = ratio**share
    return Noise(deviation**2 * growth, freedom / share, chance=chance, excess=math.sqrt(growth))
