"""Samples of the posterior distribution of a fit, drawn by the No-U-Turn sampler of nutpie.

nutpie takes any function that returns a density and its gradient, and needs no other automatic differentiation.  It
works with c of z = z_0 + S c, the coordinates in units of the covariance of the fit, for which its first guess of the
steps is right.  A straight ridge of the density over y would become a bent one over z = log(y_k - a).  What z_k adds to
the other z_j is therefore C_jk/C_kk dz_j/dy_j y_k(z_k) in place of its linear part, which leaves volumes as they are.

One evaluation of a motion takes a good part of a second, and its gradient three times as long.  The density of blocks
of measurements is therefore expanded first: with the columns S_k of the square root of the covariance, the Jacobians at
y_0 + S_k and y_0 - S_k give the second derivatives of the residuals, and

    r(c) = r_0 + (G + 1/2 sum_k c_k B_k) c,        y = y_0 + S c.

nutpie samples the density p_1 of these residuals.  Every fourth of its draws has the weight w_i = p(c_i)/p_1(c_i) with
the exact density p, and n draws are taken from these in their order, each w_i n/sum w times, rounded up or down at
random.  This holds for draws that depend on each other too, and takes one evaluation of each, without its gradient.  If
the weights count for fewer than half of the draws, (sum w)^2 < n/2 sum w^2, nutpie samples the exact density instead.

R-hat compares the means of the halves of M chains of n draws.  If all are independent draws of one distribution,
(R-hat^2 - 1) n/2 + 1 is the quotient of a chi-squared number and its degrees of freedom, 2 M - 1.  Chains have not
converged if R-hat is above 1.01 and above what this gives by chance; for 250 draws of 2 chains, above 1.02.

References
----------
M. D. Hoffman, A. Gelman, The No-U-Turn sampler, Journal of Machine Learning Research 15 (2014).
J. S. Liu, Monte Carlo Strategies in Scientific Computing, Springer (2001), Sections 2.5 and 3.4, for weights and for
systematic resampling.
A. Vehtari et al., Rank-normalization, folding, and localization: an improved R-hat, Bayesian Analysis 16 (2021).
"""

from __future__ import annotations

import importlib
import math
import warnings
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import casadi as cs
import numpy as np
import scipy  # its packages are imported on first use

from ancf_casadi.estimation.fit import Quantities
from ancf_casadi.estimation.posterior.log_density import LogDensity
from ancf_casadi.estimation.solver.gauss_newton import residuals_and_jacobian
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array, Index, Mask
from ancf_casadi.support.figures import Figure, drawing
from ancf_casadi.support.inputs import whole
from ancf_casadi.support.optional import find_module
from ancf_casadi.support.parallel import run_all

WARM_UP = 300  # steps of a chain before its draws, in which nutpie adapts
THINNING = 4  # draws of the expanded density per weighted one
LEAST_EFFECTIVE = 0.5  # share of the weighted draws
LARGEST_R_HAT = 1.01  # R-hat beyond which chains have not converged (Vehtari et al.)
# Chance of a larger R-hat of chains that have.  At 0.05, test_short_chains_that_have_converged_do_not_warn fails.
UNLUCKY = 1e-3

Chain = tuple[Array, Array, Mask]  # coordinates (k, n), log density (k,), and whether a trajectory diverged (k,)
SHARES = (0.95, 0.5)  # of the samples within the contours


def sample_posterior(
    density: LogDensity,
    named: tuple[Sequence[str], Sequence[str], Quantities],
    *,
    draws: int,
    chains: int,
    seed: int,
    executor: Executor | None,
    jobs: int,
    progress: bool,
) -> Any:
    """Return samples of quantities, with names and units, as an InferenceData; see ``LeastSquaresResult.sample``."""
    draws, chains, seed = whole(draws, "draws", 4), whole(chains, "chains", 1), whole(seed, "seed", 0)
    for module in ("nutpie", "arviz"):
        find_module(module, "sampling needs it", "nutpie 'arviz<1'")
    expansion = density if density.solution is None else second_order_density(density)
    seeds = np.random.SeedSequence(seed).spawn(chains)
    tasks = [partial(_chain, density, expansion, draws, child) for child in seeds]
    results = run_all(tasks, executor=executor, jobs=jobs, progress=progress, title="chains")
    drawn, lp, diverging = (np.array(column) for column in zip(*results, strict=True))
    names, units, of = named
    x = [cs.MX.sym(name) for name in density.names]
    quantities_function = cs.Function("quantities", [cs.vertcat(*x)], [cs.densify(of(*x))])
    points = density.unknowns(np.concatenate(drawn))
    values = quantities_function.map(len(points))(points.T).full().reshape(len(names), chains, draws)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of coming changes
        arviz = importlib.import_module("arviz")
        data = arviz.from_dict(
            posterior=dict(zip(names, values, strict=True)),
            sample_stats={"lp": lp, "diverging": diverging},
        )
        for name, unit in zip(names, units, strict=True):
            data.posterior[name].attrs["units"] = unit
        ratios = arviz.rhat(data) if chains > 1 else {}
    limit = largest_r_hat(draws, chains, len(names))
    bad = [name for name in ratios if float(ratios[name]) > limit]
    if bad:
        warnings.warn(
            f"the chains have not converged: R-hat is above {limit:.3g} for {', '.join(map(str, bad))}; take "
            "more draws, or give bounds or a prior to an unknown that the data do not determine",
            RuntimeWarning,
            stacklevel=3,
        )
    return data


