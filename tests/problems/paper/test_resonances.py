"""Steady vibration under the excitation of simulated experiments."""

import numpy as np
import pytest

from problems.paper.steady_vibration import frequency_range, resonances
from problems.study.compute import Compute
from problems.study.kinds.experiment import RequestedRun
from problems.study.step import Finding, LawChoice

pytestmark = pytest.mark.slow  # all tests need the curves

MODAL = LawChoice("modal", ({"law": "modal", "ratios": (0.05, 0.02)},), "modal")
DRAG = LawChoice("drag", ({"law": "quadratic", "eta1": 1.2, "eta2": 2.0},), "air drag")


@pytest.fixture(scope="module")
def steady(paper_beam) -> Finding:
    run = RequestedRun(mode=1, amplitude=0.02, stop=340.0, laws=(MODAL, DRAG))
    return resonances(Compute(quick=True, formats=()), paper_beam(6), [run])


def test_a_long_experiment_ends_on_its_curve(steady):
    """After 10 s of excitation (a quick study drives for 3 % of the time), the vibration is steady."""
    for run in steady.data:
        frequency = np.array(run["curve"]["frequency_hz"])
        amplitude = np.array(run["amplitude_m"])
        order = np.argsort(frequency)
        steady = np.interp(run["drive_hz"], frequency[order], amplitude[order])
        assert run["reached_amplitude_m"] == pytest.approx(steady, rel=0.01)
        assert run["curve"]["peak_amplitude_m"] > 0.9 * steady


def test_the_curve_of_a_linear_law_has_its_damping_ratio(steady):
    """But for the share of the other modes in the motion of the tip, 1 % of it."""
    modal, drag = steady.data
    assert (modal["law"], drag["law"]) == ("modal", "drag")
    assert modal["curve"]["peak_damping_ratio"] == pytest.approx(0.05, rel=0.03)
    assert drag["curve"]["peak_damping_ratio"] > 1.2 / (4 * np.pi * 1.876)


def test_the_range_reaches_the_peak_of_a_mode_that_softens_and_ends_at_three_per_cent():
    """The peak at the amplitude of the steady vibration has four times the change of frequency of the decay."""
    run = {"law": "modal", "mode": 2, "natural_frequency_hz": 10.0, "expected_damping_ratio": 0.002, "stop_s": 1e3,
           "requested_amplitude_m": 0.02, "amplitude_m": 0.01, "frequency_hz": 9.99}  # fmt: skip
    first, last = frequency_range(run)
    assert first == pytest.approx(10.0 * 1.01)
    assert 9.8 < last < 10.0 * (1 - 4e-3 - 5 * 0.002)
    assert frequency_range({**run, "frequency_hz": 9.9})[1] == pytest.approx(9.7)
    assert frequency_range({**run, "frequency_hz": 10.01})[0] > 10.0 * (1 + 4e-3 + 5 * 0.002)
