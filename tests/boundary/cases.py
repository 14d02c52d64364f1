"""The reference cases, what computes them, and the page of the documentation that compares.

``python -m tests.boundary.cases`` writes the tables of ``docs/boundary_references.md``; the tests compute them again.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from tests.boundary import backbones, buckling, flow, frequencies, motions, stability, statics
from tests.boundary.convergence import HELD, errors, order

REFERENCES = json.loads((Path(__file__).parent / "references.json").read_text())
PAGE = Path(__file__).parents[2] / "docs" / "boundary_references.md"
HEADER = "| case | at | reference | computed | largest difference | elements |\n|---|---|---|---|---|---|\n"
CASES_HEADER = "| case | description | quantity | source |\n|---|---|---|---|\n"
RATES_HEADER = "| supports | 8 elements | 16 elements | 32 elements | order |\n|---|---|---|---|---|\n"
SECOND_MODE = "Relative error of the second frequency that is not zero."
DYNAMIC, PENDULUM = 1e-3, 5e-3


@dataclass(frozen=True)
class Case:
    """A reference case: the function that computes its numbers, its mesh, and the largest difference allowed.

    Differences are relative to the reference, or to ``size`` where that is larger.  ``slow`` cases take over 2 s.
    """

    compute: Callable[[int], Any]
    elements: int
    accuracy: float = 1e-4
    size: float = 0.0
    slow: bool = False

    @property
    def name(self) -> str:
        """The name of the case."""
        return self.compute.__name__

    @property
    def reference(self) -> dict[str, Any]:
        """Description, quantity, numbers, tolerance and source of the reference."""
        found: dict[str, Any] = REFERENCES[self.name]
        return found

    @property
    def limit(self) -> float:
        """Largest relative difference allowed."""
        return max(self.accuracy, self.reference["tolerance"])

    @cached_property
    def rows(self) -> list[tuple[str, np.ndarray, np.ndarray, float]]:
        """Label, reference, computed numbers and largest relative difference of each row."""
        found = np.concatenate([np.ravel(part) for part in self.compute(self.elements)])
        exact = [np.array(values) for values in self.reference["rows"].values()]
        assert found.size == sum(values.size for values in exact)
        computed = np.split(found, np.cumsum([values.size for values in exact])[:-1])
        scales = [np.maximum(np.abs(values), self.size) for values in exact]
        differences = [float((abs(a - b) / s).max()) for a, b, s in zip(computed, exact, scales, strict=True)]
        return list(zip(self.reference["rows"], exact, computed, differences, strict=True))

    def lines(self) -> list[str]:
        """Return the rows of the page."""
        return [
            f"| {self.name} | {label} | {shown(exact)} | {shown(computed)} | {difference:.0e} | {self.elements} |"
            for label, exact, computed, difference in self.rows
        ]


def shown(values: np.ndarray) -> str:
    """Return numbers with seven digits, or eight decimals where they are small."""
    return ", ".join(f"{value:.7g}" if abs(value) >= 0.1 else f"{value:.8f}" for value in values.tolist())


CASES = [
    Case(statics.tip_moment_rollup, 40, size=1.0, slow=True),
    Case(statics.dead_tip_force, 20),
    Case(statics.follower_tip_force, 80, slow=True),
    Case(statics.uniform_dead_load, 20),
    Case(statics.uniform_follower_load, 20),
    Case(buckling.elastica_cantilever_axial, 40),
    Case(buckling.elastica_clamped_clamped, 40),
    Case(statics.inclined_tip_force, 40),
    Case(statics.clamped_clamped_centre_force, 40),
    Case(statics.williams_toggle, 20),
    Case(statics.deep_arch_clamped_hinged, 60, slow=True),
    Case(statics.initially_curved_straightened, 20, size=1.0),
    Case(flow.blade_in_uniform_flow, 80, slow=True),
    Case(stability.euler_buckling, 20, slow=True),
    Case(stability.self_weight_buckling, 20, slow=True),
    Case(stability.beck_column, 20),
    Case(stability.pfluger_column, 20, slow=True),
    Case(stability.beck_with_internal_damping, 20, slow=True),
    Case(frequencies.freq_clamped_clamped, 40),
    Case(frequencies.freq_pinned_pinned, 40),
    Case(frequencies.freq_free_free, 40),
    Case(frequencies.freq_cantilever_mid_mass, 40),
    Case(frequencies.freq_pp_mid_mass, 40),
    Case(frequencies.freq_tip_spring, 20),
    Case(frequencies.freq_clamped_pinned_rotary_inertia, 20),
    Case(frequencies.freq_pp_mid_spring, 40),
    Case(frequencies.freq_rotational_springs, 40),
    Case(frequencies.freq_free_on_springs, 20),
    Case(frequencies.freq_winkler, 40),
    Case(frequencies.freq_axial_cc, 40),
    Case(frequencies.freq_axial_pp, 40),
    Case(frequencies.freq_stepped_cantilever, 40),
    Case(frequencies.freq_taper, 160),
    Case(frequencies.freq_rotating_lag, 30),
    Case(frequencies.freq_hinged_hanging, 40),
    Case(frequencies.freq_chain, 160),
    Case(stability.tip_dashpot_weak, 40),
    Case(stability.tip_dashpot_strong, 40, size=1e-6),
    Case(stability.kelvin_voigt_pp, 40),
    Case(backbones.backbone_pp, 20, slow=True),
    Case(backbones.backbone_cc, 20, slow=True),
    Case(buckling.postbuckled_pp, 40),
    Case(buckling.postbuckled_cc, 40),
    Case(motions.moving_force, 20, DYNAMIC, slow=True),
    Case(motions.flying_beam_500, 10, DYNAMIC, slow=True),
    Case(motions.robot_arm_moment, 20, DYNAMIC),
    Case(motions.rubber_pendulum, 40, PENDULUM, size=1.2, slow=True),
    Case(motions.clamped_clamped_step_force, 40, DYNAMIC, size=1e-4, slow=True),
]


def summary() -> str:
    """Return the table of the cases."""
    keys = "description", "quantity", "source"
    cells = [[case.name, *(case.reference[key].replace("|", "\\|") for key in keys)] for case in CASES]
    return CASES_HEADER + "\n".join(f"| {' | '.join(row)} |" for row in cells) + "\n"


def rates() -> str:
    """Return the table of convergence."""
    rows = []
    for name in HELD:
        found = errors(name)
        rows.append(f"| {name} | {' | '.join(f'{error:.2e}' for error in found)} | {order(found):.2f} |")
    return RATES_HEADER + "\n".join(rows) + "\n"


def numbers() -> str:
    """Return the table of the numbers."""
    return HEADER + "\n".join(line for case in CASES for line in case.lines()) + "\n"


if __name__ == "__main__":
    text = PAGE.read_text()
    introduction = text[: text.index("## Cases")]
    parts = "## Cases", summary(), "## Convergence", SECOND_MODE, rates(), "## Numbers", numbers()
    PAGE.write_text(introduction + "\n\n".join(part.rstrip() for part in parts) + "\n")
