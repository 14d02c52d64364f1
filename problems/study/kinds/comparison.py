"""A part that fits several damping laws to measured large motion and selects one, as ``ancf-casadi compare-laws``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypedDict, final

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.inputs import check_keys
from problems.response.comparison import compare_laws
from problems.schema.records import read_motions
from problems.study.data_table import Column, DataTable
from problems.study.drawing import Drawing, drawn
from problems.study.files import FilePart, TablesOfFile
from problems.study.kind import Kind
from problems.study.kinds.motion import TABLES
from problems.study.part import Effort, Finding, Heading, Outcome, Task
from problems.study.source import Source

KEYS = """\
  kind = "comparison"   the law that explains measured large motion best: the tables
                        of "motion" with several [[damping]], or laws in [fit]
"""
SECONDS = 120.0  # expected computing time


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
@dataclass(frozen=True)
class Comparison(FilePart):
    """A comparison of damping laws on measured large motion."""

    kind = "comparison"
    numbers = ComparisonNumbers

    def tasks(self, found: Mapping[str, Outcome], effort: Effort) -> tuple[Task, ...]:
        """Return the comparison."""
        return (Task(compare_plain, (self.given, self.heading.name), SECONDS),)

    def finding(self, results: Sequence[Any], found: Mapping[str, Outcome], effort: Effort) -> Finding:
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
        notes = (*compared.notes, *self.heading.notes)
        table = DataTable(self.heading.name, "Damping laws fitted to the measured motion", columns, notes)
        return Finding(Outcome(compared.data), (table,), (compared.figure,), tuple(compared.data["warnings"]))


def read(source: Source, given: dict[str, Any], heading: Heading, where: str) -> Comparison:
    """Return the part that a table describes.

    Raises
    ------
    InputError
        If a table is missing, a key or value cannot be used, a file cannot be read, or there is only one law.
    """
    check_keys(given, set(), set(), where)
    motions = read_motions(source.file)
    if len(motions.laws) < 2:
        raise InputError("there is only one law; add tables [[damping]]", where)
    if "fixed" in motions.settings:
        raise InputError("all parameters of the laws are compared; leave out fixed", source.file.where("fit"))
    return Comparison(heading, TablesOfFile.of(source, TABLES))


KIND = Kind(Comparison.kind, "Damping laws compared on measured motion", KEYS, read)
