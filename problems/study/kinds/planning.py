"""A part with a planned experiment, computed from the tables of the file as ``ancf-casadi plan`` does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from ancf_casadi.support.tables import known
from problems.schema.plan import PLAN_TABLES, read_plan
from problems.schema.table import StudyFile
from problems.study.data_table import Column, DataTable
from problems.study.drawing import drawn
from problems.study.kinds.motion import FilePart
from problems.study.part import Finding


@final
@dataclass(frozen=True, kw_only=True)
class PlanPart(FilePart):
    """The standard errors that candidates will have, and the list that is worth measuring."""

    kind, heading = "plan", "Planned experiments"
    about = "expected errors of experiments: the tables [[damping]], [[candidates]], [fit] (unknowns), [plan]"
    seconds = 20.0
    wanted = PLAN_TABLES

    @staticmethod
    def compute(file: StudyFile) -> Finding:
        """Plan the candidates of a study file: the errors of each and of all, and the best list."""
        task = read_plan(file)
        found = task.planned()
        choice = task.chosen(found)
        own = found.table()
        rows = [*own.rows, ("best list", None, *map(known, found.relative(choice["standard_errors"]).values()))]
        heads = [head.rpartition(", ")[::2] if ", " in head else (head, "") for head in own.columns]
        columns = tuple(
            Column(head, cells, unit) for (head, unit), cells in zip(heads, zip(*rows, strict=True), strict=True)
        )
        bought = ", ".join(f"{count} × {name}" for name, count in choice["best"].items() if count)
        note = f"Best list within the budget {choice['budget']:g} for {choice['goal']}: {bought}."
        caption = (
            "Expected standard errors from one record of each candidate, relative to the guesses; below, those of "
            "motions against their duration and the place of a single sensor."
        )
        tables = (DataTable(own.title, columns, (note,)),)
        return Finding(found.to_dict() | choice, tables, (drawn(caption, found.figure),), found.warnings)

    def check(self, file: StudyFile, where: str) -> None:
        """Check the candidates."""
        read_plan(file)
