"""Simulated experiments: their numbers agree with each other and with the laws."""

import math

import pytest

from ancf_casadi import InputError
from problems.study.reading import read_study
from problems.study.study import StudyReport
from tests.problems.conftest import BEAM, column, run_in

pytestmark = pytest.mark.slow  # all tests need the study

LAWS = """
[[laws]]
name = "modal"
terms = [{law = "modal", ratios = [0.02, 0.01]}]

[[laws]]
name = "drag"
title = "air drag"
terms = [{law = "quadratic", eta1 = 0.2, eta2 = 2.0}]
"""
PARTS = """
[[steps]]
kind = "transients"
laws = ["modal", "drag"]
runs = [
    {mode = 2, amplitude = 0.004, stop = 5.0, measured_ratio = 0.01, laws = ["modal"]},
    {mode = 1, amplitude = 0.02, stop = 60.0},
    {mode = 1, amplitude = 0.01, stop = 60.0, laws = ["drag"]},
]
printed = {modal = [1.0, 2.0, nan]}
"""


@pytest.fixture(scope="module")
def report(tmp_path_factory) -> StudyReport:
    return run_in(tmp_path_factory.mktemp("experiments"), BEAM + LAWS + PARTS, quick=True)


def test_ratios_stand_under_their_laws_in_the_order_of_the_runs(report):
    """Laws that are not simulated in a run have no ratio there."""
    found = report.results["transients"]
    assert found["experiment"] == [0.01, None, None]
    assert found["modal"][:2] == pytest.approx([0.01, 0.02], rel=0.02)
    assert found["modal"][2] is None
    assert found["drag"][0] is None
    assert found["drag"][1] > found["drag"][2] > 0.2 / (4 * math.pi * 1.9)  # falls with the amplitude
    assert [(row["mode"], row["law"]) for row in found["runs"]] == [
        (2, "modal"), (1, "modal"), (1, "drag"), (1, "drag"),
    ]  # fmt: skip
    for row in found["runs"]:
        assert row["damping_ratio"] == pytest.approx(row["expected_damping_ratio"], rel=0.05)


def test_the_table_is_in_ascending_order_of_the_modes(report):
    """With the printed number of the same run beside each ratio, and none where none is printed."""
    ratios, amplitudes = report.steps[0].tables
    assert column(ratios, "mode") == column(amplitudes, "mode") == [1, 1, 1, 2]
    assert column(ratios, "law") == ["modal", "air drag", "air drag", "modal"]
    assert ratios.printed == {"simulated, %": [2.0, None, None, 1.0]}
    assert column(ratios, "simulated")[3] == pytest.approx(1.0, rel=0.02)


def test_a_synthetic_measurement_says_so(report):
    figures = report.steps[0].figures
    assert ["synthetic" in figure.svg for figure in figures[:3]] == [True, False, False]
    assert "synthetic" in figures[0].caption


@pytest.mark.parametrize("name", ["experiment", "runs"])
def test_a_law_cannot_take_the_name_of_another_key(study_file, name):
    text = (LAWS + PARTS).replace('"drag"', f'"{name}"')
    with pytest.raises(InputError, match=f"transients: the name {name} is taken in results.json"):
        read_study(study_file(BEAM, text))
