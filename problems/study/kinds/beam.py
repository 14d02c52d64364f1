"""A part with the properties of the beam, Table 1 of the paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypedDict, final

import numpy as np

from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.support.inputs import check_keys, located
from problems.study.data_table import Column, DataTable, printed_values
from problems.study.kind import Kind
from problems.study.part import Effort, Finding, Heading, Outcome, Part
from problems.study.source import Source, printed_numbers

KEYS = """\
  kind = "beam"         the properties of [beam]; printed = {value = [length (mm),
                        width (mm), thickness (mm), density (kg/m^3), elastic
                        modulus (GPa)]}
"""
ROWS = (("length", "mm", 1e3), ("width", "mm", 1e3), ("thickness", "mm", 1e3), ("density", "kg/m³", 1.0),
        ("elastic_modulus", "GPa", 1e-9))  # fmt: skip


class BeamNumbers(TypedDict):
    """Properties of a beam, one value per element, in SI units."""

    length: float
    elements: int
    axis: list[float]
    gravity: list[float]
    width: list[float]
    thickness: list[float]
    density: list[float]
    elastic_modulus: list[float]


@final
@dataclass(frozen=True)
class BeamProperties(Part):
    """The properties of a beam.

    Parameters
    ----------
    beam : Beam
        The beam.
    printed : dict
        Printed numbers by column.
    """

    kind = "beam"
    numbers = BeamNumbers

    beam: Beam
    printed: dict[str, tuple[float | None, ...]]

    def finding(self, results: Sequence[Any], found: Mapping[str, Outcome], effort: Effort) -> Finding:
        """Return the table of properties."""
        beam = self.beam
        means = [scale * float(np.mean(getattr(beam, name))) for name, _, scale in ROWS]
        printed = printed_values(self.printed, "value")
        columns = (
            Column("property", tuple(name.replace("_", " ") for name, *_ in ROWS)),
            Column("unit", tuple(unit for _, unit, _ in ROWS)),
            Column("value", tuple(means), printed=printed),
        )
        varying = [name for name, *_ in ROWS[1:] if np.ptp(getattr(beam, name)) > 0.0]
        notes = [f"{beam.elements} elements; axis {beam.axis}, gravity {beam.gravity} m/s²."]
        if varying:
            notes.append(f"Means over the elements: {', '.join(varying).replace('_', ' ')} vary along the beam.")
        if beam.tip_mass:
            notes.append(f"Mass at the tip: {1e3 * beam.tip_mass:.4g} g.")
        if np.isfinite(beam.clamp_stiffness):
            notes.append(f"Stiffness of the clamp: {beam.clamp_stiffness:.4g} N m/rad.")
        name = self.heading.name
        table = DataTable(name, "Properties of the beam", columns, (*notes, *self.heading.notes), self.heading.source)
        data = {
            **{row: list(np.atleast_1d(getattr(beam, row)).astype(float)) for row, *_ in ROWS[1:]},
            "length": beam.length,
            "elements": beam.elements,
            "axis": list(beam.axis),
            "gravity": list(beam.gravity),
        }
        return Finding(Outcome(data, beam=beam), (table,))


def read(source: Source, given: dict[str, Any], heading: Heading, where: str) -> BeamProperties:
    """Return the part that a table describes.

    Raises
    ------
    InputError
        If a key or value cannot be used.
    """
    check_keys(given, set(), {"printed"}, where)
    with located(where):
        return BeamProperties(heading, source.model.beam, printed_numbers(given, {"value": len(ROWS)}))


KIND = Kind(BeamProperties.kind, "The beam", KEYS, read)
