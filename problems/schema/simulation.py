"""The tables of a simulation: [simulation] with its settings, and [markers] with points to output."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.base_motion import BaseMotion
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.inputs import check_keys, located, physical, shown
from problems.schema.beam import DAMPED_HELP, read_damped
from problems.schema.file import StudyFile
from problems.schema.motion import MOTION_KEYS, read_motion

SIMULATION_KEYS = """\
  [simulation]  duration (s), sample_rate (1/s), tolerance,
                method ("auto", "idas" or "radau"),
                start ("equilibrium", "straight" or "impact")
"""
MARKERS_KEYS = """\
  [markers]     NAME = arc length from the clamp (m): points in the output
"""
SIMULATION_HELP = DAMPED_HELP + MOTION_KEYS + SIMULATION_KEYS + MARKERS_KEYS
SETTINGS = {"sample_rate", "start", "method", "tolerance"}
COLUMN_NAMES = ("time", "tip", "base")  # names of columns that are always there


@dataclass(frozen=True)
class Simulation:
    """The arguments of ``simulate`` from a file."""

    model: Model
    damping: DampingLaw | None
    base: BaseMotion | None
    settings: Mapping[str, Any]  # other arguments of ``simulate``
    markers: Mapping[str, float]  # arc length of each point to output, m


def read_simulation(given: str | StudyFile) -> Simulation:
    """Read a beam, its damping, the motion of its base and the settings of the simulation."""
    file = StudyFile.of(given)
    source, where = read_damped(file), file.where("simulation")
    table = file.needed("simulation")
    check_keys(table, {"duration"}, SETTINGS, where)
    _check_size(table, source.model, where)
    if "start" in table and "release" in file.tables:
        raise InputError("is given by the table [release]; leave it out", f"{where}: start")
    settings = table | read_motion(file, table, source.model, where)
    base = settings.pop("base", None)
    return Simulation(source.model, source.damping, base, settings, read_markers(file, source.model))


def _check_size(settings: Mapping[str, Any], model: Model, where: str) -> None:
    """Refuse a motion that would fill the memory."""
    rate = settings.get("sample_rate", 1000.0)  # 1/s, the default of ``simulate``
    with located(where):
        samples = physical(settings["duration"], "duration") * physical(rate, "sample_rate")
    if 2 * 8 * model.size * samples > 5e8:  # bytes of the coordinates and velocities
        raise InputError(
            f"{samples:.3g} samples of {model.beam.elements} elements would take {16 * model.size * samples / 1e9:.2g} "
            "GB; lower sample_rate or duration, or use fewer elements",
            f"{where}: sample_rate",
        )


def read_markers(file: StudyFile, model: Model) -> dict[str, float]:
    """Return the points of the table [markers]: arc length by name, m."""
    table, where = file.tables.get("markers", {}), file.where("markers")
    if not isinstance(table, dict):
        raise InputError(f"must be a table, got {shown(table)}", where)
    for name, point in table.items():
        if name in COLUMN_NAMES or not re.fullmatch(r"\w[\w.-]*", name):
            raise InputError(
                f"a name must be made of letters and digits and differ from {', '.join(COLUMN_NAMES)}",
                f"{where}: {shown(name)}",
            )
        with located(f"{where}: {name}"):
            model.element_at(point)
    return {name: float(point) for name, point in table.items()}
