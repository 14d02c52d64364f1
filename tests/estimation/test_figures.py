"""Figures of repeated fits show plain numbers."""

import numpy as np

from ancf_casadi.estimation.figures import scatter_figure


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
