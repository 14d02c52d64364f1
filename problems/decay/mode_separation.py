"""Fit of several modes to one free decay.

Under linear damping the modes of a beam are independent, and a record is their sum and an offset,

    y(t) = d + sum_k r_k(t),    r_k of Eq. (9) with omega_k, zeta_k, r0_k, v0_k.

The strongest mode is fitted first and subtracted, then the strongest of the rest, and so on.  This gives the starting
values of one problem in which all modes are fitted at once, so that no mode is in the residuals of another.

References
----------
"Comparison of external damping models in a large deformation problem", Eq. (9), (10).
S. G. Mallat, Z. Zhang, Matching pursuits with time-frequency dictionaries, IEEE Transactions on Signal Processing 41
(1993).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import casadi as cs
from numpy.typing import ArrayLike

from ancf_casadi.decay.first_guess import first_guess
from ancf_casadi.estimation.least_squares import Unknown, least_squares
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import flag, number, whole
from problems.decay.arguments import as_record
from problems.decay.laws import DecayModel
from problems.decay.result import DecayFit, decay_result
from problems.decay.solution import RATIO_BOUNDS, fit_from

SAMPLES = 5  # per mode at least: four unknowns and one degree of freedom
ADVICE = "fit fewer modes, or check the release (release_time)"


def fit_modes(
    time: Measurement | ArrayLike,
    displacement: ArrayLike | None = None,
    *,
    count: int,
    offset: bool = True,
    release_time: float | None = None,
) -> tuple[DecayFit, ...]:
    """Fit the strongest modes of a free decay at once, each with linear damping.

    Parameters
    ----------
    time : array_like or Measurement
        Times, s, increasing; or the whole record.
    displacement : array_like
        Displacement at each time, m.
    count : int
        Number of modes.
    offset : bool
        Whether the equilibrium may differ from 0.
    release_time : float, optional
        Start of the free decay, s; detected in the record if not given.

    Returns
    -------
    tuple of DecayFit
        Result for each mode, in ascending order of frequency.  ``displacement`` gives the contribution of the mode; the
        strongest mode includes the offset.

    Raises
    ------
    InputError
        If the record is not usable, or shows fewer modes.
    FitError
        If a fit does not converge.
    """
    record = as_record(time, displacement)
    count, offset = whole(count, "count", 1, max(1, len(record.time) // SAMPLES)), flag(offset, "offset")
    release = None if release_time is None else number(release_time, "release_time")
    unknowns: list[Unknown] = []
    parts: list[tuple[DecayModel, tuple[int, ...]]] = []
    left, reason = record, ""
    for mode in range(1, count + 1):
        model = DecayModel("linear", offset and mode == 1, False)
        try:
            guess = first_guess(left, release_time=release, offset=model.offset)
            (alone,) = fit_from([guess], [left], law="linear", offset=model.offset, drift=False)
        except InputError as error:
            if mode == 1:
                raise
            raise InputError(
                f"shows {mode - 1} of {count} modes: the rest {str(error).removeprefix('record: ')}; fit fewer modes",
                "record",
            ) from None
        release, reason = alone.release_time, reason or alone.release_reason
        left = Measurement(alone.time, left.values[-alone.samples :] - alone.displacement(alone.time))
        own = [*model.shared(guess, RATIO_BOUNDS), *model.own(guess)]
        parts.append((model, tuple(range(len(unknowns), len(unknowns) + len(own)))))
        values = alone.fit.values.tolist()
        unknowns += [replace(u, name=f"{u.name}_{mode}", guess=x) for u, x in zip(own, values, strict=True)]

    y, t = cs.DM(record.values[-len(left.time) :]), left.time - left.time[0]
    fit = least_squares(_sum(parts, t, y), unknowns, series=[len(t)], times=t, advice=ADVICE)
    fits = [
        decay_result(
            model, fit, left.time, indices=indices, rows=slice(0, len(t)), ratio_bounds=RATIO_BOUNDS, reason=reason
        )
        for model, indices in parts
    ]
    return tuple(sorted(fits, key=lambda fit: fit.frequency))


def _sum(parts: list[tuple[DecayModel, tuple[int, ...]]], t: Array, y: cs.DM) -> Callable[..., cs.MX]:
    """Return a function of all unknowns: the sum of the modes, less the measured displacements."""

    def residuals(*x: cs.MX) -> cs.MX:
        curve = -cs.MX(y)
        for model, indices in parts:
            curve += model.curve(t, *(x[i] for i in indices))
        return curve

    return residuals
