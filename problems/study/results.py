"""The results of a study: labels of its tables and figures, ``results.json`` with its schema, and the HTML page.

A part may give labels; all other tables and figures have running numbers.

    {"study": {"title", "source", "seed", "quick", "parts": [{"name", "kind", "title", "tables", "figures"}]},
     "versions": {...},
     "<name of a part>": ...,       its numbers: SI units, ratios as fractions, lists in the order of modes or runs
     "timing": {...}}               computing time of each part, s

Two runs of one study with one seed differ only in ``timing`` and in keys that end in ``_seconds``.
"""

from __future__ import annotations

import base64
import itertools
import re
from collections import ChainMap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from html import escape
from importlib.resources import files
from types import NoneType
from typing import Any

from markupsafe import Markup

from problems.study.data_table import DataTable
from problems.study.part import PartReport, Study

JSON_TYPES = {dict: "object", list: "array", str: "string", bool: "boolean", int: "integer", float: "number",
              NoneType: "null"}  # fmt: skip
NO_BREAK = "\u00a0"  # a space where no line ends
INK = re.compile(r"((?:fill|stroke|stop-color)(?:: *|=\"))(?:#000000|#222222|black)\b")  # of axes, text and records
NUMBER_AND_UNIT = re.compile(r"(?<=\d) (?=(?:%|[km]?Hz|[kmµ]?m|m?s|1/s|1/m|k?g|kg/m³|m/s²|[GMk]?Pa)(?![\w/]))")
LEADING_NUMBER = re.compile(r"^(?:< |[(])?[-+–]?\d")


def labelled(reports: Sequence[PartReport]) -> tuple[PartReport, ...]:
    """Return the reports with the labels of all tables and figures, and with the notes of each part."""
    given = [label for one in reports for label in (*one.part.tables, *one.part.figures)]
    taken = {file_name(label) for label in given}
    numbered = {kind: _free(f"{kind} {'A' if given else ''}", taken) for kind in ("Table", "Figure")}

    def label(kind: str, own: tuple[str, ...], k: int) -> str:
        return own[k] if k < len(own) else next(numbered[kind])

    found = []
    for one in reports:
        part, figures = one.part, one.finding.figures
        tables = list(one.finding.tables)
        if tables:
            tables[0] = replace(tables[0], notes=(*tables[0].notes, *part.notes))
        found.append(
            replace(
                one,
                tables=tuple((label("Table", part.tables, k), table) for k, table in enumerate(tables)),
                figures=tuple((label("Figure", part.figures, k), figure) for k, figure in enumerate(figures)),
            )
        )
    return tuple(found)


def file_name(label: str) -> str:
    """Return the name of the files of a labelled table or figure: ``figure_05`` for Figure 5."""
    kind, _, number = label.lower().partition(" ")
    named = f"{kind} {number.zfill(2)}" if number.isdecimal() else label.lower()
    return re.sub(r"\W+", "_", named).strip("_")


def _free(kind: str, taken: set[str]) -> Iterator[str]:
    """Yield the running labels whose files have other names than those taken."""
    for number in itertools.count(1):
        if file_name(f"{kind}{number}") not in taken:
            yield f"{kind}{number}"


def results(study: Study, reports: Sequence[PartReport], versions: Mapping[str, str], *, quick: bool) -> dict[str, Any]:
    """Return the numbers of a study as plain data; ``versions`` are those of the programs."""
    parts = [
        {
            "name": one.name,
            "kind": one.part.kind,
            "title": one.part.title,
            "tables": [label for label, _ in one.tables],
            "figures": [label for label, _ in one.figures],
            "warnings": list(one.finding.warnings),
        }
        for one in reports
    ]
    source = study.source.strip()
    return {
        "study": {"title": study.title, "source": source, "seed": study.seed, "quick": quick, "parts": parts},
        "versions": dict(versions),
        **{one.name: one.finding.data for one in reports},
        "timing": {one.name: one.seconds for one in reports},
    }


