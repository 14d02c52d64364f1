"""Panels of the page, and the fields, notes, tables and charts that they share."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

from nicegui import app, events, ui

from ancf_casadi.exceptions import AncfError
from problems.look.charts import SPARKLINE
from problems.look.choices import DIGITS
from problems.look.worker import Work, work

T = TypeVar("T")

POLLING = 0.2  # s between two looks at the progress
HANDLE = """setTimeout(() => {
    const element = getElement(%d), value = %s, chart = element.chart, axis = {xAxisIndex: 0}, width = 9;
    let at = null;
    chart.off('finished', chart.placeHandle);
    chart.placeHandle = () => {
        const x = value === null ? NaN : chart.convertToPixel(axis, value) - width / 2;
        if (Object.is(x, at)) return;
        at = x;
        const {y, height} = chart.getModel().getComponent('grid').coordinateSystem.getRect();
        chart.setOption({graphic: {
            id: 'handle', type: 'rect', x, y, shape: {width, height}, style: {fill: 'rgba(217, 72, 15, 0.25)'},
            draggable: 'horizontal', cursor: 'ew-resize', z: 100, ignore: isNaN(x),
            ondragend() { element.$emit('drag', chart.convertFromPixel(axis, this.x + width / 2)); }}});
    };
    chart.on('finished', chart.placeHandle);
    chart.placeHandle();
}, 100)"""  # a new size of the chart moves the handle
BRUSHING = "{type: 'takeGlobalCursor', key: 'brush', brushOption: {brushType: 'lineX', brushMode: 'single'}}"


class Panel(ABC):
    """A part of the page that reads and fits in the thread until it shows what the user has chosen last."""

    choices: Any  # options of a command, a dataclass
    _task: asyncio.Task[None] | None = None
    _busy: ui.spinner
    _column: ui.column  # of the results

    @property
    def chosen(self) -> Any:
        """All that the user has chosen."""
        return self.choices

    def choose(self, **changes: Any) -> None:
        """Change choices, and show what belongs to them."""
        if (changed := replace(self.choices, **changes)) != self.choices:
            self.choices = changed
            self.start()

    def build(self) -> None:
        """Build the column of the choices, and that of the results beside it."""
        with ui.grid(columns="18rem minmax(0, 1fr)").classes("w-full"):
            with ui.column():
                self._build_choices()
            with ui.column().classes("w-full") as self._column:
                self._build_results()

    @abstractmethod
    def _build_choices(self) -> None: ...

    @abstractmethod
    def _build_results(self) -> None: ...

    @abstractmethod
    async def update(self) -> None:
        """Read what is chosen, fit it, and show both."""

    async def show(self) -> None:
        """Read and fit until the page shows the latest choices."""
        shown = None
        self._busy.set_visibility(True)
        self._column.classes("opacity-60")  # while its results are those of earlier choices
        while shown != (chosen := self.chosen):
            await self.update()
            shown = chosen
        self._busy.set_visibility(False)
        self._column.classes(remove="opacity-60")

    def start(self) -> None:
        """Begin to show the choices, unless this is being done."""
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self.show())

    async def save_figure(self, figure: Callable[[], Any]) -> None:
        """Draw the figure of a fit, for the user to save."""
        from ancf_casadi.figures.files import figure_bytes  # matplotlib is slow to import

        ui.download.content(await work(lambda: figure_bytes(figure(), ".png")), "fit.png")


class ComputingPanel(Panel):
    """A panel whose computations take long: they count their steps, and the user can stop them."""

    def __init__(self) -> None:
        self._works: list[Work] = []  # that the thread of all computations has yet to finish
        ui.context.client.on_delete(self.stop)
        app.on_shutdown(self.stop)

    def build_progress(self, *actions: Callable[[], Any]) -> None:
        """Build the buttons of actions that take long, of which each has its name, one that stops, and the progress."""
        with ui.row(align_items="center"):
            self._actions = {
                action.__name__: ui.button(action.__name__.replace("_", " "), on_click=action) for action in actions
            }
            self._stop = ui.button("stop", on_click=self.stop).props("outline")
            self._busy = ui.spinner()
            self._progress = ui.label().mark("progress")
        ui.timer(POLLING, self.show_progress)

    async def compute(self, function: Callable[..., T], *arguments: Any, title: str = "") -> T | None:
        """Return the result of a function; None if it was stopped.  With a title, its progress is shown."""
        computation = Work(title)
        self._works.append(computation)
        self.show_progress()
        try:
            return await work(computation.run, function, *arguments)
        finally:
            self._works.remove(computation)
            self.show_progress()

    async def attempt(self, message: ui.label, function: Callable[..., T], *arguments: Any, title: str) -> T | None:
        """Return the result of a function; None if it has failed or was stopped, which a message then says."""
        message.text = ""
        try:
            result = await self.compute(function, *arguments, title=title)
        except AncfError as error:
            message.text = str(error)
            return None
        message.text = "stopped" if result is None else ""
        return result

    def stop(self) -> None:
        """Stop all that is being computed."""
        for computation in self._works:
            computation.stop.set()

    def can_act(self, name: str) -> bool:
        """Return whether an action has an effect."""
        return not self._works

    def show_progress(self) -> None:
        """Show how far the last computation is, and the buttons that have an effect."""
        latest = self._works[-1] if self._works else None
        self._progress.text = latest.progress() if latest and latest.title else ""
        self._stop.set_visibility(latest is not None)
        for name, button in self._actions.items():
            button.set_visibility(self.can_act(name))


class Fields:
    """Fields for options by their names, which pass a new value to a function as its argument."""

    def __init__(self, choose: Callable[..., None]) -> None:
        self._choose, self.by_name = choose, dict[str, Any]()

    def select(self, name: str, options: Sequence[Any], label: str, hint: str = "") -> None:
        """Add a field with a list."""
        field = ui.select([*options], label=label, clearable=True)
        field.on_value_change(lambda: self._choose(**{name: field.value}))
        self._add(name, field, hint)

    def entry(self, name: str, label: str, hint: str = "", kind: type[str] | type[float] = str) -> None:
        """Add a field for a text or a number."""
        field: Any = ui.input(label) if kind is str else ui.number(label, format="%.6g")
        field.on("change", lambda: self._choose(**{name: None if field.value in (None, "") else kind(field.value)}))
        self._add(name, field, hint)

    def show(self, choices: Any) -> None:
        """Show the choices in their fields."""
        for name, field in self.by_name.items():
            field.value = getattr(choices, name)

    def _add(self, name: str, field: ui.element, hint: str) -> None:
        self.by_name[name] = field.props(f'dense hint="{hint}"').classes("w-full").mark(name)


def show_notes(column: ui.column, notes: Sequence[str]) -> None:
    """Show notes in place of those in a column."""
    column.clear()
    with column:
        for note in notes:
            ui.label(note).classes("text-sm border-l-4 border-orange-400 pl-2")


def show_lines(row: ui.row, lines: Mapping[str, str], choose: Callable[[str], None]) -> None:
    """Show columns as buttons with small lines in place of those in a row; a click chooses the name of one."""
    row.clear()
    width, height = SPARKLINE
    with row:
        ui.label("Choose a column:").classes("w-full text-subtitle2")
        for name, points in lines.items():
            with ui.button(on_click=lambda name=name: choose(name)).props("outline no-caps"):
                with ui.element("svg").props(f"width={width} height={height}"):
                    ui.element("polyline").props(f'points="{points}" fill=none stroke=currentColor')
                ui.label(name).classes("pl-2 break-all")


def columns(heads: Mapping[str, str]) -> list[dict[str, Any]]:
    """Return the columns of a table by the names of their values."""
    return [{"name": name, "label": head, "field": name, "align": "left"} for name, head in heads.items()]


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


def choose_in(chart: ui.echart, choose_value: Callable[[float], None]) -> None:
    """Let a double click in a chart, or the handle of its line, choose a value of the horizontal axis."""
    script = f"event => emit(getElement({chart.id}).chart.convertFromPixel({{xAxisIndex: 0}}, event.offsetX))"
    chart.on("dblclick", lambda event: choose_value(float(f"{event.args:.{DIGITS}g}")), js_handler=script)
    chart.on("drag", lambda event: choose_value(float(f"{event.args:.{DIGITS}g}")))


def place_handle(chart: ui.echart, value: float | None) -> None:
    """Place a handle, which can be dragged, on a value of the horizontal axis of a chart, or take it away."""
    chart.client.run_javascript(HANDLE % (chart.id, "null" if value is None else value))


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
