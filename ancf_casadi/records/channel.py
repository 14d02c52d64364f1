"""The columns of a file: their names, their units as written, and their numbers."""

from __future__ import annotations

from dataclasses import dataclass

from ancf_casadi.records.units import Unit
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.inputs import shown
from ancf_casadi.support.tables import Displayed, counted


@dataclass(frozen=True, eq=False)
class RecordedChannel(Displayed):
    """One column of a file, or one channel of a measuring system."""

    number: int  # number of the column in the file, from 1
    name: str
    values: Array  # its numbers in the unit of the file; nan marks a gap
    symbol: str = ""  # unit as written in the file; empty if there is none
    unit: Unit | None = None  # meaning of the unit; None if there is none, or if it is not understood
    time: Array | None = None  # time of each number, s, if the file gives it
    fault: str = ""  # reason why the column cannot be used; empty if it can
    reference: str = ""  # of a frequency response function: its input, if the file names it

    @property
    def label(self) -> str:
        """Number and name, for messages."""
        return f"{self.number} {shown(self.name)}"

    def _summary(self) -> str:
        return f"{self.label}, {counted(len(self.values), 'sample')}"


@dataclass(frozen=True, eq=False)
class Contents:
    """The columns of a file, before one of them is chosen as the time."""

    channels: tuple[RecordedChannel, ...]
    notes: tuple[str, ...] = ()  # decisions of the reader that the user should know
    lines: Index | None = None  # line of each row in a text file

    def place(self, row: int) -> str:
        """Return the place of a row in the file, for messages."""
        return f"sample {row + 1}" if self.lines is None else f"line {self.lines[row]}"
