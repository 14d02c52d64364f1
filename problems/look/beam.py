"""The page of a study with a beam: its form, the beam at rest and its modes, its motion over the record, and its fit.

Every change makes another study, which the page shows as text, and computes anew in the thread of all computations.  A
change stops what is being computed, and so does the button beside the fit.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from nicegui import events, ui

from ancf_casadi.estimation.prediction import PredictedChannel
from ancf_casadi.estimation.solver.unknown import Unknown
from ancf_casadi.exceptions import AncfError
from problems.beam.fitting import Guesses
from problems.beam.result import BeamFit
from problems.look.beam_charts import channel_chart, difference_chart, mode_chart, tip_chart
from problems.look.beam_computation import BeamAtRest, Work, beam_at_rest, computed_motion, fit_study, has_records
from problems.look.computation import WORKER
from problems.look.form import Form
from problems.look.widgets import report_label, set_options, show_notes
from problems.spec.editing import EditedStudy, Place
from problems.study.formatting import shown

DECADES = 1.0  # that a slider spans to either side of the first guess
RESOLUTION = 1e-3  # of a slider
DIGITS = 6  # behind the point of a damping ratio, per cent
POLLING = 0.2  # s between two looks at the progress
T = TypeVar("T")


class BeamView:
    """The part of the page that belongs to a study with a beam."""

    def __init__(self, file: str) -> None:
        self.study = EditedStudy.of(file)
        self._works: list[Work] = []  # that the thread of all computations has yet to finish
        self._fitting = False
        self._task: asyncio.Task[None] | None = None
        self._rest: BeamAtRest | None = None
        self._mode = 0
        self._sliders: dict[str, tuple[ui.label, ui.slider, float]] = {}
        self._guesses: dict[str, float] = {}  # those of the study that is shown
        ui.context.client.on_disconnect(self._stop)
        with ui.grid(columns="18rem minmax(0, 1fr)").classes("w-full"):
            with ui.column():
                ui.label(Path(file).name).classes("text-subtitle1")
                self._form_error = ui.label().classes("text-negative").mark("form-error")
                self._form = Form(self.study, self._choose_value)
            with ui.column().classes("w-full"):
                self._build_rest()
                self._build_motion()
                self._build_study()

    async def show(self) -> None:
        """Compute until the page shows the latest study."""
        study = None
        self._busy.set_visibility(True)
        while study is not self.study:
            study = self.study
            await self._update(study)
        self._busy.set_visibility(False)

    def choose(self, change: Callable[[EditedStudy], EditedStudy | None]) -> None:
        """Change the study, unless the change is None, and compute anew."""
        try:
            self.study = change(self.study) or self.study
        except AncfError as error:
            self._form_error.text = str(error)
            return
        self._stop()
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self.show())

    def _choose_value(self, place: Place, value: Any) -> None:
        self.choose(lambda study: study.with_value(place, value))

    def _build_rest(self) -> None:
        columns = [
            {"name": name, "label": label, "field": name}
            for name, label in (("mode", "mode"), ("frequency", "frequency, Hz"), ("ratio", "damping ratio, %"))
        ]
        with ui.row(align_items="center"):
            ui.label("Beam at rest, and its modes").classes("text-subtitle1")
            self._busy = ui.spinner()
        with ui.row(align_items="start").classes("w-full"):
            self._drawing = ui.html(sanitize=False).classes("fill-current").style("width: 25rem").mark("drawing")
            self._modes = ui.table(columns=columns, rows=[], row_key="mode", selection="single")
            self._modes.props("dense flat hide-selected-banner").on_select(self._choose_mode).mark("modes")
            self._mode_chart = ui.echart({}).style("width: 19rem; height: 19rem").mark("mode-chart")

    def _build_motion(self) -> None:
        self._motion_error = ui.label().classes("text-negative").mark("motion-error")
        self._motion_title = ui.label().classes("text-subtitle1").mark("motion-title")
        self._unknowns = ui.grid(columns="repeat(auto-fill, minmax(18rem, 1fr))").classes("w-full")
        self._motion = ui.column().classes("w-full").mark("motion")
        with ui.row(align_items="center"):
            self._fit_button = ui.button("fit", on_click=self._fit)
            self._stop_button = ui.button("stop", on_click=self._stop).props("outline")
            self._progress = ui.label().mark("progress")
        self._values = ui.label().classes("text-subtitle1").mark("values")
        self._notes = ui.column().classes("w-full gap-1").mark("notes")
        self._report = report_label().mark("report")
        ui.timer(POLLING, self._show_progress)

    def _build_study(self) -> None:
        ui.label("The study that does the same").classes("text-subtitle2")
        self._text = ui.code("", language="toml").classes("w-full").mark("study")
        name = Path(self.study.file.path).name
        ui.button("save the study", on_click=lambda: ui.download.content(self.study.text, name))

    async def _update(self, study: EditedStudy) -> None:
        """Show a study, the beam at rest, and its motion."""
        self._text.content = study.text
        self._form.show(study)
        self._show_fit(None)
        try:
            rest = await self._compute(beam_at_rest, study)
        except AncfError as error:
            self._form_error.text = "" if self._form.show_error(str(error)) else str(error)
            return
        if rest is None:  # a change has stopped it
            return
        self._form_error.text = ""
        self._form.show_error("")
        self._show_rest(rest)
        try:
            motion = await self._compute(computed_motion, study)
        except AncfError as error:
            self._motion_error.text = str(error)
            return
        self._motion_error.text = ""
        if isinstance(motion, Guesses):
            self._show_unknowns(motion.unknowns)
            self._show_channels("The record, and what the guesses give for it", motion.records.channels)
        else:  # without records, or stopped
            self._show_unknowns(())
            self._show_channels("Simulated motion" if motion else "", ())
            with self._motion:
                if motion is not None:
                    ui.echart(tip_chart(motion)).classes("w-full h-64")

    async def _compute(self, function: Callable[[EditedStudy], T], study: EditedStudy) -> T | None:
        """Return the result of a function for a study; None if it was stopped."""
        work = Work()
        self._works.append(work)
        try:
            return await asyncio.get_running_loop().run_in_executor(WORKER, work.run, function, study)
        finally:
            self._works.remove(work)

    def _stop(self) -> None:
        """Stop all that is being computed."""
        for work in self._works:
            work.stop.set()

    async def _fit(self) -> None:
        """Fit the study that is shown, and show the result."""
        if self._works:
            return
        study, self._fitting = self.study, True
        self._show_fit(None)
        try:
            fit = await self._compute(fit_study, study)
        except AncfError as error:
            self._motion_error.text = str(error)
        else:
            self._motion_error.text = "" if fit else "the fit was stopped"
            if fit is not None and study is self.study:
                self._show_fit(fit)
                self._show_channels("The record and its fit", fit.channels)
        self._fitting = False

    def _show_progress(self) -> None:
        """Show how far the fit is, and the buttons that have an effect."""
        self._progress.text = self._works[-1].progress() if self._fitting and self._works else ""
        self._stop_button.set_visibility(bool(self._works))
        self._fit_button.set_visibility(has_records(self.study) and not self._works)

    def _show_rest(self, rest: BeamAtRest) -> None:
        self._rest, self._mode = rest, min(self._mode, rest.modes.count - 1)
        self._drawing.content = rest.drawing
        columns = zip(rest.modes.frequencies.tolist(), (100.0 * rest.damping_ratios).tolist(), strict=True)
        self._modes.rows = [
            {"mode": k, "frequency": f"{frequency:.6g}", "ratio": f"{round(ratio, DIGITS):.4g}"}
            for k, (frequency, ratio) in enumerate(columns, start=1)
        ]
        self._modes.selected = [self._modes.rows[self._mode]]
        set_options(self._mode_chart, mode_chart(rest.modes, self._mode))

    def _choose_mode(self, event: events.TableSelectionEventArguments) -> None:
        if event.selection and self._rest is not None:
            self._mode = int(event.selection[0]["mode"]) - 1
            set_options(self._mode_chart, mode_chart(self._rest.modes, self._mode))

    def _show_unknowns(self, unknowns: Sequence[Unknown]) -> None:
        """Show a slider for each unknown whose guess is a value of the study."""
        self._guesses = {unknown.name: unknown.guess for unknown in unknowns if unknown.guess}
        scaled = [name for name in self._guesses if self.study.with_guess(name, 1.0) is not None]
        if scaled != [*self._sliders]:
            self._sliders.clear()
            self._unknowns.clear()
            with self._unknowns:
                for name in scaled:
                    self._sliders[name] = self._slider(name, self._guesses[name])
        units = {unknown.name: unknown.unit for unknown in unknowns}
        for name, (label, slider, first) in self._sliders.items():
            slider.value = math.log10(self._guesses[name] / first)
            label.text = f"{name} {self._guesses[name]:.6g} {units[name]}"

    def _slider(self, name: str, first: float) -> tuple[ui.label, ui.slider, float]:
        """Return a slider for the logarithm of a guess over its first value, with its label and that value."""

        def choose() -> None:
            value = first * 10.0**slider.value
            if not math.isclose(value, self._guesses[name], rel_tol=RESOLUTION):
                self.choose(lambda study: study.with_guess(name, value / self._guesses[name]))

        with ui.column().classes("gap-0"):
            label = ui.label().classes("text-sm")
            slider = ui.slider(min=-DECADES, max=DECADES, step=RESOLUTION, value=0.0).mark(f"slider-{name}")
            slider.on("change", choose)
        return label, slider, first

    def _show_channels(self, title: str, channels: Sequence[PredictedChannel]) -> None:
        self._motion_title.text = title
        self._motion.clear()
        with self._motion:
            for channel in channels:
                ui.echart(channel_chart(channel)).classes("w-full h-64")
                ui.echart(difference_chart(channel)).classes("w-full h-44")

    def _show_fit(self, fit: BeamFit | None) -> None:
        """Show the values, the report and the notes of a fit, or take them away."""
        names = fit.estimates if fit else ()
        values = [
            f"{name} {shown(fit.estimates[name], fit.standard_errors[name])} {fit.units[name]}".rstrip()
            for name in names
            if fit
        ]
        self._values.text, self._report.text = ", ".join(values), fit.report() if fit else ""
        show_notes(self._notes, fit.warnings if fit else ())
