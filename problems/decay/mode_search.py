"""Search for the modes of a record: repeatedly, the strongest oscillation in the residuals of the modes found so far.

If modes were subtracted one by one, a mode fitted beside stronger ones would leave residuals at its own frequency.  All
modes found are therefore fitted at once before the next one is sought.  An oscillation that is no separate mode changes
what is subtracted: a moving mode is subtracted with its frequency against amplitude and its harmonics; other
oscillations are subtracted as fitted.  Noise is subtracted only to find the next oscillation, not before fits: with
less noise, more oscillations would seem to be modes.  Finally, modes that fade at once beside the others are omitted.

An oscillation beside the modes found is no separate mode in three cases.

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
misfit of the other modes would hide it.

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
from problems.decay.solution import fit_record, fit_several_modes

MOVING_LAWS: tuple[FrequencyLaw, ...] = ("logarithmic", "power")
HARMONICS = (2, 3, 4, 5)
# Tests that fail if this is halved: test_a_mode_weaker_than_several_peaks_of_the_noise_is_found.  More take longer.
MAX_REFUSALS = 6  # oscillations in a row that are no modes, after which the search ends


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
    def residuals(self) -> Array:
        """Values less all oscillations found."""
        explained = [*self.curves, *self.harmonics.values(), self.other, self.noise]
        return np.asarray(self.values - np.sum(explained, axis=0))

    def add(self, mode: DecayFit) -> str:
        """Classify an oscillation of the residuals; return the reason if it is no mode and belongs to none."""
        t = self.time
        if not is_lasting(mode):
            return self._subtract_other(
                mode,
                f"the remainder near {mode.frequency:.4g} Hz, with a damping ratio of {mode.damping_ratio:.2g}, is not "
                "a mode; another law or a drift may explain it",
            )
        nearest = min(range(len(self.modes)), key=lambda k: abs(self.modes[k].frequency - mode.frequency))
        is_close = is_near(self.modes[nearest], mode)
        if is_close:
            moving_mode = fit_moving_mode(self.modes[nearest], mode, t, self.residuals + self.curves[nearest])
            if moving_mode is not None:
                return self._update_mode(nearest, mode, moving_mode)
        orders = [(k, order) for k, found_mode in enumerate(self.modes) if (order := harmonic_order(found_mode, mode))]
        if not (is_close or orders or mode_is_visible(mode)):  # alone: no misfit of a mode shapes the rest there
            return self._subtract_noise(mode)
        try:
            joint = fit_several_modes([*self.shapes, mode], t, self.values - self.other - sum(self.harmonics.values()))
        except FitError:
            joint = None
        if joint is not None and not mode_is_visible(joint[-1]):
            return self._subtract_noise(mode)
        if any(self._subtract_harmonic(k, order, mode) for k, order in orders):
            return ""
        if joint is None:
            return self._subtract_other(
                mode, f"the remainder near {mode.frequency:.4g} Hz cannot be distinguished from the modes"
            )
        self.modes.append(mode)
        self.shapes.append(mode)
        self.curves = [joint_mode.displacement(t) for joint_mode in joint]
        return ""

    def _subtract_other(self, mode: DecayFit, reason: str) -> str:
        """Subtract an oscillation that is no mode."""
        self.other = self.other + mode.displacement(self.time)
        return reason

    def _subtract_noise(self, mode: DecayFit) -> str:
        """Subtract an oscillation from the residuals that are searched, but not from the values that are fitted."""
        self.noise = self.noise + mode.displacement(self.time)
        return f"the remainder is noise, for example near {mode.frequency:.4g} Hz"

    def _update_mode(self, nearest: int, second: DecayFit, moving_mode: DecayFit) -> str:
        """Subtract a mode with a frequency that depends on amplitude; its harmonics follow it."""
        mode = self.modes[nearest]
        if self.shapes[nearest] is mode:
            self.notes.append(
                f"one mode near {mode.frequency:.4g} Hz: a second one at {second.frequency:.4g} Hz would imitate a "
                "frequency that depends on amplitude; fit the mode with a frequency law"
            )
        elif not explains_more(moving_mode, self.residuals, self.curves[nearest]):
            return self._subtract_other(second, f"the remainder near {mode.frequency:.4g} Hz belongs to the mode there")
        self.shapes[nearest], self.curves[nearest] = moving_mode, moving_mode.displacement(self.time)
        for k, order in self.harmonics:
            if k == nearest:
                residuals = self.residuals + self.harmonics[k, order]
                self.harmonics[k, order] = fit_harmonic(moving_mode, order, self.time, residuals)
        return ""

    def _subtract_harmonic(self, k: int, order: int, mode: DecayFit) -> bool:
        """Subtract an oscillation as the harmonic of mode k; return False if it is evident as a mode of its own."""
        residuals = self.residuals + self.harmonics.get((k, order), 0.0)
        curve = fit_harmonic(self.shapes[k], order, self.time, residuals)
        if not harmonic_suffices(
            residuals - curve, self.residuals - mode.displacement(self.time), mode, self.curves[k]
        ):
            return False
        if (k, order) not in self.harmonics:
            self.notes.append(
                f"the oscillation at {mode.frequency:.4g} Hz is not a mode but harmonic {order} of the mode near "
                f"{self.modes[k].frequency:.4g} Hz, whose phase and amplitude it follows; a nonlinear sensor or a "
                "large motion causes it"
            )
        self.harmonics[k, order] = curve
        return True


def search_modes(record: Measurement, limit: int, offset: bool, release: float | None) -> tuple[ModeSearch, str]:
    """Return up to ``limit`` modes, and the reason if there are fewer."""
    strongest = _fit_strongest(record, offset, release)
    t = strongest.time
    search = ModeSearch(
        t, strongest.measured, [strongest], [strongest], [strongest.displacement(t)], *np.zeros((2, len(t)))
    )
    refusals, reason = 0, ""
    while len(search.modes) < limit and refusals < MAX_REFUSALS:
        try:
            mode = _fit_strongest(Measurement(t, search.residuals, sensor=record.sensor), False, float(t[0]))
        except (InputError, FitError) as error:
            reason = reason or f"the rest {str(error).removeprefix('record: ')}"
            break
        reason = search.add(mode)
        refusals = refusals + 1 if reason else 0
    incomplete = len(search.modes) < limit
    return search, f"the record supports {len(search.modes)} of {limit} modes: {reason}" if incomplete else ""


def _fit_strongest(record: Measurement, offset: bool, release: float | None) -> DecayFit:
    """Return the fit of the strongest mode alone."""
    return fit_record(record, DecayModel("linear", "constant" if offset else "zero"), release_time=release)


def is_lasting(mode: DecayFit) -> bool:
    """Return whether an oscillation lasts for some periods."""
    rate, length = decay_rate(mode), float(mode.time[-1] - mode.time[0])
    duration = min(length, math.log(20) / rate if rate > 0.0 else math.inf)  # until a twentieth is left
    return bool(mode.frequency * duration >= MIN_PERIODS)


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


def fit_moving_mode(first: DecayFit, second: DecayFit, t: Array, y: Array) -> DecayFit | None:
    """Return the fit of one mode with a frequency that depends on amplitude; None if two modes are evident."""
    one_mode = fit_amplitude_dependent(first, t, y)
    if one_mode is None:
        return None
    try:
        two_modes, _ = fit_several_modes([first, second], t, y)
    except FitError:
        return one_mode
    one_mode_misfit, two_mode_misfit = (float(fit.residuals @ fit.residuals) for fit in (one_mode, two_modes))
    samples = min(effective_samples(two_modes), effective_samples(one_mode))
    added_unknowns = len(two_modes.fit.names) - len(one_mode.fit.names)
    squares = one_mode_misfit, two_mode_misfit
    return None if larger_model_is_evident(*squares, samples, added_unknowns, float(y @ y)) else one_mode


def explains_more(mode: DecayFit, residuals: Array, curve: Array) -> bool:
    """Return whether another fit of a mode is evident beside the present one with its curve and residuals."""
    new = residuals + curve - mode.displacement(mode.time)
    squares = float(residuals @ residuals), float(new @ new)
    return larger_model_is_evident(*squares, effective_samples(mode), 0, float(curve @ curve))


def effective_samples(fit: DecayFit) -> float:
    """Return the number of samples with white noise that would determine a mode as well."""
    return float(fit.fit.effective_samples * fit.samples / fit.fitted_samples)


def fit_amplitude_dependent(mode: DecayFit, t: Array, y: Array) -> DecayFit | None:
    """Return a mode with a frequency and a damping ratio that depend on amplitude; None if it cannot be fitted."""
    record, fits = Measurement(t, y, sensor=mode.model.sensor), []
    for law in MOVING_LAWS:
        model = DecayModel("friction", mode.model.rest, law)
        try:
            fits.append(fit_record(record, model, release_time=float(t[0])))
        except (InputError, FitError):
            continue
        if fits[-1].fit.noise.white:
            break  # the other law could not leave less than noise
    return min(fits, key=lambda fit: fit.residual_rms, default=None)


def harmonic_order(mode: DecayFit, other: DecayFit) -> int | None:
    """Return the order of the harmonic of a mode that another, weaker one may be; None if it cannot be one."""
    order = round(other.frequency / mode.frequency)
    is_near = abs(other.frequency - order * mode.frequency) <= SAME_MODE_DISTANCE * order * mode.frequency
    return order if order in HARMONICS and is_near and mode.amplitude > other.amplitude else None


def fit_harmonic(mode: DecayFit, order: int, t: Array, residuals: Array) -> Array:
    """Return the curve of a harmonic of a mode that fits the residuals best."""
    f = np.fft.fftfreq(len(t), (t[-1] - t[0]) / (len(t) - 1)) / mode.frequency
    correction = np.fft.ifft(2 * np.fft.fft(residuals) * ((f > 0.5) & (f < 1.5)))
    values = mode.fit.estimates
    z, quarter_behind = (
        mode.decay.at(t - t[0], values | {"phase": values["phase"] - shift}) - mode.offset for shift in (0.0, np.pi / 2)
    )
    z = z + 1j * quarter_behind
    curves = []
    for z_estimate in (z, z + correction):
        power = (z_estimate / mode.amplitude) ** order
        columns = np.column_stack([power.real, power.imag])
        curves.append(columns @ np.linalg.lstsq(columns, residuals)[0])
    return min(curves, key=lambda curve: float(np.sum((residuals - curve) ** 2)))


def harmonic_suffices(harmonic_residuals: Array, mode_residuals: Array, mode: DecayFit, fundamental: Array) -> bool:
    """Return whether a mode is not evident beside a harmonic, from the residuals of either."""
    squares = float(harmonic_residuals @ harmonic_residuals), float(mode_residuals @ mode_residuals)
    return not larger_model_is_evident(*squares, effective_samples(mode), 2, float(fundamental @ fundamental))
