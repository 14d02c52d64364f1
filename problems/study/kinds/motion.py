"""Steps that one computation makes of the tables of the file.

One simulated motion; a fit to measured large motion with predictions of other records; a comparison of damping laws on
measured motion; planned experiments.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, final

import numpy as np
from msgspec import Meta

from ancf_casadi.dynamics.trajectory import Trajectory
from ancf_casadi.exceptions import InputError, NumericsError
from ancf_casadi.export.identification import Identification
from ancf_casadi.export.model_document import Document
from ancf_casadi.mechanics.lumped import changed_properties
from ancf_casadi.mechanics.mesh_limits import bends_allowed
from ancf_casadi.mechanics.spec import BeamSpec
from ancf_casadi.support.inputs import error_prefix
from ancf_casadi.support.specs import Positive
from ancf_casadi.support.tables import Table, finite_or_none, to_json
from ancf_casadi.vibration.modes import natural_modes
from problems.beam.fitting import compare_laws
from problems.beam.properties import property_value
from problems.beam.result import BeamFit
from problems.beam.values.records import FrequencyRecord
from problems.spec.file import StudyFile
from problems.spec.motion import SimulationTables, StepTables
from problems.spec.plan import PLAN_TABLES, PlanTables
from problems.spec.records import NUMBERS, Measurements
from problems.study.compute import Compute
from problems.study.step import Finding, Findings, Step, Study, join_findings

MODES = 12  # whose natural frequencies get standard errors
MOTION_TABLES = {"beam", "damping", "base", "load", "release", "records", *NUMBERS, "predictions", "fit"}


@dataclass(frozen=True, kw_only=True)
class TablesStep(Step):
    """A step that one computation makes of tables of the file."""

    converter: ClassVar[type[StepTables]]
    function: ClassVar[Callable[..., Finding]]  # of the file, the formats of figures, and ``inputs``

    @property
    def inputs(self) -> tuple[Any, ...]:
        """Keys of the step that its computation needs."""
        return ()

    def prepare(self, study: Study, where: str) -> Self:
        """Return the step with its tables, which are checked."""
        self.converter.of(study.file)
        return super().prepare(study, where)

    def finding(self, compute: Compute, findings: Findings) -> Finding:
        """Open the files of measurements, and return the finding."""
        self.converter.of(self.file).read()
        return compute(type(self).function, self.file, compute.formats, *self.inputs)


def simulation_finding(
    file: StudyFile, formats: tuple[str, ...], animate: bool, animation: str, slower: float | None
) -> Finding:
    """Simulate the motion of a study file: range and energies, and the figure of the motion."""
    tables = SimulationTables.of(file).read()
    run = tables.simulate()
    data: dict[str, Any] = {
        "tip_position_range_m": np.ptp(run.tip, axis=0).tolist(),
        "dissipated_energy_j": float(run.dissipated_energy[-1]),
        "balance_error_j": float(np.abs(run.balance_error).max()),
        "integrators": [use.method for use in run.integrators],
    }
    finding = Finding.of(run, "Motion of the tip relative to the clamp, and shapes of the beam.", formats, data=data)
    finding.files["motion.csv"] = _positions(run, tables.markers).csv().encode()
    if animate or animation:
        from ancf_casadi.animation.motions import moving_pictures  # matplotlib is slow to import

        if animation:
            finding.files[animation] = moving_pictures({"": run}, animation, slower=slower)
        if animate:
            (figure,) = finding.figures
            moving = moving_pictures({"": run}, "motion.gif", slower=slower)
            return replace(finding, figures=(replace(figure, moving=moving),))
    return finding


@final
@dataclass(frozen=True, kw_only=True)
class SimulationStep(TablesStep):
    """One simulated motion: the tables [[damping]], [base], [load], [release], [simulation], [markers]."""

    kind, heading = "simulation", "Simulated motion"
    converter, function = SimulationTables, simulation_finding
    reading = frozenset({"beam", "damping", "base", "load", "release", "simulation", "markers"})

    animate: Annotated[bool, Meta(description="with a moving picture")] = False
    animation: Annotated[str, Meta(description='further file with it, such as "motion.mp4" or "motion.html"')] = ""
    slower: Annotated[Positive | None, Meta(description="times that it is slower than the motion was")] = None

    def prepare(self, study: Study, where: str) -> Self:
        """Return the step with its tables and the name of its animation, which are checked."""
        if self.animation:
            from ancf_casadi.animation.motions import check_animation  # matplotlib is slow to import

            with error_prefix(f"{where}: animation"):
                check_animation(self.animation)
                if Path(self.animation).name != self.animation:
                    raise InputError("must be a name without a folder")
        return super().prepare(study, where)

    @property
    def inputs(self) -> tuple[Any, ...]:
        """The settings of the moving picture."""
        return self.animate, self.animation, self.slower


def _positions(run: Trajectory, markers: Mapping[str, float]) -> Table:
    """Return the positions of tip, base and markers over time."""
    places = {"tip": run.tip, "base": run.base} | {name: run.position(s) for name, s in markers.items()}
    columns = ("time_s", *(f"{name}_{axis}_m" for name in places for axis in "xy"))
    return Table("motion", "Motion of the beam", columns, np.column_stack([run.time, *places.values()]).tolist())


def fit_finding(file: StudyFile, formats: tuple[str, ...]) -> Finding:
    """Fit the motion in the files of a study: estimates, predictions and their figures."""
    read = Measurements.of(file).read()
    fit = read.fit()
    fitted = Finding.of(fit, "Measured motion (dots), fitted motion (lines), and residuals.", formats)
    predictions = []
    for k, record in enumerate(read.predictions, start=1):
        caption = f"Record {k} that was predicted, not fitted: measured (dots) and computed (lines), and residuals."
        try:
            prediction = fit.predict(record)
        except NumericsError as error:  # the fit holds nevertheless
            failure = f"record {k} could not be predicted: {error}"
            predictions.append(Finding(None, warnings=(failure,), text=f"  note: {failure}"))
        else:
            text = f"prediction {k}\n{prediction.report()}"
            predictions.append(Finding.of(prediction, caption, formats, text=text))
    data = {"fit": fitted.data, "predictions": [finding.data for finding in predictions]}  # None for one that failed
    document = Document(fit.model, fit.law if read.damping else None, [Identification.of(fit)])
    files = {"identified.json": to_json(document.to_dict()).encode()}
    finding = join_findings(data, [fitted, *predictions], files=files, beam=BeamSpec.of(fit.model.beam))
    if not fit.first:
        return finding
    with bends_allowed():  # the fit tells
        frequencies = natural_modes(fit.model, count=min(MODES, fit.model.freedoms)).frequencies
        numbers = np.flatnonzero(frequencies) + 1
        tones = FrequencyRecord(fit.given, frequencies[numbers - 1], modes=numbers.tolist())
        (predicted,) = fit.predict(tones).channels
    errors = np.full(frequencies.size, math.nan)
    errors[numbers - 1] = predicted.errors
    return replace(
        finding,
        guess=BeamSpec.of(fit.given.beam),
        errors={
            changed: _error(fit, name, changed)
            for name in fit.first
            if "[" not in name
            for changed in (name, *changed_properties(name))
        },
        frequency_errors=tuple(errors.tolist()),
    )


def _error(fit: BeamFit, name: str, changed: str) -> float:
    """Return the standard error of a property that an unknown changes, SI units; nan if unknown."""
    relative = fit.standard_errors[name] / fit.estimates[name] if fit.estimates[name] else math.nan
    return relative * property_value(fit.model.beam, changed)


@final
@dataclass(frozen=True, kw_only=True)
class MotionFit(TablesStep):
    """A fit to measurements, and predictions: [[damping]], [base], [[records]] and others, [[predictions]], [fit]."""

    kind, heading = "motion", "Fit to measured motion"
    reading = MOTION_TABLES
    converter, function = Measurements, fit_finding


def comparison_finding(file: StudyFile, formats: tuple[str, ...]) -> Finding:
    """Fit the laws of a study file to its records: the criteria, as a table and as a figure."""
    read = Measurements.of(file).read()
    with error_prefix(file.where("fit")):
        comparison = compare_laws(read.model, read.records, read.laws, **read.settings)
    return Finding.of(comparison, "Information criteria of the laws above the lowest: smaller is better.", formats)


@final
@dataclass(frozen=True, kw_only=True)
class Comparison(TablesStep):
    """The law that explains measured motion best, of several [[damping]] or of laws in [fit]; tables as for motion."""

    kind, heading = "comparison", "Damping laws compared on measured motion"
    reading = MOTION_TABLES
    converter, function = Measurements, comparison_finding

    def prepare(self, study: Study, where: str) -> Self:
        """Return the step with the tables of its records and laws, of which there must be several."""
        motions = Measurements.of(study.file)
        if len(motions.law_terms) < 2:
            raise InputError("there is only one law; add tables [[damping]]", where)
        if "fixed" in motions.settings:
            raise InputError("all parameters of the laws are compared; leave out fixed", study.file.where("fit"))
        return super().prepare(study, where)


def plan_finding(file: StudyFile, formats: tuple[str, ...]) -> Finding:
    """Plan the candidates of a study file: the errors of each and of all, and the best list."""
    tables = PlanTables.of(file)
    if tables.table.laws:
        return Finding.of(tables.compare(), "Probability that each candidate tells two laws apart.", formats)
    plan = tables.plan()
    choice = tables.choose(plan)
    errors, bought = choice["standard_errors"], [f"{n} x {name}" for name, n in choice["best"].items() if n]
    title = f"best list within the budget {choice['budget']:g} for {choice['goal']}: {', '.join(bought)}"
    columns = errors, plan.units.values(), errors.values(), plan.relative(errors).values()
    rows = [(name, unit, *map(finite_or_none, values)) for name, unit, *values in zip(*columns, strict=True)]
    best = Table("best", title, ("unknown", "unit", "standard_error", "relative"), rows)
    caption = (
        "Expected standard errors from one record of each candidate, relative to the guesses; below, those of "
        "motions against their duration and the place of a single sensor."
    )
    finding = Finding.of(plan, caption, formats, data=plan.to_dict() | choice)
    return replace(finding, tables=(*finding.tables, best), text=f"{finding.text}\n\n{best.text()}")


@final
@dataclass(frozen=True, kw_only=True)
class PlanStep(TablesStep):
    """Expected errors of experiments, and the best list: [[damping]], [[candidates]], [fit] (unknowns), [plan]."""

    kind, heading = "plan", "Planned experiments"
    reading = PLAN_TABLES
    converter, function = PlanTables, plan_finding
