"""Universal files, data set 58 (functions of time, and of frequency), through pyuff.

The units are those of the labels; without labels, data set 164 gives the factors to SI units, and without it the values
are in SI units.  Times and frequencies are in the unit of their label, without one in s and Hz.  Frequency response
functions (function type 4) and coherences (6) share one column of frequencies, that of the first of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import RecordedChannel, Recording
from ancf_casadi.records.reading.libraries import library_errors
from ancf_casadi.records.units import Unit, hertz_factor, parse_unit
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import error_prefix, shown
from ancf_casadi.support.optional import library

DATA_TYPES = {
    8: ("length", "m"), 9: ("force", "N"), 11: ("velocity", "m/s"), 12: ("acceleration", "m/s^2"), 13: ("force", "N"),
}  # fmt: skip
OVER_TIME, FREQUENCY_RESPONSE, COHERENCE = 1, 4, 6  # function types
DIRECTIONS = dict(zip(range(-6, 7), "-RZ -RY -RX -Z -Y -X . X Y Z RX RY RZ".split(), strict=True))


def read_uff(path: Path) -> Recording:
    """Read the time responses and the frequency response functions of a universal file."""
    pyuff = library("pyuff", "UFF files need it")
    notes: list[str] = []
    channels: list[RecordedChannel] = []
    spectra: list[Mapping[str, Any]] = []
    with library_errors(str(path), "UFF"), error_prefix(str(path)):
        file = pyuff.UFF(str(path))
        types = [int(kind) for kind in file.get_set_types()]
        length, force = 1.0, 1.0
        for number in [k for k, kind in enumerate(types) if kind == 164][:1]:
            units = file.read_sets(number)
            length, force = 1 / float(units["length"]), 1 / float(units["force"])
        for number in [k for k, kind in enumerate(types) if kind == 58][:10_000]:
            function = _without_padding(file.read_sets(number))
            kind = int(function["func_type"])
            if kind == OVER_TIME and not np.iscomplexobj(function["data"]):
                channels.append(_channel(len(channels) + 1, function, length, force))
            elif kind in (FREQUENCY_RESPONSE, COHERENCE):
                spectra.append(function)
            else:
                notes.append(f"data set {number + 1} is not a response over time or frequency, and is left out")
        if spectra:
            axis = _frequencies(spectra[0])
            channels.append(RecordedChannel(len(channels) + 1, "frequency", axis, "Hz", parse_unit("Hz")))
        for function in spectra:
            if not np.array_equal(_frequencies(function), axis):
                notes.append(f"{_name(function)!r} has other frequencies than the first function, and is left out")
                continue
            channels += _spectral(len(channels) + 1, function, length, force)
    if not channels:
        raise InputError("has no responses over time or frequency (data set 58, function types 1 and 4)", str(path))
    untimed = [channel.label for channel in channels if channel.time is None]
    fault = f"the unit of the times of {untimed[0]} is not understood" if untimed and not spectra else ""
    return Recording(str(path), tuple(channels), tuple(notes), time_fault=fault)


def _without_padding(function: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a function without the padding of its last row beyond the stated number of values."""
    count = int(function["num_pts"])
    return {**function, "data": function["data"][:count], "x": function["x"][:count]}


def _spectral(number: int, function: Mapping[str, Any], length: float, force: float) -> Iterator[RecordedChannel]:
    """Yield the columns of a function over frequency: real and imaginary part, or a coherence."""
    name, values = _name(function), np.asarray(function["data"])
    reference = f"{function.get('ref_node', 0)} {DIRECTIONS.get(int(function.get('ref_dir', 0)), '?')}"
    if len(values) < function["num_pts"]:
        raise InputError(f"{name!r} has {len(values)} of {function['num_pts']} values; it is damaged")
    if int(function["func_type"]) == COHERENCE:
        yield RecordedChannel(number, f"{name} coherence", values.real.astype(float), reference=reference)
        return
    numerator, denominator = (_unit(function, axis, length, force)[0] for axis in ("ordinate", "orddenom"))
    symbol = f"({numerator})/({denominator})" if denominator else numerator
    for k, (component, column) in enumerate((("real", values.real), ("imag", values.imag))):
        yield RecordedChannel(number + k, f"{name} {component}", column.astype(float), symbol, reference=reference)


def _name(function: Mapping[str, Any]) -> str:
    """Return node and direction of the response of a function over frequency."""
    return f"node {function.get('rsp_node', 0)} {DIRECTIONS.get(int(function.get('rsp_dir', 0)), '?')}"


def _channel(number: int, function: Mapping[str, Any], length: float, force: float) -> RecordedChannel:
    name = str(function.get("id1", "")).strip()
    node, direction = function.get("rsp_node", 0), function.get("rsp_dir", 0)
    name = f"node {node} direction {direction}" if name in ("", "NONE") else name
    values = np.array(function["data"], dtype=float)
    if len(values) < function["num_pts"]:
        raise InputError(f"has {len(values)} of {function['num_pts']} values; it is damaged", f"function {number}")
    symbol, unit = _unit(function, "ordinate", length, force)
    label, time_unit = _unit(function, "abscissa", length, force)
    factor = 1.0 if not label else time_unit.factor if time_unit and time_unit.quantity == "time" else None
    time = None if factor is None else factor * np.array(function["x"], dtype=float)
    return RecordedChannel(number, name, values, symbol, unit, time)


def _frequencies(function: Mapping[str, Any]) -> Array:
    """Return the frequencies of a function, Hz."""
    label, unit = _unit(function, "abscissa", 1.0, 1.0)
    with error_prefix(f"the abscissa of {_name(function)!r}"):
        if label and not unit:
            raise InputError(f"the unit {shown(label)} is not understood; export it in Hz")
        return (hertz_factor(unit) if unit else 1.0) * np.array(function["x"], dtype=float)


def _unit(function: Mapping[str, Any], axis: str, length: float, force: float) -> tuple[str, Unit | None]:
    """Return the unit of the values or of their denominator, from its label, or from the kind of data and factors."""
    written = str(function.get(f"{axis}_axis_units_lab", "")).strip()
    if written not in ("", "NONE"):
        return written, parse_unit(written)
    kind = int(function.get(f"{axis}_spec_data_type", 0))
    if kind not in DATA_TYPES:
        return "", None
    quantity, plain = DATA_TYPES[kind]
    factor = force if quantity == "force" else length
    symbol = plain if factor == 1.0 else f"{factor:g} {plain}"
    return symbol, Unit(symbol, quantity, factor)
