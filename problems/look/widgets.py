"""What the panels of the page have in common: notes, reports and charts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from nicegui import ui


def show_notes(column: ui.column, notes: Sequence[str]) -> None:
    """Show notes in place of those in a column."""
    column.clear()
    with column:
        for note in notes:
            ui.label(note).classes("text-sm border-l-4 border-orange-400 pl-2")


def report_label() -> ui.label:
    """Return a label for a report, with its columns below one another."""
    return ui.label().classes("w-full overflow-x-auto whitespace-pre font-mono text-xs")


def set_options(chart: ui.echart, options: dict[str, Any]) -> None:
    """Draw a chart with other options."""
    chart.options.clear()
    chart.options.update(options)
    chart.update()
