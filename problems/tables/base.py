"""The table [base]: the motion of the clamp, of one of four kinds that its keys tell apart."""

from __future__ import annotations

from typing import Any

import numpy as np

from ancf_casadi.dynamics.base_motion import BaseMotion, FixedBase, HarmonicBase, SampledBase, SweepBase
from ancf_casadi.records.sensor import Quantity
from ancf_casadi.support.inputs import located, vector
from problems.tables.columns import read_columns
from problems.tables.study import Study, checked

KEYS = """\
  [base]        harmonic: amplitude (m), frequency (Hz), stop (s), direction,
                stop_at ("rest" or "once"), ramp (cycles in which the
                amplitude grows from 0)
                sweep: the same with frequencies = [FIRST, LAST] (Hz)
                sampled: file, with the columns (name or number) x, y and
                rotation, of which one is enough; time, unit, time_unit, rate
                fixed: displacement (m), rotation (rad)
"""
OSCILLATION = {"amplitude", "frequency", "frequencies", "stop", "direction", "stop_at", "ramp"}
AXES: dict[str, Quantity] = {"x": "position", "y": "position", "rotation": "slope"}


def read_base(study: Study, table: Any, where: str) -> BaseMotion:
    """Return the motion of the clamp that a table describes.

    Raises
    ------
    InputError
        If the keys belong to no kind of motion, a value cannot be used, or a file cannot be read.
    """
    keys = set(table) if isinstance(table, dict) else set()
    if "file" in keys:
        time, parts = read_columns(study, table, AXES, where)
        with located(where):
            return SampledBase(time, np.column_stack([parts["x"], parts["y"]]), parts["rotation"])
    if "frequencies" in keys:
        given = checked(table, {"amplitude", "frequencies", "stop"}, OSCILLATION - {"frequency"}, where)
        with located(where):
            return SweepBase(**(given | {"frequencies": vector(given["frequencies"], "frequencies")}))
    if keys and keys <= {"displacement", "rotation"}:
        with located(where):
            return FixedBase(**table)
    given = checked(table, {"amplitude", "frequency"}, OSCILLATION - {"frequencies"}, where)
    with located(where):
        return HarmonicBase(**given)
