"""Every result of a fit has the same attributes and methods, of the same types, and can be saved and loaded."""

import json
import math
import pickle

import numpy as np
import pytest

from ancf_casadi import Beam, InputError, Measurement, Model
from ancf_casadi.estimation.result import FitResult, LeastSquaresResult
from ancf_casadi.export import Identification
from problems import (
    FrequencyRecord,
    FrfRecord,
    Global,
    MeasuredModes,
    ResponseRecord,
    fit_beam,
    fit_decay,
    fit_decays,
    fit_frf,
    fit_mode,
    fit_modes,
    fit_rayleigh,
    load_fit,
    match_frequencies,
    monte_carlo,
)

TIME = np.arange(0.0, 4.0, 0.02)
BEAM = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8e3, elastic_modulus=210e9, elements=2)
LINES = np.linspace(1.0, 3.0, 201)


def swing(seed: int, *modes: tuple[float, float, float]) -> Measurement:
    """Return a record of modes (amplitude, decay rate, angular frequency) with noise."""
    y = sum(a * np.exp(-rate * TIME) * np.cos(ω * TIME) for a, rate, ω in modes)
    return Measurement(TIME, y + 1e-4 * np.random.default_rng(seed).standard_normal(len(TIME)))


def lines(seed: int) -> FrfRecord:
    """Return a receptance with noise."""
    noise = np.random.default_rng(seed).normal(0.0, 0.05, (2, len(LINES))).T @ [1, 1j]
    return FrfRecord(LINES, 1.0 / (2.0**2 - LINES**2 + 0.04j * LINES) + noise, "receptance")


def curve(seed: int) -> ResponseRecord:
    """Return the response of a mode of 2 Hz to a force, with noise of 1 %."""
    noise = 1 + 0.01 * np.random.default_rng(seed).standard_normal((2, 21)).T @ [1, 1j]
    f = np.linspace(1.9, 2.1, 21)
    return ResponseRecord(f, 0.01 * noise / (2.0**2 - f**2 + 0.08j * f), excitation_unit="N")


def frequencies(f: float) -> FrequencyRecord:
    """Return two frequencies of the beam."""
    return FrequencyRecord(Model(BEAM), [f, 5.674 * f], [0.001, 0.01])


ONE, TWO = (0.05, 0.2, 12.0), (0.02, 0.4, 60.0)
PAIR = (1.0, 5.0, 9.0)
CASES = {  # result of a fit, records for another fit, and a record to predict
    "decay": (lambda: fit_decay(swing(1, ONE)), swing(2, ONE), swing(3, ONE)),
    "decays": (lambda: fit_decays([swing(1, ONE), swing(2, ONE)]), [swing(3, ONE), swing(4, ONE)], swing(5, ONE)),
    "decay modes": (lambda: fit_modes(swing(1, ONE, TWO), modes=2), swing(2, ONE, TWO), swing(3, ONE, TWO)),
    "mode": (
        lambda: fit_mode([swing(1, (0.05, 0.25, 12.566)), curve(1)]),
        [swing(2, (0.05, 0.25, 12.566)), curve(2)],
        curve(3),
    ),
    "frequency response": (lambda: fit_frf(lines(1), frequencies=[2.0]), lines(2), lines(3)),
    "rayleigh": (
        lambda: fit_rayleigh(PAIR, (0.02, 0.021, 0.035), ratio_std=0.001),
        (PAIR, (0.019, 0.021, 0.035)),
        ((12.0,), (0.046,)),
    ),
    "frequency matching": (
        lambda: match_frequencies(
            BEAM, targets=MeasuredModes((1.9, 10.8), (0.01, 0.1)), unknowns=[Global("elastic_modulus")]
        ),
        MeasuredModes((1.91, 10.8), (0.01, 0.1)),
        (1.9, 10.8),
    ),
    "beam": (
        lambda: fit_beam(Model(BEAM), frequencies(1.9), unknowns=["elastic_modulus"]),
        frequencies(1.91),
        frequencies(1.89),
    ),
}


@pytest.fixture(scope="module", params=CASES)
def case(request):
    make, records, record = CASES[request.param]
    return request.param, make(), records, record


def test_estimates_have_units_errors_intervals_covariance_and_limits(case):
    kind, fit, *_ = case
    assert isinstance(fit, FitResult) and fit.kind == kind
    assert fit.estimates and all(type(value) is float for value in fit.estimates.values())
    intervals, wide = fit.intervals(), fit.intervals(0.99)
    assert list(fit.units) == list(fit.standard_errors) == list(intervals) == list(fit.estimates)
    for name, value in fit.estimates.items():
        (low, high), (lower, upper) = intervals[name], wide[name]
        assert lower < low < value < high < upper
    errors = np.array(list(fit.standard_errors.values()))
    np.testing.assert_allclose(np.sqrt(np.diag(fit.covariance)), errors, rtol=1e-9)
    np.testing.assert_allclose(np.diag(fit.correlations), 1.0)
    np.testing.assert_allclose(fit.correlations, fit.correlations.T, rtol=1e-9)
    assert fit.at_bound == () and isinstance(fit.agreements, tuple)
    assert isinstance(fit.warnings, tuple) and all(warning in fit.report() for warning in fit.warnings)
    with pytest.raises(InputError, match="level: must be between 0 and 1"):
        fit.intervals(1.0)


