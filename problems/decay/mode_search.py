"""Search for the modes of a record: the strongest oscillation in what the modes found so far leave, again and again.

If modes were subtracted one by one, a mode fitted beside stronger ones would leave a rest at its own frequency.  All
modes found are therefore fitted at once before the next one is sought.  An oscillation that is no mode of its own
changes what is subtracted: a mode that moves is subtracted with its frequency against amplitude and its harmonics; the
others are subtracted as they are.  Noise is subtracted only to find the next oscillation: beside less than all of the
noise, more would seem to be modes.  At last, modes that fade at once beside the others are left out.

An oscillation that is found beside known modes is none of its own in three cases.

Moving mode.  A mode whose frequency depends on its amplitude leaves an oscillation close to its frequency.  Two modes
under linear damping must be evident (``ancf_casadi.decay.bic``) beside one mode with friction, linear and
quadratic damping, and a frequency that is logarithmic in the amplitude or changes with a power of it.  The samples
count as the number of those with white noise that would determine the modes as well.

Harmonic.  A nonlinear sensor or a large motion adds harmonics to a mode A cos(phi), c_n A^n cos(n phi + psi_n).  With
z = A exp(i phi), these are Re(k z^n) with one complex constant k.  The mode as fitted gives z.  If the law of the mode
does not hold exactly, the band from a half to three halves of its frequency in the residuals corrects z.  A mode with
a frequency and a damping ratio of its own must be evident beside the better of the two harmonics.

Noise.  The amplitude of a mode must be visible beside its standard error, which allows for the colour of the noise, in
the fit with all other modes.  A mode far from the others and their harmonics must be visible alone, too; near them, the
rest holds what the fit of one mode has missed, and would hide it.

References
----------
Y. C. Pati, R. Rezaiifar, P. S. Krishnaprasad, Orthogonal matching pursuit, 27th Asilomar Conference on Signals, Systems
and Computers (1993).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from ancf_casadi.decay.bic import is_visible, larger_model_is_evident
from ancf_casadi.decay.first_guess import SAME_MODE_DISTANCE
from ancf_casadi.decay.phase import FrequencyLaw
from ancf_casadi.decay.release import MIN_PERIODS
from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Array
from problems.decay.laws import DecayModel
from problems.decay.result import DecayFit
from problems.decay.solution import curve_at, fit_one, together

MOVING_LAWS: tuple[FrequencyLaw, ...] = ("logarithmic", "power")
HARMONICS = (2, 3, 4, 5)
# Tests that fail if this is halved: test_a_mode_weaker_than_several_peaks_of_the_noise_is_found.  More take longer.
MOST_REFUSED = 6  # oscillations in a row that are no modes, after which the search ends


@dataclass(eq=False)
class ModeSearch:
    """The modes found so far, and what else a record holds."""

    time: Array
    values: Array
    modes: list[DecayFit]  # each fitted alone under linear damping, to what the modes before left
    shapes: list[DecayFit]  # the modes as they are subtracted: those that move with a frequency law
    curves: list[Array]  # of the shapes
    other: Array  # oscillations that are no modes
    noise: Array  # oscillations that are noise
    harmonics: dict[tuple[int, int], Array] = field(default_factory=dict)  # by position of the mode and order
    notes: list[str] = field(default_factory=list)

    @property
    def rest(self) -> Array:
        """Values less all that was found."""
        found = [*self.curves, *self.harmonics.values(), self.other, self.noise]
        return np.asarray(self.values - np.sum(found, axis=0))

    def add(self, mode: DecayFit) -> str:
        """Take an oscillation of the rest as a mode, or as a part of one; return the reason if it is neither."""
        t = self.time
        if not lasts(mode):
            return self._set_aside(
                mode,
                f"the rest, near {mode.frequency:.4g} Hz with a damping ratio of {mode.damping_ratio:.2g}, is no mode; "
                "another law or a drift may explain it",
            )
        near = min(range(len(self.modes)), key=lambda k: abs(self.modes[k].frequency - mode.frequency))
        close = is_near(self.modes[near], mode)
        if close:
            one = single(self.modes[near], mode, t, self.rest + self.curves[near])
            if one is not None:
                return self._move(near, mode, one)
        orders = [(k, order) for k, known in enumerate(self.modes) if (order := harmonic_order(known, mode))]
        if not (close or orders or mode_is_visible(mode)):  # alone: no misfit of a mode shapes the rest there
            return self._as_noise(mode)
        try:
            joint = together([*self.shapes, mode], t, self.values - self.other - sum(self.harmonics.values()))
        except FitError:
            joint = None
        if joint is not None and not mode_is_visible(joint[-1]):
            return self._as_noise(mode)
        if any(self._is_harmonic(k, order, mode) for k, order in orders):
            return ""
        if joint is None:
            return self._set_aside(mode, f"the rest near {mode.frequency:.4g} Hz cannot be told apart from the modes")
        self.modes.append(mode)
        self.shapes.append(mode)
        self.curves = [one.displacement(t) for one in joint]
        return ""

    def _set_aside(self, mode: DecayFit, reason: str) -> str:
        """Subtract an oscillation that is no mode."""
        self.other = self.other + mode.displacement(self.time)
        return reason

    def _as_noise(self, mode: DecayFit) -> str:
        """Subtract an oscillation from what is searched, but not from what is fitted."""
        self.noise = self.noise + mode.displacement(self.time)
        return f"the rest is noise, as near {mode.frequency:.4g} Hz"

    def _move(self, near: int, second: DecayFit, one: DecayFit) -> str:
        """Subtract a mode with a frequency that depends on amplitude; its harmonics follow it."""
        mode = self.modes[near]
        if self.shapes[near] is mode:
            self.notes.append(
                f"one mode near {mode.frequency:.4g} Hz: a second one at {second.frequency:.4g} Hz would imitate a "
                "frequency that depends on amplitude; fit the mode with a frequency law"
            )
        elif not is_better(one, self.rest, self.curves[near]):
            return self._set_aside(second, f"the rest near {mode.frequency:.4g} Hz belongs to the mode there")
        self.shapes[near], self.curves[near] = one, one.displacement(self.time)
        for k, order in self.harmonics:
            if k == near:
                self.harmonics[k, order] = harmonic(one, order, self.time, self.rest + self.harmonics[k, order])
        return ""

    def _is_harmonic(self, k: int, order: int, mode: DecayFit) -> bool:
        """Take an oscillation as a harmonic of a mode if nothing speaks against it."""
        rest = self.rest + self.harmonics.get((k, order), 0.0)
        curve = harmonic(self.shapes[k], order, self.time, rest)
        if not is_harmonic(rest - curve, self.rest - mode.displacement(self.time), mode, self.curves[k]):
            return False
        if (k, order) not in self.harmonics:
            self.notes.append(
                f"the oscillation at {mode.frequency:.4g} Hz is no mode but harmonic {order} of the mode near "
                f"{self.modes[k].frequency:.4g} Hz, whose phase and amplitude it follows; a nonlinear sensor or a "
                "large motion causes it"
            )
        self.harmonics[k, order] = curve
        return True


def search_modes(record: Measurement, limit: int, offset: bool, release: float | None) -> tuple[ModeSearch, str]:
    """Return up to ``limit`` modes, and the reason if there are fewer."""
    first = _strongest(record, offset, release)
    t, y = first.time, record.values[-first.samples :]
    found = ModeSearch(t, y, [first], [first], [first.displacement(t)], *np.zeros((2, len(t))))
    refused, reason = 0, ""
    while len(found.modes) < limit and refused < MOST_REFUSED:
        try:
            mode = _strongest(Measurement(t, found.rest, sensor=record.sensor), False, float(t[0]))
        except (InputError, FitError) as error:
            reason = reason or f"the rest {str(error).removeprefix('record: ')}"
            break
        reason = found.add(mode)
        refused = refused + 1 if reason else 0
    missing = len(found.modes) < limit
    return found, f"the record supports {len(found.modes)} of {limit} modes: {reason}" if missing else ""


def _strongest(record: Measurement, offset: bool, release: float | None) -> DecayFit:
    """Return the fit of the strongest mode alone."""
    return fit_one(record, DecayModel("linear", "constant" if offset else "zero"), release_time=release)


def lasts(mode: DecayFit) -> bool:
    """Return whether an oscillation lasts for some periods."""
    rate, length = decay_rate(mode), float(mode.time[-1] - mode.time[0])
    lasts = min(length, math.log(20) / rate if rate > 0.0 else math.inf)  # until a twentieth is left
    return bool(mode.frequency * lasts >= MIN_PERIODS)


def decay_rate(mode: DecayFit) -> float:
    """Return the decay rate of a mode, 1/s."""
    return mode.values["damping_ratio"] * 2 * math.pi * mode.values["frequency"]


def mode_is_visible(mode: DecayFit) -> bool:
    """Return whether a mode stands out of the noise, with its colour, beside the modes fitted with it."""
    k = next(k for k in mode.indices if mode.fit.names[k].startswith("e0"))
    return bool(is_visible(mode.fit.values[k], mode.fit.errors[k], mode.samples))


def is_near(first: DecayFit, second: DecayFit) -> bool:
    """Return whether two modes are so close that they may be one."""
    return bool(abs(first.frequency - second.frequency) <= SAME_MODE_DISTANCE * first.frequency)


def single(first: DecayFit, second: DecayFit, t: Array, y: Array) -> DecayFit | None:
    """Return one mode with a frequency that depends on amplitude; None if two modes explain the values better."""
    one = _moving(first, t, y)
    if one is None:
        return None
    try:
        two, _ = together([first, second], t, y)
    except FitError:
        return one
    left, beside = (float(fit.residuals @ fit.residuals) for fit in (one, two))
    samples = min(effective_samples(two), effective_samples(one))
    further = len(two.fit.names) - len(one.fit.names)
    return None if larger_model_is_evident(left, beside, samples, further, float(y @ y)) else one


def is_better(mode: DecayFit, rest: Array, curve: Array) -> bool:
    """Return whether another fit of a mode clearly leaves less than the present one, with its curve and its rest."""
    left = rest + curve - mode.displacement(mode.time)
    squares = float(rest @ rest), float(left @ left)
    return larger_model_is_evident(*squares, effective_samples(mode), 0, float(curve @ curve))


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
    near = abs(other.frequency - order * mode.frequency) <= SAME_MODE_DISTANCE * order * mode.frequency
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
    return not larger_model_is_evident(*squares, effective_samples(mode), 2, float(fundamental @ fundamental))
