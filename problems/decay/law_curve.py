"""Damping ratio and frequency against amplitude under the law of a fit, with 95 % bands.

The band at each amplitude is the interval of a derived quantity, to first order in the unknowns (``Fit``); it
holds for one amplitude at a time.
"""

from __future__ import annotations

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.decay.envelope import LawCurve
from ancf_casadi.estimation.intervals import CONFIDENCE_LEVEL
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.inputs import array, check_instance
from problems.decay.result import DecayFit


def law_curve(fit: DecayFit, amplitudes: ArrayLike | None = None, *, level: float = CONFIDENCE_LEVEL) -> LawCurve:
    """Return damping ratio and frequency against amplitude under the law of a fit.

    Parameters
    ----------
    fit : DecayFit
        The fit.
    amplitudes : array_like, optional
        Amplitudes (k,), in the unit of ``fit.amplitude``, positive; those between release and end of the record if not
        given.
    level : float
        Confidence level of the bands.

    Raises
    ------
    InputError
        If an amplitude is not positive, or the level is not between 0 and 1.

    Examples
    --------
    >>> import numpy as np
    >>> from problems import fit_decay, law_curve
    >>> time = np.linspace(0.0, 10.0, 1001)
    >>> noise = np.random.default_rng(0).normal(scale=1e-4, size=time.size)
    >>> y = 0.02 / (1.0 + 0.2 * time) * np.cos(12.0 * time) + noise  # quadratic damping
    >>> curve = law_curve(fit_decay(time, y, law="quadratic"), amplitudes=[0.010, 0.020])
    >>> [f"{100 * ratio:.2f} %" for ratio in curve.damping_ratio]
    ['0.83 %', '1.67 %']
    """
    check_instance(fit, "fit", DecayFit)
    if amplitudes is None:
        last = fit.displacement(fit.time[fit.time > fit.time[-1] - 1 / fit.frequency])
        per_amplitude = (2 * np.pi * fit.frequency) ** fit.model.sensor.derivatives  # of the record
        visible = max(float(np.ptp(last)) / 2, fit.residual_rms) / per_amplitude
        lowest = max(visible, fit.amplitude / 100)
        chosen = np.geomspace(min(lowest, fit.amplitude / 2), fit.amplitude, 60)
    else:
        chosen = array(amplitudes, "amplitudes").ravel()
        if not (chosen > 0.0).all():
            raise InputError(f"must be positive, got {chosen.min():g}", "amplitudes")

    def both(*x: cs.MX) -> cs.MX:
        return cs.vertcat(*fit.model.against_amplitude(chosen, *(x[i] for i in fit.indices)))

    values, ends = fit.fit.derived(both)[0], fit.fit.derived_intervals(both, level)
    ratio, frequency = np.split(values, 2)
    ratio_band, frequency_band = np.split(ends, 2)
    return LawCurve(chosen, ratio, ratio_band, frequency, frequency_band, fit.units["amplitude"])
