"""What the panels of the page have in common: work in the one thread, notes, and charts with a brush."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from nicegui import events, ui

from problems.look.computation import WORKER

T = TypeVar("T")

BRUSHING = "{type: 'takeGlobalCursor', key: 'brush', brushOption: {brushType: 'lineX', brushMode: 'single'}}"
DIGITS = 6  # of a time or a frequency that is chosen in a chart


async def work(function: Callable[..., T], *arguments: Any) -> T:
    """Return the result of a function that the thread of all computations calls."""
    return await asyncio.get_running_loop().run_in_executor(WORKER, function, *arguments)


def show_notes(column: ui.column, notes: Sequence[str]) -> None:
    """Show notes in place of those in a column."""
    column.clear()
    with column:
        for note in notes:
            ui.label(note).classes("text-sm border-l-4 border-orange-400 pl-2")


def report_label() -> ui.label:
    """Return a label for a report, with its columns below one another."""
    return ui.label().classes("w-full overflow-x-auto whitespace-pre font-mono text-xs")


def brushed_chart(choose_interval: Callable[[float, float], None], size: str) -> ui.echart:
    """Return a chart in which the user brushes over an interval."""

    def end_brush(event: events.GenericEventArguments) -> None:
        if areas := event.args["areas"]:
            low, high = (float(f"{end:.{DIGITS}g}") for end in areas[0]["coordRange"])
            choose_interval(low, high)
            chart.run_chart_method("dispatchAction", {"type": "brush", "areas": []})

    chart = ui.echart({}).classes(f"w-full {size}")
    return chart.on("chart:brushEnd", end_brush, ["areas"])


def set_options(chart: ui.echart, options: dict[str, Any]) -> None:
    """Draw a chart with other options."""
    chart.options.clear()
    chart.options.update(options)
    redraw(chart)


def redraw(chart: ui.echart) -> None:
    """Draw a chart with its new options; the pointer brushes in it, once the browser has drawn it."""
    chart.update()
    if "brush" in chart.options:
        chart.client.run_javascript(f"setTimeout(() => getElement({chart.id}).chart.dispatchAction({BRUSHING}), 100)")
