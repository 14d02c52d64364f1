"""Colours, dashes and texts of figures.

Records are black, what is computed from them is green; both keep their contrast in grey.  The colours of ``SERIES`` can
be told apart by the colour-blind (M. Okabe, K. Ito, 2008), on light and on dark pages; in grey, the dashes and markers
tell them apart.

Matplotlib reads what stands between two $ as a formula, and fails on one that it does not know.  Names of columns and
files, and titles, are no formulas.  ``literal_text`` shows them as they were written.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, ParamSpec

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MEASURED = "#222222"
COMPUTED = "#1b7f5c"

SERIES: tuple[tuple[str, object, str], ...] = (  # colour, dash, marker
    ("#009e73", "-", "o"),
    ("#d55e00", (0, (5, 2)), "s"),
    ("#3a7fc4", (0, (1, 1.2)), "^"),
    ("#b565a7", (0, (6, 1.5, 1, 1.5)), "D"),
    ("#b8860b", (0, (3, 1, 1, 1, 1, 1)), "v"),
)

P = ParamSpec("P")


def literal_text(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Return a function that draws the same figure, with its texts as they are: a $ starts no formula.

    Annotations, and numbers beside axes, remain formulas.  So do texts that the caller adds to the figure.
    """

    @functools.wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> Figure:
        figure = draw(*args, **kwargs)
        _show_literally(figure)
        return figure

    return drawn


def _show_literally(figure: Figure) -> None:
    from matplotlib.axis import Axis, Tick  # slow to import
    from matplotlib.text import Annotation, Text
    from matplotlib.ticker import FixedFormatter, FuncFormatter

    axes = figure.findobj(Axis)
    numbers = {id(text) for tick in figure.findobj(Tick) for text in (tick.label1, tick.label2)}
    numbers |= {id(axis.get_offset_text()) for axis in axes}
    for text in figure.findobj(Text):
        if id(text) not in numbers and not isinstance(text, Annotation) and text.get_text():
            text.set_text(_drawable(text.get_text()))
            if "$" in text.get_text():
                text.set_parse_math(False)
    for axis in axes:
        names = axis.get_major_formatter()
        if isinstance(names, FixedFormatter | FuncFormatter):
            axis.set_major_formatter(FuncFormatter(functools.partial(_literal_name, names)))


def _literal_name(names: Callable[[float, int | None], str], value: float, position: int | None) -> str:
    return _drawable(names(value, position)).replace("$", r"\$")


def _drawable(text: str) -> str:
    """Return text without control characters and halves of characters, for which fonts have no glyph."""
    return "".join(c if c.isprintable() or c == "\n" else " " if c.isspace() else "\ufffd" for c in text)
