"""Uncertainty of a fit by repetition: fits to many synthetic records.

With the fitted curve r(x), n free unknowns and the residuals e of a record of m values, the records

    parametric    y* = r(x) + s g,      g normal and white, s^2 = e'e/(m - n), or s as the user states it
    bootstrap     y* = r(x) + e*,       e* drawn from the residuals, centred and scaled by (m/(m - n))^1/2

are fitted as the measured record was, starting from its estimates.  If residuals correlate, drawing them one by one
would make the estimates scatter too little.  Blocks of successive residuals are drawn instead.  With the
autocorrelation rho_k, the length that is best for the variance of a mean of m values is

    l = (3 m/2)^(1/3) (G/g)^(2/3),    G = 2 sum_k c_k k |rho_k|,    g = 1 + 2 sum_k c_k |rho_k|,

with c_k = 1 up to the lag M, and c_k = 2 - k/M from there to 2 M.  M is the last lag before five successive ones within
2 (log10 m/m)^1/2, about 3.7 standard deviations of white noise for m = 2500.

A series is one coordinate of one record.  The residuals of each series are drawn from this series alone; a block that
reaches the end of the series continues at its beginning.

Run k uses the k-th child of the seed, so that the numbers do not depend on where and in which order the runs execute.

References
----------
B. Efron, R. J. Tibshirani, An Introduction to the Bootstrap, Chapman & Hall (1993), Sections 6.5, 9.4, 13.3.
E. Carlstein, The use of subseries values for estimating the variance of a general statistic from a stationary sequence,
Annals of Statistics 14 (1986).
D. N. Politis, H. White, Automatic block-length selection for the dependent bootstrap, Econometric Reviews 23 (2004).
D. N. Politis, J. P. Romano, A circular block-resampling procedure for stationary data, in Exploring the Limits of
Bootstrap, Wiley (1992).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, get_args

import numpy as np

from ancf_casadi.estimation.fit import CONFIDENCE_LEVEL, Fit
from ancf_casadi.estimation.noise.series import autocorrelation
from ancf_casadi.estimation.result import FitResult, LeastSquaresResult
from ancf_casadi.exceptions import AncfError, FitError, InputError
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.figures import Figure, drawing
from ancf_casadi.support.inputs import choice, number, whole
from ancf_casadi.support.interrupts import lasting_interrupts
from ancf_casadi.support.parallel import run_all
from ancf_casadi.support.tables import Displayed, Table, finite_or_none

Method = Literal["parametric", "bootstrap"]

QUIET_LAGS = 5  # successive insignificant lags that end the sums
MINIMUM_RUNS = 2


@dataclass(frozen=True, eq=False)
class MonteCarlo(Displayed):
    """Estimates from many synthetic records, made from one fit.

    Parameters
    ----------
    names : tuple of str
        Names of the p quantities.
    units : tuple of str
        Unit of each quantity.
    estimates : ndarray
        Estimates of the fit (p,).
    standard_errors : mapping of str to float
        Standard errors of the fit by name; nan where unknown.
    samples : ndarray
        Quantities of each run that converged (runs, p).
    failures : tuple of str
        Error message of each run that failed.
    method : {"parametric", "bootstrap"}
        Kind of noise in the records.
    block : int
        Number of successive residuals that were drawn together; 1 for parametric records.
    too_white : bool
        True if the noise of the fit is coloured, but that of these records white.

    Examples
    --------
    >>> import numpy as np
    >>> from ancf_casadi import Measurement
    >>> from problems import fit_decay, monte_carlo
    >>> time = np.linspace(0.0, 10.0, 1001)
    >>> noise = np.random.default_rng(0).normal(scale=1e-4, size=time.size)
    >>> record = Measurement(time, 0.02 * np.exp(-0.1 * time) * np.cos(12.0 * time) + noise)
    >>> scatter = monte_carlo(fit_decay(record), runs=20)
    >>> scatter.names
    ('frequency', 'damping_ratio', 'eta1', 'amplitude', 'offset')
    >>> scatter.samples.shape, scatter.intervals(0.9).shape
    ((20, 5), (5, 2))
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    estimates: Array
    standard_errors: Mapping[str, float]
    samples: Array
    failures: tuple[str, ...]
    method: Method
    block: int
    too_white: bool = False

    @property
    def runs(self) -> int:
        """Number of runs, including failures."""
        return len(self.samples) + len(self.failures)

    @property
    def means(self) -> Array:
        """Means over the runs (p,)."""
        return np.asarray(self.samples.mean(axis=0))

    @property
    def stds(self) -> Array:
        """Standard deviations over the runs (p,)."""
        return np.asarray(self.samples.std(axis=0, ddof=1))

    def intervals(self, level: float = CONFIDENCE_LEVEL) -> Array:
        """Return the central ranges (p, 2) of the samples: a fraction ``level`` within, equal parts on either side.

        Raises
        ------
        InputError
            If the level is not between 0 and 1.
        """
        if not 0.0 < number(level, "level") < 1.0:
            raise InputError(f"must be between 0 and 1, got {level:g}", "level")
        return np.asarray(np.quantile(self.samples, [(1 - level) / 2, (1 + level) / 2], axis=0)).T

    @property
    def warnings(self) -> tuple[str, ...]:
        """Number of failed runs for each reason, and whether the estimates may scatter too little."""
        notes = [f"{count} runs failed: {reason}" for reason, count in Counter(self.failures).items()]
        if self.too_white:
            notes.append(
                "the noise of these records is white, and that of the fit coloured, so that the estimates may scatter "
                "less than they should; use method='bootstrap'"
            )
        return tuple(notes)

    def table(self) -> Table:
        """Return estimate and standard error of each quantity, and mean, deviation and interval over the runs."""
        columns = ("quantity", "estimate", "unit", "standard_error", "mean", "deviation", "lower_95", "upper_95")
        rows = [(*row, *interval) for *row, interval in self._rows()]
        drawn = f"blocks of {self.block} residuals" if self.block > 1 else "single residuals"
        notes = [
            f"{self.runs} runs, {len(self.failures)} failed; "
            + ("white noise" if self.method == "parametric" else f"bootstrap of {drawn}"),
            *(f"note: {warning}" for warning in self.warnings),
        ]
        return Table("monte_carlo", "Estimates from synthetic records", columns, rows, notes)

    def report(self) -> str:
        """Return the table as text."""
        return self.table().text()

    def figure(self) -> Figure:
        """Draw the distribution of each quantity over the runs, and the normal distribution that the fit predicts."""
        labels = [f"{name}, {unit}".removesuffix(", ") for name, unit in zip(self.names, self.units, strict=True)]
        draw = drawing("ancf_casadi.figures.fits.scatter_figure")
        return draw(labels, self.samples, self.estimates, list(self.standard_errors.values()))

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON, with None for unknown values."""
        columns = ("name", "estimate", "unit", "standard_error", "mean", "deviation", "interval_95")
        return {
            "method": self.method,
            "block": self.block,
            "runs": self.runs,
            "failures": list(self.failures),
            "quantities": [dict(zip(columns, row, strict=True)) for row in self._rows()],
            "samples": self.samples.tolist(),
        }

    def _rows(self) -> list[tuple[Any, ...]]:
        """Return name, estimate, unit, standard error (None if unknown), mean, deviation and interval of each."""
        errors = map(finite_or_none, self.standard_errors.values())
        numbers = (column.tolist() for column in (self.means, self.stds, self.intervals()))
        return list(zip(self.names, self.estimates.tolist(), self.units, errors, *numbers, strict=True))


@lasting_interrupts()
def monte_carlo(
    fit: FitResult,
    *,
    runs: int = 200,
    seed: int = 0,
    method: Method = "parametric",
    executor: Executor | None = None,
    jobs: int = 1,
    progress: bool = False,
) -> MonteCarlo:
    """Repeat a fit on many synthetic records.

    Parameters
    ----------
    fit : DecayFit, BeamFit or any other result of a fit
        The fit.
    runs : int
        Number of records.
    seed : int
        Seed of the noise; the same seed gives the same numbers with any executor.
    method : {"parametric", "bootstrap"}
        ``parametric``: white noise as large as the residuals.  ``bootstrap``: the residuals themselves, in blocks if
        successive residuals correlate.
    executor, jobs, progress
        As in ``run_all``; processes, because IPOPT is not safe in threads.  With ``jobs`` above 1 a script must call
        this under ``if __name__ == "__main__":``.

    Raises
    ------
    InputError
        If a number is not usable, the method is unknown, or the fit has no scatter.
    FitError
        If fewer than two runs converge.

    Examples
    --------
    >>> import numpy as np
    >>> from ancf_casadi import Measurement
    >>> from problems import fit_decay, monte_carlo
    >>> time = np.linspace(0.0, 10.0, 1001)
    >>> noise = np.random.default_rng(0).normal(scale=1e-4, size=time.size)
    >>> record = Measurement(time, 0.02 * np.exp(-0.1 * time) * np.cos(12.0 * time) + noise)
    >>> fit = fit_decay(record)
    >>> scatter = monte_carlo(fit, runs=20, seed=1)
    >>> stds = dict(zip(scatter.names, scatter.stds))
    >>> bool(0.5 < stds["damping_ratio"] / fit.standard_errors["damping_ratio"] < 2.0)
    True
    """
    runs, seed = whole(runs, "runs", MINIMUM_RUNS, 1_000_000), whole(seed, "seed", 0)
    choice(method, get_args(Method), "method")
    if not isinstance(fit, FitResult):
        raise InputError(f"must be the result of a fit, got a {type(fit).__name__}", "fit")
    if not fit.residual_count:
        raise InputError(
            "has no scatter to make records from: the residuals are zero or no more than the unknowns, or no standard "
            "deviation is known",
            "fit",
        )
    block = 1
    if method == "bootstrap":
        if not (isinstance(fit, LeastSquaresResult) and fit.fit.degrees_of_freedom):
            raise InputError(f"finds no residuals to draw from in this {type(fit).__name__}; use parametric", "method")
        block = block_length(fit.fit)
    tasks = [partial(_run, fit, child, method, block) for child in np.random.SeedSequence(seed).spawn(runs)]
    results = run_all(tasks, executor=executor, jobs=jobs, progress=progress, title="fits")
    samples = [result for result in results if not isinstance(result, str)]
    failures = tuple(result for result in results if isinstance(result, str))
    if len(samples) < MINIMUM_RUNS:
        raise FitError(f"{len(failures)} of {runs} runs failed, the first: {failures[0]}")
    names = tuple(fit.estimates)
    return MonteCarlo(
        names=names,
        units=tuple(fit.units[name] for name in names),
        estimates=np.array(list(fit.estimates.values())),
        standard_errors={name: fit.standard_errors[name] for name in names},
        samples=np.array(samples),
        failures=failures,
        method=method,
        block=block,
        too_white=method == "parametric" and isinstance(fit, LeastSquaresResult) and not fit.fit.noise.white,
    )


def block_length(fit: Fit) -> int:
    """Return the number of successive residuals to draw together; 1 if they do not correlate."""
    m, shortest = len(fit.residuals), min(fit.series, default=1)
    size = np.nan_to_num(np.abs(autocorrelation(fit.residuals, fit.series, fit.times)[1:]))
    # times (log10 m/m)^1/2: least correlation that is significant
    quiet = np.append(size < 2.0 * math.sqrt(math.log10(m) / m), np.ones(QUIET_LAGS, dtype=bool))
    last = int(np.argmax(np.lib.stride_tricks.sliding_window_view(quiet, QUIET_LAGS).all(axis=1)))
    lags = np.arange(1, min(2 * last, len(size)) + 1)
    size = np.clip(2 - lags / max(last, 1), 0.0, 1.0) * size[: len(lags)]
    slope, total = 2 * float(lags @ size), 1 + 2 * float(size.sum())
    best: float = (1.5 * m) ** (1 / 3) * (slope / total) ** (2 / 3)
    return max(1, min(shortest // 2, round(best)))


def draw_blocks(size: int, block: int, rng: np.random.Generator) -> Index:
    """Return the positions (size,) of residuals drawn in blocks from a series that continues at its beginning."""
    starts = rng.integers(size, size=-(-size // block))
    return np.asarray((starts[:, None] + np.arange(block)).ravel()[:size] % size)


def _run(fit: FitResult, seed: np.random.SeedSequence, method: Method, block: int) -> Array | str:
    """Return the quantities from one synthetic record, or the error message if the fit fails."""
    rng = np.random.default_rng(seed)
    try:
        return fit.resampled(_noise(fit, rng, method, block))
    except AncfError as error:
        return str(error)


def _noise(fit: FitResult, rng: np.random.Generator, method: Method, block: int) -> Array:
    """Return noise (m,) to add to the residuals of a fit, in units of the standard deviations if these are known."""
    if not isinstance(fit, LeastSquaresResult):
        return rng.standard_normal(fit.residual_count)
    noise, residuals, freedom, m = fit.fit.noise, fit.fit.residuals, fit.fit.degrees_of_freedom, fit.residual_count
    if method == "parametric":
        variance = noise.variance
        if math.isfinite(noise.freedom):
            variance = max(variance, float(residuals @ residuals) / freedom)
        return math.sqrt(variance) * rng.standard_normal(m)
    centred = [series - series.mean() for series in np.split(residuals, np.cumsum(fit.fit.series)[:-1])]
    resampled = [series[draw_blocks(len(series), block, rng)] for series in centred]
    return np.asarray(math.sqrt(m / freedom) * np.concatenate(resampled))
