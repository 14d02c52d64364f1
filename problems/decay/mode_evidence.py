"""Evidence for another mode in a record: one mode or two, a harmonic, or noise.

An oscillation that is found beside known modes is none of its own in three cases.

Moving mode.  A mode whose frequency depends on its amplitude leaves an oscillation close to its frequency.  Two modes
under linear damping must be evident (``ancf_casadi.decay.evidence``) beside one mode with friction, linear and
quadratic damping, and a frequency that is logarithmic in the amplitude or changes with a power of it.  The samples
count as the number of those with white noise that would determine the modes as well.

Harmonic.  A nonlinear sensor or a large motion adds harmonics to a mode A cos(phi), c_n A^n cos(n phi + psi_n).  With
z = A exp(i phi), these are Re(k z^n) with one complex constant k.  The mode as fitted gives z.  If the law of the mode
does not hold exactly, the band from a half to three halves of its frequency in the residuals corrects z.  A mode with
a frequency and a damping ratio of its own must be evident beside the better of the two harmonics.

Noise.  The amplitude of a mode must be visible beside its standard error, which allows for the colour of the noise, in
the fit with all other modes.  A mode far from the others and their harmonics must be visible alone, too; near them, the
rest holds what the fit of one mode has missed, and would hide it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import casadi as cs
import numpy as np

from ancf_casadi.decay.evidence import evident, visible
from ancf_casadi.decay.first_guess import CLOSE
from ancf_casadi.decay.phase import FrequencyLaw
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.solver.least_squares import least_squares
from ancf_casadi.estimation.solver.unknown import Unknown, started
from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Array
from problems.decay.laws import DecayModel
from problems.decay.result import DecayFit
from problems.decay.solution import curve_at, fit_one, reduced, reduced_counts

MOVING_LAWS: tuple[FrequencyLaw, ...] = ("logarithmic", "power")
HARMONICS = (2, 3, 4, 5)


def is_visible(mode: DecayFit) -> bool:
    """Return whether the noise, with its colour, leaves a mode visible."""
    return bool(visible(mode.amplitude, mode.standard_errors["amplitude"], mode.samples))


def is_near(first: DecayFit, second: DecayFit) -> bool:
    """Return whether two modes are so close that they may be one."""
    return bool(abs(first.frequency - second.frequency) <= CLOSE * first.frequency)


def single(first: DecayFit, second: DecayFit, t: Array, y: Array) -> DecayFit | None:
    """Return one mode with a frequency that depends on amplitude; None if two modes explain the values better."""
    one = _moving(first, t, y)
    if one is None:
        return None
    try:
        two = together([first, second], t, y)
    except FitError:
        return one
    left, beside = (float(rest @ rest) for rest in (one.residuals, two.residuals))
    samples = min(two.effective_samples, effective_samples(one))
    further = len(two.fit.names) - len(one.fit.names)
    return None if evident(left, beside, samples, further, float(y @ y)) else one


def is_better(mode: DecayFit, rest: Array, curve: Array) -> bool:
    """Return whether another fit of a mode clearly leaves less than the present one, with its curve and its rest."""
    left = rest + curve - mode.displacement(mode.time)
    squares = float(rest @ rest), float(left @ left)
    return evident(*squares, effective_samples(mode), 0, float(curve @ curve))


def effective_samples(fit: DecayFit) -> float:
    """Return the number of samples with white noise that would determine a mode as well."""
    return float(fit.fit.effective_samples * fit.samples / fit.fitted_samples)


def _moving(mode: DecayFit, t: Array, y: Array) -> DecayFit | None:
    """Return a mode with a frequency and a damping ratio that depend on amplitude; None if it cannot be fitted."""
    record, found = Measurement(t, y, sensor=mode.model.sensor), []
    for law in MOVING_LAWS:
        model = DecayModel("friction", mode.model.rest, law)
        try:
            found.append(fit_one(record, model, release_time=float(t[0])))
        except (InputError, FitError):
            continue
        if found[-1].fit.noise.white:
            break  # the other law could not leave less than noise
    return min(found, key=lambda fit: fit.residual_rms, default=None)


def harmonic_order(mode: DecayFit, other: DecayFit) -> int | None:
    """Return the order of the harmonic of a mode that another, weaker one may be; None if it cannot be one."""
    order = round(other.frequency / mode.frequency)
    near = abs(other.frequency - order * mode.frequency) <= CLOSE * order * mode.frequency
    return order if order in HARMONICS and near and mode.amplitude > other.amplitude else None


def harmonic(mode: DecayFit, order: int, t: Array, rest: Array) -> Array:
    """Return the curve of a harmonic of a mode that explains the rest best."""
    f = np.fft.fftfreq(len(t), (t[-1] - t[0]) / (len(t) - 1)) / mode.frequency
    correction = np.fft.ifft(2 * np.fft.fft(rest) * ((f > 0.5) & (f < 1.5)))
    own = [mode.fit.values[i] for i in mode.indices]
    place = [mode.fit.names[i] for i in mode.indices].index("phase")
    quarter = np.arange(len(own)) == place
    z = sum(
        factor * (curve_at(mode.model, own - turn * quarter)(t - t[0]) - mode.offset)
        for factor, turn in ((1, 0.0), (1j, np.pi / 2))
    )
    curves = []
    for turning in (z, z + correction):
        power = (turning / mode.amplitude) ** order
        columns = np.column_stack([power.real, power.imag])
        curves.append(columns @ np.linalg.lstsq(columns, rest)[0])
    return min(curves, key=lambda curve: float(np.sum((rest - curve) ** 2)))


def is_harmonic(left: Array, beside: Array, mode: DecayFit, fundamental: Array) -> bool:
    """Return whether the rest after a harmonic leaves no evidence of a mode, which leaves the rest ``beside``."""
    squares = float(left @ left), float(beside @ beside)
    return not evident(*squares, effective_samples(mode), 2, float(fundamental @ fundamental))


@dataclass(frozen=True, eq=False)
class JointFit:
    """Modes that were fitted at once to values at times from the release on."""

    fit: Fit
    columns: list[tuple[int, ...]]  # positions of the unknowns of each mode
    curves: list[Array]  # of each mode
    values: Array

    @cached_property
    def residuals(self) -> Array:
        """Fitted less measured values."""
        return np.asarray(np.sum(self.curves, axis=0) - self.values)

    @property
    def effective_samples(self) -> float:
        """Number of samples with white noise that would determine the modes as well."""
        return self.fit.effective_samples * len(self.values) / len(self.fit.residuals)

    def shows(self, position: int) -> bool:
        """Return whether the noise, with its colour, leaves a mode visible beside the others."""
        place = self.fit.names.index(f"e0_{position + 1}")
        return bool(visible(self.fit.values[place], self.fit.errors[place], len(self.values)))


def together(modes: Sequence[DecayFit], t: Array, y: Array) -> JointFit:
    """Return the fit of modes at once; a long record is reduced to their band, as in ``solution``."""
    unknowns: list[Unknown] = []
    columns = []
    for position, mode in enumerate(modes, start=1):
        own = started([mode.fit.unknowns[i] for i in mode.indices], mode.fit.estimates)
        columns.append(tuple(range(len(unknowns), len(unknowns) + len(own))))
        unknowns += [replace(u, name=f"{u.name}_{position}") for u in own]
    names, decay = [u.name for u in unknowns], Measurement(t - t[0], y)
    (count,) = reduced_counts([decay], [2 * np.pi * max(mode.frequency for mode in modes)])
    values = np.array([u.guess for u in unknowns])
    for _ in range(1 + (count < len(t))):  # with the curves of the first fit, which have slopes at the ends
        parts = [curve_at(mode.model, values[list(own)]) for mode, own in zip(modes, columns, strict=True)]
        less = reduced(decay, count, partial(_sum, parts))
        fit = _at_once(modes, columns, started(unknowns, dict(zip(names, values, strict=True))), less)
        values = fit.values
    curves = [curve_at(mode.model, values[list(own)])(decay.time) for mode, own in zip(modes, columns, strict=True)]
    return JointFit(fit, columns, curves, y)


def _at_once(
    modes: Sequence[DecayFit], columns: Sequence[tuple[int, ...]], unknowns: Sequence[Unknown], decay: Measurement
) -> Fit:
    """Return the fit of modes whose unknowns have positions ``columns``."""

    def residuals(*x: cs.MX) -> cs.MX:
        curves = [mode.model.curve(decay.time, *(x[i] for i in own)) for mode, own in zip(modes, columns, strict=True)]
        return sum(curves, -cs.MX(cs.DM(decay.values)))

    advice = "fit fewer modes, or check the time of the release"
    return least_squares(residuals, unknowns, series=[len(decay.time)], times=decay.time, advice=advice)


def _sum(curves: Sequence[Callable[[Array], Array]], time: Array) -> Array:
    return np.asarray(np.sum([curve(time) for curve in curves], axis=0))
