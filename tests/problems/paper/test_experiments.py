"""Simulated experiments of the paper, seen in other ways than by their tables."""

import math

import numpy as np
import pytest

from problems.paper.against_amplitude import amplitude_curves
from problems.paper.integrators import compare_integrators
from problems.paper.shapes import deformed_shapes
from problems.study.compute import Compute, Store
from problems.study.kinds.experiment import RequestedRun
from problems.study.kinds.transients import transients_finding
from problems.study.step import LawChoice

pytestmark = pytest.mark.slow

MODAL = LawChoice("modal", ({"law": "modal", "ratios": (0.02, 0.01)},), "modal")
DRAG = LawChoice("drag", ({"law": "quadratic", "eta1": 0.2, "eta2": 2.0},), "air drag")
STORE = Store()


@pytest.fixture(scope="module")
def beam(paper_beam):
    return paper_beam(3)


def run(*laws, stop=60.0) -> RequestedRun:
    """Return an excitation of mode 1, shortened as in every quick look."""
    return RequestedRun(mode=1, amplitude=0.02, stop=stop, laws=laws)


def compute() -> Compute:
    """Return a quick look that shares its computations with the other tests."""
    return Compute(STORE, quick=True, formats=())


def test_the_curve_of_a_decay_is_that_of_the_law(beam):
    modal, drag = amplitude_curves(compute(), beam, [run(MODAL, DRAG)]).data
    assert modal["damping_ratio"] == pytest.approx([0.02] * len(modal["damping_ratio"]), rel=0.03)
    eta1_ratio = 0.2 / (4 * math.pi * np.array(drag["frequency_hz"]))
    expected = eta1_ratio + 8.0 * np.array(drag["amplitude_m"]) / (3 * math.pi)
    assert drag["damping_ratio"] == pytest.approx(expected, rel=0.05)
    assert len(drag["amplitude_m"]) > 2


def test_the_shapes_span_the_motion(beam):
    (row,) = deformed_shapes(compute(), beam, [run(MODAL)]).data
    (numbers,) = transients_finding(compute(), beam, [run(MODAL)]).data["runs"]
    assert row["tip_across_m"] == pytest.approx(2 * numbers["reached_amplitude_m"], rel=0.1)
    assert 0.0 < row["tip_along_m"] < 0.1 * row["tip_across_m"]


def test_both_integrators_agree(beam):
    (row,) = compare_integrators(compute(), beam, MODAL, run(stop=3.0).shorten()).data
    assert row["idas"] == pytest.approx(row["radau"], rel=0.02)
    assert row["largest_difference_m"] < 0.01 * 0.02


def test_equal_experiments_run_once(beam):
    """The same excitation in several steps: a later one takes its results from the first."""
    steps = [compute() for _ in range(3)]
    transients_finding(steps[0], beam, [run(MODAL, DRAG)])
    amplitude_curves(steps[1], beam, [run(MODAL, DRAG)])
    deformed_shapes(steps[2], beam, [run(MODAL)])
    assert [len(step.times) for step in steps] == [2, 2, 1]
    assert steps[0].times == steps[1].times
