"""Tables of a study: values with their standard errors, beside the numbers that others have printed.

A value is shown with as many digits as its standard error supports, and with four digits if there is none.  CSV files
hold all digits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ancf_casadi.support.tables import Cell, Table


@dataclass(frozen=True)
class Column:
    """A column of a table."""

    head: str  # quantity
    values: tuple[Cell, ...]  # one cell per row
    unit: str = ""  # unit of the numbers; none if empty
    errors: tuple[float | None, ...] | None = None  # standard error of each value
    printed: tuple[float | None, ...] | None = None  # value that the source prints in each row
    digits: tuple[int, ...] | None = None  # significant digits of each value without a standard error; 4 if None


def columns_of(
    heads: Sequence[str], rows: Sequence[Sequence[Cell]], printed: Mapping[str, tuple[float | None, ...]] | None = None
) -> tuple[Column, ...]:
    """Return the columns of rows; a head is a quantity, or ``quantity, unit``, and ``printed`` is by quantity."""
    named = [head.rpartition(", ")[::2] if ", " in head else (head, "") for head in heads]
    return tuple(
        Column(head, tuple(row[k] for row in rows), unit, printed=(printed or {}).get(head))
        for k, (head, unit) in enumerate(named)
    )


@dataclass(frozen=True)
class DataTable:
    """A table of a study."""

    title: str
    columns: tuple[Column, ...]
    notes: tuple[str, ...] = ()  # remarks below the table
    source: str = "printed"  # origin of the printed numbers

    def heads(self) -> list[str]:
        """Return the heads of the columns as a document shows them, with units."""
        found = []
        for column in self.columns:
            found.append(f"{column.head}, {column.unit}" if column.unit else column.head)
            found += [self.source, "difference"] if column.printed else []
        return found

    def cells(self) -> list[list[str]]:
        """Return the rows as a document shows them: value and standard error in one cell."""
        rows = []
        for k in range(len(self.columns[0].values)):
            row = []
            for column in self.columns:
                value = column.values[k]
                error = column.errors[k] if column.errors else None
                row.append(shown(value, error, column.digits[k] if column.digits else 4))
                if column.printed:
                    row += [shown(column.printed[k], digits=6), difference(value, column.printed[k])]
            rows.append(row)
        return rows

    def text(self) -> str:
        """Return the table for a terminal, as a document shows it."""
        return Table(self.title, self.title, self.heads(), self.cells(), self.notes).text()

    def table(self) -> Table:
        """Return the table with one number per cell, all digits, for CSV."""
        heads: list[str] = []
        cells: list[Sequence[Cell]] = []
        for column in self.columns:
            heads.append(f"{column.head} ({column.unit})" if column.unit else column.head)
            cells.append(column.values)
            if column.errors:
                heads.append("standard error")
                cells.append([None if error is None or math.isnan(error) else error for error in column.errors])
            if column.printed:
                heads.append(self.source)
                cells.append(column.printed)
        return Table(self.title, self.title, heads, list(zip(*cells, strict=True)), self.notes)


def shown(value: Cell, error: float | None = None, digits: int = 4) -> str:
    """Return a cell as text: a number with the digits that its standard error supports."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if not isinstance(value, float):
        return str(value)
    if error is None or not math.isfinite(error) or error <= 0.0:
        return _plain(f"{value:.{digits}g}")
    decimals = 1 - math.floor(math.log10(error))  # two digits of a standard error
    if -3 <= math.log10(max(abs(value), error)) < 6:
        return f"{value:.{max(0, decimals)}f} ± {error:.{max(0, decimals)}f}"
    power = math.floor(math.log10(max(abs(value), error)))
    places = max(0, decimals + power)
    return f"({value / 10**power:.{places}f} ± {error / 10**power:.{places}f})e{power}"


def digits_of(value: float, error: float | None) -> int:
    """Return the significant digits of a value down to the second digit of an error; 4 for none."""
    if not (value and error and math.isfinite(error)):
        return 4
    return max(4, 2 + math.floor(math.log10(abs(value))) - math.floor(math.log10(error)))


def difference(value: Cell, printed: float | None) -> str:
    """Return the difference of a value from a printed one, in per cent of the printed one."""
    if printed is None or not isinstance(value, int | float) or not math.isfinite(value):
        return ""
    if printed == 0.0:
        return "0" if value == 0.0 else f"{value:+.2g}"
    relative = value / printed - 1
    if abs(relative) < 5e-7:  # relative difference that counts as none
        return "0"
    return f"{100 * relative:+.2g} %" if abs(relative) < 0.995 else f"{100 * relative:+.0f} %"


def _plain(text: str) -> str:
    """Return a number without the zeros that Python puts into exponents."""
    mantissa, e, power = text.partition("e")
    return f"{mantissa}e{int(power)}" if e else text
