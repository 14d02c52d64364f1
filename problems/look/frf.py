"""Options of ``fit-frf`` that the user has chosen on the page, and the functions, poles and fit that belong to them."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

from ancf_casadi.exceptions import InputError
from ancf_casadi.response.linear_frf import FrfKind
from ancf_casadi.support.inputs import shown
from problems.frf.fitting import fit_frf
from problems.frf.record import FrfRecord
from problems.frf.result import FrfFit
from problems.frf.selection import StabilityChart, stability_chart
from problems.look.choices import DIGITS, CommandOptions, option_words


@dataclass(frozen=True)
class FrfChoices(CommandOptions):
    """Options of ``fit-frf`` by their names; None where the user has left the default."""

    files: tuple[str, ...]
    kind: FrfKind | None = None
    column: str | None = None
    phase: str | None = None
    unit: str | None = None
    phase_unit: str | None = None
    modes: int | None = None
    frequencies: tuple[float, ...] | None = None  # Hz
    band: tuple[float, float] | None = None  # Hz

    def command(self) -> str:
        """Return the command line that fits the same."""
        return shlex.join(["ancf-casadi", "fit-frf", *self.files, *option_words(self.options())])


def comma_numbers(text: str) -> tuple[float, ...] | None:
    """Return numbers separated by commas; None for an empty text."""
    try:
        return tuple(map(float, text.split(","))) if text.strip() else None
    except ValueError:
        raise InputError(f"must be numbers separated by commas, got {shown(text)}", "frequencies") from None


def choose_pole(choices: FrfChoices, modes: Sequence[float], chart: StabilityChart, pole: int) -> FrfChoices:
    """Return choices with the modes that are shown (Hz), and a pole of the chart, or without the mode that it is."""
    matches = chart.matches(pole, modes)
    chosen = [f for f, is_pole in zip(modes, matches, strict=True) if not is_pole]
    if not matches.any():
        chosen.append(float(chart.frequencies[pole]))
    frequencies = tuple(sorted({float(f"{f:.{DIGITS}g}") for f in chosen}))
    return replace(choices, frequencies=frequencies or None, modes=None)


def frf_record(choices: FrfChoices) -> FrfRecord:
    """Return the functions in the chosen files, at all frequencies."""
    return _frf_record(replace(choices, modes=None, frequencies=None, band=None))


@lru_cache(1)
def _frf_record(choices: FrfChoices) -> FrfRecord:
    keys = {name: getattr(choices, name) for name in ("column", "phase", "unit", "phase_unit")}
    records = [FrfRecord.from_file(path, choices.kind, **keys) for path in choices.files]
    return records[0] if len(records) == 1 else FrfRecord.stacked(records)


def frf_poles(choices: FrfChoices) -> StabilityChart:
    """Return the poles of the functions in the chosen band."""
    return _poles(replace(choices, modes=None, frequencies=None))


@lru_cache(1)
def _poles(choices: FrfChoices) -> StabilityChart:
    record = frf_record(choices)
    return stability_chart(record if choices.band is None else record.between(*choices.band))


@lru_cache(1)
def fit_modes(choices: FrfChoices) -> FrfFit:
    """Fit the chosen modes to the functions as ``fit-frf`` does."""
    return fit_frf(frf_record(choices), modes=choices.modes, frequencies=choices.frequencies, band=choices.band)
