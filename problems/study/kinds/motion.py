"""Parts with measured large motion: a fit with predictions of other records, and a comparison of damping laws.

They read the tables [[damping]], [base], [[records]], [[predictions]] and [fit] of the file, as the commands
``fit-motion`` and ``compare-laws`` do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypedDict, final

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import PROPERTIES, Beam
from problems.response.comparison import compare_laws
from problems.schema.file import StudyFile
from problems.schema.records import read_motions
from problems.study.data_table import Column, DataTable
from problems.study.drawing import Drawing, drawn
from problems.study.files import FilePart, TablesOfFile
from problems.study.part import Effort, Finding, Found, Task
from problems.transient.fitting import fit_transient
from problems.transient.prediction import MotionPrediction

FITTING, COMPARING = 60.0, 120.0  # s, expected computing time
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
@dataclass(frozen=True, kw_only=True)
class MotionFit(FilePart):
    """A fit to measured large motion."""

    kind, heading = "motion", "Fit to measured motion"
    about = ("fit to measured large motion, and predictions: the tables [[damping]], [base], [[records]], "
             "[[predictions]], [fit]")  # fmt: skip
    numbers = MotionNumbers
    wanted = TABLES

    def check(self, file: StudyFile, where: str) -> None:
        """Check the records."""
        read_motions(file)

    def tasks(self, found: Found, effort: Effort) -> tuple[Task, ...]:
        """Return the fit."""
        return (Task(fit_plain, (self.given, self.name), FITTING),)

    def finding(self, results: Sequence[Any], found: Found, effort: Effort) -> Finding:
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
        factors = sorted({one["name"] for one in unknowns} & set(PROPERTIES))
        notes = [f"Factors of the given values: {', '.join(factors)}."] if factors else []
        tables = [self.data_table("Estimates from the measured motion", columns, *notes)]
        if fitted.predictions:
            tables.append(self._predictions(fitted))
        data = {"fit": fitted.fit, "predictions": list(fitted.predictions)}
        return Finding(data, tuple(tables), fitted.figures, fitted.warnings, fitted.beam)

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
        return self.data_table("Errors of the predictions", columns, suffix="_predictions")


class ComparisonNumbers(TypedDict):
    """Comparison of damping laws, as ``LawComparison.to_dict``."""

    best: str
    settled: bool
    effective_samples: float
    laws: list[dict[str, Any]]
    failed: dict[str, str]
    warnings: list[str]


@dataclass(frozen=True)
class ComparedLaws:
    """A comparison of laws as plain data.

    Parameters
    ----------
    data : dict
        The comparison for JSON.
    notes : tuple of str
        Parameters of each law, and the choice.
    figure : Drawing
        The criteria.
    """

    data: dict[str, Any]
    notes: tuple[str, ...]
    figure: Drawing


def compare_plain(given: TablesOfFile, name: str) -> ComparedLaws:
    """Fit the laws of a study file to its records, and return the comparison as plain data.

    Raises
    ------
    InputError, FitError
        As ``compare_laws``.
    """
    motions = read_motions(given.file())
    found = compare_laws(motions.model, motions.records, motions.laws, **motions.settings)
    caption = "Information criteria of the laws above the lowest: smaller is better."
    return ComparedLaws(found.to_dict(), tuple(found.table().notes), drawn(name, caption, found.figure))


@final
@dataclass(frozen=True, kw_only=True)
class Comparison(FilePart):
    """A comparison of damping laws on measured large motion."""

    kind, heading = "comparison", "Damping laws compared on measured motion"
    about = ('the law that explains measured large motion best: the tables of "motion" with several [[damping]], or '
             "laws in [fit]")  # fmt: skip
    numbers = ComparisonNumbers
    wanted = TABLES

    def check(self, file: StudyFile, where: str) -> None:
        """Check the records and the laws, of which there must be several."""
        motions = read_motions(file)
        if len(motions.laws) < 2:
            raise InputError("there is only one law; add tables [[damping]]", where)
        if "fixed" in motions.settings:
            raise InputError("all parameters of the laws are compared; leave out fixed", file.where("fit"))

    def tasks(self, found: Found, effort: Effort) -> tuple[Task, ...]:
        """Return the comparison."""
        return (Task(compare_plain, (self.given, self.name), COMPARING),)

    def finding(self, results: Sequence[Any], found: Found, effort: Effort) -> Finding:
        """Return the criteria, as a table and as a figure."""
        compared: ComparedLaws = results[0]
        laws = compared.data["laws"]
        lowest = min(law["bic"] for law in laws)
        columns = (
            Column("law", tuple(law["law"] for law in laws)),
            Column("unknowns", tuple(law["estimated"] for law in laws)),
            Column("rms residual", tuple(law["residual_rms"] for law in laws)),
            Column("BIC above the lowest", tuple(law["bic"] - lowest for law in laws)),
        )
        table = self.data_table("Damping laws fitted to the measured motion", columns, *compared.notes)
        return Finding(compared.data, (table,), (compared.figure,), tuple(compared.data["warnings"]))
