"""Decays under quadratic laws and the law for all modes: their tables and their numbers."""

import math

import pytest

from problems.paper import combined_law as combined
from problems.paper import tables_05_06
from problems.paper.air import Air
from problems.paper.effects import QuadraticLaw
from problems.study.compute import Compute
from tests.problems.conftest import column

pytestmark = pytest.mark.slow  # all tests need simulations or fits


@pytest.fixture
def effects(monkeypatch):
    """The effect of eta1 and eta2 at two frequencies."""
    laws = (QuadraticLaw("linear", "linear", 2.0, 0.0), QuadraticLaw("drag", "drag", 0.0, 1.0))
    printed = (("rapid decay", "independent", "controllable"), ("rapid decay", "dependent", "uncontrollable"))
    inputs = {"LAWS": laws, "PRINTED": printed, "FREQUENCY": 2.0, "FREQUENCIES": (2.0, 4.0), "DURATION": 5.0}
    for name, value in inputs.items():
        monkeypatch.setattr(tables_05_06, name, value)
    return tables_05_06.eta_effects.finding(Compute(formats=()), {})


def test_decays_under_eta1_take_the_same_time_at_every_frequency_on_the_beam_and_by_formula(effects):
    times, words, amplitudes = effects.tables
    assert column(times, "frequency") == [2.0, 4.0] * 2
    linear = column(times, "time to 10 %, beam")[:2]
    assert linear == pytest.approx([math.log(10)] * 2, rel=0.01)  # exp(-eta1 t/2)
    drag = column(amplitudes, "after 5 s, beam")[2:]
    exact = [76 / (1 + 8 * math.pi * f * 0.076 * 5 / (3 * math.pi)) for f in (2.0, 4.0)]  # Eq. (27), eta1 = 0
    assert drag == pytest.approx(exact, rel=0.01)
    assert column(words, "residual motion") == ["controllable", "uncontrollable"]
    assert column(words, "as in the paper") == ["yes", "no"]
    assert effects.data["characteristics"][0]["frequency"] == "independent"
    assert effects.data["decays"][0]["amplitude_m"][0] == pytest.approx(0.076 * math.exp(-5), rel=0.01)
    assert len(effects.figures) == 4


def test_the_drag_of_each_mode_has_errors_and_the_printed_eta2_its_coefficient(monkeypatch):
    monkeypatch.setattr(combined, "AIR", Air(density=1.2, density_std=0.03))
    finding = combined.combined_law.finding(Compute(), {})
    law, drag = finding.tables
    assert column(drag, "Cd of η2 in the paper")[:2] == pytest.approx([0.990, 0.540], abs=1e-3)
    value, error = column(drag, "Cd, true shape")[0], drag.errors["Cd, true shape, 1"][0]
    assert error > 0.03 / 1.2 * value  # error of the air density at least
    assert column(law, "value")[-1] == pytest.approx(value, rel=0.2)
    assert all("synthetic" in figure.caption and "SYNTHETIC" in figure.svg for figure in finding.figures)
    assert finding.data["law"]["degrees_of_freedom"] == 4
