"""The table [load]: force and moment at the tip over time."""

from __future__ import annotations

from typing import Any

import numpy as np

from ancf_casadi.dynamics.tip_load import HarmonicLoad, SampledLoad, TipLoad
from ancf_casadi.records.sensor import Quantity
from ancf_casadi.support.inputs import located
from problems.tables.columns import read_columns
from problems.tables.study import Study, checked

KEYS = """\
  [load]        force and moment at the tip, in the laboratory frame
                harmonic: force (N), moment (N m), frequency (Hz), stop (s),
                ramp (cycles)
                sampled: time = [0, 5], force = [[1, 0], [1, 0]], moment; or
                file, with the columns force_x, force_y and moment, of which
                one is enough; time, unit, time_unit, rate
"""
COMPONENTS: dict[str, Quantity] = {"force_x": "force", "force_y": "force", "moment": "moment"}


def read_load(study: Study, table: Any, where: str) -> TipLoad:
    """Return the load that a table describes.

    Raises
    ------
    InputError
        If the keys belong to no kind of load, a value cannot be used, or a file cannot be read.
    """
    keys = set(table) if isinstance(table, dict) else set()
    if "file" in keys:
        time, parts = read_columns(study, table, COMPONENTS, where)
        with located(where):
            return SampledLoad(time, np.column_stack([parts["force_x"], parts["force_y"]]), parts["moment"])
    if "time" in keys:
        given = checked(table, {"time", "force"}, {"moment"}, where)
        with located(where):
            return SampledLoad(**given)
    given = checked(table, {"force", "frequency"}, {"moment", "stop", "ramp"}, where)
    with located(where):
        return HarmonicLoad(**given)
