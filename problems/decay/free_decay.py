"""A free decay: a record that is cut at its release, described, and reduced for a fit, in one object.

``clean_record`` leaves out outliers, ``cut_at_release`` finds the release and guesses the oscillation, ``about`` adds
the rest position of a model, and ``reduced`` selects the samples that a fit uses.  Later steps read the object.

A long record with even times is reduced to the band of its modes by a projection on its slowest cosines
(``ancf_casadi.records.processing``), which keeps estimates and standard errors.  The curve of a first fit is subtracted
before the projection, because the slope of the decay at the release would leave an error there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.decay.first_guess import DecayGuess, first_guess, with_rest_position
from ancf_casadi.decay.outliers import without_outliers
from ancf_casadi.decay.quantisation import rounding_errors
from ancf_casadi.decay.rest_position import REST_TERMS, Rest
from ancf_casadi.decay.spectrum import has_even_steps
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.processing import project_on_cosines, resolution
from ancf_casadi.support.arrays import Array
from problems.decay.laws import DecayModel, evaluate

MIN_REDUCED_LENGTH = 2500  # samples to which a longer record is reduced, if the band of the mode needs no more
REDUCED_PER_PERIOD = 6  # samples that this band needs
NOISE_FREE = 1e-6  # residual relative to the amplitude, below which there is no noise


def clean_record(time: Measurement | ArrayLike, displacement: ArrayLike | None = None) -> Measurement:
    """Return a record, or times (s) and displacements (m) as a record, without outliers."""
    return without_outliers(as_record(time, displacement))


def as_record(time: Measurement | ArrayLike, displacement: ArrayLike | None = None) -> Measurement:
    """Return a record, or times (s) and displacements (m) as a record."""
    if isinstance(time, Measurement) and displacement is not None:
        raise InputError("is part of the record already; leave it out", "displacement")
    if not isinstance(time, Measurement):
        if displacement is None:
            raise InputError("is missing; give it after the times, or give a Measurement", "displacement")
        time = Measurement(time, displacement)
    return time


@dataclass(frozen=True)
class DecayMode:
    """A mode of a decay: its laws, and the names of its unknowns in the fit, in the order of the laws."""

    model: DecayModel
    names: tuple[str, ...]

    def curve(self, time: Array, unknowns: Mapping[str, cs.MX]) -> cs.MX:
        """Return the motion at times (s) after the release, in the unit of the sensor, for unknowns by name."""
        return self.model.curve(time, *(unknowns[name] for name in self.names))

    def at(self, time: Array, values: Mapping[str, float]) -> Array:
        """Return the motion for values of the unknowns by name."""
        return evaluate(self.curve(time, {name: cs.MX(values[name]) for name in self.names}))


@dataclass(frozen=True, eq=False)
class FreeDecay:
    """A free decay: its record, the part from the release on, what a fit uses of it, and its modes."""

    source: Measurement  # the whole record
    guess: DecayGuess  # of the release and of the motion; ``about`` makes its amplitude that of the displacement
    record: Measurement  # all values from the release on, at the times since then
    fitted: Measurement  # those that a fit uses: all of them, or fewer in the band of the modes
    share: float = 1.0  # number of these samples over that of all
    modes: tuple[DecayMode, ...] = ()
    notes: tuple[str, ...] = ()  # limitations of the record

    def about(self, rest: Rest) -> Self:
        """Return the decay with a guess about a kind of rest position, with the amplitude of the displacement."""
        guess, derivatives = with_rest_position(self.guess, self.source, rest), self.record.sensor.derivatives
        amplitude, phase = guess.amplitude / guess.ω**derivatives, guess.phase - derivatives * math.pi / 2
        return replace(self, guess=replace(guess, amplitude=amplitude, phase=phase), notes=guess.notes)

    @property
    def time(self) -> Array:
        """Times of the record from the release on, s."""
        return self.source.time[self.guess.release :]

    @property
    def release_time(self) -> float:
        """Time of the release in the record, s."""
        return float(self.time[0])

    @cached_property
    def resolution(self) -> float:
        """Step to which the values from the release on are rounded; 0 if most of them differ."""
        return resolution(self.record.values)

    @property
    def rounding(self) -> float:
        """Systematic error that moves estimates as far as the white noise of rounding to floating-point numbers.

        Numbers with the spacing s have an error of s/12^1/2; residuals may be less, since curves are rounded alike.
        """
        return float(np.spacing(np.abs(self.fitted.values).max())) / math.sqrt(12 * len(self.fitted.time))

    @property
    def least_deviation(self) -> float:
        """Standard deviation of residuals up to which they are no noise."""
        swing = float(np.ptp(self.fitted.values)) / 2
        return math.hypot(NOISE_FREE * swing, self.rounding * math.sqrt(len(self.fitted.time)))

    def at(self, time: Array, values: Mapping[str, float]) -> Array:
        """Return the sum of the modes at times (s) after the release for values of the unknowns by name."""
        return np.asarray(np.sum([mode.at(time, values) for mode in self.modes], axis=0))

    def reduced(self, share: float, values: Mapping[str, float]) -> Self:
        """Return the decay fitted as a share of its samples: the sum of its modes, plus the projected residuals."""
        if share == 1.0:
            return replace(self, fitted=self.record, share=share)
        m = len(self.record.time)
        count = math.ceil(share * m)
        time = (m / count * (np.arange(count) + 0.5) - 0.5) * self.record.time[-1] / (m - 1)
        residuals = project_on_cosines(self.record.values - self.at(self.record.time, values), count)
        fitted = Measurement(time, self.at(time, values) + residuals, self.record.name, self.record.sensor)
        return replace(self, fitted=fitted, share=share)

    def rounding_errors(self, values: Mapping[str, float], residual_rms: float) -> Array:
        """Return the errors (m, 4) of rounding of the record to steps (``quantisation``), 0 if there are none."""
        if not self.resolution:
            return np.zeros((len(self.fitted.time), 4))
        (mode,) = self.modes
        motion_count = len(mode.names) - len(REST_TERMS[mode.model.rest])
        swing = DecayMode(replace(mode.model, rest="zero"), mode.names[:motion_count])
        amplitude = evaluate(mode.model.amplitude(self.fitted.time, *(cs.MX(values[name]) for name in mode.names)))
        sensor_amplitude = amplitude * values[mode.names[0]] ** mode.model.sensor.derivatives
        cosine = np.zeros_like(amplitude)
        np.divide(swing.at(self.fitted.time, values), sensor_amplitude, out=cosine, where=sensor_amplitude > 0.0)
        return rounding_errors(sensor_amplitude, cosine, self.resolution, residual_rms)


def cut_at_release(source: Measurement, release_time: float | None = None) -> FreeDecay:
    """Return the free decay in a record; the release is detected if its time (s) is not given."""
    guess = first_guess(source, release_time=release_time)
    time = source.time[guess.release :]
    record = Measurement(time - time[0], source.values[guess.release :], source.name, source.sensor)
    return FreeDecay(source, guess, record, record, notes=guess.notes)


def needed_share(decays: Sequence[FreeDecay]) -> float:
    """Return the share of the samples that a fit needs: all, if a decay is short or unevenly sampled.

    It is the same for all decays, because a fit takes their noise as equal.
    """
    share = 0.0
    for decay in decays:
        time = decay.record.time
        count = max(MIN_REDUCED_LENGTH, REDUCED_PER_PERIOD * decay.guess.ω * time[-1] / (2 * math.pi))
        share = max(share, count / len(time) if has_even_steps(time) else 1.0)
    return share if 2 * share < 1.0 else 1.0