def schema(study: Study, numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Return the layout of the numbers of a study as a JSON Schema (draft 2020-12).

    The numbers themselves give the layout: all their keys are required, but in a list of tables those that not all of
    them have.  Every number may be null, which stands for an unknown one.
    """
    layout = _layout([numbers])
    layout["properties"]["timing"] = {"type": "object", "additionalProperties": {"type": "number", "minimum": 0}}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"results.json of the study: {study.title}",
        **layout,
        "additionalProperties": False,
    }


def _layout(values: Sequence[Any]) -> dict[str, Any]:
    """Return the layout that all of these values have; that of null alone leaves open what it stands for."""
    types = {JSON_TYPES[type(value)] for value in values}
    if "number" in types:
        types.discard("integer")
    if types & {"integer", "number"}:
        types.add("null")
    layout: dict[str, Any] = {} if types == {"null"} else {"type": sorted(types)}
    if "object" in types:
        tables = [value for value in values if isinstance(value, dict)]
        keys = dict.fromkeys(key for table in tables for key in table)
        layout["properties"] = {key: _layout([table[key] for table in tables if key in table]) for key in keys}
        layout["required"] = [key for key in keys if all(key in table for table in tables)]
    if items := [item for value in values if isinstance(value, list) for item in value]:
        layout["items"] = _layout(items)
    return layout


def page(study: Study, reports: Sequence[PartReport], **about: Any) -> str:
    """Return the document as HTML.

    The circumstances are ``command``, ``versions`` of the programs, ``quick`` for shortened simulations, and
    ``left_out``, the titles of the parts that a quick look leaves out.
    """
    from jinja2 import Environment, StrictUndefined  # slow to import

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters |= {"paragraphs": _paragraphs, "anchor": file_name, "unbroken": _unbroken}
    environment.filters |= {"with_units": _with_units, "base64": lambda content: base64.b64encode(content).decode()}
    environment.globals |= {"svg": inline_svg, "numeric": _numeric, "zip": zip}
    source = files("problems.study").joinpath("page.html.jinja").read_text(encoding="utf-8")
    times = ChainMap(*(dict(report.times) for report in reports))  # a computation that parts share counts once
    return environment.from_string(source).render(study=study, parts=reports, times=times, about=about)


def _paragraphs(text: str) -> Markup:
    """Return text with empty lines as paragraphs."""
    parts = [part.strip() for part in text.strip().split("\n\n") if part.strip()]
    return Markup("\n").join(Markup("<p>{}</p>").format(_with_units(part)) for part in parts)


def _unbroken(text: str) -> str:
    """Return text that breaks before ± only: a number keeps its unit, and a label its number."""
    return text.replace(" ", NO_BREAK).replace(f"{NO_BREAK}±", " ±")


def _with_units(text: str) -> str:
    """Return text that does not break between a number and its unit."""
    return NUMBER_AND_UNIT.sub(NO_BREAK, text)


def _numeric(table: DataTable) -> list[bool]:
    """Return for each shown column whether it holds numbers, which are aligned to the right."""
    return [all(not cell or cell == "–" or LEADING_NUMBER.match(cell) for cell in column)
            for column in zip(*table.cells(), strict=True)]  # fmt: skip


def inline_svg(svg: str, name: str, caption: str) -> Markup:
    """Return an SVG file as an element of an HTML page: names get a prefix, as they must differ between figures."""
    element = svg[svg.index("<svg") :]
    element = re.sub(r"<metadata>.*?</metadata>", "", element, flags=re.S)
    element = re.sub(r'\bid="([^"]+)"', rf'id="{name}-\1"', element)
    element = re.sub(r"url\(#([^)]+)\)", rf"url(#{name}-\1)", element)
    element = re.sub(r'xlink:href="#([^"]+)"', rf'xlink:href="#{name}-\1"', element)
    element = INK.sub(r"\1currentColor", element)
    width, height = re.search(r'width="([\d.]+)pt" height="([\d.]+)pt"', element).groups()  # type: ignore[union-attr]
    element = re.sub(r'width="[\d.]+pt" height="[\d.]+pt"', "", element, count=1)
    opening = f'<svg role="img" aria-label="{escape(caption)}" style="aspect-ratio: {width} / {height}"'
    return Markup(element.replace("<svg", opening, 1))
