"""Search for the modes of a record: the strongest oscillation in what the modes found so far leave, again and again.

If modes were subtracted one by one, a mode fitted beside stronger ones would leave a rest at its own frequency.  All
modes found are therefore fitted at once before the next one is sought.  An oscillation that is no mode of its own
(``mode_evidence``) changes what is subtracted: a mode that moves is subtracted with its frequency against amplitude
and its harmonics; the others are subtracted as they are.  Noise is subtracted only to find the next oscillation: beside
less than all of the noise, more would seem to be modes.  At last, modes that fade at once beside the others are left
out.

References
----------
Y. C. Pati, R. Rezaiifar, P. S. Krishnaprasad, Orthogonal matching pursuit, 27th Asilomar Conference on Signals, Systems
and Computers (1993).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from ancf_casadi.decay.release import MINIMUM_PERIODS
from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Array
from problems.decay.laws import DecayModel
from problems.decay.mode_evidence import (
    harmonic,
    harmonic_order,
    is_better,
    is_harmonic,
    is_near,
    is_visible,
    single,
    together,
)
from problems.decay.result import DecayFit
from problems.decay.solution import fit_one

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
    moved: set[int] = field(default_factory=set)  # positions of the modes that move
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
        if not (close or orders or is_visible(mode)):  # alone: no misfit of a mode shapes the rest there
            return self._as_noise(mode)
        try:
            joint = together([*self.shapes, mode], t, self.values - self.other - sum(self.harmonics.values()))
        except FitError:
            joint = None
        if joint is not None and not joint.shows(len(self.modes)):
            return self._as_noise(mode)
        if any(self._is_harmonic(k, order, mode) for k, order in orders):
            return ""
        if joint is None:
            return self._set_aside(mode, f"the rest near {mode.frequency:.4g} Hz cannot be told apart from the modes")
        self.modes.append(mode)
        self.shapes.append(mode)
        self.curves = joint.curves
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
        if near not in self.moved:
            self.notes.append(
                f"one mode near {mode.frequency:.4g} Hz: a second one at {second.frequency:.4g} Hz would imitate a "
                "frequency that depends on amplitude; fit the mode with a frequency law"
            )
        elif not is_better(one, self.rest, self.curves[near]):
            return self._set_aside(second, f"the rest near {mode.frequency:.4g} Hz belongs to the mode there")
        self.moved.add(near)
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
    return bool(mode.frequency * lasts >= MINIMUM_PERIODS)


def decay_rate(mode: DecayFit) -> float:
    """Return the decay rate of a mode, 1/s."""
    return mode.values["damping_ratio"] * 2 * math.pi * mode.values["frequency"]
