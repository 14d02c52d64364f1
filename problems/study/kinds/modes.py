"""A part with the natural frequencies and mode shapes of a beam about its equilibrium."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypedDict, final

from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.inputs import check_keys, located, whole
from ancf_casadi.vibration.modes import natural_modes
from problems.study.data_table import Column, DataTable, printed_values
from problems.study.drawing import drawn
from problems.study.kind import Kind
from problems.study.part import Effort, Finding, Heading, Outcome, Part
from problems.study.source import BeamChoice, Source, printed_numbers

KEYS = """\
  kind = "modes"        natural frequencies and shapes: count, beam ("PART"),
                        printed = {frequency (Hz)}
"""


class ModesNumbers(TypedDict):
    """Natural frequencies."""

    frequency_hz: list[float]


@final
@dataclass(frozen=True)
class ModesOfBeam(Part):
    """The lowest modes of a beam.

    Parameters
    ----------
    choice : BeamChoice
        The beam.
    count : int
        Number of modes.
    printed : dict
        Printed numbers by column.
    """

    kind = "modes"
    numbers = ModesNumbers

    choice: BeamChoice
    count: int
    printed: dict[str, tuple[float | None, ...]]

    @property
    def needs(self) -> tuple[str, ...]:
        """The part that finds the beam."""
        return self.choice.needs

    def finding(self, results: Sequence[Any], found: Mapping[str, Outcome], effort: Effort) -> Finding:
        """Return the table of frequencies, and the shapes."""
        beam = self.choice.beam(found)
        modes = natural_modes(Model(beam), count=self.count)
        frequencies = modes.frequencies.tolist()
        name, heading = self.heading.name, self.heading
        columns = (
            Column("mode", tuple(range(1, self.count + 1))),
            Column("frequency", tuple(frequencies), "Hz", printed=printed_values(self.printed, "frequency")),
        )
        table = DataTable(name, "Natural frequencies", columns, heading.notes, heading.source)
        figure = drawn(name, "Mode shapes about the equilibrium.", modes.figure)
        return Finding(Outcome({"frequency_hz": frequencies}, beam=beam), (table,), (figure,))


def read(source: Source, given: dict[str, Any], heading: Heading, where: str) -> ModesOfBeam:
    """Return the part that a table describes.

    Raises
    ------
    InputError
        If a key or value cannot be used.
    """
    check_keys(given, set(), {"beam", "count", "printed"}, where)
    with located(where):
        count = whole(given.get("count", 5), "count", 1, source.most_modes)
        return ModesOfBeam(
            heading, source.beam_choice(given, where), count, printed_numbers(given, {"frequency": count})
        )


KIND = Kind(ModesOfBeam.kind, "Natural modes", KEYS, read)
