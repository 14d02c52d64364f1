"""The results of a study: labels of its tables and figures, ``results.json`` with its schema, and the HTML page.

A step may give labels; all other tables and figures have running numbers.

    {"study": {"title", "source", "seed", "quick", "steps": [{"name", "kind", "title", "tables", "figures"}]},
     "versions": {...},
     "<name of a step>": ...,       its numbers: SI units, ratios as fractions, lists in the order of modes or runs
     "timing": {...}}               computing time of each step, s

Two runs of one study with one seed differ only in ``timing`` and in keys that end in ``_seconds``.
"""

from __future__ import annotations

import base64
import re
from collections import ChainMap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from html import escape
from importlib.resources import files
from itertools import chain, count
from types import NoneType
from typing import Any

from markupsafe import Markup

from ancf_casadi.support.tables import Table
from problems.study.formatting import formatted_table
from problems.study.step import Finding, Study

JSON_TYPES = {dict: "object", list: "array", str: "string", bool: "boolean", int: "integer", float: "number",
              NoneType: "null"}  # fmt: skip
NO_BREAK = "\u00a0"  # a space where no line ends
INK = re.compile(r"((?:fill|stroke|stop-color)(?:: *|=\"))(?:#000000|#222222|black)\b")  # of axes, text and records
NUMBER_AND_UNIT = re.compile(r"(?<=\d) (?=(?:%|[km]?Hz|[kmµ]?m|m?s|1/s|1/m|k?g|kg/m³|m/s²|[GMk]?Pa)(?![\w/]))")
LEADING_NUMBER = re.compile(r"^(?:< |[(])?[-+–]?\d")


def label_findings(study: Study, findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Return the findings of the steps with labels as names of tables and figures, and with the notes of each step."""
    labels = [label for step in study.steps for label in (*step.tables, *step.figures)]
    taken = {file_name(label) for label in labels}
    numbers = {kind: _free(f"{kind} {'A' if labels else ''}", taken) for kind in ("Table", "Figure")}

    def named(kind: str, items: Sequence[Any], labels: Sequence[str]) -> tuple[Any, ...]:
        return tuple(
            replace(item, name=label) for item, label in zip(items, chain(labels, numbers[kind]), strict=False)
        )

    with_labels = []
    for step, finding in zip(study.steps, findings, strict=True):
        tables = [replace(table, source=study.printed_by) for table in named("Table", finding.tables, step.tables)]
        first = [replace(table, notes=(*table.notes, *step.notes)) for table in tables[:1]]
        figures = named("Figure", finding.figures, step.figures)
        with_labels.append(replace(finding, tables=(*first, *tables[1:]), figures=figures))
    return tuple(with_labels)


def file_name(label: str) -> str:
    """Return the name of the files of a labelled table or figure: ``figure_05`` for Figure 5."""
    kind, _, number = label.lower().partition(" ")
    named = f"{kind} {number.zfill(2)}" if number.isdecimal() else label.lower()
    return re.sub(r"\W+", "_", named).strip("_")


def _free(kind: str, taken: set[str]) -> Iterator[str]:
    """Yield the running labels whose files have other names than those taken."""
    for number in count(1):
        if file_name(f"{kind}{number}") not in taken:
            yield f"{kind}{number}"


def results(study: Study, findings: Sequence[Finding], versions: Mapping[str, str], *, quick: bool) -> dict[str, Any]:
    """Return the numbers of a study as plain data; ``versions`` are those of the programs."""
    steps = [
        {
            "name": step.name,
            "kind": step.kind,
            "title": step.title,
            "tables": [table.name for table in finding.tables],
            "figures": [figure.name for figure in finding.figures],
            "warnings": list(finding.warnings),
        }
        for step, finding in zip(study.steps, findings, strict=True)
    ]
    source = study.source.strip()
    return {
        "study": {"title": study.title, "source": source, "seed": study.seed, "quick": quick, "steps": steps},
        "versions": dict(versions),
        **{finding.name: finding.data for finding in findings},
        "timing": {finding.name: finding.seconds for finding in findings},
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


def page(study: Study, findings: Sequence[Finding], **about: Any) -> str:
    """Return the document as HTML.

    The circumstances are ``command``, ``versions`` of the programs, ``quick`` for shortened simulations, and
    ``left_out``, the titles of the steps that a quick look leaves out.
    """
    from jinja2 import Environment, StrictUndefined  # slow to import

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters |= {"paragraphs": _paragraphs, "anchor": file_name, "unbroken": _without_breaks}
    environment.filters |= {"with_units": _with_units, "base64": lambda content: base64.b64encode(content).decode()}
    environment.globals |= {"svg": inline_svg, "numeric": _numeric, "zip": zip,
                            "formatted": formatted_table}  # fmt: skip
    source = files("problems.study").joinpath("page.html.jinja").read_text(encoding="utf-8")
    times = ChainMap(*(dict(finding.times) for finding in findings))  # a computation that steps share counts once
    steps = list(zip(study.steps, findings, strict=True))
    return environment.from_string(source).render(study=study, steps=steps, times=times, about=about)


def _paragraphs(text: str) -> Markup:
    """Return text with empty lines as paragraphs."""
    paragraphs = [paragraph.strip() for paragraph in text.strip().split("\n\n") if paragraph.strip()]
    return Markup("\n").join(Markup("<p>{}</p>").format(_with_units(paragraph)) for paragraph in paragraphs)


def _without_breaks(text: str) -> str:
    """Return text that breaks before ± only: a number keeps its unit, and a label its number."""
    return text.replace(" ", NO_BREAK).replace(f"{NO_BREAK}±", " ±")


def _with_units(text: str) -> str:
    """Return text that does not break between a number and its unit."""
    return NUMBER_AND_UNIT.sub(NO_BREAK, text)


def _numeric(table: Table) -> list[bool]:
    """Return for each column of a formatted table whether it holds numbers, which are aligned to the right."""
    return [all(not cell or cell == "–" or LEADING_NUMBER.match(cell) for cell in column)
            for column in zip(*table.rows, strict=True)]  # fmt: skip


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
    least = 0.75 * float(width)  # px, at which letters are readable
    style = f"aspect-ratio: {width} / {height}; min-width: {least:g}px"
    opening = f'<svg role="img" aria-label="{escape(caption)}" style="{style}"'
    return Markup(element.replace("<svg", opening, 1))
