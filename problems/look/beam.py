"""The page of a study with a beam: its form, the beam at rest and its modes, its motion over the record, and its fit.

Every change makes another study, which the page shows as text, and computes anew in the thread of all computations.  A
change stops what is being computed, and so does the button beside the fit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

from nicegui import app, events, ui

from ancf_casadi.estimation.solver.unknown import Unknown
from ancf_casadi.exceptions import AncfError
from problems.look.beam_computation import (
    BeamAtRest,
    MotionView,
    beam_at_rest,
    computed_motion,
    fit_study,
    has_records,
    write_document,
)
from problems.look.charts import Options
from problems.look.form import Change, Form
from problems.look.widgets import ComputingPanel, columns, report_label, set_options, show_notes
from problems.spec.editing import EditedStudy, Place
from problems.spec.records import unsimulated_records

HEADS = {"mode": "mode", "frequency": "frequency, Hz", "ratio": "damping ratio, %"}
DECADES = 1.0  # that a slider spans to either side of the first guess
RESOLUTION = 1e-3  # of a slider
DIGITS = 6  # behind the point of a damping ratio, per cent


class BeamPanel(ComputingPanel):
    """The part of the page that belongs to a study with a beam."""

    def __init__(self, files: Sequence[str], folder: Path) -> None:
        super().__init__()
        self.study, self._folder = EditedStudy.of(files[0]), folder
        self._mode = 1
        self._charts: Sequence[Options] = ()  # of the modes
        self._sliders: dict[tuple[str, Place], Callable[[Unknown], None]] = {}  # each shows a guess
        self.build()

    @property
    def chosen(self) -> EditedStudy:
        """The latest study."""
        return self.study

    def change(self, change: Change) -> None:
        """Change the study, and compute anew."""
        try:
            self.study = change(self.study)
        except AncfError as error:
            self._form_error.text = str(error)
            return
        self.stop()
        self.start()

    def _build_choices(self) -> None:
        ui.label(Path(self.study.file.path).name).classes("text-subtitle1")
        self._form_error = ui.label().classes("text-negative").mark("form-error")
        self._form = Form(self.study, self.change)

    def _build_results(self) -> None:
        self._build_beam()
        self._build_motion()
        self._build_study()

    def _build_beam(self) -> None:
        ui.label("Beam at rest, and its modes").classes("text-subtitle1")
        with ui.row(align_items="start").classes("w-full"):
            self._drawing = ui.html(sanitize=False).classes("fill-current").style("width: 25rem").mark("drawing")
            self._modes = ui.table(columns=columns(HEADS), rows=[], row_key="mode", selection="single")
            self._modes.props("dense flat hide-selected-banner").on_select(self._choose_mode).mark("modes")
            self._mode_chart = ui.echart({}).style("width: 19rem; height: 19rem").mark("mode-chart")

    def _build_motion(self) -> None:
        self._motion_error = ui.label().classes("text-negative").mark("motion-error")
        self._motion_title = ui.label().classes("text-subtitle1").mark("motion-title")
        self._unknowns = ui.grid(columns="repeat(auto-fill, minmax(18rem, 1fr))").classes("w-full")
        self.build_progress(self.run_simulation, self.fit, self.run_all_steps)
        self._values = ui.label().classes("text-subtitle1").mark("values")
        self._motion = ui.column().classes("w-full").mark("motion")
        self._notes = ui.column().classes("w-full gap-1").mark("notes")
        self._report = report_label().mark("report")

    def _build_study(self) -> None:
        ui.label("The study that does the same, which can be changed here, too").classes("text-subtitle2")
        self._text = ui.textarea().classes("w-full").props("autogrow outlined input-class=font-mono").mark("study")
        ui.label().bind_text_from(self._form_error, "text").classes("text-negative")
        self._text.on("change", lambda: self.change(lambda study: study.with_text(self._text.value)))
        name = Path(self.study.file.path).name
        ui.button("save the study", on_click=lambda: ui.download.content(self.study.text, name))
        self._document = ui.column().classes("w-full")

    async def update(self) -> None:
        """Show the study, the beam at rest, and its motion."""
        study = self.study
        self._text.value = study.text
        self._form.show(study)
        try:
            if (at_rest := await self.compute(beam_at_rest, study)) is None:
                return
        except AncfError as error:
            self._form_error.text = "" if self._form.show_error(str(error)) else str(error)
            return
        self._form_error.text = ""
        self._form.show_error("")
        self._show_beam(at_rest)
        motion = await self._show_motion(computed_motion, study)
        if motion is not None:
            self._show_sliders(motion.guesses)

    async def _show_motion(
        self, function: Callable[[EditedStudy], MotionView], study: EditedStudy, title: str = ""
    ) -> MotionView | None:
        """Compute a motion, or fit it, and show it; return None if that has failed or was stopped."""
        motion = await self.attempt(self._motion_error, function, study, title=title)
        if motion is None or study is not self.study or self._motion.is_deleted:  # by a change, or as the page closed
            return None
        self._motion_title.text, self._values.text, self._report.text = motion.title, motion.values, motion.report
        show_notes(self._notes, motion.notes)
        self._motion.clear()
        with self._motion:
            for chart in motion.charts:
                ui.echart(chart).classes("w-full h-60")
        return motion

    async def run_simulation(self) -> None:
        """Write the motion that is to be measured, as ``run`` does, and show it."""
        study, folder = self.study, unsimulated_records(self.study.file)[0].parent
        if await self.attempt(self._motion_error, write_document, study, folder, "simulation", title="simulation"):
            self.start()

    async def fit(self) -> None:
        """Fit the study that is shown."""
        await self._show_motion(fit_study, self.study, "fit")

    async def run_all_steps(self) -> None:
        """Run all steps of the study that is shown, such as predictions and a plan, and show their document."""
        folder = self._folder / "results"
        document = await self.attempt(self._motion_error, write_document, self.study, folder, title="run")
        if document is not None and not self._document.is_deleted:
            self._document.clear()
            with self._document:
                frame = ui.element("iframe").classes("w-full bg-white").style("height: 60rem").mark("document")
                frame.props["src"] = app.add_static_file(local_file=document)
                ui.button("save the document", on_click=lambda: ui.download.file(document))
            ui.run_javascript(f"getHtmlElement({self._document.id}).scrollIntoView()")

    def can_act(self, name: str) -> bool:
        """Return whether nothing is being computed, and an action has what it needs."""
        is_ready = (name == "run_simulation") == bool(unsimulated_records(self.study.file))
        return super().can_act(name) and is_ready and (name != "fit" or has_records(self.study))

    def _show_beam(self, at_rest: BeamAtRest) -> None:
        self._charts, self._drawing.content = at_rest.charts, at_rest.drawing
        modes = zip(at_rest.frequencies.tolist(), (100.0 * at_rest.damping_ratios).tolist(), strict=True)
        self._modes.rows = [
            {"mode": k, "frequency": f"{frequency:.6g}", "ratio": f"{round(ratio, DIGITS):.4g}"}
            for k, (frequency, ratio) in enumerate(modes, start=1)
        ]
        self._show_mode(min(self._mode, len(at_rest.charts)))

    def _choose_mode(self, event: events.TableSelectionEventArguments) -> None:
        self._show_mode(int((event.selection or [{"mode": self._mode}])[0]["mode"]))

    def _show_mode(self, number: int) -> None:
        self._mode, self._modes.selected = number, self._modes.rows[number - 1 : number]
        set_options(self._mode_chart, self._charts[number - 1])

    def _show_sliders(self, guesses: Sequence[tuple[Unknown, Place]]) -> None:
        """Show a slider for each guess."""
        names = [(unknown.name, place) for unknown, place in guesses]
        if names != [*self._sliders]:
            self._sliders.clear()
            self._unknowns.clear()
            with self._unknowns:
                for unknown, place in guesses:
                    self._sliders[unknown.name, place] = self._slider(unknown, place)
        for unknown, place in guesses:
            self._sliders[unknown.name, place](unknown)

    def _slider(self, unknown: Unknown, place: Place) -> Callable[[Unknown], None]:
        """Build a slider for the logarithm of a guess over its first value, and return what shows a guess."""
        guess = first = unknown.guess

        def choose() -> None:
            factor = first * 10.0**slider.value / guess
            if not math.isclose(factor, 1.0, rel_tol=RESOLUTION):
                self.change(lambda study: study.scaled(place, factor))

        def show(unknown: Unknown) -> None:
            nonlocal guess
            guess = unknown.guess
            slider.value = math.log10(guess / first)
            label.text = f"{unknown.name} {guess:.6g} {unknown.unit}"

        with ui.column().classes("gap-0"):
            label = ui.label().classes("text-sm")
            slider = ui.slider(min=-DECADES, max=DECADES, step=RESOLUTION).on("change", choose)
        return show
