"""A part with one simulated motion, as ``ancf-casadi simulate`` computes it from the tables of the file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypedDict, final

import numpy as np

from ancf_casadi.dynamics.simulation import simulate
from problems.schema.file import StudyFile
from problems.schema.simulation import read_simulation
from problems.study.data_table import Column, DataTable
from problems.study.drawing import drawn
from problems.study.part import FilePart, Finding


class SimulationNumbers(TypedDict):
    """Range of the tip position in x and y, m; energy that damping has taken, J; the largest balance error, J."""

    tip_position_range_m: list[float]
    dissipated_energy_j: float
    balance_error_j: float
    integrators: list[str]


def simulated_motion(file: StudyFile, name: str) -> Finding:
    """Simulate the motion of a study file: range and energies, and the figure of the motion.

    Raises
    ------
    InputError, SimulationError
        As ``simulate``.
    """
    task = read_simulation(file)
    run = simulate(task.model, damping=task.damping, base=task.base, **task.settings)
    if run.interrupted:
        raise KeyboardInterrupt
    data: dict[str, Any] = {
        "tip_position_range_m": np.ptp(run.tip, axis=0).tolist(),
        "dissipated_energy_j": float(run.dissipated_energy[-1]),
        "balance_error_j": float(np.abs(run.balance_error).max()),
        "integrators": [use.method for use in run.integrators],
    }
    x, y = data["tip_position_range_m"]
    rows = (
        ("range of the tip position in x", "mm", 1e3 * x),
        ("range of the tip position in y", "mm", 1e3 * y),
        ("energy taken by damping", "mJ", 1e3 * data["dissipated_energy_j"]),
        ("largest energy balance error", "mJ", 1e3 * data["balance_error_j"]),
    )
    heads = ("quantity", "unit", "value")
    columns = tuple(Column(head, cells) for head, cells in zip(heads, zip(*rows, strict=True), strict=True))
    caption = "Motion of the tip relative to the clamp, and shapes of the beam."
    return Finding(data, (DataTable(name, "Simulated motion", columns),), (drawn(name, caption, run.figure),))


@final
@dataclass(frozen=True, kw_only=True)
class SimulationPart(FilePart):
    """One simulated motion."""

    kind, heading = "simulation", "Simulated motion"
    about = "one motion: the tables [[damping]], [base], [load], [release], [simulation]"
    numbers = SimulationNumbers
    seconds = 10.0
    compute = staticmethod(simulated_motion)
    wanted = frozenset({"beam", "damping", "base", "load", "release", "simulation", "markers"})

    def check(self, file: StudyFile, where: str) -> None:
        """Check the simulation."""
        read_simulation(file)
