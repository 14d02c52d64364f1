"""Names of the unknowns of a fit that belong to a record, a sensor or a mode, all counted from 1.

alpha, beta, eta1, eta2, ratio1, ...         parameters of the law; in a sum, a second eta1 is called ``eta1_2``
elastic_modulus, thickness[3:5], tip_mass    properties of the beam (``properties``)
frequency_1, ...                             factor on the natural frequency of a mode
excitation, or excitation_1, ...             factor on the levels of all response curves, or of each
base_amplitude_1, ...                        amplitude of the base motion of each motion
start_force_x_1, start_force_x_rate_1, ...   tip load that holds the beam at the start of each motion, and its rate
release_1, camera_scale_1, ...               start of the motion, and view of the camera, of each motion
offset_1_2, zero_1_2                         time offset and zero of the second channel of the first motion
"""

from __future__ import annotations

from ancf_casadi.dynamics.derivatives.release_load import LOAD_NAMES, START_LOAD_NAMES
from ancf_casadi.vibration.equilibrium import Equilibrium
from problems.beam.motions.record import MotionRecord


def base_name(name: str, number: int) -> str:
    """Return the name of a parameter of a record's base motion."""
    return f"base_{name}_{number}"


def load_name(name: str, number: int) -> str:
    """Return the name of a component of the load at the start of a record, or of its rate."""
    return f"start_{name}_{number}"


def frequency_name(mode: int) -> str:
    """Return the name of the factor on the natural frequency of a mode, from 0."""
    return f"frequency_{mode + 1}"


def loads(record: MotionRecord) -> list[tuple[str, float]]:
    """Return the load at the start of a record, zero where it is unknown, and zero for its rate, by name."""
    start = record.start
    known = (*start.tip_force, start.tip_moment) if isinstance(start, Equilibrium) else (0.0,) * len(LOAD_NAMES)
    return list(zip(START_LOAD_NAMES, (*known, *(0.0,) * len(LOAD_NAMES)), strict=True))
