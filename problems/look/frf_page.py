"""The part of the page for frequency response functions: their poles and modes, and the command that does the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import get_args

from nicegui import events, ui

from ancf_casadi.exceptions import AncfError, InputError
from ancf_casadi.response.linear_frf import FrfKind
from ancf_casadi.support.tables import plural
from problems.frf.result import FrfFit
from problems.frf.selection import StabilityChart
from problems.look.choices import band_text, beside
from problems.look.frf import FrfChoices, choose_pole, comma_numbers, fit_modes, frf_poles, frf_record
from problems.look.frf_charts import MOST_DRAWN, magnitude_chart, pole_chart, show_modes
from problems.look.widgets import (
    Fields,
    Panel,
    brushed_chart,
    columns,
    redraw,
    report_label,
    set_options,
    show_notes,
)
from problems.look.worker import work
from problems.study.formatting import shown

HEADS = {"mode": "mode", "frequency": "frequency, Hz", "damping_ratio": "damping ratio, %"}


class FrfPanel(Panel):
    """The part of the page that belongs to files of frequency response functions."""

    def __init__(self, files: Sequence[str], folder: Path) -> None:
        self.choices, self._folder = FrfChoices(tuple(files)), folder
        self._poles: StabilityChart | None = None
        self._fit: FrfFit | None = None
        self._fields = Fields(self.choose)
        self.build()

    def _choose_frequencies(self) -> None:
        try:
            self.choose(frequencies=comma_numbers(self._frequencies.value), modes=None)
        except InputError as error:
            self._fit_error.text = str(error)

    def _choose_pole(self, event: events.EChartPointClickEventArguments) -> None:
        if self._poles is not None and isinstance(event.value, list):
            self.choices = choose_pole(self.choices, self._modes, self._poles, int(event.value[2]))
            self.start()

    @property
    def _modes(self) -> Sequence[float]:
        """Frequencies of the modes that are shown: those that were chosen, or that the fit has chosen."""
        return self.choices.frequencies or (() if self._fit is None else self._fit.frequencies.tolist())

    def _build_choices(self) -> None:
        for file in self.choices.files:
            ui.label(Path(file).name).classes("text-subtitle1 break-all")
        self._fields.select("kind", get_args(FrfKind), "kind", "default: as the unit tells")
        self._fields.entry("column", "column", "of one function, by name or number")
        self._fields.entry("phase", "phase", "column of its phases")
        self._fields.entry("unit", "unit", "such as mm/N or g/N")
        self._fields.select("phase_unit", ["deg", "rad"], "unit of the phases")
        self._reading_error = ui.label().classes("text-negative").mark("reading-error")
        ui.label("Modes").classes("text-subtitle2")
        self._fields.entry("modes", "number of modes", "default: as many as show", int)
        self._frequencies = ui.input("frequencies, Hz").props('hint="approximate, instead of a number"')
        self._frequencies.on("change", self._choose_frequencies)
        self._frequencies.classes("w-full").mark("frequencies")
        self._band = ui.label()
        ui.button("all frequencies", on_click=lambda: self.choose(band=None)).props("flat dense")
        everything = {"modes": None, "frequencies": None}
        ui.button("as many modes as show", on_click=lambda: self.choose(**everything)).props("flat dense")

    def _build_results(self) -> None:
        with ui.row(align_items="center"):
            self._summary = ui.label().classes("text-subtitle1").mark("summary")
            self._busy = ui.spinner()
        self._magnitudes = brushed_chart(lambda low, high: self.choose(band=(low, high)), "h-72")
        self._fit_error = ui.label().classes("text-negative").mark("fit-error")
        ui.label("Click a pole to fit a mode there, or a pole of a mode, at a dashed line, to leave it out.")
        self._stability = ui.echart({}, on_point_click=self._choose_pole).classes("w-full h-72").mark("stability")
        self._poles_error = ui.label().classes("text-negative").mark("poles-error")
        self._table = ui.table(columns=columns(HEADS), rows=[], row_key="mode").props("flat dense").mark("modes-table")
        self._notes = ui.column().classes("w-full gap-1").mark("notes")
        self._report = report_label().mark("report")
        ui.label("The command that does the same").classes("text-subtitle2")
        self._command = ui.code("", language="bash").classes("w-full").mark("command")
        with ui.row():
            ui.button("save the report", on_click=lambda: ui.download.content(self._report.text, "report.txt"))
            ui.button("save the figure", on_click=self._save_figure)

    async def update(self) -> None:
        """Read what is chosen, find its poles, fit its modes, and show all."""
        choices = self.choices
        self._show_choices(choices)
        try:
            record = await work(frf_record, choices)
        except AncfError as error:
            self._reading_error.text = str(error)
            self._forget_fit("")
            set_options(self._magnitudes, {})
            set_options(self._stability, {})
            return
        self._reading_error.text = ""
        set_options(self._magnitudes, magnitude_chart(record))
        try:
            self._poles, self._poles_error.text = await work(frf_poles, choices), ""
        except AncfError as error:
            self._poles, self._poles_error.text = None, str(error)
        try:
            fit = await work(fit_modes, choices)
            self._show_fit(fit, await work(fit.report))
        except AncfError as error:
            self._forget_fit("" if self._poles_error.text == str(error) else str(error))
        set_options(self._stability, {} if self._poles is None else pole_chart(self._poles, record, self._modes))

    def _show_choices(self, choices: FrfChoices) -> None:
        """Show the choices in their fields, and the command."""
        self._fields.show(choices)
        self._frequencies.value = ", ".join(map(str, choices.frequencies or ()))
        self._band.text = band_text(choices.band)
        files = tuple(beside(file, self._folder) for file in choices.files)
        self._command.content = replace(choices, files=files).command()

    def _show_fit(self, fit: FrfFit, report: str) -> None:
        self._fit, self._fit_error.text, errors = fit, "", fit.standard_errors
        count = fit.record.columns.shape[1]
        drawn = f"; the first {MOST_DRAWN} of {count} functions are drawn" if count > MOST_DRAWN else ""
        self._summary.text = plural(len(fit.frequencies), "mode") + drawn
        self._table.rows = [
            {"mode": k, "frequency": shown(f, errors[f"frequency_{k}"]),
             "damping_ratio": shown(100 * ratio, 100 * errors[f"damping_ratio_{k}"])}
            for k, (f, ratio) in enumerate(zip(fit.frequencies.tolist(), fit.damping_ratios.tolist(), strict=True), 1)
        ]  # fmt: skip
        self._table.set_visibility(True)
        show_modes(self._magnitudes.options, fit)
        redraw(self._magnitudes)
        show_notes(self._notes, fit.warnings)
        self._report.text = report

    def _forget_fit(self, reason: str) -> None:
        """Say why there is no fit, and show none."""
        self._fit, self._fit_error.text = None, reason
        self._summary.text = self._report.text = ""
        self._table.set_visibility(False)
        self._notes.clear()

    async def _save_figure(self) -> None:
        if self._fit is not None:
            await self.save_figure(self._fit.figure)
