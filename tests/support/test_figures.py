"""Names of columns, files, records and titles stand in figures as they were written."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from ancf_casadi.figures.files import figure_bytes
from ancf_casadi.figures.fits import criteria_figure, scatter_figure
from ancf_casadi.figures.records import record_figure, spectra_figure
from ancf_casadi.support.figures import literal_text, si_prefix

FORMULA = r"$\undefined$, $5"
TIME = np.arange(50) / 50
WAVE = np.sin(40 * TIME)


DRAWN = {
    "record": lambda name: record_figure(name, TIME, WAVE, name),
    "spectrum": lambda name: spectra_figure([(name, TIME, WAVE, (TIME, WAVE))], name),
    "laws": lambda name: criteria_figure([name, "other"], {"AICc": [1.0, 2.0], "BIC": [1.0, 2.0]}),
    "estimates": lambda name: scatter_figure([name], WAVE[:, None], [0.0], [1.0]),
}


NAMES = {"formula": FORMULA, "escaped": r"\$", "mixed": r"\$1 and $2", "control": "\udcff\x00\x1b[31m\t.csv"}


@pytest.mark.parametrize(
    ("kind", "drawn"),
    [*((kind, drawn) for kind in ("formula", "control") for drawn in DRAWN), ("escaped", "record"), ("mixed", "laws")],
)
def test_a_name_is_drawn_as_it_was_written(kind, drawn):
    """Halves of characters and control characters, which no font has, become a replacement character."""
    name = NAMES[kind]
    figure = DRAWN[drawn](name)
    assert figure_bytes(figure, ".png").startswith(b"\x89PNG")
    shown = name.replace("\udcff\x00\x1b", "\ufffd" * 3).replace("\t", " ")
    assert [label for label in labels(figure) if shown in label]


def labels(figure: Figure) -> list[str]:
    """Return the texts that a figure has drawn, without the signs that keep tick labels from being formulas."""
    found = [text for axes in figure.axes for text in (axes.title, axes.xaxis.label, axes.yaxis.label)]
    assert not any(text.get_parse_math() for text in found if "$" in text.get_text())
    ticks = [text.get_text().replace(r"\$", "$") for axes in figure.axes for text in axes.get_yticklabels()]
    return [*(text.get_text() for text in found), *ticks]


def test_powers_of_ten_and_formulas_that_are_added_later_remain_formulas():
    figure = literal_text(Figure)()
    above = figure.subplots()
    above.plot(TIME, WAVE)
    above.set(yscale="log", title=r"$\omega$")
    above.yaxis.set_major_formatter("$10^2$")
    figure.draw_without_rendering()
    assert above.title.get_parse_math() and all(text.get_parse_math() for text in above.get_yticklabels())


def test_a_figure_that_passes_twice_is_the_same():

    def draw():
        figure = Figure()
        figure.subplots().set_xticks([0.0, 1.0], ["a $b$", "c"])
        return figure

    labels = []
    for function in (literal_text(draw), literal_text(literal_text(draw))):
        axis = function().axes[0].xaxis
        labels.append([axis.get_major_formatter()(value, k) for k, value in enumerate((0.0, 1.0))])
    assert labels[0] == labels[1] == [r"a \$b\$", "c"]


@pytest.mark.parametrize(
    ("largest", "unit", "expected"),
    [
        (0.02, "m", (1e-3, "mm")),
        (3e-5, "m", (1e-6, "µm")),
        (12.0, "m/s^2", (1.0, "m/s²")),
        (4e-4, "", (1e-6, "1e-6")),
        (0.0, "m", (1.0, "m")),
        (1.0, "N", (1.0, "N")),
    ],
)
def test_a_value_is_between_1_and_1000_in_the_unit_with_its_prefix(largest, unit, expected):
    size, name = si_prefix(largest, unit)
    assert (pytest.approx(size), name) == expected
