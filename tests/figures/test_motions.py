"""Figures show their data with the right labels, and give the same bytes each time."""

import sys
from subprocess import run

import numpy as np
import pytest

from ancf_casadi import Beam, HarmonicBase, Model, PointMass, Trajectory, simulate
from ancf_casadi.exceptions import InputError
from ancf_casadi.figures.beams import match_figure
from ancf_casadi.figures.files import figure_bytes


@pytest.fixture(scope="module")
def motion() -> Trajectory:
    beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9, elements=3)
    base = HarmonicBase(amplitude=2e-3, frequency=2.0)
    return simulate(Model(beam), duration=0.2, base=base, sample_rate=200.0)


def test_a_motion_figure_shows_both_directions_of_the_tip_relative_to_the_clamp_and_shapes_of_the_beam(motion):
    figure = motion.figure()
    horizontal, vertical, in_plane = figure.axes
    assert (horizontal.get_ylabel(), vertical.get_ylabel()) == ("horizontal, mm", "vertical, mm")
    assert vertical.get_xlabel() == "time, s"
    assert (in_plane.get_xlabel(), in_plane.get_ylabel()) == ("horizontal position x, mm", "vertical position y, mm")
    titles = [part.get_suptitle() for part in figure.subfigs]
    assert titles[0] == "displacement of the tip relative to the clamp"
    assert in_plane.get_title() == "shape of the beam at 12 instants"
    relative = motion.tip - motion.base
    for axes, component in zip((horizontal, vertical), relative.T, strict=True):
        (line,) = axes.lines
        assert np.asarray(line.get_ydata()) == pytest.approx(1e3 * (component - component[0]))


def test_the_shapes_of_a_motion_figure_tell_start_and_end_without_colour(motion):
    *_, in_plane = motion.figure().axes
    first, *between, last, clamp = in_plane.lines
    assert (first.get_xdata()[0], first.get_ydata()[0]) == pytest.approx((0.0, 0.0))
    assert (last.get_xdata()[-1], last.get_ydata()[-1]) == pytest.approx(1e3 * motion.tip[-1], abs=1e-6)
    assert (clamp.get_xdata()[0], clamp.get_ydata()[0]) == pytest.approx(1e3 * motion.base[-1])
    assert (first.get_linestyle(), last.get_linestyle()) == ("--", "-")
    assert last.get_linewidth() > 2 * max(line.get_linewidth() for line in between)
    assert [text.get_text() for text in in_plane.figure.legends[0].get_texts()] == ["at 0 s", "at 0.2 s"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("suffix", "begins"), [(".png", b"\x89PNG"), (".svg", b"<?xml"), (".pdf", b"%PDF-"), (".PDF", b"%PDF-")]
)
def test_the_suffix_names_the_format_and_the_bytes_are_the_same_each_time(motion, suffix, begins):
    first, second = (figure_bytes(motion.figure(), suffix) for _ in range(2))
    assert first.startswith(begins)
    assert first == second


@pytest.mark.parametrize("suffix", ["", ".jpg", "png"])
def test_another_format_is_refused(motion, suffix):
    with pytest.raises(InputError, match=r"figure: must end in \.png, \.svg, \.pdf"):
        figure_bytes(motion.figure(), suffix)


@pytest.mark.slow
def test_drawing_needs_no_display_and_no_global_state():
    """Figures are drawn without pyplot, which would select a backend and keep the figures alive."""
    code = (
        "import sys, ancf_casadi.figures.motions; from problems.study.drawing import new_figure; new_figure(2.0); "
        "print('matplotlib.pyplot' in sys.modules)"
    )
    done = run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == "False\n"


def test_properties_are_drawn_as_changes_within_their_ranges(paper_beam):
    """Over the elements, which are not equal where a node is at a mass."""
    given = paper_beam(4, attachments=(PointMass(0.2, mass=1e-3),))
    found = given.with_(thickness=tuple(0.5e-3 * np.array([1.02, 0.97, 1.0, 1.05])), density=8400.0)
    ranges = {"density": np.tile([-0.1, 0.1], (4, 1)), "thickness": np.array([[-0.05, 0.06]] * 4)}
    frequencies = np.array([1.0, 2.0])
    _, thickness, density = match_figure(frequencies, frequencies, frequencies, given, found, ranges).axes
    assert (thickness.get_ylabel(), density.get_ylabel()) == ("thickness, %", "density, %")
    (steps,) = [patch for patch in thickness.patches if hasattr(patch, "get_data")]
    assert steps.get_data().values == pytest.approx([2.0, -3.0, 0.0, 5.0])
    assert steps.get_data().edges == pytest.approx([0.0, 100.0, 200.0, 350.0, 500.0])
    low, high = thickness.collections[0].get_datalim(thickness.transData).intervaly
    assert (low, high) == pytest.approx((-5.0, 6.0))
