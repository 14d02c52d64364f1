"""Beyond the paper: the best uniform beam, which cannot have all five measured frequencies."""

from __future__ import annotations

from problems.paper.inputs import FREQUENCIES, STANDARD_BEAM
from problems.paper.step import paper_step
from problems.spec.match import MatchTable
from problems.study.compute import Compute
from problems.study.kinds.beam import match_finding
from problems.study.step import Finding

UNIFORM = MatchTable(
    targets=FREQUENCIES,
    bounds=0.10,
    objective="worst-error",
    unknowns=dict.fromkeys(("width", "thickness", "density", "elastic_modulus"), "global"),
)


@paper_step(
    kind="match",
    title="The best uniform beam",
    draw=False,
    text="""
If width, thickness, density and elastic modulus are the same in all elements, no beam within 10 % has the five \
frequencies. The smallest possible largest error is about 3 %; with one value per element it is zero (Table 10).""",
)
def uniform_beam(compute: Compute) -> Finding:
    """Return the uniform beam with the smallest largest error."""
    match: Finding = compute(match_finding, STANDARD_BEAM, UNIFORM)
    return match
