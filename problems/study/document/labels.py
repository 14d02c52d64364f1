"""Labels of tables and figures: those that a part gives, and running numbers for all others."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from problems.study.data_table import DataTable
from problems.study.drawing import Drawing
from problems.study.part import Finding, Part, Study


@dataclass(frozen=True)
class Shown:
    """A part as the document shows it.

    Parameters
    ----------
    part : Part
        The part.
    finding : Finding
        Its results.
    tables : tuple of (str, DataTable)
        Its tables with their labels.
    figures : tuple of (str, Drawing)
        Its figures with their labels.
    """

    part: Part
    finding: Finding
    tables: tuple[tuple[str, DataTable], ...]
    figures: tuple[tuple[str, Drawing], ...]


def labelled(study: Study, findings: Mapping[str, Finding]) -> tuple[Shown, ...]:
    """Return the parts in order, their tables and figures with labels.

    In a study that gives labels, the others continue with the letters of additional ones: ``Table A1``, ``Figure A1``.
    """
    own = any(part.tables or part.figures for part in study.parts)
    taken = {file_name(label) for part in study.parts for label in (*part.tables, *part.figures)}
    numbered = {kind: _free(f"{kind} {'A' if own else ''}", taken) for kind in ("Table", "Figure")}

    def label(kind: str, given: tuple[str, ...], k: int) -> str:
        return given[k] if k < len(given) else next(numbered[kind])

    shown = []
    for part in study.parts:
        finding = findings[part.name]
        shown.append(
            Shown(
                part,
                finding,
                tuple((label("Table", part.tables, k), table) for k, table in enumerate(finding.tables)),
                tuple((label("Figure", part.figures, k), figure) for k, figure in enumerate(finding.figures)),
            )
        )
    return tuple(shown)


def file_name(label: str) -> str:
    """Return the name of the files of a labelled table or figure: ``figure_05`` for Figure 5.

    The name is made of letters, digits and _; it is empty if the label has none of them.
    """
    kind, _, number = label.lower().partition(" ")
    named = f"{kind} {number.zfill(2)}" if number.isdecimal() else label.lower()
    return re.sub(r"\W+", "_", named).strip("_")


def _free(kind: str, taken: set[str]) -> Iterator[str]:
    """Yield the running labels whose files have other names than those taken."""
    for number in itertools.count(1):
        if file_name(f"{kind}{number}") not in taken:
            yield f"{kind}{number}"
