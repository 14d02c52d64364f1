"""The record and the fit that belong to what a user has chosen, by the public functions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ancf_casadi.decay.envelope import DampingCurve, LawCurve
from ancf_casadi.estimation.comparison import LawComparison
from ancf_casadi.exceptions import AncfError, InputError
from ancf_casadi.records.channel import Recording
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.over_frequency import is_over_frequency
from ancf_casadi.records.processing import amplitude_spectrum
from ancf_casadi.records.reading.formats import read_contents
from ancf_casadi.records.recording import with_times
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.arrays import Array
from problems.decay.fitting import fit_decays, fit_or_compare
from problems.decay.law_curve import law_curve, measured_curve
from problems.decay.mode_separation import isolate_mode
from problems.decay.result import DecayFit
from problems.decay.takes import DecayFits
from problems.look.choices import Choices, Takes

MOST_TAKES = 32  # whose fits are kept
AMPLITUDES = 60  # at which the page shows frequency and damping ratio
LEAST_SHOWN = 0.0005  # probability of a law; the report has all


@dataclass(frozen=True, eq=False)
class DecayView:
    """A fitted decay, as the page shows it."""

    fit: DecayFit
    report: str
    curve: LawCurve  # frequency and damping ratio against amplitude, with bands
    windows: DampingCurve | None  # the same without a law; None if the record is too short
    laws: Mapping[str, LawCurve]  # the same under each of several laws, by name and probability


@lru_cache(8)
def contents(file: str) -> Recording:
    """Return the columns of a file, read once."""
    return read_contents(file)


def over_frequency(files: Sequence[str]) -> bool:
    """Return whether all files hold functions over frequency; what cannot be read, or is a study, holds none."""
    if any(Path(file).suffix.lower() == ".toml" for file in files):
        return False
    try:
        return all(is_over_frequency(contents(file)) for file in files)
    except AncfError:
        return False


def recording(choices: Choices) -> Recording:
    """Return the columns of the chosen file with their times."""
    return with_times(
        contents(choices.file), time=choices.time, time_unit=choices.time_unit, sample_rate=choices.sample_rate
    )


def whole_record(choices: Choices) -> Measurement:
    """Return the chosen channel."""
    sensor = None if choices.sensor is None else Sensor(choices.sensor)  # type: ignore[arg-type]
    return Measurement.from_recording(recording(choices), choices.column, unit=choices.unit, sensor=sensor)


def spectrum(record: Measurement) -> tuple[Array, Array]:
    """Return frequencies (Hz) and amplitudes of a record, by linear interpolation at even times."""
    grid = np.linspace(record.time[0], record.time[-1], record.time.size)
    return amplitude_spectrum(grid, np.interp(grid, record.time, record.values))


def chosen_part(choices: Choices) -> tuple[Measurement, float | None]:
    """Return the chosen part of the record, and its release time (s), if it is known; a band leaves its mode alone."""
    record = whole_record(choices).cut(choices.begin, choices.end)
    if choices.band is None:
        return record, choices.release_time
    isolated = isolate_mode(record, choices.band, release_time=choices.release_time)
    return isolated.record, isolated.mode.release_time


@lru_cache(MOST_TAKES)
def fit_chosen(choices: Choices) -> DecayView:
    """Fit the chosen part of the record as ``fit-decay`` does."""
    record, release_time = chosen_part(choices)
    result = fit_or_compare(record, _laws(choices), release_time=release_time, robust=choices.robust)
    fit = result.best if isinstance(result, LawComparison) else result
    amplitudes = np.geomspace(*fit.amplitude_range, AMPLITUDES)
    curves: dict[str, LawCurve] = {}
    if isinstance(result, LawComparison):
        for (name, probability), candidate in zip(result.probabilities.items(), result.fits, strict=True):
            if probability >= LEAST_SHOWN:
                curves[f"{name} {100 * probability:.1f} %"] = law_curve(candidate, amplitudes)
    return DecayView(fit, result.report(), law_curve(result, amplitudes), measured_curve(fit), curves)


@lru_cache(1)
def compare_takes(takes: Takes) -> DecayFits:
    """Fit the chosen parts of takes at once and each alone, as ``fit-decay`` does with several files."""
    laws = _laws(takes[0])
    if "auto" in laws.values():
        raise InputError("compares sums of squares on one record; choose a law to compare takes", "auto")
    records, known_times = zip(*map(chosen_part, takes), strict=True)
    release_times = None
    if any(time is not None for time in known_times):
        release_times = [fit_chosen(take).fit.release_time for take in takes]
    settings: dict[str, Any] = {name: law or "constant" for name, law in laws.items()}
    return fit_decays(records, release_times=release_times, robust=takes[0].robust, **settings)


def _laws(choices: Choices) -> dict[str, str | None]:
    """Return the laws by the names of their options; None for the default of one that depends on the law."""
    return {"law": choices.law or "linear", "frequency_law": choices.frequency_law, "rest": choices.rest}
