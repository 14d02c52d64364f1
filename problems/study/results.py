"""The numbers of a study as ``results.json``, and the JSON Schema of this file.

    {"study": {"title", "source", "seed", "quick", "parts": [{"name", "kind", "title", "tables", "figures"}]},
     "versions": {...},
     "<name of a part>": ...,       its numbers: SI units, ratios as fractions, lists in the order of modes or runs
     "timing": {...}}               computing time of each part, s

Two runs of one study with one seed differ only in ``timing`` and in keys that end in ``_seconds``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypedDict

import msgspec

from problems.study.document.labels import Shown
from problems.study.part import Study
from problems.study.runner import PartTime


class PartNumbers(TypedDict):
    """A part of the study and its place in the document."""

    name: str
    kind: str
    title: str
    tables: list[str]
    figures: list[str]
    warnings: list[str]


class StudyNumbers(TypedDict):
    """The study."""

    title: str
    source: str
    seed: int
    quick: bool
    parts: list[PartNumbers]


def results(
    study: Study, shown: Sequence[Shown], steps: Sequence[PartTime], versions: Mapping[str, str], *, quick: bool
) -> dict[str, Any]:
    """Return the numbers of a study as plain data.

    Parameters
    ----------
    study : Study
        The study.
    shown : sequence of Shown
        Its parts with labels.
    steps : sequence of PartTime
        Time of each part.
    versions : mapping of str to str
        Versions of the programs.
    quick : bool
        Whether the simulations were shortened.
    """
    parts = [
        {
            "name": part.name,
            "kind": part.kind,
            "title": part.title,
            "tables": [label for label, _ in one.tables],
            "figures": [label for label, _ in one.figures],
            "warnings": list(one.finding.warnings),
        }
        for part, one in zip(study.parts, shown, strict=True)
    ]
    about = {
        "title": study.title,
        "source": study.source.strip(),
        "seed": study.seed,
        "quick": quick,
        "parts": parts,
    }
    numbers = {one.part.name: one.finding.data for one in shown}
    return {
        "study": about,
        "versions": dict(versions),
        **numbers,
        "timing": {step.name: step.seconds for step in steps},
    }


def schema(study: Study) -> dict[str, Any]:
    """Return the layout of ``results.json`` of a study as a JSON Schema (draft 2020-12)."""
    types = [StudyNumbers, *(part.numbers for part in study.parts)]
    layouts, components = msgspec.json.schema_components(types, ref_template="#/$defs/{name}")
    about, *parts = layouts
    properties = {
        "study": about,
        "versions": {"type": "object", "additionalProperties": {"type": "string"}},
        **{part.name: layout for part, layout in zip(study.parts, parts, strict=True)},
        "timing": {"type": "object", "additionalProperties": {"type": "number", "minimum": 0}},
    }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"results.json of the study: {study.title}",
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
        "$defs": components,
    }
