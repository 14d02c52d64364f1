"""Every result has warnings, standard errors, a report, JSON and a figure, of the same types."""

import json
from collections.abc import Mapping
from dataclasses import fields

import numpy as np
import pytest

from ancf_casadi import Beam
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.result import Result
from ancf_casadi.estimation.solver.least_squares import least_squares
from ancf_casadi.estimation.solver.unknown import Unknown
from ancf_casadi.plot import png
from problems import (
    DecayFit,
    FrequencyMatch,
    Global,
    LawComparison,
    MeasuredModes,
    MonteCarlo,
    MotionPrediction,
    RayleighFit,
    TransientFit,
    compare_decay_laws,
    fit_decay,
    fit_rayleigh,
    match_frequencies,
    monte_carlo,
)

TIME = np.arange(0.0, 4.0, 0.02)
RECORD = 0.05 * np.exp(-0.2 * TIME) * np.cos(12.0 * TIME) + 1e-3 * np.random.default_rng(1).standard_normal(len(TIME))
BEAM = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8e3, elastic_modulus=210e9, elements=4)
UNKNOWNS = (Global("thickness"), Global("elastic_modulus"))

CLASSES = [Fit, DecayFit, RayleighFit, MonteCarlo, LawComparison, TransientFit, MotionPrediction, FrequencyMatch]
MAKERS = {
    Fit: lambda: least_squares(lambda a: a * TIME - RECORD, [Unknown("a", 0.1, unit="m/s")]),
    DecayFit: lambda: fit_decay(TIME, RECORD),
    RayleighFit: lambda: fit_rayleigh((1.0, 5.0, 9.0), (0.01, 0.02, 0.04), ratio_std=0.001),
    MonteCarlo: lambda: monte_carlo(fit_decay(TIME, RECORD), runs=3),
    LawComparison: lambda: compare_decay_laws(TIME, RECORD),
    FrequencyMatch: lambda: match_frequencies(BEAM, targets=MeasuredModes((1.9, 10.4), 0.01), unknowns=UNKNOWNS),
}


@pytest.mark.parametrize("kind", CLASSES)
def test_warnings_and_standard_errors_are_attributes_and_the_rest_are_methods(kind):
    attributes = {field.name for field in fields(kind)}
    for name in ("warnings", "standard_errors"):
        assert name in attributes or not callable(getattr(kind, name))
    for name in ("report", "to_dict", "figure"):
        assert callable(getattr(kind, name))


@pytest.mark.parametrize("kind", [kind for kind in CLASSES if kind in MAKERS])
def test_a_result_has_the_common_interface(kind):
    result = MAKERS[kind]()
    assert type(result) is kind and isinstance(result, Result)
    assert isinstance(result.warnings, tuple) and all(isinstance(warning, str) for warning in result.warnings)
    assert isinstance(result.standard_errors, Mapping) and result.standard_errors
    assert all(isinstance(name, str) and isinstance(error, float) for name, error in result.standard_errors.items())
    assert all(warning in result.report() for warning in result.warnings)
    json.dumps(result.to_dict(), allow_nan=False)
    assert png(result.figure()).startswith(b"\x89PNG")
