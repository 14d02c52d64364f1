"""The page: a file, its record with brushes, the fit of its decay, and the command and the study that do the same.

What the user chooses changes ``Choices``; the page then reads and fits in a thread, the latest choice alone if several
came in the meantime.  Errors appear beside what caused them.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar, get_args

import numpy as np
from nicegui import events, ui

from ancf_casadi.decay.phase import FrequencyLaw
from ancf_casadi.decay.rest_position import Rest
from ancf_casadi.exceptions import AncfError
from ancf_casadi.records.channel import Recording, is_counter, is_time
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.sensor import Quantity
from problems.decay.laws import Law
from problems.look.beam import BeamView
from problems.look.charts import (
    amplitude_chart,
    forget_fit,
    record_chart,
    residual_chart,
    show_fit,
    spectrum_chart,
)
from problems.look.choices import Choices
from problems.look.computation import WORKER, DecayView, fit_chosen, recording, spectrum, whole_record
from problems.spec.editing import has_beam
from problems.study.formatting import shown

T = TypeVar("T")

BRUSHING = "{type: 'takeGlobalCursor', key: 'brush', brushOption: {brushType: 'lineX', brushMode: 'single'}}"
DIGITS = 6  # of a time or a frequency that is chosen in a chart
LAWS_OF = {"law": Law, "frequency_law": FrequencyLaw, "rest": Rest}
SHOWS_RECORD = {"time", "time_unit", "sample_rate", "column", "unit", "sensor"}  # options that show another record


def build_page(file: str | None, folder: Path) -> None:
    """Build the page for a file, or for the one that is dropped there, which goes to a folder."""

    async def show_upload(event: events.UploadEventArguments) -> None:
        path = folder / Path(event.file.name).name
        await event.file.save(path)
        await show_file(str(path))

    async def show_file(path: str) -> None:
        body.clear()
        with body:
            try:
                view = BeamView(path) if has_beam(path) else RecordView(path)
            except AncfError as error:
                ui.label(str(error)).classes("text-negative")
                return
        await view.show()

    with ui.row(align_items="center").classes("w-full"):
        ui.label("ancf-casadi look").classes("text-h6")
        upload = ui.upload(label="Drop a file of measurements here", on_upload=show_upload, auto_upload=True)
        upload.props("flat bordered").style("max-height: 3.5rem").mark("upload")
    body = ui.column().classes("w-full")
    if file is not None:
        ui.timer(0.0, lambda: show_file(file), once=True)


class RecordView:
    """The part of the page that belongs to one file."""

    def __init__(self, file: str) -> None:
        self.choices = Choices.of(file)
        self._reading_changed = True
        self._task: asyncio.Task[None] | None = None
        self._view: DecayView | None = None
        with ui.grid(columns="18rem minmax(0, 1fr)").classes("w-full"):
            with ui.column():
                self._build_choices()
            with ui.column().classes("w-full"):
                self._build_results()

    async def show(self) -> None:
        """Read and fit until the page shows the latest choices."""
        shown = None
        self._busy.set_visibility(True)
        while shown != self.choices:
            shown = self.choices
            await self._update(shown)
        self._busy.set_visibility(False)

    def choose(self, **changes: Any) -> None:
        """Change choices, and read and fit anew."""
        if all(getattr(self.choices, name) == value for name, value in changes.items()):
            return
        self.choices = replace(self.choices, **changes)
        self._reading_changed |= not SHOWS_RECORD.isdisjoint(changes)
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self.show())

    def _build_choices(self) -> None:
        self._inputs: dict[str, Any] = {}
        ui.label(Path(self.choices.file).name).classes("text-subtitle1")
        self._select("column", [], "column")
        self._text("unit", "unit", "such as mm, g or 0.25 mm")
        self._select("sensor", get_args(Quantity), "sensor", "default: as the unit tells")
        self._number("sample_rate", "samples per second", "for a file without times")
        self._reading_error = ui.label().classes("text-negative").mark("reading-error")
        self._reader_notes = ui.column().classes("w-full gap-1").mark("reader-notes")
        ui.label("Part to fit, s").classes("text-subtitle2")
        for name in ("begin", "end", "release_time"):
            self._number(name, name.replace("_", " "))
        self._release = ui.label()
        self._band = ui.label()
        ui.button("all times and frequencies", on_click=self._choose_all).props("flat dense")
        ui.label("Laws").classes("text-subtitle2")
        for name, laws in LAWS_OF.items():
            default = "linear" if name == "law" else "constant, or auto if the law is"
            self._select(name, [*get_args(laws), "auto"], name.replace("_", " "), f"default: {default}")
        self._probabilities = ui.column().classes("w-full gap-0").mark("probabilities")
        self._inputs["robust"] = ui.checkbox(
            "limit the influence of outliers", on_change=lambda event: self.choose(robust=event.value)
        )

    def _build_results(self) -> None:
        with ui.row(align_items="center"):
            self._summary = ui.label().classes("text-subtitle1").mark("summary")
            self._busy = ui.spinner()
        self._fit_error = ui.label().classes("text-negative").mark("fit-error")
        self._record_chart = self._brushed_chart("begin", "end", "h-64")
        with ui.grid(columns="minmax(0, 1fr) minmax(0, 1fr)").classes("w-full"):
            self._residual_chart = ui.echart({}).classes("w-full h-56")
            self._spectrum_chart = self._brushed_chart("band", "", "h-56")
            self._curves = {name: ui.echart({}).classes("w-full h-56") for name in ("damping_ratio", "frequency")}
        self._notes = ui.column().classes("w-full gap-1").mark("notes")
        self._report = ui.label().classes("w-full overflow-x-auto whitespace-pre font-mono text-xs").mark("report")
        ui.label("The command and the study that do the same").classes("text-subtitle2")
        self._command = ui.code("", language="bash").classes("w-full").mark("command")
        self._study = ui.code("", language="toml").classes("w-full").mark("study")
        with ui.row():
            ui.button("save study.toml", on_click=lambda: ui.download.content(self.choices.study(), "study.toml"))
            ui.button("save the report", on_click=lambda: ui.download.content(self._report.text, "report.txt"))
            ui.button("save the figure", on_click=self._save_figure)

    def _brushed_chart(self, first: str, last: str, size: str) -> ui.echart:
        """Return a chart in which the user brushes over an interval: two options, or one with both ends."""

        def choose_interval(event: events.GenericEventArguments) -> None:
            if not (areas := event.args["areas"]):
                return
            low, high = (float(f"{end:.{DIGITS}g}") for end in areas[0]["coordRange"])
            self.choose(**({first: low, last: high} if last else {first: (max(low, 0.0), high)}))
            chart.run_chart_method("dispatchAction", {"type": "brush", "areas": []})

        chart = ui.echart({}).classes(f"w-full {size}").mark(first)
        return chart.on("chart:brushEnd", choose_interval, ["areas"])

    def _select(self, name: str, options: Sequence[Any], label: str, hint: str = "") -> None:
        def choose_value(event: events.ValueChangeEventArguments[Any]) -> None:
            self.choose(**{name: event.value})

        select = ui.select([*options], label=label, on_change=choose_value, clearable=True)
        self._inputs[name] = select.props(f'hint="{hint}"').classes("w-full").mark(name)

    def _text(self, name: str, label: str, hint: str) -> None:
        field = ui.input(label).props(f'hint="{hint}"')
        field.on("change", lambda: self.choose(**{name: field.value or None}))
        self._inputs[name] = field.classes("w-full").mark(name)

    def _number(self, name: str, label: str, hint: str = "") -> None:
        field = ui.number(label, format="%.6g").props(f'hint="{hint}"')
        field.on("change", lambda: self.choose(**{name: None if field.value is None else float(field.value)}))
        self._inputs[name] = field.classes("w-full").mark(name)

    def _choose_all(self) -> None:
        self.choose(begin=None, end=None, release_time=None, band=None)

    async def _update(self, choices: Choices) -> None:
        """Read what is chosen, fit it, and show both."""
        self._show_choices(choices)
        try:
            if self._reading_changed:
                self._show_columns(await _work(recording, choices))
                self._show_record(await _work(whole_record, choices))
                self._reading_changed = False
        except AncfError as error:
            self._reading_error.text = str(error)
            return
        self._reading_error.text = ""
        try:
            view = await _work(fit_chosen, choices)
        except AncfError as error:
            self._view, self._fit_error.text, self._summary.text = None, str(error), ""
            forget_fit(self._record_chart.options)
            _redraw(self._record_chart)
            return
        self._fit_error.text = ""
        self._show_fit(view)

    def _show_choices(self, choices: Choices) -> None:
        """Show the choices in their fields, and the command and the study."""
        for name, field in self._inputs.items():
            if name != "column":  # whose options the file tells
                field.value = getattr(choices, name)
        self._band.text = "band: " + ("{:g} to {:g} Hz".format(*choices.band) if choices.band else "all frequencies")
        self._command.content, self._study.content = choices.command(), choices.study()

    def _show_columns(self, contents: Recording) -> None:
        """Offer the columns of a file with values."""
        usable = [c for c in contents.channels if not (c.fault or is_time(c) or is_counter(c))]
        self._inputs["column"].set_options([channel.name for channel in usable], value=self.choices.column)

    def _show_record(self, record: Measurement) -> None:
        _show_notes(self._reader_notes, record.warnings)
        sensor = record.sensor
        label = f"{sensor.quantity}, {sensor.unit}".rstrip(", ")
        self._set_options(self._record_chart, record_chart(record.time, record.values, label))
        self._set_options(self._spectrum_chart, spectrum_chart(*spectrum(record)))

    def _show_fit(self, view: DecayView) -> None:
        self._view, fit = view, view.fit
        values = [
            f"{shown(scale * fit.values[name], scale * fit.standard_errors.get(name, np.nan))} {unit}"
            for name, scale, unit in (("frequency", 1.0, "Hz"), ("damping_ratio", 100.0, "%"))
        ]
        self._summary.text = ", ".join(values)
        show_fit(self._record_chart.options, view)
        _redraw(self._record_chart)
        self._set_options(self._residual_chart, residual_chart(view))
        for quantity, chart in self._curves.items():
            self._set_options(chart, amplitude_chart(view, quantity))
        self._report.text = view.report
        self._release.text = f"release at {fit.release_time:.6g} s: {fit.release_reason}"
        _show_notes(self._notes, fit.warnings)
        ranking = sorted(view.probabilities.items(), key=lambda pair: -pair[1])
        _show_notes(self._probabilities, [f"{100 * probability:.1f} %: {law}" for law, probability in ranking])

    @staticmethod
    def _set_options(chart: ui.echart, options: dict[str, Any]) -> None:
        chart.options.clear()
        chart.options.update(options)
        _redraw(chart)

    async def _save_figure(self) -> None:
        from ancf_casadi.figures.files import figure_bytes  # matplotlib is slow to import

        if (view := self._view) is not None:
            picture = await _work(lambda: figure_bytes(view.fit.figure(), ".png"))
            ui.download.content(picture, "fit.png")


async def _work(function: Callable[..., T], *arguments: Any) -> T:
    """Return the result of a function that the thread of all computations calls."""
    return await asyncio.get_running_loop().run_in_executor(WORKER, function, *arguments)


def _show_notes(column: ui.column, notes: Sequence[str]) -> None:
    """Show notes in place of those in a column."""
    column.clear()
    with column:
        for note in notes:
            ui.label(note).classes("text-sm border-l-4 border-orange-400 pl-2")


def _redraw(chart: ui.echart) -> None:
    """Draw a chart with its new options; the pointer brushes in it, once the browser has drawn it."""
    chart.update()
    if "brush" in chart.options:
        chart.client.run_javascript(f"setTimeout(() => getElement({chart.id}).chart.dispatchAction({BRUSHING}), 100)")
