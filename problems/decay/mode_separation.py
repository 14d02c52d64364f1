"""Fit of several modes to one free decay, and the mode within a band of frequencies.

Under linear damping the modes of a beam are independent, and a record is their sum and an offset,

    y(t) = d + sum_k r_k(t),    r_k of Eq. (9) with omega_k, zeta_k, and an amplitude and a phase.

``mode_search`` finds the modes, and refuses oscillations that are no modes of their own.

The mode within a band of frequencies follows likewise.  A band-pass filter would colour the noise, ring at the release
and shift it, and would make the standard errors too small.  Instead, modes are fitted at once until the residuals show
no other oscillation outside the band.  All but the wanted one are subtracted from the record, and the rest can be
fitted with any law.  The subtracted modes are then taken as known.  With decay rates sigma = zeta omega, this neglects
correlations of about (sigma_1 + sigma_2)/|omega_1 - omega_2|, so that close modes give a warning.

References
----------
"Comparison of external damping models in a large deformation problem", Eq. (9), (10).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import flag, number, physical, vector, whole
from ancf_casadi.support.interrupts import lasting_interrupts
from ancf_casadi.support.tables import Displayed
from problems.decay.free_decay import clean_record
from problems.decay.limitations import residual_oscillation
from problems.decay.mode_search import (
    ModeSearch,
    decay_rate,
    explains_more,
    fit_amplitude_dependent,
    is_lasting,
    search_modes,
)
from problems.decay.result import DecayFit
from problems.decay.solution import fit_several_modes
from problems.decay.takes import DecayModes

MAX_DECAY_MODES = 6  # fitted at once if no number is given


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
        others = ", ".join(f"{mode.frequency:.4g}" for mode in self.others)
        return f"{self.mode.frequency:.4g} Hz{others and f', without {others} Hz'}, {self.record!r}"


@lasting_interrupts()
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
    time, displacement, release_time
        As in ``fit_decay``.
    modes : int, optional
        Largest number of modes; as many as the record supports, up to six, if not given.
    offset : bool
        Whether the equilibrium may differ from 0.

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
    record = clean_record(time, displacement)
    max_modes = max(1, len(record.time) // 5)  # four unknowns and one degree of freedom per mode
    limit = min(MAX_DECAY_MODES, max_modes) if modes is None else whole(modes, "modes", 1, max_modes)
    release = None if release_time is None else number(release_time, "release_time")
    search, end_reason = search_modes(record, limit, flag(offset, "offset"), release)
    notes = [*record.warnings, *search.notes, *([] if modes is None or not end_reason else [end_reason])]
    settings: dict[str, Any] = {"modes": modes, "offset": offset, "release_time": release_time}
    fits = _fit_all_modes(search, notes, settings)
    return DecayModes(fits[0].fit, fits, again=partial(fit_modes, **settings))


@lasting_interrupts()
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
    for count in range(1, MAX_DECAY_MODES + 1):
        try:
            modes = fit_modes(record, modes=count, release_time=release_time)
        except InputError:
            if count == 1:
                raise
            break
        if len(modes) <= len(fits):
            break
        fits = modes
        modes_in_band = [fit for fit in fits if low <= fit.frequency <= high]
        next_oscillation = residual_oscillation(fits[0])
        if next_oscillation is None or (modes_in_band and low <= next_oscillation.ω / (2 * math.pi) <= high):
            break
    if not modes_in_band:
        frequencies = ", ".join(f"{fit.frequency:.4g}" for fit in fits)
        raise InputError(f"no mode is within {low:g} to {high:g} Hz; those found are at {frequencies} Hz", "band")
    mode = max(modes_in_band, key=lambda fit: fit.amplitude)
    other_modes = tuple(fit for fit in fits if fit is not mode)
    values = mode.measured - np.sum(_curves(other_modes, mode), axis=0)
    # correlation of two modes beyond which there is a warning; the errors are then 5 % too small
    warnings = [
        f"the modes at {mode.frequency:.4g} and {neighbour.frequency:.4g} Hz are close, and the latter is subtracted "
        "as if it were known: the standard errors are too small; fit all modes at once"
        for neighbour in other_modes
        if decay_rate(mode) + decay_rate(neighbour) > 0.3 * 2 * math.pi * abs(mode.frequency - neighbour.frequency)
    ]
    return IsolatedMode(
        mode, other_modes, Measurement(mode.time, values, record.name, record.sensor, record.warnings), tuple(warnings)
    )


def _curves(modes: Sequence[DecayFit], in_band: DecayFit) -> list[Array]:
    """Return the curves of modes beside one in a band; where it is evident, they depend on amplitude."""
    t = in_band.time
    curves = [fit.displacement(t) for fit in modes]
    residuals = in_band.measured - in_band.displacement(t) - np.sum(curves, axis=0)
    for k, fit in enumerate(modes):
        moving_mode = fit_amplitude_dependent(fit, t, residuals + curves[k])
        if moving_mode is not None and explains_more(moving_mode, residuals, curves[k]):
            residuals = residuals + curves[k]
            curves[k] = moving_mode.displacement(t)
            residuals = residuals - curves[k]
    return curves


def _fit_all_modes(search: ModeSearch, notes: Sequence[str], settings: Mapping[str, Any]) -> tuple[DecayFit, ...]:
    """Return the fits of all modes in the order of frequency, less those that fade at once beside the others."""
    modes, strongest = sorted(search.modes, key=lambda mode: mode.frequency), search.modes[0]
    while True:
        fits = [
            replace(
                fit,
                decay=replace(fit.decay, guess=strongest.decay.guess, notes=tuple(notes)),
                again=partial(_refit_mode, frequency=mode.frequency, **settings),
            )
            for mode, fit in zip(modes, fit_several_modes(modes, search.time, search.values), strict=True)
        ]
        lasting_modes = [mode for mode, fit in zip(modes, fits, strict=True) if mode is strongest or is_lasting(fit)]
        if len(lasting_modes) == len(modes):
            return tuple(sorted(fits, key=lambda fit: fit.frequency))
        faded = [mode.frequency for mode in modes if mode not in lasting_modes]
        notes = [
            *notes,
            *(
                f"the oscillation near {f:.4g} Hz is not a mode: fitted with the others, it decays within two periods"
                for f in faded
            ),
        ]
        modes = lasting_modes


def _refit_mode(record: Measurement, *, frequency: float, **settings: Any) -> DecayFit:
    """Return the mode of a record whose frequency (Hz) is closest to another one."""
    return min(fit_modes(record, **settings), key=lambda fit: abs(fit.frequency - frequency))
