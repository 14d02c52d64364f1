"""The beam at rest, its computed motion and its fit, as the page shows them, by the public functions."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from ancf_casadi.dynamics.trajectory import Trajectory
from ancf_casadi.response.linear_frf import ratios_at_rest
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import error_prefix
from ancf_casadi.support.interrupts import stoppable
from ancf_casadi.support.progress import counted, progress_line
from ancf_casadi.vibration.modes import Modes, natural_modes
from problems.beam.fitting import Guesses
from problems.beam.result import BeamFit
from problems.spec.beam import DampedBeam
from problems.spec.editing import EditedStudy
from problems.spec.motion import SimulationTables, start_shape
from problems.spec.records import NUMBERS, Measurements
from problems.study.drawing import render
from problems.study.results import inline_svg

T = TypeVar("T")

MODES = 6  # that the page shows
MEASURED_TABLES = {"records", *NUMBERS}


@dataclass(frozen=True, eq=False)
class BeamAtRest:
    """A beam under gravity and the load that holds it, and its small vibration under gravity."""

    drawing: str  # SVG
    modes: Modes
    damping_ratios: Array  # of very small motion


@dataclass(eq=False)
class Work:
    """A computation that counts its steps, and that another thread can stop."""

    began: float = field(default_factory=time.perf_counter)
    steps: int = 0
    stop: threading.Event = field(default_factory=threading.Event)

    def run(self, function: Callable[..., T], *arguments: object) -> T | None:
        """Return the result of a function; None if it was stopped."""
        try:
            with stoppable(self.stop), counted(self._count):
                return function(*arguments)
        except KeyboardInterrupt:
            return None

    def progress(self) -> str:
        """Return what a command would show of the progress."""
        return progress_line("fit", self.steps, time.perf_counter() - self.began)

    def _count(self) -> None:
        self.steps += 1


def has_records(study: EditedStudy) -> bool:
    """Return whether a study has measurements to fit."""
    return not MEASURED_TABLES.isdisjoint(study.file.tables)


def beam_at_rest(study: EditedStudy) -> BeamAtRest:
    """Compute the shape of a beam at rest, and its lowest modes."""
    beam = DampedBeam.of(study.file)
    with error_prefix(study.file.where("beam")):
        modes = natural_modes(beam.model, count=min(MODES, beam.model.freedoms))
    shape, law = start_shape(study.file, beam.model), beam.damping
    ratios = np.zeros(modes.count) if law is None else ratios_at_rest(modes, law)
    drawing = render("", shape.figure, ("svg",)).svg
    return BeamAtRest(str(inline_svg(drawing, "beam", "the beam at rest")), modes, ratios)


def computed_motion(study: EditedStudy) -> Guesses | Trajectory | None:
    """Compute the records of a study from the guesses of its fit; without records, the motion of [simulation]."""
    if has_records(study):
        return Measurements.of(study.file).read().guesses()
    return SimulationTables.of(study.file).read().simulate() if "simulation" in study.file.tables else None


def fit_study(study: EditedStudy) -> BeamFit:
    """Fit the records of a study, as its step ``motion`` does."""
    return Measurements.of(study.file).read().fit()