def test_a_profile_is_close_to_the_interval_to_first_order(case):
    _, fit, *_ = case
    name = next(iter(fit.estimates))
    low, high = fit.intervals()[name]
    if fit.agreements:  # two records may agree by chance, for which their interval allows
        low, high = (fit.estimates[name] + side * 1.96 * fit.standard_errors[name] for side in (-1.0, 1.0))
    assert fit.profile(name) == pytest.approx((low, high), abs=0.1 * (high - low))
    with pytest.raises(InputError, match="no_such: is not estimated by this fit; it has"):
        fit.profile("no_such")


def test_a_prediction_of_the_same_law_has_small_errors_and_no_warning(case):
    _, fit, _, record = case
    prediction = fit.predict(record)
    assert max(prediction.relative_errors.values()) < 0.2 and prediction.warnings == ()
    assert prediction.report() and json.dumps(prediction.to_dict(), allow_nan=False)
    prediction.figure().draw_without_rendering()


@pytest.mark.slow
def test_another_fit_has_the_settings_of_the_first(case):
    kind, fit, records, _ = case
    other = pickle.loads(pickle.dumps(fit)).refit(records)
    assert type(other) is type(fit) and other.kind == kind
    assert list(other.estimates) == list(fit.estimates) and other.estimates != fit.estimates
    assert other.refit(records).estimates == other.estimates
    fit.figure(other, labels=["one", "other"]).draw_without_rendering()


def test_the_scatter_of_synthetic_records_is_about_the_standard_error(case):
    _, fit, *_ = case
    study = monte_carlo(fit, runs=12, seed=1)
    assert study.names == tuple(fit.estimates) and not study.failures
    ratio = study.stds / np.array(list(fit.standard_errors.values()))
    assert ((ratio > 0.4) & (ratio < 2.0)).all()  # 12 runs: a standard deviation is known to 21 %
    if not isinstance(fit, LeastSquaresResult):
        with pytest.raises(InputError, match="method: finds no residuals to draw from in this FrequencyMatch"):
            monte_carlo(fit, runs=2, method="bootstrap")


def test_a_saved_result_states_the_same(case, tmp_path):
    kind, fit, *_ = case
    fit.save(tmp_path / "fit.json")
    found = load_fit(tmp_path / "fit.json")
    assert found.kind == kind and found.report() == fit.report() and found.to_dict()["kind"] == kind
    assert (found.estimates, found.units, found.standard_errors) == (fit.estimates, fit.units, fit.standard_errors)
    assert (found.at_bound, found.warnings) == (fit.at_bound, fit.warnings)
    np.testing.assert_allclose(found.covariance, fit.covariance)
    np.testing.assert_allclose(found.correlations, fit.correlations, atol=1e-12)
    for name, ends in fit.intervals().items():
        assert found.intervals()[name] == pytest.approx(ends, rel=1e-9)
    with pytest.raises(InputError, match="level: the file has the intervals"):
        found.intervals(0.9)
    assert len(repr(fit)) < 200 and len(repr(found)) < 200 and found._repr_html_().startswith("<table>")
    found.figure(found).draw_without_rendering()
    assert Identification.of(fit).kind == Identification.of(found).kind == kind


def changed(saved: dict, **changes) -> str:
    return json.dumps({**saved, **changes})


OTHER_FILES = {
    "empty": (lambda saved: "", "is empty"),
    "list": (lambda saved: "[]", "is not the saved result of a fit"),
    "no estimates": (lambda saved: '{"kind": "modes"}', "is not the saved result of a fit: .*estimates"),
    "deep": (lambda saved: '{"a": ' * 5000 + "1" + "}" * 5000, "is not the saved result of a fit"),
    "estimate": (lambda saved: changed(saved, estimates=[{"name": "a"}]), r".*estimates\[0\]"),
    "twice": (lambda saved: changed(saved, estimates=saved["estimates"][:1] * 2), "an estimate appears twice"),
    "ragged": (lambda saved: changed(saved, covariance=[[1.0, 2.0], [1.0]]), "the covariance is not 2 by 2"),
    "negative": (lambda saved: changed(saved, degrees_of_freedom=-1.0), ".*degrees_of_freedom"),
    "kind": (lambda saved: changed(saved, kind=3), ".*kind"),
    "infinite": (lambda saved: changed(saved, degrees_of_freedom=math.inf), "is not the saved result of a fit"),
    "surrogate": (lambda saved: changed(saved, report="\ud800"), "is not the saved result of a fit"),
}


@pytest.mark.parametrize("file", OTHER_FILES)
def test_other_files_are_refused(file, tmp_path):
    make, message = OTHER_FILES[file]
    saved = fit_rayleigh(PAIR, (0.01, 0.02, 0.04)).to_dict()
    content = make(saved)
    path = tmp_path / "fit.json"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match=message):
        load_fit(path)


def test_a_fit_with_nothing_to_spare_has_no_intervals_after_loading_either(tmp_path):
    fit = fit_rayleigh(PAIR[:2], (0.01, 0.02))
    fit.save(tmp_path / "fit.json")
    found = load_fit(tmp_path / "fit.json")
    assert found.estimates == fit.estimates
    assert all(math.isnan(end) for ends in found.intervals().values() for end in ends)
    with pytest.raises(InputError, match="fit: has no scatter"):
        monte_carlo(fit, runs=2)
