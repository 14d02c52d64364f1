"""Tables 9 and 10: the standard beam, changed until it has the measured natural frequencies."""

from __future__ import annotations

from dataclasses import replace

from ancf_casadi.mechanics.model import Model
from ancf_casadi.vibration.modes import natural_modes
from problems.paper.inputs import STANDARD_BEAM, match_standard_beam
from problems.paper.step import paper_step
from problems.study.compute import Compute
from problems.study.step import Finding

PROPERTIES = (5.0, 0.49, 8108.0, 205.130)  # Table 9: width, thickness, mm, density, kg/m^3, elastic modulus, GPa
STANDARD = (1.67, 10.47, 29.32, 57.46, 94.97)  # Table 10, Hz
OPTIMUM = (1.84, 10.18, 26.81, 53.15, 88.79)  # Table 10, Hz
PRINTED_DENSITY = 7850.0  # kg/m^3, of a beam without gravity that has the printed standard frequencies
WEIGHTLESS = f"{PRINTED_DENSITY:g} kg/m³, no gravity"


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
    properties, frequencies = match.tables
    weightless = Model(STANDARD_BEAM.with_(gravity=(0.0, 0.0), density=PRINTED_DENSITY))
    of_weightless = natural_modes(weightless, count=len(frequencies.rows)).frequencies.tolist()
    columns = (*frequencies.columns[:3], WEIGHTLESS, *frequencies.columns[3:])
    rows = [(*row[:3], frequency, *row[3:]) for row, frequency in zip(frequencies.rows, of_weightless, strict=True)]
    match = replace(match, tables=(properties, replace(frequencies, columns=columns, rows=rows)))
    return match.beside_print({"mean": PROPERTIES}, {WEIGHTLESS: STANDARD, "matched": OPTIMUM})
