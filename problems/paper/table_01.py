"""Table 1: the properties of the beam."""

from __future__ import annotations

from problems.paper.inputs import STANDARD_BEAM
from problems.paper.step import paper_step
from problems.study.compute import Compute
from problems.study.kinds.beam import properties_finding
from problems.study.step import Finding

PRINTED = {"value": (500.0, 5.0, 0.5, 8000.0, 210.0)}  # mm, mm, mm, kg/m^3, GPa


@paper_step(
    kind="beam",
    title="Properties of the beam",
    tables=("Table 1",),
    notes=("The frequencies that the paper computes with these properties (Table 10) need 7850 kg/m³ and no gravity.",),
)
def standard_beam(compute: Compute) -> Finding:
    """Return the properties of the beam."""
    return properties_finding(STANDARD_BEAM).beside_print(PRINTED)
