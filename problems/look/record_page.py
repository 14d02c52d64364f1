"""The part of the page for a record, or for takes: brushes, the fit, and the command and the study that do the same.

What the user chooses changes ``Choices``; the panel then reads and fits in the thread, the latest choice alone if
several came in the meantime.  Errors appear beside what caused them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import cycle
from pathlib import Path
from typing import Any, get_args

import numpy as np
from nicegui import ui

from ancf_casadi.decay.phase import FrequencyLaw
from ancf_casadi.decay.rest_position import Rest
from ancf_casadi.exceptions import AncfError
from ancf_casadi.records.channel import Recording
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.records.sensor import Quantity
from problems.decay.laws import Law
from problems.look.charts import (
    OTHER_LAWS,
    amplitude_chart,
    forget_fit,
    record_chart,
    residual_chart,
    show_fit,
    show_harmonics,
    sparkline,
    spectrum_chart,
)
from problems.look.choices import (
    STUDY_NAME,
    Choices,
    Takes,
    band_text,
    beside,
    change_takes,
    command,
    read_takes,
    study,
)
from problems.look.computation import DecayView, contents, fit_chosen, recording, spectrum, whole_record
from problems.look.takes import TakesTable
from problems.look.widgets import (
    Fields,
    Panel,
    brushed_chart,
    choose_in,
    place_handle,
    redraw,
    report_label,
    set_options,
    show_lines,
    show_notes,
)
from problems.look.worker import work
from problems.study.formatting import shown

LAWS_OF = {"law": Law, "frequency_law": FrequencyLaw, "rest": Rest}
PART_HINTS = {"begin": "or brush over the record", "end": "", "release_time": "or drag its line, or double-click"}
SHOWS_RECORD = {"time", "time_unit", "sample_rate", "column", "unit", "sensor"}  # options that show another record


def record_panel(files: Sequence[str], folder: Path) -> Panel:
    """Build the panel for files of measurements, or for the decays of a study among them."""
    return RecordPanel(read_takes(files), folder)


class RecordPanel(Panel):
    """The part of the page that belongs to one record, or to one of several takes, below a table of all."""

    def __init__(self, takes: Takes, folder: Path) -> None:
        self.takes, self._shown, self._folder = takes, 0, folder  # files in the folder are named as from there
        self._reading_changed = True
        self._view: DecayView | None = None
        self._table = TakesTable(self.show_take) if len(takes) > 1 else None
        self.build()

    @property
    def take(self) -> Choices:
        """The choices for the take that is shown."""
        return self.takes[self._shown]

    @property
    def chosen(self) -> tuple[Takes, int]:
        """The takes, and which of them is shown."""
        return self.takes, self._shown

    def choose(self, **changes: Any) -> None:
        """Change choices, and read and fit anew."""
        if all(getattr(self.take, name) == value for name, value in changes.items()):
            return
        self.takes = change_takes(self.takes, self._shown, **changes)
        self._reading_changed |= not SHOWS_RECORD.isdisjoint(changes)
        self.start()

    def show_take(self, k: int) -> None:
        """Show another take."""
        if self._table is not None and k != self._shown:
            self._shown, self._reading_changed = k, True
            self._table.mark_shown(k)
            self.start()

    def _build_choices(self) -> None:
        self._fields = Fields(self.choose)
        self._name = ui.label().classes("text-subtitle1 break-all")
        self._reading_error = ui.label().classes("text-negative break-words w-full empty:hidden").mark("reading-error")
        self._fields.select("column", [], "column")
        self._fields.entry("unit", "unit", "such as mm, g or 0.25 mm")
        self._fields.select("sensor", get_args(Quantity), "sensor", "default: as the unit tells")
        self._fields.select("time", [], "time", "column of the times; default: as its name tells")
        self._fields.entry("time_unit", "time unit", "such as ms")
        self._fields.entry("sample_rate", "samples per second", "for a file without times", kind=float)
        self._reader_notes = ui.column().classes("w-full gap-1").mark("reader-notes")
        ui.label("Part to fit, s").classes("text-subtitle2")
        for name, hint in PART_HINTS.items():
            self._fields.entry(name, name.replace("_", " "), hint, float)
        self._release = ui.label()
        self._band = ui.label()
        everything = dict.fromkeys(("begin", "end", "release_time", "band"))
        ui.button("all times and frequencies", on_click=lambda: self.choose(**everything)).props("flat dense")
        ui.label("Laws").classes("text-subtitle2")
        for name, laws in LAWS_OF.items():
            default = "linear; auto compares all" if name == "law" else "constant, or auto if the law is"
            self._fields.select(name, [*get_args(laws), "auto"], name.replace("_", " "), f"default: {default}")
        self._fields.by_name["robust"] = ui.checkbox(
            "limit the influence of outliers", on_change=lambda event: self.choose(robust=event.value)
        )

    def _build_results(self) -> None:
        with ui.row(align_items="center"):
            self._summary = ui.label().classes("text-subtitle1").mark("summary")
            self._busy = ui.spinner()
        self._fit_error = ui.label().classes("text-negative empty:hidden").mark("fit-error")
        self._lines = ui.row().classes("empty:hidden").mark("lines")
        with ui.column().classes("w-full") as self._results:
            self._build_charts()
        ui.label("The command and the study that do the same, beside their files").classes("text-subtitle2")
        self._command = ui.code("", language="bash").classes("w-full").mark("command")
        self._study = ui.code("", language="toml").classes("w-full").mark("study")
        with ui.row():
            ui.button("save study.toml", on_click=lambda: ui.download.content(self._study.content, STUDY_NAME))
            for title, save in (("save the report", self._save_report), ("save the figure", self._save_figure)):
                ui.button(title, on_click=save).bind_enabled_from(self._report, "text", bool)

    def _build_charts(self) -> None:
        self._record_chart = brushed_chart(lambda low, high: self.choose(begin=low, end=high), "h-64")
        choose_in(self._record_chart, lambda time: self.choose(release_time=time))
        with ui.grid(columns="minmax(0, 1fr) minmax(0, 1fr)").classes("w-full"):
            self._residual_chart = ui.echart({}).classes("w-full h-56")
            self._spectrum_chart = brushed_chart(lambda low, high: self.choose(band=(max(low, 0.0), high)), "h-56")
            self._curves = {name: ui.echart({}).classes("w-full h-56") for name in ("damping_ratio", "frequency")}
        self._laws = ui.row(align_items="center").classes("empty:hidden").mark("laws")
        self._notes = ui.column().classes("w-full gap-1").mark("notes")
        self._report = report_label().mark("report")

    async def update(self) -> None:
        """Read what is chosen, fit it, and show both; then the other takes."""
        takes, shown_take = chosen = self.chosen
        await self._update(self.take)
        if self._table is not None:
            await self._table.show(takes, shown_take, lambda: chosen == self.chosen)

    async def _update(self, choices: Choices) -> None:
        self._show_choices(choices)
        try:
            if self._reading_changed:
                self._lines.clear()
                self._offer("time", [channel.name for channel in (await work(contents, choices.file)).channels])
                self._show_columns(await work(recording, choices))
                self._show_record(await work(whole_record, choices))
                self._reading_changed = False
        except AncfError as error:
            self._reading_error.text = str(error).removeprefix(f"{choices.file}: ")
            self._forget_fit("")
            self._results.set_visibility(False)
            return
        self._reading_error.text = ""
        self._results.set_visibility(True)
        try:
            view = await work(fit_chosen, choices)
        except AncfError as error:
            self._forget_fit(str(error))
            forget_fit(self._record_chart.options)
            redraw(self._record_chart)
            place_handle(self._record_chart, None)
            return
        self._fit_error.text = ""
        self._show_fit(view)

    def _forget_fit(self, reason: str) -> None:
        """Say why there is no fit, and show none."""
        self._view, self._fit_error.text = None, reason
        self._summary.text = self._report.text = self._release.text = ""
        self._notes.clear()
        self._laws.clear()
        for chart in (self._residual_chart, *self._curves.values()):
            set_options(chart, {})

    def _show_choices(self, choices: Choices) -> None:
        """Show the choices in their fields, and the command and the study."""
        for name, field in self._fields.by_name.items():
            if name not in ("column", "time"):  # whose options the file tells
                field.value = getattr(choices, name)
        self._band.text = band_text(choices.band)
        takes = tuple(replace(take, file=beside(take.file, self._folder)) for take in self.takes)
        self._name.text = Path(choices.file).name
        self._command.content, self._study.content = command(takes), study(takes)

    def _show_columns(self, record: Recording) -> None:
        """Offer the columns of a file with values, as lines if the user must choose one."""
        usable = {channel.name: channel.values for channel in record.measured}
        self._offer("column", [*usable])
        if self.take.column is None and len(usable) > 1:
            lines = {name: sparkline(values) for name, values in usable.items()}
            show_lines(self._lines, lines, lambda name: self.choose(column=name))

    def _offer(self, name: str, columns: Sequence[str]) -> None:
        """Offer columns in a field, and the one that is chosen, which may be a number."""
        value = getattr(self.take, name)
        chosen = [] if value in (None, *columns) else [value]
        self._fields.by_name[name].set_options([*columns, *chosen], value=value)

    def _show_record(self, record: Measurement) -> None:
        show_notes(self._reader_notes, record.warnings)
        sensor = record.sensor
        label = f"{sensor.quantity}, {sensor.unit}".rstrip(", ")
        set_options(self._record_chart, record_chart(record.time, record.values, label))
        set_options(self._spectrum_chart, spectrum_chart(*spectrum(record)))

    def _show_fit(self, view: DecayView) -> None:
        self._view, fit = view, view.fit
        values = [
            f"{shown(scale * fit.values[name], scale * fit.standard_errors.get(name, np.nan))} {unit}"
            for name, scale, unit in (("frequency", 1.0, "Hz"), ("damping_ratio", 100.0, "%"))
        ]
        at_release = "" if fit.law == "linear" else " at the release"
        self._summary.text = f"{', '.join(values)}{at_release} (± standard errors)"
        show_fit(self._record_chart.options, view)
        redraw(self._record_chart)
        place_handle(self._record_chart, fit.release_time)
        set_options(self._residual_chart, residual_chart(view))
        show_harmonics(self._spectrum_chart.options, fit.frequency)
        redraw(self._spectrum_chart)
        self._report.text = view.report
        self._release.text = f"release at {fit.release_time:.6g} s: {fit.release_reason}"
        show_notes(self._notes, fit.warnings)
        self._laws.clear()
        with self._laws:
            for name, colour in zip(view.laws, cycle(OTHER_LAWS), strict=False):
                ui.checkbox(name, value=True, on_change=self._draw_curves).style(f"color: {colour}")
        self._draw_curves()

    def _draw_curves(self) -> None:
        """Draw frequency and damping ratio against amplitude, also under each law that is checked."""
        if self._view is not None:
            checked = [box.text for box in self._laws if isinstance(box, ui.checkbox) and box.value]
            for quantity, chart in self._curves.items():
                set_options(chart, amplitude_chart(self._view, quantity, checked))

    def _save_report(self) -> None:
        reports = [self._table.report if self._table else "", self._report.text]
        ui.download.content("\n\n".join(filter(None, reports)), "report.txt")

    async def _save_figure(self) -> None:
        if self._view is not None:
            await self.save_figure(self._view.fit.figure)
