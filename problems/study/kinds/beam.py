"""Parts with the properties of the beam, Table 1 of the paper, and with its natural frequencies and mode shapes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Self, TypedDict, final

import numpy as np
from msgspec import Meta

from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.inputs import whole
from ancf_casadi.vibration.modes import natural_modes
from problems.study.data_table import Column
from problems.study.drawing import drawn
from problems.study.part import Effort, Finding, Found, Part
from problems.study.source import Printed, Source, printed_numbers

BEAM_ROWS = (("length", "mm", 1e3), ("width", "mm", 1e3), ("thickness", "mm", 1e3), ("density", "kg/m³", 1.0),
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
@dataclass(frozen=True, kw_only=True)
class BeamProperties(Part):
    """The properties of a beam."""

    kind, about, heading = "beam", "the properties of [beam]; {}", "The beam"
    numbers = BeamNumbers
    naming, beam = ("beam",), ""

    printed: Annotated[
        Printed,
        Meta(
            description="{value = [length (mm), width (mm), thickness (mm), density (kg/m^3), elastic modulus (GPa)]}"
        ),
    ] = field(default_factory=dict)

    def checked(self, source: Source, where: str) -> Self:
        """Return the part with its printed numbers."""
        return replace(self, printed=printed_numbers(self.printed, {"value": len(BEAM_ROWS)}, where))

    def finding(self, results: Sequence[Any], found: Found, effort: Effort) -> Finding:
        """Return the table of properties."""
        beam = self.beam_in(found)
        means = [scale * float(np.mean(getattr(beam, name))) for name, _, scale in BEAM_ROWS]
        printed = self.printed.get("value")
        columns = (
            Column("property", tuple(name.replace("_", " ") for name, *_ in BEAM_ROWS)),
            Column("unit", tuple(unit for _, unit, _ in BEAM_ROWS)),
            Column("value", tuple(means), printed=printed),
        )
        varying = [name for name, *_ in BEAM_ROWS[1:] if np.ptp(getattr(beam, name)) > 0.0]
        notes = [f"{beam.elements} elements; axis {beam.axis}, gravity {beam.gravity} m/s²."]
        if varying:
            notes.append(f"Means over the elements: {', '.join(varying).replace('_', ' ')} vary along the beam.")
        if beam.tip_mass:
            notes.append(f"Mass at the tip: {1e3 * beam.tip_mass:.4g} g.")
        if np.isfinite(beam.clamp_stiffness):
            notes.append(f"Stiffness of the clamp: {beam.clamp_stiffness:.4g} N m/rad.")
        table = self.data_table("Properties of the beam", columns, *notes)
        data = {
            **{row: list(np.atleast_1d(getattr(beam, row)).astype(float)) for row, *_ in BEAM_ROWS[1:]},
            "length": beam.length,
            "elements": beam.elements,
            "axis": list(beam.axis),
            "gravity": list(beam.gravity),
        }
        return Finding(data, (table,), beam=beam)


class ModesNumbers(TypedDict):
    """Natural frequencies."""

    frequency_hz: list[float]


@final
@dataclass(frozen=True, kw_only=True)
class ModesOfBeam(Part):
    """The lowest modes of a beam."""

    kind, about, heading = "modes", "natural frequencies and shapes: {}", "Natural modes"
    numbers = ModesNumbers
    naming = ("beam",)

    modes: Annotated[int, Meta(ge=1)] = 5
    beam: Annotated[str, Meta(description='"PART"')] = ""
    printed: Annotated[Printed, Meta(description="{frequency (Hz)}")] = field(default_factory=dict)

    def checked(self, source: Source, where: str) -> Self:
        """Return the part with its printed numbers."""
        whole(self.modes, f"{where}: modes", 1, source.most_modes)
        return replace(self, printed=printed_numbers(self.printed, {"frequency": self.modes}, where))

    def finding(self, results: Sequence[Any], found: Found, effort: Effort) -> Finding:
        """Return the table of frequencies, and the shapes."""
        beam = self.beam_in(found)
        modes = natural_modes(Model(beam), count=self.modes)
        frequencies = modes.frequencies.tolist()
        columns = (
            Column("mode", tuple(range(1, self.modes + 1))),
            Column("frequency", tuple(frequencies), "Hz", printed=self.printed.get("frequency")),
        )
        table = self.data_table("Natural frequencies", columns)
        figure = drawn(self.name, "Mode shapes about the equilibrium.", modes.figure)
        return Finding({"frequency_hz": frequencies}, (table,), (figure,), beam=beam)
