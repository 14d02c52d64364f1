"""Figures of repeated fits show plain numbers."""

from types import SimpleNamespace

import numpy as np
import pytest

from ancf_casadi.estimation.prediction import PredictedChannel
from ancf_casadi.figures.fits import channels_figure, scatter_figure
from ancf_casadi.figures.responses import Curve, bode_figure


def test_the_axis_of_a_narrow_scatter_shows_the_values_and_no_offset():
    samples = 1.846 + 1e-6 * np.random.default_rng(0).standard_normal((50, 1))
    figure = scatter_figure(["frequency, Hz"], samples, np.array([1.846]), [1e-6])
    figure.draw_without_rendering()
    (axes,) = figure.axes
    low, high = axes.get_xlim()
    shown = [float(label.get_text()) for label in axes.get_xticklabels() if low <= label.get_position()[0] <= high]
    assert len(shown) >= 2
    assert all(abs(value - 1.846) < 1e-5 for value in shown)
    assert axes.xaxis.get_offset_text().get_text() == ""


def channels():
    """Three channels of one diagram, which fill it."""
    time, names = np.linspace(0.0, 1.0, 500), ("base", "middle", "tip")
    made = [
        PredictedChannel(name, "m", y, y, 0 * y, time, "time, s", 1e-3, diagram="position")
        for name, y in ((name, np.sin(60.0 * time + k)) for k, name in enumerate(names))
    ]
    return channels_figure({"": SimpleNamespace(channels=made)})


def functions():
    f = np.linspace(1.0, 50.0, 300)
    curves = [Curve(name, f, 1 / (400.0 - f**2 + 2j * f)) for name in ("measured", "fitted", "difference")]
    return bode_figure([curves] * 3, "receptance, m/N", ["0.1 m", "0.3 m", "0.5 m"])


@pytest.mark.parametrize("draw", [channels, functions])
def test_a_legend_of_three_channels_stands_beside_the_data(draw):
    figure = draw()
    figure.draw_without_rendering()
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes if axes.get_legend())]
    assert legends
    for legend in legends:
        extent = legend.get_window_extent()
        assert extent.x1 <= figure.bbox.x1 and extent.y0 >= figure.bbox.y0
        assert not any(extent.overlaps(axes.get_window_extent()) for axes in figure.axes)
