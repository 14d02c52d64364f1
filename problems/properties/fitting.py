"""Properties of a beam from load-deflection tables and natural frequencies of one or several configurations.

    record = StaticRecord(model, loads=[PointLoad.hung(0.02, 0.5)], values=[-0.0141], sensors=Sensor(direction=(0, 1)))
    fit = fit_properties([record, FrequencyRecord(model, [4.25, 27.3])], ["elastic_modulus", "clamp_stiffness"])
    print(fit.report())

All configurations share the unknown properties, but may differ in free length, orientation, gravity, and loads.  With
the residuals r of all records, in standard deviations or relative (``records``),

    minimise  1/2 |r(x)|^2    within bounds,

over factors x on the properties, and reciprocal factors on stiffnesses (``quantities``).  Equilibria and modes are
computed at each x, with exact derivatives (``response``), and the solver works with the Gauss-Newton Hessian J' J.
Before the fit, the singular values of J show whether the records determine all unknowns (``determined``).

Two optima may fit equally well, most of all where a tip mass and a soft clamp compete: a cantilever with the tip mass m
has exactly the frequencies of one with the clamp stiffness k if m/mu = E I/k, because both have the equation

    1 + cos b cosh b = a b (sin b cosh b - cos b sinh b),    a = m/(mu L) or E I/(k L),    b^4 = mu omega^2 L^4/(E I).

A fit of either therefore has several starts, and its intervals cover all optima that fit.

If no standard deviations are given, the scatter of the relative errors, model errors included, sets the standard
errors.  If they are given, the scatter still does so where it is larger.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from types import NoneType
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.estimation.estimates import LEVEL
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.least_squares import Unknown, least_squares
from ancf_casadi.estimation.noise import Noise
from ancf_casadi.estimation.polish import residuals_and_jacobian
from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.mechanics.beam import LUMPED, PROPERTIES
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.inputs import array, check_instance, check_keys, choices, instances, shown
from problems.properties.determined import Determined
from problems.properties.quantities import ALL_UNITS, CLAMP, COMBINED, STIFFNESSES, factors_of, unknown_of, value_of
from problems.properties.records import PropertyRecord
from problems.properties.result import PropertyFit

KNOWN = (*PROPERTIES, *LUMPED, *COMBINED)
WIDEST = 10.0  # factor on a property, either way, without other bounds
VANISHING = 1e-3  # least factor on a property, whatever the bounds
HEAVIEST = 100.0  # factor on a tip mass without other bounds
STIFF = 10.0  # first clamp stiffness if the clamp is rigid, in units of E I/L
RIGID, LOOSE = 1e5, 1e-2  # largest and least clamp stiffness without other bounds, in units of E I/L
SAME = 1e-9  # relative difference of properties that are the same
ACCURACY = 1e-6  # relative accuracy of computed values; in standard deviations if these are given
OPTIONS: Mapping[str, Any] = {
    "ipopt.tol": 1e-5,
    "ipopt.compl_inf_tol": 1e-9,
    "ipopt.max_iter": 100,
    "ipopt.mu_init": 1e-4,  # small, so that bounds do not push a good guess away
    "ipopt.bound_mult_init_method": "mu-based",
}
SLIGHT = 0.02  # second start of a tip mass, and of the compliance of a clamp, relative to the first
ADVICE = "start from other values, set bounds, or estimate fewer properties"
UNSEEN = 0.01  # change of the residuals, in standard deviations, by which an unknown at its bound may miss it
DIFFERENT = 0.05  # relative difference of unknowns that belong to different optima

Bounds = Mapping[str, tuple[float, float]]


def fit_properties(
    records: PropertyRecord | Sequence[PropertyRecord], unknowns: Sequence[str], *, bounds: Bounds | None = None
) -> PropertyFit:
    """Estimate properties of a beam from static tests and natural frequencies.

    Parameters
    ----------
    records : StaticRecord, FrequencyRecord, or sequence of them
        The measurements, of one or several configurations of the same beam.
    unknowns : sequence of str
        Properties to estimate, each common to all elements and configurations: ``width``, ``thickness``, ``density``,
        ``elastic_modulus``, ``tip_mass``, ``clamp_stiffness``; ``bending_stiffness`` (E I, by the modulus) and
        ``mass_per_length`` (by the density).  The models of the records hold their first values.  A rigid clamp gets a
        stiffness of 10 E I/L as its first value.
    bounds : mapping, optional
        Bounds (lower, upper) of unknowns by name, SI units.  By default a tenth and ten times the first value; 0 and a
        hundred times for a tip mass; 0.01 and 1e5 E I/L for a clamp.

    Raises
    ------
    InputError
        If a name is unknown or given twice, bounds do not contain the first value, no beam has the tip mass, the
        records differ in a property of the beam, or only some of them have standard deviations.
    EquilibriumError
        If a beam has no stable equilibrium.
    FitError
        If the records do not determine the unknowns, or the fit does not converge.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model
    >>> from problems import FrequencyRecord, fit_properties
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> errors = [0.01, 0.05, 0.15]  # Hz
    >>> record = FrequencyRecord(Model(beam), [1.90, 10.8, 30.1], standard_deviation=errors)
    >>> fit = fit_properties(record, ["elastic_modulus"])
    >>> value, error = fit["elastic_modulus"], fit.standard_errors["elastic_modulus"]
    >>> print(f"{value / 1e9:.0f} +- {error / 1e9:.0f} GPa")
    219 +- 1 GPa
    """
    given = [records] if isinstance(records, PropertyRecord) else records
    own = instances(given, "records", PropertyRecord)
    names = choices(unknowns, KNOWN, "unknowns")
    if not names or len(set(names)) < len(names):
        raise InputError("must name one or more different properties", "unknowns")
    for name in names:
        rivals = set(names) & set(COMBINED[name].powers) if name in COMBINED else set()
        if rivals:
            raise InputError(f"{name} contains {', '.join(sorted(rivals))}; estimate one or the other", "unknowns")
    check_instance(bounds, "bounds", Mapping, NoneType)
    check_keys(dict(bounds or {}), set(), set(names), "bounds")
    if len({record.deviations is None for record in own}) > 1:
        raise InputError("some have standard deviations and some have none; give them for all, or for none", "records")
    if CLAMP in names:
        own = _with_clamp(own)
    first = _first_values(own, names)
    started = [_unknown(name, first[name], own, bounds or {}) for name in names]
    solved = tuple(unknown.name for unknown in started)
    _check_determined(own, solved)
    best, *others = _optima(own, started)
    return PropertyFit(own, first, best, tuple(others))


def _optima(records: Sequence[PropertyRecord], unknowns: Sequence[Unknown]) -> list[Fit]:
    """Return the best fit, and others that fit as well within the confidence level of intervals.

    A soft clamp and a tip mass lower all frequencies alike, so a fit of either starts from a small value as well.
    """
    names = [unknown.name for unknown in unknowns]

    def residuals(*values: cs.MX) -> cs.MX:
        factors = factors_of(dict(zip(names, values, strict=True)))
        return cs.vertcat(*(record.residuals(factors) for record in records))

    fits, failures = [], []
    for start in product(*map(_starts, unknowns)):
        try:
            fit = least_squares(
                residuals,
                [replace(unknown, guess=guess) for unknown, guess in zip(unknowns, start, strict=True)],
                gauss_newton=True,
                forward=True,
                noise=ACCURACY,
                systematic=ACCURACY,
                options=OPTIONS,
                advice=ADVICE,
            )
        except FitError as error:
            failures.append(error)
        else:
            fits.append(_settled(fit, stated=records[0].deviations is not None))
    if not fits:
        raise failures[0]
    fits.sort(key=lambda fit: fit.residual_rms)
    found = [fits[0]]
    most = np.sum(fits[0].residuals ** 2) + np.nan_to_num(fits[0].quantile(LEVEL) ** 2 * fits[0].noise.variance)
    for fit in fits[1:]:
        if np.sum(fit.residuals**2) < most and all(_differ(fit, other) for other in found):
            found.append(fit)
    return found


def _starts(unknown: Unknown) -> tuple[float, ...]:
    """Return the first values of an unknown."""
    if unknown.name not in (unknown_of(CLAMP), "tip_mass"):
        return (unknown.guess,)
    slight = min(max(SLIGHT * unknown.guess, unknown.lower), unknown.upper)
    return (unknown.guess,) if slight >= unknown.guess else (unknown.guess, slight)


def _differ(fit: Fit, other: Fit) -> bool:
    size = np.maximum(np.abs(fit.values), np.abs(other.values))
    return bool((np.abs(fit.values - other.values) > DIFFERENT * np.maximum(size, fit.lower / DIFFERENT)).any())


def _settled(fit: Fit, stated: bool) -> Fit:
    """Return a fit with unknowns at bounds, from which they differ by less than the residuals show, and its errors.

    An interior-point method stays off a bound, by more the less the residuals depend on the unknown.  If standard
    deviations are stated, the variance of the residuals is at least theirs, which is 1.
    """
    m, deviation = len(fit.residuals), max(fit.residual_rms, ACCURACY)
    seen = np.linalg.norm(fit.jacobian, axis=0) / (UNSEEN * deviation)
    low, high = seen * (fit.values - fit.lower) < 1.0, seen * (fit.upper - fit.values) < 1.0
    values, free = np.select([low, high], [fit.lower, fit.upper], fit.values), ~(low | high)
    residuals, jacobian = residuals_and_jacobian(fit.model, values / fit.scale)
    if not np.isfinite(jacobian).all():
        raise FitError(f"at the bounds that the estimates reach, a beam has no stable equilibrium; {ADVICE}")
    freedom = m - int(np.count_nonzero(free))
    noise = Noise(float(residuals @ residuals) / freedom if freedom else math.nan, freedom)
    if stated:
        noise = Noise(max(noise.variance, 1.0), freedom) if freedom else Noise(1.0, math.inf)
    covariance, inverse = np.full(fit.covariance.shape, math.nan), np.linalg.pinv(jacobian[:, free] / fit.scale[free])
    covariance[np.ix_(free, free)] = (noise.variance + m * fit.systematic**2) * (inverse @ inverse.T)
    return replace(
        fit,
        values=values,
        covariance=covariance,
        active_bounds=~free,
        residuals=residuals,
        jacobian=jacobian / fit.scale,
        noise=noise,
    )


def _with_clamp(records: Sequence[PropertyRecord]) -> tuple[PropertyRecord, ...]:
    """Return the records with a first stiffness for each clamp that is rigid."""
    elastic = [r.model.beam.clamp_stiffness for r in records if math.isfinite(r.model.beam.clamp_stiffness)]
    first = elastic[0] if elastic else STIFF * _clamp_unit(records)
    return tuple(
        record
        if math.isfinite(record.model.beam.clamp_stiffness)
        else record.with_model(Model(record.model.beam.with_(clamp_stiffness=first), record.model.measures))
        for record in records
    )


def _clamp_unit(records: Sequence[PropertyRecord]) -> float:
    """Return E I/L of the shortest beam, N m/rad."""
    return max(value_of(record.model.beam, "bending_stiffness") / record.model.beam.length for record in records)


def _first_values(records: Sequence[PropertyRecord], names: Sequence[str]) -> dict[str, float]:
    """Return the first value of each property that a report names, SI units; check that the beams are the same."""
    first = {}
    for name in (*PROPERTIES, *COMBINED, *LUMPED):
        if name in LUMPED and name not in names:
            continue
        values = [value_of(record.model.beam, name) for record in records]
        values = [value for value in values if not (name == "tip_mass" and value == 0.0)]
        if not values:
            raise InputError("no beam has a tip mass to estimate; give one of the models a first value", name)
        if max(values) - min(values) > SAME * max(values):
            raise InputError(
                f"the records must be of the same beam, but their models have a {name} from {min(values):g} to "
                f"{max(values):g} {ALL_UNITS[name]}",
                "records",
            )
        first[name] = values[0]
    return first


def _unknown(name: str, first: float, records: Sequence[PropertyRecord], bounds: Bounds) -> Unknown:
    """Return the factor on a property, or its reciprocal, as an unknown within its bounds."""
    unit = _clamp_unit(records)
    if name in bounds:
        pair = array(bounds[name], f"bounds: {name}", finite=False)
        if pair.shape != (2,) or not 0.0 <= pair[0] < pair[1]:
            raise InputError(f"must be a pair 0 <= lower < upper, got {shown(bounds[name])}", f"bounds: {name}")
        if not pair[0] <= first <= pair[1]:
            raise InputError(f"the first value {first:g} is not within [{pair[0]:g}, {pair[1]:g}]", f"bounds: {name}")
        lower, upper = (pair / first).tolist()
    elif name == "tip_mass":
        lower, upper = 0.0, HEAVIEST
    else:
        lower, upper = 1 / WIDEST, WIDEST
        if name == CLAMP:
            lower, upper = LOOSE * unit / first, RIGID * unit / first
    if name in STIFFNESSES:
        least = LOOSE * unit / first if name == CLAMP else VANISHING
        most = RIGID * unit / first if name == CLAMP else math.inf
        lower, upper = 1 / min(upper, most), 1 / max(lower, least)
    elif name != "tip_mass":
        lower = max(lower, VANISHING)
    return Unknown(unknown_of(name), 1.0, lower=lower, upper=upper)


def _check_determined(records: Sequence[PropertyRecord], names: tuple[str, ...]) -> None:
    """Raise a FitError if the records leave a product of the unknowns open at their first values."""
    found = Determined.of(records, names, np.ones(len(names)))
    if found.rank < len(names):
        raise FitError(
            f"{found.statement}. Estimate fewer properties, or add a record: only a known force or weight sets the "
            "scale of mass and stiffness, and only another section or configuration separates their factors"
        )
