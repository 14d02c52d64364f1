"""The mode of a record within a band of frequencies.

A band-pass filter would colour the noise, ring at the release and shift it, and would make the standard errors too
small.  Instead, modes are fitted at once, the strongest first, until the residuals show no other oscillation outside
the band.  The modes other than the wanted one are subtracted from the record, and the rest can be fitted with any law.
The subtracted modes are then taken as known.  With decay rates sigma = zeta omega, this neglects correlations of about
(sigma_1 + sigma_2)/|omega_1 - omega_2|, so that close modes give a warning.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ancf_casadi.decay.first_guess import first_guess
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.inputs import physical, vector
from ancf_casadi.support.tables import Displayed
from problems.decay.mode_separation import MOST_DECAY_MODES, fit_modes
from problems.decay.result import DecayFit


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
        inside = any(low <= fit.frequency <= high for fit in fits)
        next_one = _oscillation(fits[0])
        if next_one is None or (inside and low <= next_one <= high):
            break
    inside_band = [fit for fit in fits if low <= fit.frequency <= high]
    if not inside_band:
        known = ", ".join(f"{fit.frequency:.4g}" for fit in fits)
        raise InputError(f"no mode is within {low:g} to {high:g} Hz; those found are at {known} Hz", "band")
    return _isolated(record, max(inside_band, key=lambda fit: fit.amplitude), fits)


def _oscillation(fit: DecayFit) -> float | None:
    """Return the frequency (Hz) of an oscillation in the residuals; None if they are noise."""
    try:
        guess = first_guess(Measurement(fit.time, fit.residuals), release_time=fit.release_time)
    except InputError:
        return None
    return guess.ω / (2 * math.pi)


def _isolated(record: Measurement, mode: DecayFit, fits: Sequence[DecayFit]) -> IsolatedMode:
    others = tuple(fit for fit in fits if fit is not mode)
    values = record.values[-mode.samples :] - np.sum([fit.displacement(mode.time) for fit in others], axis=0)
    rest = Measurement(mode.time, values, record.name, record.sensor)
    # correlation of two modes beyond which there is a warning; the errors are then 5 % too small
    close = [
        f"the modes at {mode.frequency:.4g} and {other.frequency:.4g} Hz are close, and the latter is subtracted as if "
        "it were known: the standard errors are too small; fit all modes at once"
        for other in others
        if _rate(mode) + _rate(other) > 0.3 * 2 * math.pi * abs(mode.frequency - other.frequency)
    ]
    return IsolatedMode(mode, others, rest, tuple(close))


def _rate(fit: DecayFit) -> float:
    """Return the decay rate of a mode, 1/s."""
    return fit.values["damping_ratio"] * 2 * math.pi * fit.values["frequency"]
