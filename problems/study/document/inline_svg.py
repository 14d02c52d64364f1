"""SVG figures inside an HTML page: their black becomes the text colour of the page, and their names stay unique."""

from __future__ import annotations

import re

INK = re.compile(r"((?:fill|stroke|stop-color)(?:: *|=\"))(?:#000000|#222222|black)\b")  # of axes, text and records


def inline_svg(svg: str, name: str, caption: str) -> str:
    """Return an SVG file as an element of an HTML page.

    Parameters
    ----------
    svg : str
        Content of the file.
    name : str
        Prefix of its names, which must differ from those of other figures on the page.
    caption : str
        Description for readers who do not see the figure.
    """
    element = svg[svg.index("<svg") :]
    element = re.sub(r"<metadata>.*?</metadata>", "", element, flags=re.S)
    element = re.sub(r'\bid="([^"]+)"', rf'id="{name}-\1"', element)
    element = re.sub(r"url\(#([^)]+)\)", rf"url(#{name}-\1)", element)
    element = re.sub(r'xlink:href="#([^"]+)"', rf'xlink:href="#{name}-\1"', element)
    element = INK.sub(r"\1currentColor", element)
    width, height = re.search(r'width="([\d.]+)pt" height="([\d.]+)pt"', element).groups()  # type: ignore[union-attr]
    element = re.sub(r'width="[\d.]+pt" height="[\d.]+pt"', "", element, count=1)
    opening = f'<svg role="img" aria-label="{_attribute(caption)}" style="aspect-ratio: {width} / {height}"'
    return element.replace("<svg", opening, 1)


def _attribute(text: str) -> str:
    return text.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
