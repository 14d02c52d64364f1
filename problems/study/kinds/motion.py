"""A part with a fit of damping laws and properties to measured large motion, and with predictions of other records.

The part reads the tables [[damping]], [base], [[records]], [[predictions]] and [fit] of the file, as
``ancf-casadi fit-motion`` does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypedDict, final

from ancf_casadi.mechanics.beam import PROPERTIES, Beam
from ancf_casadi.support.inputs import check_keys
from problems.schema.records import read_motions
from problems.study.data_table import Column, DataTable
from problems.study.drawing import Drawing, drawn
from problems.study.files import FilePart, TablesOfFile
from problems.study.kind import Kind
from problems.study.part import Effort, Finding, Heading, Outcome, Task
from problems.study.source import Source
from problems.transient.fitting import fit_transient
from problems.transient.prediction import MotionPrediction

KEYS = """\
  kind = "motion"       fit to measured large motion, and predictions: the tables
                        [[damping]], [base], [[records]], [[predictions]], [fit]
"""
SECONDS = 60.0  # expected computing time
TABLES = {"beam", "damping", "base", "load", "release", "records", "predictions", "fit"}


class MotionNumbers(TypedDict):
    """Fit to measured motion, as ``TransientFit.to_dict``, and predictions, as ``MotionPrediction.to_dict``."""

    fit: dict[str, Any]
    predictions: list[dict[str, Any]]


@dataclass(frozen=True)
class FittedMotion:
    """A fit to measured motion as plain data.

    Parameters
    ----------
    fit : dict
        The fit for JSON.
    predictions : tuple of dict
        The predictions for JSON.
    beam : Beam
        The fitted beam.
    figures : tuple of Drawing
        Measured and fitted motion, and each prediction.
    warnings : tuple of str
        Limitations of fit and predictions.
    """

    fit: dict[str, Any]
    predictions: tuple[dict[str, Any], ...]
    beam: Beam
    figures: tuple[Drawing, ...]
    warnings: tuple[str, ...]


def fit_plain(given: TablesOfFile, name: str) -> FittedMotion:
    """Fit the motion in the files of a study, and return the fit as plain data.

    Parameters
    ----------
    given : TablesOfFile
        The tables.
    name : str
        Name of the part.

    Raises
    ------
    InputError, FitError
        As ``fit_transient``.
    """
    motions = read_motions(given.file())
    fit = fit_transient(motions.model, motions.records, motions.damping, **motions.settings)
    figures = [drawn(name, "Measured motion (dots), fitted motion (lines), and residuals.", fit.figure)]
    predictions: list[MotionPrediction] = []
    for k, (record, mass) in enumerate(motions.predictions, start=1):
        prediction = fit.predict(record, tip_mass=mass)
        predictions.append(prediction)
        caption = f"Record {k} that was predicted, not fitted: measured (dots) and computed (lines), and residuals."
        figures.append(drawn(f"{name}_prediction_{k}", caption, prediction.figure))
    warnings = (*fit.warnings, *(warning for prediction in predictions for warning in prediction.warnings))
    return FittedMotion(
        fit.to_dict(), tuple(one.to_dict() for one in predictions), fit.model.beam, tuple(figures), warnings
    )


@final
@dataclass(frozen=True)
class MotionFit(FilePart):
    """A fit to measured large motion."""

    kind = "motion"
    numbers = MotionNumbers

    def tasks(self, found: Mapping[str, Outcome], effort: Effort) -> tuple[Task, ...]:
        """Return the fit."""
        return (Task(fit_plain, (self.given, self.heading.name), SECONDS),)

    def finding(self, results: Sequence[Any], found: Mapping[str, Outcome], effort: Effort) -> Finding:
        """Return the estimates, the predictions and their figures."""
        fitted: FittedMotion = results[0]
        unknowns = fitted.fit["unknowns"]
        columns = (
            Column("unknown", tuple(one["name"] for one in unknowns)),
            Column("unit", tuple(one["unit"] for one in unknowns)),
            Column("estimate", tuple(one["value"] for one in unknowns),
                   errors=tuple(one["standard_error"] for one in unknowns)),
            Column("95 % interval from", tuple(one["interval_95"][0] for one in unknowns)),
            Column("to", tuple(one["interval_95"][1] for one in unknowns)),
        )  # fmt: skip
        name, heading = self.heading.name, self.heading
        factors = sorted({one["name"] for one in unknowns} & set(PROPERTIES))
        notes = (*([f"Factors of the given values: {', '.join(factors)}."] if factors else []), *heading.notes)
        tables = [DataTable(name, "Estimates from the measured motion", columns, notes)]
        if fitted.predictions:
            tables.append(self._predictions(fitted))
        outcome = Outcome({"fit": fitted.fit, "predictions": list(fitted.predictions)}, beam=fitted.beam)
        return Finding(outcome, tuple(tables), fitted.figures, fitted.warnings)

    def _predictions(self, fitted: FittedMotion) -> DataTable:
        rows = [
            (k, channel["channel"], channel["unit"], channel["rms_error"], 100 * channel["relative_error"])
            for k, one in enumerate(fitted.predictions, start=1)
            for channel in one["channels"]
        ]
        heads = (("record", ""), ("channel", ""), ("unit", ""), ("rms error", ""), ("rms error", "% of the rms motion"))
        columns = tuple(
            Column(head, cells, unit) for (head, unit), cells in zip(heads, zip(*rows, strict=True), strict=True)
        )
        return DataTable(f"{self.heading.name}_predictions", "Errors of the predictions", columns)


def read(source: Source, given: dict[str, Any], heading: Heading, where: str) -> MotionFit:
    """Return the part that a table describes.

    Raises
    ------
    InputError
        If a table is missing, a key or value cannot be used, or a file cannot be read.
    """
    check_keys(given, set(), set(), where)
    read_motions(source.file)  # check
    return MotionFit(heading, TablesOfFile.of(source, TABLES))


KIND = Kind(MotionFit.kind, "Fit to measured motion", KEYS, read)
