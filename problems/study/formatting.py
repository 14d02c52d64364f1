"""Tables of a study on its page and in its files.

The page shows a value with as many digits as its standard error supports, or else with those that the table states,
beside the number that others have printed.  CSV files hold all digits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from ancf_casadi.support.tables import Cell, Table, finite_or_none


def formatted_table(table: Table) -> Table:
    """Return a table as a document shows it: texts, with value and standard error in one cell."""
    columns: list[tuple[str, Sequence[Cell]]] = []
    for head, values in zip(table.columns, zip(*table.rows, strict=True), strict=True):
        errors = table.errors.get(head, [None] * len(values))
        columns.append((head, [shown(value, error, table.digits) for value, error in zip(values, errors, strict=True)]))
        if printed := table.printed.get(head):
            columns.append((table.source, [shown(number, digits=6) for number in printed]))
            columns.append(("difference", [*map(difference, values, printed)]))
    return _with_columns(table, columns)


def numeric_table(table: Table) -> Table:
    """Return a table with one number per cell, all digits, for CSV."""
    columns: list[tuple[str, Sequence[Cell]]] = []
    for head, values in zip(table.columns, zip(*table.rows, strict=True), strict=True):
        quantity, _, unit = head.rpartition(", ") if ", " in head else (head, "", "")
        in_unit = f" ({unit})" if unit else ""
        columns.append((quantity + in_unit, values))
        if errors := table.errors.get(head):
            numbers = [None if error is None else finite_or_none(error) for error in errors]
            columns.append((f"standard error of {quantity}{in_unit}", numbers))
        if printed := table.printed.get(head):
            columns.append((f"{table.source} {quantity}{in_unit}", printed))
    return _with_columns(table, columns)


def _with_columns(table: Table, columns: Sequence[tuple[str, Sequence[Cell]]]) -> Table:
    heads, values = zip(*columns, strict=True)
    return replace(table, columns=list(heads), rows=list(zip(*values, strict=True)))


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
