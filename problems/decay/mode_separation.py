"""Fit of several modes to one free decay, and the mode within a band of frequencies.

Under linear damping the modes of a beam are independent, and a record is their sum and an offset,

    y(t) = d + sum_k r_k(t),    r_k of Eq. (9) with omega_k, zeta_k, and an amplitude and a phase.

The strongest mode is fitted first.  The strongest oscillation in its residuals is the next mode; both are fitted at
once, the residuals give the third mode, and so on.  If modes were subtracted one by one, a mode fitted beside stronger
ones would leave a rest at its own frequency.

A mode whose frequency depends on its amplitude leaves an oscillation close to its frequency, which is no other mode.
Two close modes therefore count as one unless they are evident (``ancf_casadi.decay.evidence``) beside one mode with
quadratic damping and a frequency that is logarithmic in amplitude.  What fades within a period is no mode either.

The mode within a band of frequencies follows likewise.  A band-pass filter would colour the noise, ring at the release
and shift it, and would make the standard errors too small.  Instead, modes are fitted at once until the residuals show
no other oscillation outside the band.  All but the wanted one are subtracted from the record, and the rest can be
fitted with any law.  The subtracted modes are then taken as known.  With decay rates sigma = zeta omega, this neglects
correlations of about (sigma_1 + sigma_2)/|omega_1 - omega_2|, so that close modes give a warning.

References
----------
"Comparison of external damping models in a large deformation problem", Eq. (9), (10).
Y. C. Pati, R. Rezaiifar, P. S. Krishnaprasad, Orthogonal matching pursuit, 27th Asilomar Conference on Signals, Systems
and Computers (1993).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.decay.evidence import evident
from ancf_casadi.decay.first_guess import CLOSE
from ancf_casadi.decay.release import MINIMUM_PERIODS
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.solver.least_squares import least_squares
from ancf_casadi.estimation.solver.unknown import Unknown, started
from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import flag, number, physical, vector, whole
from ancf_casadi.support.tables import Displayed
from problems.decay.laws import DecayModel
from problems.decay.limitations import residual_oscillation
from problems.decay.result import DecayFit
from problems.decay.solution import as_record, fit_one
from problems.decay.takes import DecayModes

MOST_DECAY_MODES = 6  # fitted at once if no number is given


@dataclass(frozen=True, eq=False)
class IsolatedMode(Displayed):
    """A mode of a record, and the record without the other modes.

    Parameters
    ----------
    mode : DecayFit
        The mode under linear damping, fitted together with the others.
    others : tuple of DecayFit
        The other modes.
    record : Measurement
        The record from the release on, less the other modes.
    warnings : tuple of str
        Modes that are too close to be told apart with correct errors.

    Examples
    --------
    >>> import numpy as np
    >>> from ancf_casadi import Measurement
    >>> from problems import isolate_mode
    >>> time = np.linspace(0.0, 10.0, 2001)
    >>> y = 0.020 * np.exp(-0.1 * time) * np.cos(12.0 * time)
    >>> y += 0.005 * np.exp(-0.3 * time) * np.cos(60.0 * time)
    >>> y += np.random.default_rng(0).normal(scale=1e-4, size=time.size)
    >>> found = isolate_mode(Measurement(time, y), band=(1.0, 3.0))
    >>> [round(mode.frequency, 2) for mode in (found.mode, *found.others)]
    [1.91, 9.55]
    """

    mode: DecayFit
    others: tuple[DecayFit, ...]
    record: Measurement
    warnings: tuple[str, ...]

    def _summary(self) -> str:
        others = ", ".join(f"{one.frequency:.4g}" for one in self.others)
        return f"{self.mode.frequency:.4g} Hz{others and f', without {others} Hz'}, {self.record!r}"


def fit_modes(
    time: Measurement | ArrayLike,
    displacement: ArrayLike | None = None,
    *,
    modes: int | None = None,
    offset: bool = True,
    release_time: float | None = None,
) -> DecayModes:
    """Fit the strongest modes of a free decay at once, each with linear damping.

    Parameters
    ----------
    time : array_like or Measurement
        Times, s, increasing; or the whole record.
    displacement : array_like
        Displacement at each time, m.
    modes : int, optional
        Largest number of modes; as many as the record supports, up to six, if not given.
    offset : bool
        Whether the equilibrium may differ from 0.
    release_time : float, optional
        Start of the free decay, s; detected in the record if not given.

    Returns
    -------
    DecayModes
        Result for each mode, in ascending order of frequency, with a warning if the record supports fewer modes than
        ``modes``.  ``displacement`` of a mode returns its contribution; that of the strongest mode includes the offset.

    Raises
    ------
    InputError
        If the record is not usable, or shows no mode.
    FitError
        If a fit does not converge.

    Examples
    --------
    >>> import numpy as np
    >>> from problems import fit_modes
    >>> time = np.linspace(0.0, 10.0, 2001)
    >>> y = 0.020 * np.exp(-0.1 * time) * np.cos(12.0 * time)
    >>> y += 0.005 * np.exp(-0.3 * time) * np.cos(60.0 * time)
    >>> y += np.random.default_rng(0).normal(scale=1e-4, size=time.size)
    >>> for fit in fit_modes(time, y, modes=2):
    ...     print(f"{fit.frequency:.2f} Hz, {100 * fit.damping_ratio:.2f} %")
    1.91 Hz, 0.83 %
    9.55 Hz, 0.50 %
    """
    record = as_record(time, displacement)
    most = max(1, len(record.time) // 5)  # four unknowns and one degree of freedom per mode
    limit = min(MOST_DECAY_MODES, most) if modes is None else whole(modes, "modes", 1, most)
    release = None if release_time is None else number(release_time, "release_time")
    found, merged, ended = _found(record, limit, flag(offset, "offset"), release)
    notes = [*record.warnings, *merged, *([] if modes is None or not ended else [ended])]
    t, y = found[0].time, record.values[-found[0].samples :]
    fit, columns = _together(found, t, y)
    settings: dict[str, Any] = {"modes": modes, "offset": offset, "release_time": release_time}
    fits = [
        DecayFit(
            fit, mode.model, indices, slice(0, len(t)), t, fit.residuals, found[0].release_reason, tuple(notes),
            again=partial(_mode, near=mode.frequency, **settings),
        )
        for mode, indices in zip(found, columns, strict=True)
    ]  # fmt: skip
    again = partial(fit_modes, **settings)
    return DecayModes(fit, tuple(sorted(fits, key=lambda fit: fit.frequency)), again=again)


def isolate_mode(record: Measurement, band: tuple[float, float], *, release_time: float | None = None) -> IsolatedMode:
    """Return the strongest mode within a band, and the record without the other modes that are found with it.

    Parameters
    ----------
    record : Measurement
        The record of a free decay.
    band : (float, float)
        Lowest and highest frequency, Hz.
    release_time : float, optional
        Start of the free decay, s; detected in the record if not given.

    Raises
    ------
    InputError
        If the band is not in order, the record is not usable, or it shows no mode in the band.
    FitError
        If a fit does not converge.

    Examples
    --------
    >>> import numpy as np
    >>> from ancf_casadi import Measurement
    >>> from problems import fit_decay, isolate_mode
    >>> time = np.linspace(0.0, 10.0, 2001)
    >>> y = 0.020 * np.exp(-0.1 * time) * np.cos(12.0 * time)
    >>> y += 0.005 * np.exp(-0.3 * time) * np.cos(60.0 * time)
    >>> y += np.random.default_rng(0).normal(scale=1e-4, size=time.size)
    >>> found = isolate_mode(Measurement(time, y), band=(8.0, 12.0))
    >>> round(fit_decay(found.record).frequency, 2)
    9.55
    """
    low, high = (physical(limit, "band") for limit in vector(band, "band"))
    if not low < high:
        raise InputError(f"must be in order, got {low:g}, {high:g} Hz", "band")
    fits: Sequence[DecayFit] = ()
    for count in range(1, MOST_DECAY_MODES + 1):
        try:
            found = fit_modes(record, modes=count, release_time=release_time)
        except InputError:
            if count == 1:
                raise
            break
        if len(found) <= len(fits):
            break
        fits = found
        inside = [fit for fit in fits if low <= fit.frequency <= high]
        next_one = residual_oscillation(fits[0])
        if next_one is None or (inside and low <= next_one.ω / (2 * math.pi) <= high):
            break
    if not inside:
        known = ", ".join(f"{fit.frequency:.4g}" for fit in fits)
        raise InputError(f"no mode is within {low:g} to {high:g} Hz; those found are at {known} Hz", "band")
    mode = max(inside, key=lambda fit: fit.amplitude)
    others = tuple(fit for fit in fits if fit is not mode)
    values = record.values[-mode.samples :] - np.sum([fit.displacement(mode.time) for fit in others], axis=0)
    # correlation of two modes beyond which there is a warning; the errors are then 5 % too small
    close = [
        f"the modes at {mode.frequency:.4g} and {other.frequency:.4g} Hz are close, and the latter is subtracted as if "
        "it were known: the standard errors are too small; fit all modes at once"
        for other in others
        if _rate(mode) + _rate(other) > 0.3 * 2 * math.pi * abs(mode.frequency - other.frequency)
    ]
    return IsolatedMode(
        mode, others, Measurement(mode.time, values, record.name, record.sensor, record.warnings), tuple(close)
    )


def _mode(record: Measurement, *, near: float, **settings: Any) -> DecayFit:
    """Return the mode of a record whose frequency (Hz) is closest to another one."""
    return min(fit_modes(record, **settings), key=lambda fit: abs(fit.frequency - near))


def _found(
    record: Measurement, limit: int, offset: bool, release: float | None
) -> tuple[list[DecayFit], list[str], str]:
    """Return up to ``limit`` modes, notes of modes that count as one, and the reason if there are fewer."""
    modes, notes, merged = [_strongest(record, offset, release)], list[str](), list[DecayFit]()
    t, y = modes[0].time, record.values[-modes[0].samples :]
    rest = y - modes[0].displacement(t)
    while len(modes) < limit:
        missing = f"the record supports {len(modes)} of {limit} modes"
        try:
            mode = _strongest(Measurement(t, rest, sensor=record.sensor), False, float(t[0]))
        except InputError as error:
            return modes, notes, f"{missing}: the rest {str(error).removeprefix('record: ')}"
        rate = _rate(mode)
        lasts = min(t[-1] - t[0], math.log(20) / rate if rate > 0.0 else math.inf)  # until a twentieth is left
        if mode.frequency * lasts < MINIMUM_PERIODS:
            ended = (
                f"{missing}: the rest, near {mode.frequency:.4g} Hz with a damping ratio of {mode.damping_ratio:.2g}, "
                "is no mode; another law or a drift may explain it"
            )
            return modes, notes, ended
        near = min(modes, key=lambda other: abs(other.frequency - mode.frequency))
        others = y - np.sum([np.zeros(len(t)), *(one.displacement(t) for one in modes if one is not near)], axis=0)
        one = _single(near, mode, t, others)
        if one is None:
            modes.append(mode)
            rest = rest - mode.displacement(t) if merged else -_together(modes, t, y)[0].residuals
            continue
        note = (
            f"one mode near {near.frequency:.4g} Hz: a second one at {mode.frequency:.4g} Hz would imitate a frequency "
            "that depends on amplitude; fit the mode with a frequency law"
        )
        if near in merged:
            return modes, notes, f"{missing}: {note}"
        merged.append(near)
        notes.append(note)
        rest = others - one.displacement(t)
    return modes, notes, ""


def _strongest(record: Measurement, offset: bool, release: float | None) -> DecayFit:
    """Return the fit of the strongest mode alone."""
    return fit_one(record, DecayModel("linear", offset, drift=False), release_time=release)


def _single(first: DecayFit, second: DecayFit, t: Array, y: Array) -> DecayFit | None:
    """Return one mode with a frequency that depends on amplitude; None if two modes explain the record better."""
    if abs(first.frequency - second.frequency) > CLOSE * first.frequency:
        return None
    record = Measurement(t, y, sensor=first.model.sensor)
    try:
        one = fit_one(
            record, DecayModel("quadratic", first.model.offset, False, "logarithmic"), release_time=float(t[0])
        )
        two = _together([first, second], t, y)[0]
    except (InputError, FitError):
        return None
    left, beside = (float(fit.residuals @ fit.residuals) for fit in (one.fit, two))
    further = len(two.names) - len(one.fit.names)
    return None if evident(left, beside, len(t), further, float(y @ y)) else one


def _together(modes: Sequence[DecayFit], t: Array, y: Array) -> tuple[Fit, list[tuple[int, ...]]]:
    """Return the fit of modes at once, and the positions of the unknowns of each."""
    unknowns: list[Unknown] = []
    columns = []
    for position, mode in enumerate(modes, start=1):
        own = started(mode.fit.unknowns, mode.fit.estimates)
        columns.append(tuple(range(len(unknowns), len(unknowns) + len(own))))
        unknowns += [replace(u, name=f"{u.name}_{position}") for u in own]
    τ = t - t[0]

    def residuals(*x: cs.MX) -> cs.MX:
        curves = [mode.model.curve(τ, *(x[i] for i in own)) for mode, own in zip(modes, columns, strict=True)]
        return sum(curves, -cs.MX(cs.DM(y)))

    advice = "fit fewer modes, or check the time of the release"
    return least_squares(residuals, unknowns, series=[len(t)], times=τ, advice=advice), columns


def _rate(fit: DecayFit) -> float:
    """Return the decay rate of a mode, 1/s."""
    return fit.values["damping_ratio"] * 2 * math.pi * fit.values["frequency"]
