"""Universal files, data set 58 (functions of time), through pyuff.

The units are those of the labels; without labels, data set 164 gives the factors to SI units, and without it the values
are in SI units.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import Contents, RecordedChannel
from ancf_casadi.records.reading.libraries import library, readable
from ancf_casadi.records.units import Unit, parse_unit

DATA_TYPES = {8: ("length", "m"), 9: ("force", "N"), 11: ("velocity", "m/s"), 12: ("acceleration", "m/s^2")}


def read_uff(path: Path) -> Contents:
    """Read the time responses of a universal file."""
    pyuff = library("pyuff", "UFF")
    notes: list[str] = []
    channels: list[RecordedChannel] = []
    with readable(str(path), "UFF"):
        file = pyuff.UFF(str(path))
        types = [int(kind) for kind in file.get_set_types()]
        length, force = 1.0, 1.0
        for number in [k for k, kind in enumerate(types) if kind == 164][:1]:
            units = file.read_sets(number)
            length, force = 1 / float(units["length"]), 1 / float(units["force"])
        for number in [k for k, kind in enumerate(types) if kind == 58][:10_000]:
            function = file.read_sets(number)
            if int(function["func_type"]) != 1 or np.iscomplexobj(function["data"]):  # function type
                notes.append(f"data set {number + 1} is no response over time, and is left out")
                continue
            channels.append(_channel(len(channels) + 1, function, length, force, str(path)))
    if not channels:
        raise InputError("has no time responses (data set 58, function type 1)", str(path))
    return Contents(tuple(channels), tuple(notes))


def _channel(number: int, function: Mapping[str, Any], length: float, force: float, path: str) -> RecordedChannel:
    name = str(function.get("id1", "")).strip()
    node, direction = function.get("rsp_node", 0), function.get("rsp_dir", 0)
    name = f"node {node} direction {direction}" if name in ("", "NONE") else name
    values = np.array(function["data"], dtype=float)
    if len(values) != function["num_pts"]:
        raise InputError(
            f"has {len(values)} of {function['num_pts']} values; it is damaged", f"{path}: function {number}"
        )
    written = str(function.get("ordinate_axis_units_lab", "")).strip()
    symbol, unit = "", None
    kind = int(function.get("ordinate_spec_data_type", 0))
    if written not in ("", "NONE"):
        symbol, unit = written, parse_unit(written)
    elif kind in DATA_TYPES:
        quantity, plain = DATA_TYPES[kind]
        factor = force if quantity == "force" else length
        symbol = plain if factor == 1.0 else f"{factor:g} {plain}"
        unit = Unit(symbol, quantity, factor)
    return RecordedChannel(number, name, values, symbol, unit, np.array(function["x"], dtype=float))
