r"""Write the formulas of the site as MathML, which browsers show without a script and without a network.

The pages hold LaTeX between dollar signs, which hosting services of repositories show as well.  A displayed formula
states its number in the paper as ``\tag{6}``, and is then the target ``#equation-6``.  A formula stays with the
punctuation beside it, and numbers such as 2.5e-6 stay on one line; browsers would break both.
"""

from __future__ import annotations

import re
from html import escape
from typing import Any

from docutils import nodes
from math_core import LatexError, LatexToMathML
from sphinx.application import Sphinx
from sphinx.util.logging import getLogger
from sphinx.writers.html5 import HTML5Translator

CONVERTER = LatexToMathML(fancy_error=False)
NUMBER = re.compile(r"([-+]?\d+(?:\.\d+)?e-\d+)")
TAG = re.compile(r"\s*\\tag\{([^}]+)\}")


def mathml(latex: str, *, display: bool) -> str:
    """Return a formula as MathML; a command that does not exist is a LatexError."""
    return CONVERTER.convert_with_local_state(latex.strip(), displaystyle=display)


def numbered(latex: str) -> tuple[str, str]:
    """Return a displayed formula without its number, and the number, empty if it has none."""
    tag = TAG.search(latex)
    return TAG.sub("", latex), tag[1] if tag else ""


def write(translator: HTML5Translator, node: nodes.Element, latex: str, *, display: bool) -> None:
    """Append a formula to a page, as it stands and with a warning if it cannot be converted."""
    try:
        translator.body.append(mathml(latex, display=display))
    except LatexError as error:
        getLogger(__name__).warning("formula %r: %s", latex, error, location=node)
        translator.body.append(f"<code>{escape(latex)}</code>")


def visit_math(translator: HTML5Translator, node: nodes.math) -> None:
    """Write a formula within a line."""
    write(translator, node, node.astext(), display=False)
    raise nodes.SkipNode


def visit_math_block(translator: HTML5Translator, node: nodes.math_block) -> None:
    """Write a displayed formula in a box that scrolls if it is narrower, and its number beside it."""
    latex, number = numbered(node.astext())
    anchor = f' id="equation-{escape(number)}"' if number else ""
    translator.body.append(f'<div class="formula"{anchor}><div tabindex="0">')
    write(translator, node, latex, display=True)
    translator.body.append("</div>" + (f"<span>({escape(number)})</span>" if number else "") + "</div>\n")
    raise nodes.SkipNode


def keep_numbers_whole(doctree: nodes.document) -> None:
    """Let no line break within a number with a negative exponent, and warn of formulas that were not read as such."""
    for text in list(doctree.findall(nodes.Text)):
        if isinstance(text.parent, nodes.literal | nodes.FixedTextElement | nodes.math):
            continue
        if "$" in text:
            getLogger(__name__).warning("a dollar sign without a formula: %r", text.astext(), location=text.parent)
        parts = NUMBER.split(text.astext())
        if len(parts) > 1:
            place = place_of(text)
            text.parent[place : place + 1] = [
                whole(nodes.Text(part)) if k % 2 else nodes.Text(part) for k, part in enumerate(parts)
            ]


def keep_punctuation(doctree: nodes.document) -> None:
    """Let no line break between a formula and the punctuation beside it."""
    for formula in list(doctree.findall(nodes.math)):
        parent, place = formula.parent, place_of(formula)
        before, after = parent[place - 1] if place else None, parent[place + 1] if place + 1 < len(parent) else None
        opening = re.search(r"[(/]*\Z", before) if isinstance(before, nodes.Text) else None
        closing = re.match(r"[,.;:)/]*", after) if isinstance(after, nodes.Text) else None
        pieces = [nodes.Text(found[0]) if found else nodes.Text("") for found in (opening, closing)]
        if any(pieces):
            parent[place] = whole(pieces[0], formula.deepcopy(), pieces[1])
            if opening:
                parent[place - 1] = nodes.Text(before[: opening.start()])
            if closing:
                parent[place + 1] = nodes.Text(after[closing.end() :])


def place_of(node: nodes.Node) -> int:
    """Return the place of a node in its parent, which may hold other nodes of the same text."""
    return next(place for place, child in enumerate(node.parent.children) if child is node)


def whole(*parts: nodes.Node) -> nodes.inline:
    """Return parts of a line as an element whose style has no line breaks."""
    return nodes.inline("", "", *parts, classes=["whole"])


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the renderer ``mathml``, and where lines must not break."""
    app.connect("doctree-read", lambda app, doctree: keep_numbers_whole(doctree))
    app.connect("doctree-read", lambda app, doctree: keep_punctuation(doctree))
    app.add_html_math_renderer("mathml", (visit_math, None), (visit_math_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
