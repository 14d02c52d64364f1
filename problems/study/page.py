"""The HTML page of a study, one self-contained file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from typing import Any

from markupsafe import Markup

from problems.study.data_table import DataTable
from problems.study.part import Study
from problems.study.results import Shown, file_name
from problems.study.runner import PartTime

NO_BREAK = "\u00a0"  # a space where no line ends
INK = re.compile(r"((?:fill|stroke|stop-color)(?:: *|=\"))(?:#000000|#222222|black)\b")  # of axes, text and records
LEADING_NUMBER = re.compile(r"^[(]?[-+–]?\d")


def page(study: Study, shown: Sequence[Shown], steps: Sequence[PartTime], **about: Any) -> str:
    """Return the document as HTML.

    The circumstances are ``command``, ``versions`` of the programs, ``quick`` for shortened simulations, and
    ``left_out``, the titles of the parts that a quick look leaves out.
    """
    from jinja2 import Environment, StrictUndefined  # slow to import

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters |= {"paragraphs": _paragraphs, "anchor": file_name, "unbroken": _unbroken}
    environment.globals |= {"svg": inline_svg, "numeric": _numeric, "zip": zip}
    source = files("problems.study").joinpath("page.html.jinja").read_text(encoding="utf-8")
    values: dict[str, Any] = {
        "study": study, "parts": shown, "steps": steps, "about": about,
        "seconds": sum(step.seconds for step in steps),
    }  # fmt: skip
    return environment.from_string(source).render(values)


def _paragraphs(text: str) -> Markup:
    """Return text with empty lines as paragraphs."""
    parts = [part.strip() for part in text.strip().split("\n\n") if part.strip()]
    return Markup("\n").join(Markup("<p>{}</p>").format(part) for part in parts)


def _unbroken(text: str) -> str:
    """Return text that breaks before ± only: a number keeps its unit, and a label its number."""
    return text.replace(" ", NO_BREAK).replace(f"{NO_BREAK}±", " ±")


def _numeric(table: DataTable) -> list[bool]:
    """Return for each shown column whether it holds numbers, which are aligned to the right."""
    return [all(not cell or cell == "–" or LEADING_NUMBER.match(cell) for cell in column)
            for column in zip(*table.cells(), strict=True)]  # fmt: skip


def inline_svg(svg: str, name: str, caption: str) -> Markup:
    """Return an SVG file as an element of an HTML page: names get a prefix, as they must differ between figures.

    The caption describes the figure to readers who do not see it.
    """
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
