"""The beam at rest, its computed motion and its fit, as the page shows them, by the public functions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ancf_casadi.damping.law import SumOfLaws
from ancf_casadi.estimation.prediction import PredictedChannel
from ancf_casadi.estimation.solver.unknown import Unknown
from ancf_casadi.response.linear_frf import ratios_at_rest
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import error_prefix
from ancf_casadi.vibration.modes import natural_modes
from problems.look.beam_charts import channel_charts, mode_chart, tip_chart
from problems.look.charts import Options
from problems.spec.beam import DampedBeam
from problems.spec.editing import EditedStudy, Place
from problems.spec.guesses import guess_places
from problems.spec.motion import SimulationTables, start_shape
from problems.spec.records import NUMBERS, Measurements
from problems.study.drawing import render
from problems.study.formatting import shown
from problems.study.reading import read_study
from problems.study.results import inline_svg
from problems.study.study import run_study

MODES = 6  # that the page shows
MEASURED_TABLES = {"records", *NUMBERS}


@dataclass(frozen=True, eq=False)
class BeamAtRest:
    """A beam under gravity and the load that holds it, and its small vibration under gravity."""

    drawing: str  # SVG
    frequencies: Array  # natural ones, Hz
    damping_ratios: Array  # of very small motion
    charts: Sequence[Options]  # of the modes


@dataclass(frozen=True, eq=False)
class MotionView:
    """The motion of a beam, as the page shows it: its records with what is computed for them, or a simulated one."""

    title: str
    charts: Sequence[Options]
    guesses: Sequence[tuple[Unknown, Place]] = ()  # that stand in the study
    values: str = ""  # of a fit, with standard errors
    report: str = ""
    notes: Sequence[str] = ()


def has_records(study: EditedStudy) -> bool:
    """Return whether a study has measurements to fit."""
    return not MEASURED_TABLES.isdisjoint(study.file.tables)


def beam_at_rest(study: EditedStudy) -> BeamAtRest:
    """Compute the shape of a beam at rest, and its lowest modes."""
    beam = DampedBeam.of(study.file)
    with error_prefix(study.file.where("beam")):
        modes = natural_modes(beam.model, count=min(MODES, beam.model.freedoms))
    law = beam.damping or SumOfLaws(())
    drawing = render("", start_shape(study.file, beam.model).figure, ("svg",)).svg
    return BeamAtRest(
        str(inline_svg(drawing, "beam", "the beam at rest")),
        modes.frequencies,
        ratios_at_rest(modes, law),
        [mode_chart(modes, k) for k in range(modes.count)],
    )


def computed_motion(study: EditedStudy) -> MotionView:
    """Compute the records of a study from the guesses of its fit; without records, the motion of [simulation]."""
    if has_records(study):
        guesses = Measurements.of(study.file).read().guesses()
        places = guess_places(study.file, [unknown.name for unknown in guesses.unknowns if unknown.guess])
        known = [(unknown, places[unknown.name]) for unknown in guesses.unknowns if unknown.name in places]
        return MotionView("The record, and what the guesses give for it", _charts(guesses.records.channels), known)
    if "simulation" in study.file.tables:
        return MotionView("Simulated motion", [tip_chart(SimulationTables.of(study.file).read().simulate())])
    return MotionView("", ())


def fit_study(study: EditedStudy) -> MotionView:
    """Fit the records of a study, as its step ``motion`` does."""
    fit = Measurements.of(study.file).read().fit()
    errors, units = fit.standard_errors, fit.units
    values = [f"{name} {shown(value, errors[name])} {units[name]}".rstrip() for name, value in fit.estimates.items()]
    title, notes = "The record and its fit", fit.warnings
    return MotionView(title, _charts(fit.channels), (), ", ".join(values), fit.report(), notes)


def write_document(study: EditedStudy, folder: Path, *steps: str) -> Path:
    """Run steps of a study, or all, as ``run`` does, and write their results to a folder; return the document."""
    report = run_study(read_study(study.file, steps), folder, command=f"ancf-casadi run {Path(study.file.path).name}")
    assert report.page is not None  # as there is a folder
    return report.page


def _charts(channels: Sequence[PredictedChannel]) -> list[Options]:
    return [chart for channel in channels for chart in channel_charts(channel)]
