"""Parts with measured large motion: a fit with predictions of other records, and a comparison of damping laws.

They read the tables [[damping]], [base], [[records]], [[predictions]] and [fit] of the file, as the commands
``fit`` and ``compare-laws`` do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypedDict, final

from ancf_casadi.exceptions import InputError
from problems.beam.fitting import compare_laws, fit_beam
from problems.schema.file import StudyFile
from problems.schema.records import NUMBERS, read_measurements
from problems.study.data_table import Column, DataTable
from problems.study.drawing import drawn
from problems.study.part import FilePart, Finding

MOTION_TABLES = {"beam", "damping", "base", "load", "release", "records", *NUMBERS, "predictions", "fit"}


class MotionNumbers(TypedDict):
    """Fit to measured motion, as ``BeamFit.to_dict``, and predictions, as ``RecordPrediction.to_dict``."""

    fit: dict[str, Any]
    predictions: list[dict[str, Any]]


def fitted_motion(file: StudyFile, name: str) -> Finding:
    """Fit the motion in the files of a study: estimates, predictions and their figures.

    Raises
    ------
    InputError, FitError
        As ``fit_beam``.
    """
    read = read_measurements(file)
    fit = fit_beam(read.model, read.records, read.damping, **read.settings)
    figures = [drawn(name, "Measured motion (dots), fitted motion (lines), and residuals.", fit.figure)]
    predictions = []
    for k, record in enumerate(read.predictions, start=1):
        prediction = fit.predict(record)
        predictions.append(prediction)
        caption = f"Record {k} that was predicted, not fitted: measured (dots) and computed (lines), and residuals."
        figures.append(drawn(f"{name}_prediction_{k}", caption, prediction.figure))
    warnings = (*fit.warnings, *(warning for prediction in predictions for warning in prediction.warnings))
    data: dict[str, Any] = {"fit": fit.to_dict(), "predictions": [one.to_dict() for one in predictions]}
    tables = [_estimates(name, data["fit"]["estimates"])]
    if predictions:
        tables.append(_errors(f"{name}_predictions", data["predictions"]))
    return Finding(data, tuple(tables), tuple(figures), warnings, fit.model.beam)


def _estimates(name: str, unknowns: Sequence[Mapping[str, Any]]) -> DataTable:
    columns = (
        Column("unknown", tuple(one["name"] for one in unknowns)),
        Column("unit", tuple(one["unit"] for one in unknowns)),
        Column("estimate", tuple(one["value"] for one in unknowns),
               errors=tuple(one["standard_error"] for one in unknowns)),
        Column("95 % interval from", tuple(one["interval_95"][0] for one in unknowns)),
        Column("to", tuple(one["interval_95"][1] for one in unknowns)),
    )  # fmt: skip
    return DataTable(name, "Estimates from the measurements", columns)


def _errors(name: str, predictions: Sequence[Mapping[str, Any]]) -> DataTable:
    rows = [
        (k, channel["channel"], channel["unit"], channel["rms_error"], 100 * channel["relative_error"])
        for k, one in enumerate(predictions, start=1)
        for channel in one["channels"]
    ]
    heads = (("record", ""), ("channel", ""), ("unit", ""), ("rms error", ""), ("rms error", "% of the rms motion"))
    columns = tuple(
        Column(head, cells, unit) for (head, unit), cells in zip(heads, zip(*rows, strict=True), strict=True)
    )
    return DataTable(name, "Errors of the predictions", columns)


@final
@dataclass(frozen=True, kw_only=True)
class MotionFit(FilePart):
    """A fit to measured large motion."""

    kind, heading = "motion", "Fit to measured motion"
    about = ("fit to measured large motion, and predictions: the tables [[damping]], [base], [[records]], "
             "[[predictions]], [fit]")  # fmt: skip
    numbers = MotionNumbers
    seconds = 60.0
    compute = staticmethod(fitted_motion)
    wanted = MOTION_TABLES

    def check(self, file: StudyFile, where: str) -> None:
        """Check the records."""
        read_measurements(file)


class ComparisonNumbers(TypedDict):
    """Comparison of damping laws, as ``LawComparison.to_dict``."""

    best: str
    settled: bool
    effective_samples: float
    laws: list[dict[str, Any]]
    failed: dict[str, str]
    warnings: list[str]


def compared_laws(file: StudyFile, name: str) -> Finding:
    """Fit the laws of a study file to its records: the criteria, as a table and as a figure.

    Raises
    ------
    InputError, FitError
        As ``compare_laws``.
    """
    read = read_measurements(file)
    found = compare_laws(read.model, read.records, read.laws, **read.settings)
    caption = "Information criteria of the laws above the lowest: smaller is better."
    data = found.to_dict()
    laws = data["laws"]
    lowest = min(law["bic"] for law in laws)
    columns = (
        Column("law", tuple(law["law"] for law in laws)),
        Column("unknowns", tuple(law["estimated"] for law in laws)),
        Column("rms residual", tuple(law["residual_rms"] for law in laws)),
        Column("BIC above the lowest", tuple(law["bic"] - lowest for law in laws)),
    )
    table = DataTable(name, "Damping laws fitted to the measured motion", columns, tuple(found.table().notes))
    return Finding(data, (table,), (drawn(name, caption, found.figure),), tuple(data["warnings"]))


@final
@dataclass(frozen=True, kw_only=True)
class Comparison(FilePart):
    """A comparison of damping laws on measured large motion."""

    kind, heading = "comparison", "Damping laws compared on measured motion"
    about = ('the law that explains measured large motion best: the tables of "motion" with several [[damping]], or '
             "laws in [fit]")  # fmt: skip
    numbers = ComparisonNumbers
    seconds = 120.0
    compute = staticmethod(compared_laws)
    wanted = MOTION_TABLES

    def check(self, file: StudyFile, where: str) -> None:
        """Check the records and the laws, of which there must be several."""
        motions = read_measurements(file)
        if len(motions.laws) < 2:
            raise InputError("there is only one law; add tables [[damping]]", where)
        if "fixed" in motions.settings:
            raise InputError("all parameters of the laws are compared; leave out fixed", file.where("fit"))
