"""Checks of the arguments that the decay fits share."""

from __future__ import annotations

from typing import Any, get_args

from numpy.typing import ArrayLike

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.inputs import choice, vector
from problems.decay.laws import DECAY_LAWS, FrequencyLaw, Interval, Law


def check_laws(law: Any, frequency_law: Any = "constant") -> None:
    """Check the names of a damping law and a frequency law.

    Raises
    ------
    InputError
        If there is no such law, or the two cannot be combined.
    """
    choice(law, get_args(Law), "law")
    choice(frequency_law, get_args(FrequencyLaw), "frequency_law")
    if not combines(law, frequency_law):
        raise InputError(f"must be constant under the {law} law; use the quadratic law instead", "frequency_law")


def combines(law: Law, frequency_law: FrequencyLaw) -> bool:
    """Return whether a damping law and a frequency law can be combined: an integrated one has a constant frequency."""
    return frequency_law == "constant" or not DECAY_LAWS[law].integrated


def checked_ratios(ratio_bounds: Any) -> Interval:
    """Return the bounds of the damping ratio under the linear law.

    Raises
    ------
    InputError
        If they are not two numbers in order, above -1 and below 1.
    """
    lower, upper = vector(ratio_bounds, "ratio_bounds")
    if not -1.0 < lower < upper < 1.0:
        raise InputError(f"must be in order and between -1 and 1, got ({lower:g}, {upper:g})", "ratio_bounds")
    return lower, upper


def as_record(time: Measurement | ArrayLike, displacement: ArrayLike | None) -> Measurement:
    """Return a record unchanged, and times (s) and displacements (m) as a record.

    Raises
    ------
    InputError
        If the displacements are missing, given twice, or not usable.
    """
    if isinstance(time, Measurement):
        if displacement is not None:
            raise InputError("is part of the record already; leave it out", "displacement")
        return time
    if displacement is None:
        raise InputError("is missing; give it after the times, or give a Measurement", "displacement")
    return Measurement(time, displacement)
