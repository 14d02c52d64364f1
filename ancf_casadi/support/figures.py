"""Colours, dashes and texts of figures.

Records are black, results computed from them green; both keep their contrast in grey.  The colours of ``SERIES`` are
distinct for the colour-blind (M. Okabe, K. Ito, 2008), on light and on dark pages; in grey, dashes and markers
distinguish them.  ``si_prefix`` chooses the unit of an axis.

Matplotlib reads text between two $ as a formula, and fails if the formula is invalid.  Names of columns and files, and
titles, are no formulas; ``literal_text`` shows them literally.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from importlib import import_module
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure
    from matplotlib.figure import SubFigure
    from matplotlib.text import Text
else:
    Axes = Figure = Any  # for annotations; matplotlib is slow to import

MEASURED = "#222222"
COMPUTED = "#1b7f5c"

SERIES: tuple[tuple[str, object, str], ...] = (  # colour, dash, marker
    ("#009e73", "-", "o"),
    ("#d55e00", (0, (5, 2)), "s"),
    ("#3a7fc4", (0, (1, 1.2)), "^"),
    ("#b565a7", (0, (6, 1.5, 1, 1.5)), "D"),
    ("#b8860b", (0, (3, 1, 1, 1, 1, 1)), "v"),
    ("#777777", (0, (8, 2)), "P"),
)

REFERENCE: dict[str, Any] = {"color": MEASURED, "ls": ":", "lw": 0.8}  # line with which others are compared
CURVE: dict[str, Any] = {"color": COMPUTED, "lw": 1.0}
POINTS: dict[str, Any] = {"fmt": "o", "ms": 4.0, "lw": 1.0}  # with bars of their errors
BAND: dict[str, Any] = {"alpha": 0.2, "lw": 0.0}
GRID: dict[str, Any] = {"alpha": 0.3}
LEGEND: dict[str, Any] = {"frameon": False, "fontsize": "small"}
LEGEND_ABOVE: dict[str, Any] = {**LEGEND, "loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "ncols": 2}

DOTS_PER_INCH = 130
PAGE_WIDTH = 5.2  # inches, of a figure whose letters stay readable on a narrow page
PREFIXES = {0: "", -3: "m", -6: "µ", -9: "n", -12: "p", 3: "k", 6: "M"}

P = ParamSpec("P")
Drawn = TypeVar("Drawn", bound="Figure | SubFigure")


def drawing(name: str) -> Callable[..., Figure]:
    """Return a drawing function by its module and name; this imports matplotlib, which is slow."""
    module, _, function = name.rpartition(".")
    draw: Callable[..., Figure] = getattr(import_module(module), function)
    return draw


def si_prefix(largest: float, unit: str) -> tuple[float, str]:
    """Return size and name of a unit with the SI prefix for which the largest value is between 1 and 1000."""
    if not (math.isfinite(largest) and largest > 0.0):
        return 1.0, unit
    power = 3 * math.floor(math.log10(largest) / 3)
    if not unit:
        return (1e-6, "1e-6") if power < 0 else (1.0, "")
    power = min(max(power, min(PREFIXES)), max(PREFIXES))
    return 10.0**power, PREFIXES[power] + unit.replace("^2", "²")


def plain_log_ticks(axes: Axes, axis: str) -> None:
    """Label a logarithmic axis with plain numbers: at 1, 2 and 5 times the powers of ten, closer on a short axis.

    Beyond three powers of ten, only the powers of ten have labels, because others would touch.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

    ticks = axes.xaxis if axis == "x" else axes.yaxis
    low, high = axes.get_xlim() if axis == "x" else axes.get_ylim()
    is_short = high < 8.0 * low  # ratio of the ends of a logarithmic axis below which its labels are closer
    multiples = (1.0, 2.0, 5.0) if high < 1e3 * low else (1.0,)
    ticks.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]) if is_short else LogLocator(subs=multiples))
    ticks.set_minor_locator(NullLocator())
    ticks.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ticks.set_minor_formatter(NullFormatter())
    axes.set(**{f"{axis}lim": (low, high)})


def literal_text(draw: Callable[P, Drawn]) -> Callable[P, Drawn]:
    """Return a function that draws the same figure with literal texts, in which a $ does not start a formula."""

    @functools.wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> Drawn:
        from matplotlib.ticker import FixedFormatter, FuncFormatter  # slow to import

        figure = draw(*args, **kwargs)
        for text in _texts(figure):
            text.set_text(_drawable(text.get_text()))
            if "$" in text.get_text():
                text.set_parse_math(False)
        for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
            names = axis.get_major_formatter()
            is_literal = isinstance(names, FuncFormatter) and getattr(names.func, "func", None) is _literal_name
            if isinstance(names, FixedFormatter | FuncFormatter) and not is_literal:
                axis.set_major_formatter(FuncFormatter(functools.partial(_literal_name, names)))
        return figure

    return drawn


def _texts(artist: Artist) -> Iterator[Text]:
    """Yield the texts in an artist without annotations and tick labels, which a search would create."""
    from matplotlib.axis import Axis
    from matplotlib.text import Annotation, Text

    if isinstance(artist, Axis):
        yield artist.label
    elif isinstance(artist, Text):
        if not isinstance(artist, Annotation):
            yield artist
    else:
        for child in artist.get_children():
            yield from _texts(child)


def _literal_name(names: Callable[[float, int | None], str], value: float, position: int | None) -> str:
    return _drawable(names(value, position)).replace("$", r"\$")


def _drawable(text: str) -> str:
    """Return text without control characters and lone surrogates, for which fonts have no glyph."""
    return "".join(c if c.isprintable() or c == "\n" else " " if c.isspace() else "\ufffd" for c in text)
