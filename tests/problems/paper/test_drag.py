"""Decays under quadratic laws and the law for all modes: their tables and their numbers."""

import json
import math

import pytest

from tests.problems.conftest import STRIP, column, run_in

pytestmark = pytest.mark.slow  # all tests need the study

BEAM = f"{STRIP}elements = 20\n"
LAWS = """
[[laws]]
name = "linear"
terms = [{law = "quadratic", eta1 = 2.0}]
[[laws]]
name = "drag"
terms = [{law = "quadratic", eta2 = 1.0}]
[[laws]]
name = "modal"
terms = [{law = "modal", ratios = [0.01]}]
"""
EFFECTS = """
[[parts]]
kind = "paper"
name = "eta_effects"
script = "eta_effects"
laws = ["linear", "drag"]
frequency = 2.0
duration = 5.0
inputs.frequencies = [2.0, 4.0]
inputs.words = [["rapid decay", "independent", "controllable"], ["rapid decay", "dependent", "uncontrollable"]]
"""
CHANGE = """
[[parts]]
kind = "paper"
name = "ratio_change"
script = "ratio_change"
laws = ["linear", "drag"]
frequency = 3.0
duration = 3.0
"""
DECAYS = """
[[parts]]
kind = "decays"
law = "quadratic"
duration = 2.0
records = [
    {synthetic = {frequency = 1.85, eta1 = 0.15, eta2 = 0.11, amplitude = 0.076}},
    {synthetic = {frequency = 10.19, eta1 = 0.31, eta2 = 0.06, amplitude = 0.0149}},
]
"""
COMBINED = """
[[parts]]
kind = "paper"
name = "combined_law"
script = "combined_law"
decays = "decays"
laws = ["modal"]
inputs.amplitudes = [0.076, 0.0149]
inputs.air = {density = 1.2, density_std = 0.03}
inputs.printed_eta2 = [0.11, 0.06]
"""


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    return run_in(tmp_path_factory.mktemp("study"), BEAM + LAWS + EFFECTS + CHANGE + DECAYS + COMBINED)


def shown(report, name):
    (part,) = (part for part in report.parts if part.name == name)
    return part


def test_decays_under_eta1_take_the_same_time_at_every_frequency_on_the_beam_and_by_formula(report):
    times, words, left = shown(report, "eta_effects").tables
    assert column(times, "frequency") == [2.0, 4.0] * 2
    linear = column(times, "time to 10 %, beam")[:2]
    assert linear == pytest.approx([math.log(10)] * 2, rel=0.01)  # exp(-eta1 t/2)
    drag = column(left, "after 5 s, beam")[2:]
    exact = [76 / (1 + 8 * math.pi * f * 0.076 * 5 / (3 * math.pi)) for f in (2.0, 4.0)]  # Eq. (27), eta1 = 0
    assert drag == pytest.approx(exact, rel=0.01)
    assert column(words, "residual motion") == ["controllable", "uncontrollable"]
    assert column(words, "as in the printed") == ["yes", "no"]


def test_the_parts_draw_their_figures_and_write_their_numbers(report):
    names = ("eta_effects", "ratio_change", "decays", "combined_law")
    assert [len(shown(report, name).figures) for name in names] == [4, 1, 2, 2]
    numbers = json.loads((report.page.parent / "results.json").read_text())
    assert numbers["eta_effects"]["characteristics"][0]["frequency"] == "independent"
    assert numbers["eta_effects"]["decays"][0]["amplitude_m"][0] == pytest.approx(0.076 * math.exp(-5), rel=0.01)
    assert numbers["ratio_change"]["ratios"][1]["crosses_the_first_law_at_s"] is None
    assert numbers["decays"][0]["unbounded"]["eta1"] == pytest.approx(numbers["decays"][0]["eta1"], rel=1e-4)
    assert numbers["combined_law"]["law"]["degrees_of_freedom"] == 1


def test_damping_ratios_along_a_decay_stand_beside_the_formula(report):
    _, ratios = shown(report, "ratio_change").tables
    first, second, *_ = ratios.rows
    omega = 6 * math.pi
    assert first[1] == pytest.approx(100 / omega, rel=0.02)  # eta1/(2 omega)
    assert second[2] > 1.5 * second[4]  # falls with the amplitude


def test_the_drag_of_each_mode_has_errors_and_the_printed_eta2_its_coefficient(report):
    part = shown(report, "combined_law")
    law, drag = part.tables
    assert column(drag, "Cd of η2 in the printed") == pytest.approx([0.990, 0.540], abs=1e-3)
    value, error = column(drag, "Cd, true shape")[0], drag.errors["Cd, true shape, 1"][0]
    assert error > 0.03 / 1.2 * value  # error of the air density at least
    assert column(law, "value")[-1] == pytest.approx(value, rel=0.2)
    assert all("synthetic" in figure.caption and "SYNTHETIC" in figure.svg for figure in part.figures)