def largest_r_hat(draws: int, chains: int, count: int) -> float:
    """Return the R-hat beyond which chains have not converged, of the largest of several estimates."""
    freedom = 2 * chains - 1
    highest_ratio = float(scipy.special.chdtri(freedom, UNLUCKY / count)) / freedom
    return max(LARGEST_R_HAT, math.sqrt(1 + (highest_ratio - 1) / (draws / 2)))


def _chain(density: LogDensity, expansion: LogDensity, draws: int, seed: np.random.SeedSequence) -> Chain:
    """Return a chain of the exact density."""
    if expansion is density:
        return _nuts(density, draws, seed)
    trace, thinned = _nuts(expansion, THINNING * draws, seed), slice(THINNING - 1, None, THINNING)
    coordinates, expected, diverging = trace[0][thinned], trace[1][thinned], trace[2][thinned]
    exact = np.array([density.value(x) for x in coordinates])
    places = resample(exact - expected, np.random.default_rng(seed))
    if places is None:
        return _nuts(density, draws, seed)
    return coordinates[places], exact[places], diverging[places]


def resample(log_weights: Array, rng: np.random.Generator) -> Index | None:
    """Return which of n draws to take, n indices in order, by weights; None if these count for too few of the draws."""
    n, highest = len(log_weights), float(log_weights.max())
    if not math.isfinite(highest):
        return None
    weights = np.exp(log_weights - highest)
    if weights.sum() ** 2 < LEAST_EFFECTIVE * n * (weights @ weights):
        return None
    ends = np.cumsum(weights)
    return np.searchsorted(ends / ends[-1], (np.arange(n) + rng.uniform()) / n)


@dataclass(frozen=True, eq=False)
class SamplerCoordinates:
    """The coordinates c (n,) of nutpie for the z of a density, in which straight ridges over y stay straight."""

    density: LogDensity

    @cached_property
    def _start(self) -> tuple[Array, Array, Array]:
        """z_0, y(z_0) and dy/dz there, (n,) each."""
        z, transformation = self.density.start, self.density.transformation
        return z, transformation.bounded(z), transformation.slopes(z)

    @cached_property
    def _regression(self) -> Array:
        """C_jk/C_kk dz_j/dy_j, the change of z_j with y_k along a ridge, (n, n); 0 for j = k."""
        covariance, (_, _, slopes) = self.density.covariance, self._start
        regression = covariance / np.diag(covariance) / slopes[:, None]
        np.fill_diagonal(regression, 0.0)
        return regression

    @cached_property
    def _with_bounds(self) -> list[int]:
        fit = self.density.fit
        return np.flatnonzero(np.isfinite(fit.lower) | np.isfinite(fit.upper)).tolist()

    def z(self, c: Array) -> tuple[Array, list[float]]:
        """Return z (n,), and for each unknown with bounds by how much dy/dz differs from its value at the start."""
        transformation, (start, y, slopes) = self.density.transformation, self._start
        z, slope_changes = start + self.density.scale @ c, []
        for k in self._with_bounds:
            slope_changes.append(float(transformation.slopes(z)[k] - slopes[k]))
            with np.errstate(over="ignore", invalid="ignore"):
                nonlinear_part = transformation.bounded(z)[k] - y[k] - slopes[k] * (z[k] - start[k])
                z = z + self._regression[:, k] * nonlinear_part
        return z, slope_changes

    def log_density(self, c: Array) -> tuple[float, Array]:
        """Return the logarithm of the density, and its gradient (n,) by c."""
        z, slope_changes = self.z(c)
        value, gradient = self.density.value_and_gradient(z)
        for k, slope_change in reversed([*zip(self._with_bounds, slope_changes, strict=True)]):
            gradient[k] += slope_change * float(self._regression[:, k] @ gradient)
        return value, gradient @ self.density.scale


