"""Tables 9 and 10: the standard beam, changed until it has the measured natural frequencies."""

from __future__ import annotations

from problems.paper.inputs import STANDARD_BEAM, match_standard_beam
from problems.paper.step import paper_step
from problems.study.compute import Compute
from problems.study.kinds.beam import match_finding
from problems.study.step import Finding

PRINTED = {
    "value": (5.0, 0.49, 8108.0, 205.130),  # Table 9: width, thickness, mm, density, kg/m^3, elastic modulus, GPa
    "standard": (1.67, 10.47, 29.32, 57.46, 94.97),  # Table 10, Hz
    "optimum": (1.84, 10.18, 26.81, 53.15, 88.79),  # Table 10, Hz
}
PRINTED_DENSITY = 7850.0  # kg/m^3, of a beam without gravity that has the printed standard frequencies


@paper_step(
    kind="match",
    section="Comparison of simulation and experiment (Section 5)",
    title="Matching of the natural frequencies",
    text="""
Width and thickness of each of 20 elements, the density and the elastic modulus change by at most 10 % until the \
hanging beam has the five measured frequencies. Of all beams that match, this one differs least from the standard \
beam.""",
    tables=("Table 9", "Table 10"),
    notes=(
        "A uniform beam with the optimum of the paper misses its Table 10 by up to 13 %. If the values of this optimum "
        "are means over the elements, Table 10 can be reproduced.",
        'Column "before" hangs under gravity and has the 8000 kg/m³ of Table 1; the paper used 7850 kg/m³ and no '
        "gravity for its standard frequencies. Its 94.97 Hz fits neither 94.99 (exact) nor 95.00 (20 elements).",
        "The errors of 0.1 to 0.5 % that the paper leaves are those of its optimiser, not a limit.",
    ),
)
def frequency_matching(compute: Compute) -> Finding:
    """Return the matched beam and its frequencies, beside those of the standard beam."""
    match = match_standard_beam(compute)
    return match_finding(compute, STANDARD_BEAM, match, PRINTED, "paper", weightless=PRINTED_DENSITY)
