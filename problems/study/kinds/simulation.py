"""A part with one simulated motion, as ``ancf-casadi simulate`` computes it from the tables of the file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypedDict, final

import numpy as np

from ancf_casadi.dynamics.simulation import simulate
from problems.schema.file import StudyFile
from problems.schema.simulation import read_simulation
from problems.study.data_table import Column
from problems.study.drawing import Drawing, drawn
from problems.study.files import FilePart, TablesOfFile
from problems.study.part import Effort, Finding, Found, Task

SECONDS = 10.0  # expected computing time


class SimulationNumbers(TypedDict):
    """Range of the tip position in x and y, m; energy that damping has taken, J; the largest balance error, J."""

    tip_position_range_m: list[float]
    dissipated_energy_j: float
    balance_error_j: float
    integrators: list[str]


@dataclass(frozen=True)
class SimulatedMotion:
    """A simulated motion as plain data.

    Parameters
    ----------
    data : dict
        Its numbers for JSON.
    figure : Drawing
        Tip motion and shapes.
    """

    data: dict[str, Any]
    figure: Drawing


def simulate_plain(given: TablesOfFile, name: str) -> SimulatedMotion:
    """Simulate the motion of a study file, and return it as plain data.

    Raises
    ------
    InputError, SimulationError
        As ``simulate``.
    """
    task = read_simulation(given.file())
    run = simulate(task.model, damping=task.damping, base=task.base, **task.settings)
    if run.interrupted:
        raise KeyboardInterrupt
    data = {
        "tip_position_range_m": np.ptp(run.tip, axis=0).tolist(),
        "dissipated_energy_j": float(run.dissipated_energy[-1]),
        "balance_error_j": float(np.abs(run.balance_error).max()),
        "integrators": [use.method for use in run.integrators],
    }
    caption = "Motion of the tip relative to the clamp, and shapes of the beam."
    return SimulatedMotion(data, drawn(name, caption, run.figure))


@final
@dataclass(frozen=True, kw_only=True)
class SimulationPart(FilePart):
    """One simulated motion."""

    kind, heading = "simulation", "Simulated motion"
    about = "one motion: the tables [[damping]], [base], [load], [release], [simulation]"
    numbers = SimulationNumbers
    wanted = frozenset({"beam", "damping", "base", "load", "release", "simulation", "markers"})

    def check(self, file: StudyFile, where: str) -> None:
        """Check the simulation."""
        read_simulation(file)

    def tasks(self, found: Found, effort: Effort) -> tuple[Task, ...]:
        """Return the simulation."""
        return (Task(simulate_plain, (self.given, self.name), SECONDS),)

    def finding(self, results: Sequence[Any], found: Found, effort: Effort) -> Finding:
        """Return range and energies, and the figure of the motion."""
        motion: SimulatedMotion = results[0]
        x, y = motion.data["tip_position_range_m"]
        rows = (
            ("range of the tip position in x", "mm", 1e3 * x),
            ("range of the tip position in y", "mm", 1e3 * y),
            ("energy taken by damping", "mJ", 1e3 * motion.data["dissipated_energy_j"]),
            ("largest energy balance error", "mJ", 1e3 * motion.data["balance_error_j"]),
        )
        heads = ("quantity", "unit", "value")
        columns = tuple(Column(head, cells) for head, cells in zip(heads, zip(*rows, strict=True), strict=True))
        return Finding(motion.data, (self.data_table("Simulated motion", columns),), (motion.figure,))
