"""Layout of the table in a file that its reader cannot recognise: rows and columns that a user names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from types import NoneType
from typing import Any

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import RecordedChannel, find_channel
from ancf_casadi.support.inputs import check_instance, is_sequence, shown, whole
from ancf_casadi.support.tables import Displayed


@dataclass(frozen=True)
class TableLayout(Displayed):
    """Rows and columns of a file that its reader cannot recognise.

    The fields are also options of the commands (``--names-row``) and keys of TOML files (``names_row``).

    Parameters
    ----------
    names_row : int, optional
        Line of a text file with the names of the columns, from 1; the rows below it, without it, hold the table.
    skip_rows : sequence of int
        Lines of a text file to leave out, from 1.
    leave_out : sequence of str or int
        Names or numbers (from 1) of the columns to leave out.
    imaginary : str or int, optional
        Name or number of the column with the imaginary parts of a function over frequency.

    Raises
    ------
    InputError
        If a value is of another type, or a line is not 1 or more.

    Examples
    --------
    >>> from pathlib import Path
    >>> from ancf_casadi import TableLayout, read_recording
    >>> _ = Path("run.txt").write_text('''1 2 3
    ... time_s x_mm y_mm
    ... 7 8 9
    ... 0.0 1.5 -2.0
    ... 0.1 1.4 -2.1
    ... ''')
    >>> layout = TableLayout(names_row=2, skip_rows=[3], leave_out=["y_mm"])
    >>> read_recording("run.txt", layout=layout).channel().values
    array([1.5, 1.4])
    """

    names_row: int | None = None
    skip_rows: Sequence[int] = ()
    leave_out: Sequence[str | int] = ()
    imaginary: str | int | None = None

    def __post_init__(self) -> None:
        """Validate, and keep tuples."""
        if self.names_row is not None:
            whole(self.names_row, "names_row", 1)
        for name in ("skip_rows", "leave_out"):
            if not is_sequence(getattr(self, name)):
                raise InputError(f"must be a list, got {shown(getattr(self, name))}", name)
            object.__setattr__(self, name, tuple(getattr(self, name)))
        for line in self.skip_rows:
            whole(line, "skip_rows", 1)
        check_instance(self.imaginary, "imaginary", str, int, NoneType)

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> TableLayout:
        """Return the layout in a mapping that may hold other keys, and None for a default."""
        return cls(**{name: options[name] for name in LAYOUT_KEYS if options.get(name) is not None})


def chosen_channels(channels: Sequence[RecordedChannel], layout: TableLayout, path: str) -> tuple[RecordedChannel, ...]:
    """Return the channels of a file without those that a layout leaves out."""
    left_out = {find_channel(channels, name, "--leave-out", path).number for name in layout.leave_out}
    return tuple(channel for channel in channels if channel.number not in left_out)


LAYOUT_KEYS = tuple(declared.name for declared in fields(TableLayout))
NO_LAYOUT = TableLayout()
