"""Functions over frequency in a file: response curves and frequency response functions.

One column holds the frequencies.  Each function has one column with its amplitude, two with amplitude and phase, or two
with real and imaginary part.  A word in the name of a column states its role; columns with the same remaining words
belong together, as in ``x_mm, x_phase_deg, y_mm, y_phase_deg`` or ``H1 real, H1 imag``; letters and digits are words of
their own, as in ``Mag1``.  A single amplitude and a single phase always belong together, and so do columns in the same
order, unless all of them have different words.

The unit of a phase must be known, because a wrong unit changes the damping unnoticed: phases without a unit count as
radians, and are refused if they exceed 2 pi.  Amplitudes in dB are 20 lg of the SI value.  The words ``rms`` and ``pp``
(peak to peak) in a name mark values that are 2^(-1/2) or 2 times the amplitude of the sine.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import (
    RecordedChannel,
    Recording,
    find_channel,
    is_counter,
    is_frequency,
    is_time,
    list_labels,
)
from ancf_casadi.records.layout import TableLayout
from ancf_casadi.records.reading.formats import read_contents
from ancf_casadi.records.units import hertz_factor, known_unit, parse_unit
from ancf_casadi.support.arrays import Array, ComplexArray
from ancf_casadi.support.inputs import check_instance, error_prefix, shown

ROLE_WORDS = {
    "phase": "phase phases phi φ ϕ arg argument angle ang ph phasenwinkel",
    "real": "real re realteil",
    "imag": "imag im imaginary imaginärteil",
    "coherence": "coherence coh gamma2 msc kohärenz",
    "level": "level levels force excitation exciting input drive driving shaker base table kraft anregung load",
    "amplitude": "amplitude amplitudes amp ampl magnitude magnitudes mag abs modulus gain betrag",
}  # words for each role; the first role with a word in the name counts
ROLES = {word: role for role, words in ROLE_WORDS.items() for word in words.split()}
SIZES = {
    "rms": math.sqrt(2.0),
    "eff": math.sqrt(2.0),
    "pp": 0.5,
    "pkpk": 0.5,
    "p2p": 0.5,
}  # word -> amplitude of a sine with such a value of 1
WHOLE_WORDS = {word for word in (*ROLES, *SIZES) if not word.isalpha()}  # such as gamma2
WORDS = re.compile(rf"(?<![^\W_])(?:{'|'.join(WHOLE_WORDS)})(?![^\W_])|[^\W\d_]+|\d+")
TURN = 2 * math.pi


@dataclass(frozen=True, eq=False)
class SpectralFunction:
    """One function over frequency, in the unit of the file."""

    channel: RecordedChannel  # that of the amplitude, or of the real part; its unit is that of the function
    values: Array | ComplexArray  # complex if the phases are known, otherwise amplitudes
    coherence: Array | None = None

    @property
    def name(self) -> str:
        """Name without the word for the part."""
        words = [word for word in self.channel.name.split() if ROLES.get(word.casefold()) not in ("real", "imag")]
        return " ".join(words)


@dataclass(frozen=True, eq=False)
class SpectralContents:
    """The columns of a file over frequency."""

    path: str
    frequencies: Array  # Hz
    columns: tuple[tuple[str, RecordedChannel], ...]  # role and column; the role is empty if no word states it
    notes: tuple[str, ...] = ()

    def only(self, option: str, roles: Sequence[str], wanted: str | int | None) -> SpectralContents:
        """Return the contents with the wanted column as the only one with one of the roles; None changes nothing."""
        if wanted is None:
            return self
        chosen = find_channel([channel for _, channel in self.columns], wanted, option, self.path)
        columns = [
            (role if role in roles else roles[0], channel) if channel is chosen else (role, channel)
            for role, channel in self.columns
            if channel is chosen or role not in roles
        ]
        return replace(self, columns=tuple(columns))


def is_over_frequency(contents: Recording) -> bool:
    """Return whether a file has a column of frequencies, and no times."""
    has_times = any(channel.time is not None or is_time(channel) for channel in contents.channels)
    return not has_times and any(map(is_frequency, contents.channels))


def read_spectral(
    source: str | Path | Recording,
    frequency: str | int | None,
    *,
    layout: TableLayout,
    progress: bool,
) -> SpectralContents:
    """Read a file over frequency, with the role of each column; ``frequency`` names that of the frequencies."""
    check_instance(layout, "layout", TableLayout)
    recording = source if isinstance(source, Recording) else read_contents(source, layout=layout, progress=progress)
    axis = _axis(recording, frequency)
    columns: list[tuple[str, RecordedChannel]] = []
    notes = list(recording.notes)
    if not axis.symbol:
        notes.append(f"column {axis.label} has no unit; its frequencies are taken in Hz")
    for channel in recording.channels:
        if channel is axis or is_counter(channel) or channel.time is not None:
            continue
        if channel.fault or len(channel.values) != len(axis.values):
            fault = channel.fault or f"has {len(channel.values)} values for {len(axis.values)} frequencies"
            notes.append(f"column {channel.label} {fault}, and is left out")
            continue
        columns.append((_role(channel), channel))
    contents = SpectralContents(
        recording.path, _hertz(axis, recording.path) * axis.values, tuple(columns), tuple(notes)
    )
    if layout.imaginary is None:
        return contents
    imaginary = find_channel([channel for _, channel in columns], layout.imaginary, "--imaginary", recording.path)
    role_columns = [("real" if role in ("", "amplitude") else role, channel) for role, channel in columns]
    return replace(
        contents, columns=tuple(("imag" if channel is imaginary else role, channel) for role, channel in role_columns)
    )


def extract_functions(contents: SpectralContents, phase_unit: str | None) -> list[SpectralFunction]:
    """Return the functions of a file: amplitudes with their phases, or real with imaginary parts."""
    stems: dict[tuple[str, ...], dict[str, RecordedChannel]] = {}
    for role, channel in contents.columns:
        if role == "level":
            continue
        columns = stems.setdefault(_stem(channel), {})
        if (role or "amplitude") in columns:
            columns = stems.setdefault((*_stem(channel), channel.label), {})
        columns[role or "amplitude"] = channel
    functions = [columns for columns in stems.values() if "amplitude" in columns or "real" in columns]
    for role in ("phase", "imag", "coherence"):  # columns without a stem, in the order of their functions
        unpaired = [columns[role] for columns in stems.values() if role in columns and columns not in functions]
        incomplete = [
            columns for columns in functions if role not in columns and role in (_second_role(columns), "coherence")
        ]
        if unpaired and incomplete and len(unpaired) != len(incomplete):
            raise InputError(
                f"has {len(incomplete)} functions without their {role}, and {len(unpaired)} columns of it, "
                f"{list_labels(unpaired)}; choose with --column and --phase",
                contents.path,
            )
        words = [[_stem(c) for c in side] for side in (unpaired, [next(iter(c.values())) for c in incomplete])]
        if all(len(stems) > 1 and len(set(stems)) == len(stems) for stems in words):
            raise InputError(
                f"the names do not say to which functions the columns of {role}, {list_labels(unpaired)}, belong; "
                "choose with --column and --phase, or --leave-out",
                contents.path,
            )
        for columns, channel in zip(incomplete, unpaired, strict=False):
            columns[role] = channel
    return [_function(columns, phase_unit, contents.path) for columns in functions]


def _second_role(columns: Mapping[str, RecordedChannel]) -> str:
    return "imag" if "real" in columns else "phase"


def _function(columns: Mapping[str, RecordedChannel], phase_unit: str | None, path: str) -> SpectralFunction:
    """Return the function whose columns are given by their roles."""
    coherence = columns["coherence"].values if "coherence" in columns else None
    if "real" in columns:
        if "imag" not in columns:
            raise InputError("is a real part without an imaginary one", f"{path}: column {columns['real'].label}")
        real, imag = columns["real"], columns["imag"]
        if imag.symbol and "".join(imag.symbol.split()) != "".join(real.symbol.split()):
            raise InputError(
                f"is in {shown(imag.symbol)}, but the real part in {shown(real.symbol)}; write both in one unit",
                f"{path}: column {imag.label}",
            )
        return SpectralFunction(real, real.values + 1j * imag.values, coherence)
    channel, amplitudes = columns["amplitude"], sine_amplitudes(columns["amplitude"])
    if channel.symbol.casefold().startswith("db") or "db" in _words(channel.name):
        amplitudes = 10.0 ** (amplitudes / 20.0)
        _, *reference = re.split(" re ", channel.symbol, maxsplit=1, flags=re.IGNORECASE)  # such as dB re 1 m/N
        symbol = "".join(reference).removeprefix("1 ").strip()
        channel = replace(channel, symbol=symbol, unit=parse_unit(symbol))
    if "phase" not in columns:
        return SpectralFunction(channel, amplitudes, coherence)
    return SpectralFunction(channel, amplitudes * np.exp(1j * _phases(columns["phase"], phase_unit, path)), coherence)


def sine_amplitudes(channel: RecordedChannel) -> Array:
    """Return the amplitudes of sines from a column that may hold rms or peak-to-peak values, in its unit."""
    return np.asarray(math.prod(SIZES[word] for word in _words(channel.name) if word in SIZES) * channel.values)


def _phases(channel: RecordedChannel, phase_unit: str | None, path: str) -> Array:
    """Return the phases in a column, rad; their unit must be stated or obvious."""
    where = f"{path}: column {channel.label}"
    unit = channel.unit if phase_unit is None else known_unit(phase_unit, "phase_unit")
    if unit is None:
        largest = float(np.nanmax(np.abs(channel.values), initial=0.0))
        if channel.symbol or largest > 1.01 * TURN:
            raise InputError("does not say whether its phases are in deg or rad; give --phase-unit", where)
        return channel.values
    if unit.quantity != "angle":
        raise InputError(f"is in {unit.symbol}, and holds no phases", where)
    return np.asarray(unit.factor * channel.values)


def _axis(contents: Recording, wanted: str | int | None) -> RecordedChannel:
    """Return the column of the frequencies."""
    if wanted is not None:
        return find_channel(contents.channels, wanted, "--frequency", contents.path)
    named = [channel for channel in contents.channels if is_frequency(channel)]
    if len(named) != 1:
        fault = f"may be column {' or '.join(c.label for c in named[:4])}" if named else "is in no column that says so"
        columns = list_labels(contents.channels)
        raise InputError(f"the frequency {fault} (there are {columns}); choose with --frequency", contents.path)
    return named[0]


def _hertz(axis: RecordedChannel, path: str) -> float:
    """Return the Hz per unit of a column of frequencies."""
    with error_prefix(f"{path}: column {axis.label}"):
        return hertz_factor(axis.unit) if axis.unit else 1.0


def _words(name: str) -> list[str]:
    return WORDS.findall(name.casefold())


def _role(channel: RecordedChannel) -> str:
    """Return the role of a column; empty if no word states it."""
    decibels = channel.symbol.casefold().startswith("db")  # such as dB re 1 m/N, where re is no real part
    name = channel.name.replace(channel.symbol, "") if decibels else channel.name
    roles = {ROLES[word] for word in _words(name) if word in ROLES}
    first = next((role for role in ROLE_WORDS if role in roles), "")
    angle = channel.unit is not None and channel.unit.quantity == "angle"
    return "phase" if angle and first in ("", "phase") else first


def _stem(channel: RecordedChannel) -> tuple[str, ...]:
    """Return the words of a name without those of role and unit, and the input of the function."""
    unit = _words(channel.symbol)
    words = [word for word in _words(channel.name) if word not in ROLES and word not in unit]
    return (*words, channel.reference)
