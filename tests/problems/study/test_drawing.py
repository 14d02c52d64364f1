"""Figures of a document in the formats that are wanted, and turning points of vibrations."""

import numpy as np
import pytest
from scipy.signal import find_peaks

from problems.modal_damping.effects import turning_points
from problems.study.drawing import drawn, new_figure, only


@pytest.mark.parametrize("formats", [("svg", "png"), ("svg",), ()])
def test_a_figure_is_drawn_in_the_wanted_formats_alone(formats):
    """Nothing at all is drawn if none is wanted; afterwards, all are again."""
    calls = []

    def draw():
        calls.append(1)
        return new_figure(1.0)[0]

    with only(formats):
        drawing = drawn("caption", draw)
    assert (drawing.caption, len(calls)) == ("caption", bool(formats))
    assert drawing.svg.startswith("<?xml") == ("svg" in formats)
    assert drawing.png.startswith(b"\x89PNG") == ("png" in formats)
    if not formats:
        assert all((drawn("caption", draw).svg, drawn("caption", draw).png))


def test_a_vibration_turns_twice_per_period():
    time = np.linspace(0.0, 3.0, 301)
    assert time[turning_points(np.sin(2 * np.pi * time))] == pytest.approx(np.arange(0.25, 3.0, 0.5))


def test_a_level_top_turns_in_its_middle_and_a_level_end_does_not():
    assert turning_points(np.array([0.0, 2.0, 2.0, 2.0, 1.0, -3.0, -3.0])).tolist() == [2]
    assert not len(turning_points(np.zeros(4))) and not len(turning_points(np.zeros(0)))


def test_any_samples_turn_where_the_peaks_of_scipy_are():
    rng = np.random.default_rng(0)
    for size in (*range(2, 40), 2000):
        samples = rng.integers(-4, 5, size).astype(float)
        assert turning_points(samples).tolist() == find_peaks(np.abs(samples))[0].tolist()
