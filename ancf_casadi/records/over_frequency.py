"""Functions over frequency in a file: response curves and frequency response functions.

One column holds the frequencies.  Each function has one column with its amplitude, two with amplitude and phase, or two
with real and imaginary part.  The last word that says so in the name of a column tells its part; the remaining words
tell which columns belong together, as in ``x_mm, x_phase_deg, y_mm, y_phase_deg`` or ``H1 real, H1 imag``.  A single
amplitude and a single phase belong together by themselves.

The unit of a phase must be known, because a wrong one gives another damping without any sign: phases without a unit
count as radians, and are refused if they exceed 2 pi.  Amplitudes in dB are 20 lg of the SI value.  The words ``rms``
and ``pp`` (peak to peak) in a name tell amplitudes that are 2^(-1/2) or 2 times those of the sine.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import RecordedChannel, Recording, find_channel, is_counter, is_frequency, listed
from ancf_casadi.records.layout import NO_LAYOUT, TableLayout
from ancf_casadi.records.reading.formats import read_contents
from ancf_casadi.records.units import known_unit, parse_unit
from ancf_casadi.support.arrays import Array, ComplexArray
from ancf_casadi.support.inputs import check_instance

PARTS = {
    "phase": "phase phases phi φ ϕ arg argument angle ang ph phasenwinkel",
    "real": "real re realteil",
    "imag": "imag im imaginary imaginärteil",
    "coherence": "coherence coh gamma2 msc kohärenz",
    "level": "level levels force excitation exciting input drive driving shaker base table kraft anregung load",
    "amplitude": "amplitude amplitudes amp ampl magnitude magnitudes mag abs modulus gain betrag",
}  # part -> words that tell it; the first part that has one in a name counts
PART_OF = {word: part for part, words in PARTS.items() for word in words.split()}
SIZES = {
    "rms": math.sqrt(2.0),
    "eff": math.sqrt(2.0),
    "pp": 0.5,
    "pkpk": 0.5,
    "p2p": 0.5,
}  # word -> amplitude of a sine with such a value of 1
WORDS = re.compile(r"[^\W_]+")
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
        words = [word for word in self.channel.name.split() if PART_OF.get(word.casefold()) not in ("real", "imag")]
        return " ".join(words)


@dataclass(frozen=True, eq=False)
class SpectralContents:
    """The columns of a file over frequency."""

    path: str
    frequencies: Array  # Hz
    columns: tuple[tuple[str, RecordedChannel], ...]  # part and column; the part is empty if no word tells it
    notes: tuple[str, ...] = ()

    def only(self, option: str, parts: Sequence[str], wanted: str | int | None) -> SpectralContents:
        """Return the same with a column, by its name or number, as the only one of some parts; None leaves all."""
        if wanted is None:
            return self
        found = find_channel([channel for _, channel in self.columns], wanted, option, self.path)
        kept = [
            (part if part in parts else parts[0], channel) if channel is found else (part, channel)
            for part, channel in self.columns
            if channel is found or part not in parts
        ]
        return replace(self, columns=tuple(kept))


def read_spectral(
    source: str | Path | Recording,
    frequency: str | int | None,
    *,
    layout: TableLayout = NO_LAYOUT,
    progress: bool = False,
) -> SpectralContents:
    """Return the columns of a file over its frequencies, whose column may be named, and the part that each is."""
    check_instance(layout, "layout", TableLayout)
    contents = source if isinstance(source, Recording) else read_contents(source, layout=layout, progress=progress)
    axis = _axis(contents, frequency)
    columns: list[tuple[str, RecordedChannel]] = []
    notes = list(contents.notes)
    if not axis.symbol:
        notes.append(f"column {axis.label} has no unit; its frequencies are taken in Hz")
    for channel in contents.channels:
        if channel is axis or is_counter(channel) or channel.time is not None:
            continue
        if channel.fault or len(channel.values) != len(axis.values):
            why = channel.fault or f"has {len(channel.values)} values for {len(axis.values)} frequencies"
            notes.append(f"column {channel.label} {why}, and is left out")
            continue
        columns.append((_part(channel), channel))
    found = SpectralContents(contents.path, _hertz(axis, contents.path) * axis.values, tuple(columns), tuple(notes))
    if layout.imaginary is None:
        return found
    imaginary = find_channel([channel for _, channel in columns], layout.imaginary, "--imaginary", contents.path)
    others = [("real" if part in ("", "amplitude") else part, channel) for part, channel in columns]
    return replace(
        found, columns=tuple(("imag" if channel is imaginary else part, channel) for part, channel in others)
    )


def functions_of(found: SpectralContents, phase_unit: str | None = None) -> list[SpectralFunction]:
    """Return the functions of a file: amplitudes with their phases, or real with imaginary parts."""
    stems: dict[tuple[str, ...], dict[str, RecordedChannel]] = {}
    for part, channel in found.columns:
        if part == "level":
            continue
        own = stems.setdefault(_stem(channel), {})
        if (part or "amplitude") in own:
            own = stems.setdefault((*_stem(channel), channel.label), {})
        own[part or "amplitude"] = channel
    sizes = [own for own in stems.values() if "amplitude" in own or "real" in own]
    for part in ("phase", "imag", "coherence"):  # columns of one part in the order of their functions
        lone = [own[part] for own in stems.values() if part in own and own not in sizes]
        missing = [own for own in sizes if part not in own and part in (_other_part(own), "coherence")]
        if lone and missing and len(lone) != len(missing):
            raise InputError(
                f"has {len(missing)} functions without their {part}, and {len(lone)} columns of it, {listed(lone)}; "
                "choose with --column and --phase",
                found.path,
            )
        for own, channel in zip(missing, lone, strict=False):
            own[part] = channel
    return [_function(own, phase_unit, found.path) for own in sizes]


def _other_part(own: Mapping[str, RecordedChannel]) -> str:
    return "imag" if "real" in own else "phase"


def _function(own: Mapping[str, RecordedChannel], phase_unit: str | None, path: str) -> SpectralFunction:
    """Return the function of the columns of its parts."""
    coherence = own["coherence"].values if "coherence" in own else None
    if "real" in own:
        if "imag" not in own:
            raise InputError("is a real part without an imaginary one", f"{path}: column {own['real'].label}")
        return SpectralFunction(own["real"], own["real"].values + 1j * own["imag"].values, coherence)
    channel, size = own["amplitude"], sine_amplitudes(own["amplitude"])
    if channel.symbol.casefold().startswith("db") or "db" in _words(channel.name):
        size = 10.0 ** (size / 20.0)
        reference = channel.symbol.casefold().partition(" re ")[0]
        symbol = channel.symbol[len(reference) + 4 :].removeprefix("1 ").strip()
        channel = replace(channel, symbol=symbol, unit=parse_unit(symbol))
    if "phase" not in own:
        return SpectralFunction(channel, size, coherence)
    return SpectralFunction(channel, size * np.exp(1j * _phases(own["phase"], phase_unit, path)), coherence)


def sine_amplitudes(channel: RecordedChannel) -> Array:
    """Return the amplitudes of sines from a column that may hold rms or peak-to-peak values, in its unit."""
    return np.asarray(math.prod(SIZES[word] for word in _words(channel.name) if word in SIZES) * channel.values)


def _phases(channel: RecordedChannel, given: str | None, path: str) -> Array:
    """Return the phases in a column, rad; refuse those whose unit is not clear."""
    where = f"{path}: column {channel.label}"
    unit = channel.unit if given is None else known_unit(given, "phase_unit")
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
    named, every = [one for one in contents.channels if is_frequency(one)], listed(contents.channels)
    if len(named) != 1:
        what = f"may be column {' or '.join(c.label for c in named[:4])}" if named else "is in no column that says so"
        raise InputError(f"the frequency {what} (there are {every}); choose with --frequency", contents.path)
    return named[0]


def _hertz(axis: RecordedChannel, path: str) -> float:
    """Return the Hz per unit of a column of frequencies."""
    quantity = axis.unit.quantity if axis.unit else "frequency"
    if quantity not in ("frequency", "angular velocity"):
        raise InputError(f"is in {axis.symbol}, and holds no frequencies", f"{path}: column {axis.label}")
    factor = axis.unit.factor if axis.unit else 1.0
    return factor / TURN if quantity == "angular velocity" else factor


def _words(name: str) -> list[str]:
    return WORDS.findall(name.casefold())


def _part(channel: RecordedChannel) -> str:
    """Return the part that a column holds; empty if no word tells it."""
    decibels = channel.symbol.casefold().startswith("db")  # such as dB re 1 m/N, where re is no real part
    name = channel.name.replace(channel.symbol, "") if decibels else channel.name
    told = {PART_OF[word] for word in _words(name) if word in PART_OF}
    first = next((part for part in PARTS if part in told), "")
    angle = channel.unit is not None and channel.unit.quantity == "angle"
    return "phase" if angle and first in ("", "phase") else first


def _stem(channel: RecordedChannel) -> tuple[str, ...]:
    """Return the words of a name that tell no part and no unit, and its input."""
    unit = _words(channel.symbol)
    words = [word for word in _words(channel.name) if word not in PART_OF and word not in unit]
    return (*words, channel.reference)
