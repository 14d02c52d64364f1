"""Figures of a document in the formats that are wanted."""

import pytest

from problems.study.drawing import new_figure, render


@pytest.mark.parametrize("formats", [("svg", "png"), ("svg",), ()])
def test_a_figure_is_drawn_in_the_wanted_formats_alone(formats):
    """Nothing at all is drawn if none is wanted."""
    calls = []

    def draw():
        calls.append(1)
        return new_figure(1.0)[0]

    drawing = render("caption", draw, formats)
    assert (drawing.caption, len(calls)) == ("caption", bool(formats))
    assert drawing.svg.startswith("<?xml") == ("svg" in formats)
    assert drawing.png.startswith(b"\x89PNG") == ("png" in formats)