def _nuts(density: LogDensity, draws: int, seed: np.random.SeedSequence) -> Chain:
    """Return a chain of the No-U-Turn sampler, which starts at random about the estimates."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of coming changes
        nutpie = importlib.import_module("nutpie")
        compiled_pyfunc = importlib.import_module("nutpie.compiled_pyfunc")
    n, rng, coordinates = len(density.names), np.random.default_rng(seed), SamplerCoordinates(density)
    model = compiled_pyfunc.from_pyfunc(
        n,
        lambda: coordinates.log_density,
        lambda *_: lambda c: {"c": np.array(c)},
        [np.dtype(float)],
        [(n,)],
        ["c"],
        make_initial_point_fn=lambda _: rng.standard_normal(n),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of coming changes
        sampler_seed = int(seed.generate_state(1)[0])
        trace = nutpie.sample(
            model,
            draws=draws,
            tune=WARM_UP,
            chains=1,
            cores=1,
            seed=sampler_seed,
            progress_bar=False,
            save_warmup=False,
        )
    points, stats = np.array([coordinates.z(c)[0] for c in trace.posterior["c"].values[0]]), trace.sample_stats
    return points, np.asarray(stats["logp"].values[0]), np.asarray(stats["diverging"].values[0], dtype=bool)


def second_order_density(density: LogDensity) -> LogDensity:
    """Return the density of residuals to second order in the unknowns, which needs no measurements."""
    fit, start = density.fit, density.start
    middle = density.transformation.bounded(start) / fit.scale
    root = (density.transformation.slopes(start) / fit.scale)[:, None] * density.scale
    r, jacobian = residuals_and_jacobian(fit.model, middle)
    second_derivatives = []
    for step in root.T:
        with np.errstate(divide="ignore", invalid="ignore"):
            to_bounds = np.array([fit.upper / fit.scale - middle, fit.lower / fit.scale - middle]) / step
        # one standard error either way, or less at a bound
        ahead, back = (min(1.0, float(np.nanmin(np.fmax.reduce(room)))) for room in (to_bounds, -to_bounds))
        at_ends = [residuals_and_jacobian(fit.model, middle + way * step)[1] for way in (ahead, -back)]
        second_derivatives.append((at_ends[0] - at_ends[1]) / (ahead + back) @ root)
    B = np.array(second_derivatives)  # (k, m, j)
    B = (B + B.transpose(2, 1, 0)) / 2
    z = cs.MX.sym("z", len(middle))
    to_c = cs.DM(np.linalg.inv(root))
    c, G = cs.mtimes(to_c, z - cs.DM(middle)), cs.DM(jacobian @ root)
    M = cs.reshape(cs.mtimes(cs.DM(B.reshape(len(B), -1).T.copy()), c), len(middle), len(r)).T
    model = cs.Function("expanded", [z], [cs.DM(r) + cs.mtimes(G + M / 2, c), cs.mtimes(G + M, to_c)])
    return LogDensity(replace(fit, model=model))


def corner_figure(samples: Any) -> Figure:
    """Draw the distribution of each quantity, and of each pair with contours about 50 and 95 % of the samples.

    Dotted lines are the ends of the central 95 %.

    Parameters
    ----------
    samples : arviz.InferenceData
        What ``fit.sample()`` returns.

    Raises
    ------
    InputError
        If it has no group ``posterior`` with samples of at least one quantity.

    Examples
    --------
    >>> import numpy as np
    >>> from ancf_casadi import Measurement
    >>> from problems import corner_figure, fit_decay
    >>> time = np.linspace(0.0, 10.0, 1001)
    >>> noise = np.random.default_rng(0).normal(scale=1e-4, size=time.size)
    >>> fit = fit_decay(Measurement(time, 0.02 * np.exp(-0.1 * time) * np.cos(12.0 * time) + noise))
    >>> figure = corner_figure(fit.sample(draws=50, chains=1))
    >>> figure.axes[-1].get_xlabel()
    'offset, m'
    """
    posterior = getattr(samples, "posterior", None)
    variables = getattr(posterior, "data_vars", None)
    if not variables:
        raise InputError("must be the samples that fit.sample() returns", "samples")
    labels = [
        f"{name}, {variable.attrs['units']}" if variable.attrs.get("units") else str(name)
        for name, variable in variables.items()
    ]
    columns: list[Array] = [np.asarray(variable.values, dtype=float).ravel() for variable in variables.values()]
    draw = drawing("ancf_casadi.figures.fits.corner_figure")
    return draw([label.replace("_", " ") for label in labels], columns, SHARES)
