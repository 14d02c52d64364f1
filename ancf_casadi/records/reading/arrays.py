"""Channels from named arrays, as MATLAB, HDF5 and NumPy files hold them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ancf_casadi.records.channel import Contents, RecordedChannel
from ancf_casadi.records.unit_names import unit_in_name
from ancf_casadi.records.units import parse_unit

MOST_CHANNELS = 10_000


@np.errstate(all="ignore")  # extended precision may hold larger numbers
def array_contents(arrays: Iterable[tuple[str, NDArray[Any]]], notes: Iterable[str] = ()) -> Contents:
    """Return the columns of named arrays: vectors, and matrices along their longer side.

    Anything else is left out, with a note.
    """
    channels: list[RecordedChannel] = []
    remarks = list(notes)
    for name, array in arrays:
        values = np.squeeze(array)
        if values.dtype.kind == "M":
            try:
                values = (values - values.ravel()[0]) / np.timedelta64(1, "s") if values.size else values.astype(float)
            except (TypeError, OverflowError):  # years and months have no length; attoseconds overflow
                remarks.append(f"the dates in {name!r} cannot be counted in s, and are left out")
                continue
            remarks.append(f"the dates in {name!r} count in s from the first")
            stamps = True
        else:
            stamps = False
        if values.dtype.kind not in "fiu" or values.ndim > 2:
            remarks.append(f"{name!r} is no real vector or matrix, and is left out")
            continue
        if values.ndim == 0:
            remarks.append(
                f"{name!r} is a single number, {float(values):g}; a sampling rate is given with --sample-rate"
            )
            continue
        columns = values[:, None] if values.ndim == 1 else values if values.shape[0] >= values.shape[1] else values.T
        if len(channels) + columns.shape[1] > MOST_CHANNELS:
            remarks.append(f"{name!r} has too many columns, and is left out")
            continue
        symbol, unit = ("s", parse_unit("s")) if stamps else unit_in_name(name)
        for k, column in enumerate(columns.T, 1):
            own = name if columns.shape[1] == 1 else f"{name}[{k}]"
            channels.append(RecordedChannel(len(channels) + 1, own, np.array(column, dtype=float), symbol, unit))
    return Contents(tuple(channels), tuple(remarks))
