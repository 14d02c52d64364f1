r"""Write the formulas of the site as MathML, which browsers show without a script and without a network.

The pages hold LaTeX between dollar signs, which hosting services of repositories show as well.  A displayed formula
states its number in the paper as ``\tag{6}``, and is then the target ``#equation-6``.
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
WORD_JOINER = "\u2060"
TAG = re.compile(r"\s*\\tag\{([^}]+)\}")


def mathml(latex: str, *, display: bool) -> str:
    """Return a formula as MathML; a command that does not exist is a LatexError."""
    return CONVERTER.convert_with_local_state(latex.strip(), displaystyle=display)


def numbered(latex: str) -> tuple[str, str]:
    """Return a displayed formula without its number, and the number, empty if it has none."""
    found = TAG.search(latex)
    return TAG.sub("", latex), found[1] if found else ""


def write(translator: HTML5Translator, node: nodes.Element, latex: str, *, display: bool) -> None:
    """Append a formula to a page, as it stands and with a warning if it cannot be converted."""
    try:
        translator.body.append(mathml(latex, display=display))
    except LatexError as error:
        getLogger(__name__).warning("formula %r: %s", latex, error, location=node)
        translator.body.append(f"<code>{escape(latex)}</code>")


def visit_math(translator: HTML5Translator, node: nodes.math) -> None:
    """Write a formula within a line, which does not break between the formula and punctuation after it."""
    write(translator, node, node.astext(), display=False)
    following = node.next_node(nodes.Text, descend=False, siblings=True)
    if following is not None and following.astext()[:1] in tuple(",.;:)"):
        translator.body.append(WORD_JOINER)
    raise nodes.SkipNode


def visit_math_block(translator: HTML5Translator, node: nodes.math_block) -> None:
    """Write a displayed formula in a box that scrolls if it is narrower, and its number beside it."""
    latex, number = numbered(node.astext())
    anchor = f' id="equation-{escape(number)}"' if number else ""
    translator.body.append(f'<div class="formula"{anchor}><div tabindex="0">')
    write(translator, node, latex, display=True)
    translator.body.append("</div>" + (f"<span>({escape(number)})</span>" if number else "") + "</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the renderer ``mathml``."""
    app.add_html_math_renderer("mathml", (visit_math, None), (visit_math_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
