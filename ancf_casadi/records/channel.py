"""The columns of a file: their names, their units as written, and their numbers."""

from __future__ import annotations

from dataclasses import dataclass

from ancf_casadi.records.units import Unit
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.inputs import shown
from ancf_casadi.support.tables import Displayed, counted


@dataclass(frozen=True, eq=False)
class RecordedChannel(Displayed):
    """One column of a file, or one channel of a measuring system.

    Parameters
    ----------
    number : int
        Number of the column in the file, from 1.
    name : str
        Its name.
    values : ndarray
        Its numbers in the unit of the file; nan marks a gap.
    symbol : str
        Unit as written in the file; empty if there is none.
    unit : Unit or None
        Meaning of the unit; None if there is none, or if it is not understood.
    time : ndarray or None
        Time of each number, s, if the file gives it.
    fault : str
        Reason why the column cannot be used; empty if it can.
    """

    number: int
    name: str
    values: Array
    symbol: str = ""
    unit: Unit | None = None
    time: Array | None = None
    fault: str = ""

    @property
    def label(self) -> str:
        """Number and name, for messages."""
        return f"{self.number} {shown(self.name)}"

    def _summary(self) -> str:
        return f"{self.label}, {counted(len(self.values), 'sample')}"


@dataclass(frozen=True, eq=False)
class Contents:
    """The columns of a file, before one of them is chosen as the time.

    Parameters
    ----------
    channels : tuple of RecordedChannel
        All columns, in their order.
    notes : tuple of str
        Decisions of the reader that the user should know.
    lines : ndarray or None
        Line of each row in a text file.
    """

    channels: tuple[RecordedChannel, ...]
    notes: tuple[str, ...] = ()
    lines: Index | None = None

    def place(self, row: int) -> str:
        """Return the place of a row in the file, for messages."""
        return f"sample {row + 1}" if self.lines is None else f"line {self.lines[row]}"
