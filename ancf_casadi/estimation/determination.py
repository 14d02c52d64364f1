"""Combinations of unknowns that records determine, and those that they leave open.

Relative changes of the unknowns, d log x_k, change the residuals by the columns x_k dr/dx_k.  Where a combination n of
these columns vanishes, the records do not change if the unknowns change by the factors

    x_k -> x_k c^(n_k)    for any c:

only products of powers with sum a_k n_k = 0 are determined, such as x_k/x_p^(n_k/n_p) for a pivot p.  A motion alone
has several such n.  Without forces, the equation of motion contains ratios of stiffness to mass, so that elastic
modulus and density with the same factor give the same motion, and the width none at all.  A measured force or moment,
a known load before the release, or a known mass at the tip fixes the scale.

A combination counts as vanishing if a change by a factor e changes the residuals by less than the computation tells
from none: the derivatives are as inaccurate as the iterations of an integrator, and the slight stretching of a beam is
no measurement of its section.  These combinations are the right singular vectors of the columns for small singular
values.  Row reduction gives each the fewest unknowns.

The other singular vectors v, with the singular values s and the standard deviation d of the residuals, are products of
powers of the unknowns that the records determine with the relative standard errors d/s (``certainty``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction

import casadi as cs
import numpy as np

from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.solver.gauss_newton import residuals_and_jacobian
from ancf_casadi.estimation.solver.least_squares import residual_function
from ancf_casadi.estimation.solver.unknown import Coordinates, Unknown
from ancf_casadi.exceptions import FitError
from ancf_casadi.support.arrays import Array

LEAST_EXPONENT = 1e-3  # exponent below which an unknown is not in a combination


def check_determination(residuals: Callable[..., cs.MX], unknowns: Sequence[Unknown], negligible: float) -> None:
    """Refuse unknowns of which the residuals determine combinations only, at the guess and at a point beside it.

    A guess may be special: without motion nothing depends on the damping.  A change of the residuals counts as none if
    its norm is ``negligible``.
    """
    y = Coordinates.of(unknowns)
    evaluate = residual_function(residuals, y)
    signs = np.where(np.arange(len(y.guess)) % 2, -1.0, 1.0)
    # distance of the second point from the guess, in scales
    for point in (y.guess, np.clip(y.guess + 0.5 * signs * y.scale, y.lower, y.upper)):
        _, jacobian = residuals_and_jacobian(evaluate, point / y.scale)
        logarithmic = np.where(point == 0.0, 1.0, y.relative_slopes(point) / y.scale)
        combinations = undetermined_combinations(logarithmic * jacobian, negligible)
        if not len(combinations):
            return
    raise FitError("; ".join(_sentence([unknown.report[0] for unknown in unknowns], row) for row in combinations))


def certainty(fit: Fit, names: Sequence[str]) -> list[tuple[str, float]]:
    """Return independent products of powers of some unknowns and their relative standard errors, the best first.

    The largest exponent of each product is 1.  All other unknowns, and those at a bound, count as known.
    """
    free = ~fit.active_bounds & (fit.values != 0.0) & np.isin(fit.names, names)
    slopes = fit.coordinates.relative_slopes(fit.values)
    names = [name for name, is_free in zip(fit.names, free, strict=True) if is_free]
    if not names or not fit.noise.freedom:
        return []
    _, singular, rows = np.linalg.svd((fit.jacobian * slopes)[:, free], full_matrices=False)
    products, deviation = [], math.sqrt(fit.noise.variance)
    for value, row in zip(singular.tolist(), rows, strict=True):
        largest = float(row[np.abs(row).argmax()])
        error = deviation / (value * abs(largest)) if value else math.inf
        products.append((product(names, row / largest), error))
    return products


def product(names: Sequence[str], exponents: Array) -> str:
    """Return a product of powers as text."""
    powers = [(name, f"{n:.3g}") for name, n in zip(names, exponents, strict=True) if abs(n) > LEAST_EXPONENT]
    return " ".join(name if power == "1" else f"{name}^{power}" for name, power in powers)


def undetermined_combinations(columns: Array, negligible: float) -> Array:
    """Return the exponents n (d, n) of the combinations of columns (m, n) with a negligible norm, the largest one 1."""
    if not np.isfinite(columns).all() or not columns.any():
        return np.zeros((0, columns.shape[1]))  # the fit reports this
    _, singular, directions = np.linalg.svd(np.linalg.qr(columns, mode="r"))
    rows = directions[singular < negligible]
    rows = reduce_rows(rows, np.argsort(-np.abs(rows).max(axis=0, initial=0.0), kind="stable").tolist())
    return np.array([row / row[np.abs(row).argmax()] for row in rows]).reshape(rows.shape)


def reduce_rows(rows: Array, columns: Iterable[int]) -> Array:
    """Return rows with the same span as independent rows, reduced in the order of the columns: each begins with 1."""
    rows, first = rows.copy(), 0
    for column in columns:
        if first == len(rows):
            break
        pivot = first + int(np.abs(rows[first:, column]).argmax())
        if abs(rows[pivot, column]) < LEAST_EXPONENT:
            continue
        rows[[first, pivot]] = rows[[pivot, first]]
        rows[first] /= rows[first, column]
        other_rows = np.arange(len(rows)) != first
        rows[other_rows] -= np.outer(rows[other_rows, column], rows[first])
        first += 1
    return rows


def _sentence(names: Sequence[str], exponents: Array) -> str:
    """Return what the records determine of the unknowns in a combination."""
    powers = [(name, float(power)) for name, power in zip(names, exponents, strict=True) if abs(power) > LEAST_EXPONENT]
    if len(powers) == 1:
        return f"the records do not depend on {powers[0][0]}; fix it, or add a record that does, such as a force"
    (pivot, base), *other_powers = powers
    ratios = [_product(name, pivot, -power / base) for name, power in other_powers]
    listed = " and ".join(name for name, _ in powers) if len(powers) == 2 else ", ".join(name for name, _ in powers)
    return (
        f"the records determine {', '.join(ratios)}, but not {listed} each; add a measured force or moment, a known "
        "load or mass at the tip, or fix one of them"
    )


def _product(name: str, pivot: str, power: float) -> str:
    """Return ``name * pivot^power`` in plain notation: ``density/elastic_modulus``."""
    simple = Fraction(abs(power)).limit_denominator(4)
    # largest deviation of an exponent from a simple fraction
    size = str(simple) if abs(float(simple) - abs(power)) < 0.02 else f"{abs(power):.2f}"
    exponent = "" if size == "1" else f"^({size})" if "/" in size else f"^{size}"
    return f"{name}{'/' if power < 0.0 else '*'}{pivot}{exponent}"
