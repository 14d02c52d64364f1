"""Simulated experiments of users and of the paper: their numbers agree with each other and with the laws."""

import math

import numpy as np
import pytest

from ancf_casadi import InputError
from ancf_casadi.mechanics.spec import BeamSpec
from problems.study.kinds.experiment import EXPERIMENT_STEPS, QUICK_DRIVING, QUICK_STEPS
from problems.study.part import Finding
from problems.study.study import StudyReport
from tests.problems.conftest import BEAM, column, run_in, study_in

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
[[parts]]
kind = "transients"
laws = ["modal", "drag"]
runs = [
    {mode = 2, amplitude = 0.004, stop = 5.0, measured_ratio = 0.01, laws = ["modal"]},
    {mode = 1, amplitude = 0.02, stop = 60.0},
    {mode = 1, amplitude = 0.01, stop = 60.0, laws = ["drag"]},
]
printed = {modal = [1.0, 2.0, nan]}

[[parts]]
kind = "paper"
name = "amplitudes"
script = "amplitudes"
laws = ["modal", "drag"]
runs = [{mode = 1, amplitude = 0.02, stop = 60.0}]

[[parts]]
kind = "paper"
name = "shapes"
script = "shapes"
laws = ["modal"]
runs = [{mode = 1, amplitude = 0.02, stop = 60.0}]

[[parts]]
kind = "paper"
name = "integrators"
script = "integrators"
laws = ["modal"]
runs = [{mode = 1, amplitude = 0.02, stop = 3.0}]
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
    ratios, amplitudes = report.parts[0].tables
    assert column(ratios, "mode") == column(amplitudes, "mode") == [1, 1, 1, 2]
    assert column(ratios, "law") == ["modal", "air drag", "air drag", "modal"]
    assert ratios.printed == {"simulated, %": [2.0, None, None, 1.0]}
    assert column(ratios, "simulated")[3] == pytest.approx(1.0, rel=0.02)


def test_a_synthetic_measurement_says_so(report):
    figures = report.parts[0].figures
    assert ["synthetic" in figure.svg for figure in figures[:3]] == [True, False, False]
    assert "synthetic" in figures[0].caption


def test_the_curve_of_a_decay_is_that_of_the_law(report):
    modal, drag = report.results["amplitudes"]
    assert modal["damping_ratio"] == pytest.approx([0.02] * len(modal["damping_ratio"]), rel=0.03)
    expected = 0.2 / (4 * math.pi * np.array(drag["frequency_hz"])) + 8.0 * np.array(drag["amplitude_m"]) / (
        3 * math.pi
    )
    assert drag["damping_ratio"] == pytest.approx(expected, rel=0.05)
    assert len(drag["amplitude_m"]) > 2


def test_the_shapes_span_the_motion(report):
    (row,) = report.results["shapes"]
    reached = report.results["transients"]["runs"][1]["reached_amplitude_m"]
    assert row["tip_across_m"] == pytest.approx(2 * reached, rel=0.1)
    assert 0.0 < row["tip_along_m"] < 0.1 * row["tip_across_m"]


def test_both_integrators_agree(report):
    (row,) = report.results["integrators"]
    assert row["idas"] == pytest.approx(row["radau"], rel=0.02)
    assert row["largest_difference_m"] < 0.01 * 0.02


def test_equal_experiments_run_once(report):
    """The same excitation in three parts: the second part takes its results from the first."""
    by_name = {part.name: part for part in report.parts}
    assert [by_name[name].tasks for name in ("transients", "amplitudes", "shapes")] == [4, 2, 1]
    files = list((report.page.parent / "steps").glob("*.msgpack"))
    assert len(files) == 4 + 2 + len(report.parts)


def test_a_quick_look_drives_for_less_time(study_file):
    whole = study_in(study_file(BEAM, LAWS, PARTS))
    for study, driving, steps in ((whole, 1.0, EXPERIMENT_STEPS), (whole.shortened(), QUICK_DRIVING, QUICK_STEPS)):
        _, _, run, *_ = study.parts[0].tasks({"": Finding(None, beam=BeamSpec.of(study.beam))})[0].inputs
        assert run.stop == pytest.approx(5.0 * driving)
        assert run.steps_per_period == steps
    assert QUICK_DRIVING < 0.2
    assert QUICK_STEPS < EXPERIMENT_STEPS


def test_a_quick_look_has_no_bitmaps(report):
    folder = report.page.parent / "figures"
    assert {path.suffix for path in folder.iterdir()} == {".svg"}


@pytest.mark.parametrize("name", ["experiment", "runs"])
def test_a_law_cannot_take_the_name_of_another_key(study_file, name):
    text = (LAWS + PARTS).replace('"drag"', f'"{name}"')
    with pytest.raises(InputError, match=f"transients: the name {name} is taken in results.json"):
        study_in(study_file(BEAM, text))
