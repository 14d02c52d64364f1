"""Planned comparisons of laws against a scan of the wrong law."""

import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    InputError,
    Model,
    QuadraticDamping,
    RayleighDamping,
    Sensor,
    simulate,
    static_equilibrium,
)
from ancf_casadi.estimation.criteria import Expectation
from problems import PlannedRecord, plan_comparison
from problems.planning import comparison

MODEL = Model(Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9, elements=2))
START = static_equilibrium(MODEL, tip_force=(5e-3, 0.0))
LAWS = [RayleighDamping(0.5), QuadraticDamping(eta2=2.0)]


def release(std):
    return PlannedRecord.motion(Sensor(), duration=0.6, sample_rate=30.0, std=std, start=START)


@pytest.mark.slow
def test_the_expected_difference_is_what_the_best_wrong_law_misses(monkeypatch):
    std, missed = 1e-5, []

    def seen(fits, terms, change, unit, growth):
        missed.append(np.sum((change / unit) ** 2))
        return Expectation(0.0, 1.0)

    monkeypatch.setattr(comparison, "expectation", seen)
    planned = plan_comparison(MODEL, {"release": release(std)}, LAWS)
    assert list(planned.expected) == [("release", 0, 1), ("release", 1, 0)]

    def tip(law):
        run = simulate(MODEL, damping=law, start=START, duration=0.6, sample_rate=30.0, tolerance=1e-8)
        return run.tip[:, 0] - run.tip[:, 0].mean()  # the origin of a displacement is free

    exact, middle = tip(LAWS[1]), 0.5
    for width in (0.4, 0.04):
        alphas = middle + width * np.array([-1.0, 0.0, 1.0])
        scan = [np.sum((tip(RayleighDamping(alpha)) - exact) ** 2) / std**2 for alpha in alphas]
        parabola = np.polynomial.Polynomial.fit(alphas, scan, 2)
        (middle,) = parabola.deriv().roots()
    assert missed[1] == pytest.approx(parabola(middle), rel=0.02)


def test_a_single_law_and_unknown_candidates_are_refused():
    candidates = {"release": release(1e-4)}
    with pytest.raises(InputError, match="laws: needs two laws at least"):
        plan_comparison(MODEL, candidates, LAWS[:1])
    with pytest.raises(InputError, match="counts: must be"):
        plan_comparison(MODEL, candidates, LAWS, counts={"swing": 1})
    for unusable, message in (
        ({1: 2}, "candidates: must be a text, got 1"),
        ({}, "candidates: must hold at least one"),
    ):
        with pytest.raises(InputError, match=message):
            plan_comparison(MODEL, unusable, LAWS, counts={"swing": 1})
