"""Frequency and damping from measured free decays, Eq. (10).

With a free decay r, Eq. (9), Eq. (27), Eq. (27) with friction, or Eq. (26) integrated, and an equilibrium d + d' t, the
fit to the measured displacements y_i at the times t_i after the release is

    minimise    R = (1/m sum_i (r(t_i) + d + d' t_i - y_i)^2)^1/2

over the unknowns of the law, d, and d' if it is requested.  Several records of the same mode are fitted at once: they
share the unknowns of the mode, and each has its own amplitude, phase and equilibrium; their noise is assumed to be
equal.

A robust fit replaces the squares by the pseudo-Huber loss (``ancf_casadi.estimation.loss``).  The residuals of the
previous fit give the noise that sets its threshold.

References
----------
"Comparison of external damping models in a large deformation problem", Sections 3 and 4.2.
P. J. Huber, Robust Statistics, Wiley (1981), Section 7.8.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, get_args

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.decay.first_guess import DecayGuess, first_guess
from ancf_casadi.decay.one_mode import longest_step
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.least_squares import least_squares, restarted
from ancf_casadi.estimation.loss import HUBER, noise_of
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.inputs import choice, flag, instances, number, numbers, vector
from problems.decay.laws import LAWS, DecayModel, Law
from problems.decay.result import ROUNDING, DecayFit, decay_result

RATIO_BOUNDS = (0.0, 0.999)
INTEGRATION_ERROR = 0.5  # standard errors, if all samples had the same error; estimates shift by a tenth of this
INTEGRATIONS = 3  # most fits of an integrated law, until its step settles
REFINED = 0.7  # ratio of the required step to the last one, below which the fit is repeated
ROBUST_ROUNDS = 3  # robust fits, in which the estimate of the noise settles
ADVICE = "check the release (release_time), or fit a law with fewer terms"


def fit_decay(
    time: Measurement | ArrayLike,
    displacement: ArrayLike | None = None,
    *,
    law: Law = "linear",
    offset: bool = True,
    drift: bool = False,
    release_time: float | None = None,
    ratio_bounds: tuple[float, float] = RATIO_BOUNDS,
    robust: bool = False,
) -> DecayFit:
    """Fit a free decay.

    Parameters
    ----------
    time : array_like or Measurement
        Times, s, increasing; or the whole record.
    displacement : array_like
        Displacement at each time, m.
    law : {"linear", "quadratic", "friction", "one-mode"}
        ``linear``: Eq. (9).  ``quadratic``: Eq. (27).  ``friction``: Eq. (27) with friction as a third term.
        ``one-mode``: Eq. (26), integrated numerically, for damping so strong that Eq. (27) is not accurate enough.
    offset : bool
        Whether the equilibrium may differ from 0.
    drift : bool
        Whether the equilibrium may move at a constant velocity.
    release_time : float, optional
        Start of the free decay, s; detected in the record if not given.
    ratio_bounds : (float, float)
        Bounds of the damping ratio under the linear law, above -1 and below 1.
    robust : bool
        Whether to use the pseudo-Huber loss, which limits the influence of outliers.

    Raises
    ------
    InputError
        If the record is not usable, nothing in it oscillates, or an option is unknown.
    FitError
        If the fit does not converge.
    """
    record = as_record(time, displacement)
    release = None if release_time is None else [number(release_time, "release_time")]
    return fit_decays(
        [record], law=law, offset=offset, drift=drift, release_times=release, ratio_bounds=ratio_bounds, robust=robust
    )[0]


def fit_decays(
    records: Sequence[Measurement],
    *,
    law: Law = "linear",
    offset: bool = True,
    drift: bool = False,
    release_times: Sequence[float] | None = None,
    ratio_bounds: tuple[float, float] = RATIO_BOUNDS,
    robust: bool = False,
) -> tuple[DecayFit, ...]:
    """Fit several free decays of one mode at once.

    The records share frequency and damping coefficients; each has its own amplitude, phase, offset and drift.

    Parameters
    ----------
    records : sequence of Measurement
        The records.
    law, offset, drift, ratio_bounds, robust
        As in ``fit_decay``.
    release_times : sequence of float, optional
        Start of the free decay in each record, s; detected in the records if not given.

    Returns
    -------
    tuple of DecayFit
        Result for each record, with the same frequency and damping coefficients.

    Raises
    ------
    InputError
        If a record is not usable, nothing in it oscillates, or an option is unknown.
    FitError
        If the fit does not converge.
    """
    check_law(law)
    offset, drift, robust = flag(offset, "offset"), flag(drift, "drift"), flag(robust, "robust")
    lower, upper = vector(ratio_bounds, "ratio_bounds")
    if not -1.0 < lower < upper < 1.0:
        raise InputError(f"must be in order and between -1 and 1, got ({lower:g}, {upper:g})", "ratio_bounds")
    records = instances(records, "records", Measurement)
    releases = [None] * len(records) if release_times is None else numbers(release_times, "release_times")
    if len(releases) != len(records):
        raise InputError(f"has {len(releases)} values for {len(records)} records", "release_times")
    guesses = [
        first_guess(record, release_time=release, offset=offset, drift=drift)
        for record, release in zip(records, releases, strict=True)
    ]
    return fit_from(guesses, records, law=law, offset=offset, drift=drift, ratio_bounds=(lower, upper), robust=robust)


def fit_from(
    guesses: Sequence[DecayGuess],
    records: Sequence[Measurement],
    *,
    law: Law,
    offset: bool,
    drift: bool,
    ratio_bounds: tuple[float, float] = RATIO_BOUNDS,
    robust: bool = False,
) -> tuple[DecayFit, ...]:
    """Fit several free decays of one mode at once, each from its guess; see ``fit_decays``.

    Raises
    ------
    FitError
        If the fit does not converge.
    """
    model = DecayModel(law, offset, drift)
    if LAWS[law].integrated:
        model, fit, columns = _integrate(model, records, guesses, ratio_bounds, robust)
    else:
        fit, columns = _match(model, records, guesses, ratio_bounds, robust)
    times = [record.time[guess.release :] for record, guess in zip(records, guesses, strict=True)]
    ends = np.cumsum([0, *map(len, times)]).tolist()
    return tuple(
        decay_result(
            model,
            fit,
            time,
            indices=indices,
            rows=slice(*rows),
            ratio_bounds=ratio_bounds,
            reason=guess.reason,
        )
        for time, indices, rows, guess in zip(times, columns, pairwise(ends), guesses, strict=True)
    )


def _match(
    model: DecayModel,
    records: Sequence[Measurement],
    guesses: Sequence[DecayGuess],
    ratio_bounds: tuple[float, float],
    robust: bool,
    start: Mapping[str, float] = {},
) -> tuple[Fit, list[tuple[int, ...]]]:
    """Return the fit, and the positions of the unknowns of each record.

    Unknowns named in ``start`` begin at the values given there, the others at the guesses.
    """
    largest = max(guesses, key=lambda guess: guess.amplitude)
    unknowns = model.shared(largest, ratio_bounds)
    shared, columns = tuple(range(len(unknowns))), []
    data = []
    for position, (record, guess) in enumerate(zip(records, guesses, strict=True), start=1):
        own = model.own(guess)
        columns.append((*shared, *range(len(unknowns), len(unknowns) + len(own))))
        unknowns += [replace(u, name=f"{u.name}_{position}") for u in own] if len(records) > 1 else own
        time = record.time[guess.release :]
        data.append((time - time[0], cs.DM(record.values[guess.release :])))

    def residuals(*x: cs.MX) -> cs.MX:
        return cs.vertcat(
            *(model.curve(t, *(x[i] for i in indices)) - y for (t, y), indices in zip(data, columns, strict=True))
        )

    unknowns = [replace(u, guess=start.get(u.name, u.guess)) for u in unknowns]
    settings: dict[str, Any] = {
        "gauss_newton": LAWS[model.law].integrated,
        "series": [len(t) for t, _ in data],
        "advice": ADVICE,
    }
    fit = least_squares(residuals, unknowns, **settings)
    for _ in range(ROBUST_ROUNDS * robust):
        noise = noise_of(fit.residuals)
        if noise <= ROUNDING * largest.amplitude:
            break
        fit = least_squares(residuals, restarted(unknowns, fit), huber=HUBER * noise, **settings)
    return fit, columns


def _integrate(
    model: DecayModel,
    records: Sequence[Measurement],
    guesses: Sequence[DecayGuess],
    ratio_bounds: tuple[float, float],
    robust: bool,
) -> tuple[DecayModel, Fit, list[tuple[int, ...]]]:
    """Return the model with its step, the fit, and the positions of the unknowns of each record.

    The fit of the closed form, Eq. (27), gives the starting values and the accuracy that the integration needs.  If the
    residuals of the integrated law are smaller, they may need a shorter step; the fit is then repeated from its result.
    """
    closed = replace(model, law="quadratic")
    fit, columns = _match(closed, records, guesses, ratio_bounds, robust)
    found = [closed.values(fit.values[list(own)]) for own in columns]
    guesses = [
        replace(
            guess,
            ω=2 * math.pi * values["frequency"],
            amplitude=values["amplitude"],
            phase=next(fit.values[k] for k in own if fit.names[k].startswith("phase")),
        )
        for guess, own, values in zip(guesses, columns, found, strict=True)
    ]
    frequency, ζ, amplitude = (
        max(values[name] for values in found) for name in ("frequency", "damping_ratio", "amplitude")
    )
    for _ in range(INTEGRATIONS):
        allowed = INTEGRATION_ERROR * fit.residual_rms / (amplitude * math.sqrt(len(fit.residuals)))
        step = longest_step(2 * math.pi * frequency, ζ, allowed)
        if step > REFINED * model.longest_step:
            break
        model, start = replace(model, longest_step=step), dict(zip(fit.names, fit.values.tolist(), strict=True))
        fit, columns = _match(model, records, guesses, ratio_bounds, robust, start)
    return model, fit, columns


def check_law(law: Any) -> None:
    """Check the name of a law.

    Raises
    ------
    InputError
        If there is no such law.
    """
    choice(law, get_args(Law), "law")


def as_record(time: Measurement | ArrayLike, displacement: ArrayLike | None) -> Measurement:
    """Return a record unchanged, and times (s) and displacements (m) as a record.

    Raises
    ------
    InputError
        If the displacements are missing, given twice, or not usable.
    """
    if isinstance(time, Measurement):
        if displacement is not None:
            raise InputError("is part of the record already; leave it out", "displacement")
        return time
    if displacement is None:
        raise InputError("is missing; give it after the times, or give a Measurement", "displacement")
    return Measurement(time, displacement)
