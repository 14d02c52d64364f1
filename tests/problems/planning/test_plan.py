"""Expected standard errors of experiments against fits, other solvers, closed forms and brute force."""

import math
import pickle
from itertools import combinations

import numpy as np
import pytest
from scipy.stats import chi2

from ancf_casadi import (
    Beam,
    HarmonicBase,
    InputError,
    ModalDamping,
    Model,
    Pin,
    PointLoad,
    QuadraticDamping,
    RayleighDamping,
    Roller,
    Sensor,
    State,
    natural_modes,
    periodic_motion,
    reduce_model,
    simulate,
    static_equilibrium,
)
from ancf_casadi.exceptions import FitError
from problems import FrequencyRecord, PlannedRecord, fit_beam, plan

STEEL = {"length": 0.5, "width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elastic_modulus": 210e9}
BEAM = Beam.uniform(**STEEL, elements=3)
MODEL = Model(BEAM)
LEVEL = Model(BEAM.with_(axis=(1.0, 0.0)))
LAW = QuadraticDamping(0.5, 1.0)
DOWN = Sensor("displacement", direction=(0.0, -1.0))
WEIGHTS = [PointLoad.hung(mass, point=0.4) for mass in (1e-3, 2e-3, 4e-3)]
SAG = PlannedRecord.static(LEVEL, WEIGHTS, [DOWN, Sensor("slope", 0.3)], std=[1e-4, 1e-3])
TONES = PlannedRecord.natural_frequencies(MODEL, [1, 2], std=[0.01, 0.05])
LOADED = PlannedRecord.natural_frequencies(Model(BEAM.with_(tip_mass=5e-4)), [1, 3], std=[0.01, 0.1], cost=2.0)
PROPERTIES = ["elastic_modulus", "density"]


@pytest.fixture(scope="module")
def values():
    return plan(LEVEL, {"sag": SAG, "tones": TONES, "loaded": LOADED}, unknowns=PROPERTIES)


@pytest.fixture(scope="module")
def release():
    start = static_equilibrium(MODEL, tip_force=(4e-3, 0.0))
    sensors = [Sensor("displacement", point) for point in (0.1, 0.25, 0.4, None)]
    record = PlannedRecord.motion(sensors, duration=1.0, sample_rate=40.0, std=2e-4, start=start)
    return plan(MODEL, {"release": record, "sag": SAG}, LAW, unknowns=["elastic_modulus"])


def test_expected_errors_are_those_of_a_fit_to_the_expected_records(values):
    counts = {"sag": 2, "tones": 1, "loaded": 1}
    records = [record for name, record in zip(values.names, values.records, strict=True) for _ in range(counts[name])]
    fit = fit_beam(LEVEL, records, unknowns=PROPERTIES)
    assert values.errors_of(counts) == pytest.approx(fit.standard_errors, rel=1e-6)


def test_expected_values_are_those_of_the_solvers(values):
    sag, tones, _ = values.records
    unloaded, loaded = (static_equilibrium(LEVEL, loads=loads) for loads in ((), [WEIGHTS[2]]))
    assert sag.measured[4] == pytest.approx((unloaded.tip - loaded.tip)[1], rel=1e-6)
    assert tones.measured == pytest.approx(natural_modes(MODEL, count=2).frequencies, rel=1e-8)


@pytest.mark.slow
def test_an_expected_motion_is_that_of_a_simulation(release):
    start = static_equilibrium(MODEL, tip_force=(4e-3, 0.0))
    run = simulate(MODEL, damping=LAW, start=start, duration=1.0, sample_rate=40.0, method="radau", tolerance=1e-9)
    channel = release.records[0].own_channels[3]
    assert channel.measurement.values == pytest.approx(run.tip[:, 0], abs=1e-7)
    assert channel.std == 2e-4


@pytest.mark.slow
def test_an_expected_response_is_that_of_harmonic_balance_on_the_branch_from_rest():
    f, base = natural_modes(MODEL, count=1).frequencies[0] * np.array([0.97, 1.0, 1.02]), HarmonicBase(2e-3, 1.0)
    curve = PlannedRecord.response(f, base=base)
    planned = plan(MODEL, {"curve": curve}, LAW, unknowns=["natural_frequencies"], modes=2, harmonics=3)
    reduced = reduce_model(MODEL, modes=2, damping=LAW)
    motions = [
        periodic_motion(reduced, base=HarmonicBase(2e-3, frequency)).harmonics(relative=False)[1] for frequency in f
    ]
    assert planned.records[0].complex_values == pytest.approx(np.array(motions), rel=2e-3)
    record = planned.records[0]
    fit = fit_beam(MODEL, record, LAW, unknowns=["natural_frequencies"], modes=2, harmonics=3)
    assert fit.estimates["eta1"] == pytest.approx(0.5, abs=0.1 * planned.errors_of({"curve": 1})["eta1"])


@pytest.mark.slow
def test_levels_of_their_own_count_as_unknowns_with_their_priors():
    f = natural_modes(MODEL, count=1).frequencies[0] * np.array([0.99, 1.0, 1.01])
    curves = {f"{a} mm": PlannedRecord.response(f, base=HarmonicBase(1e-3 * a, 1.0)) for a in (1, 2)}
    unknowns, levels = ["natural_frequencies", "excitations"], ("excitation_1", "excitation_2")
    informed, certain, loose = (
        plan(MODEL, curves, LAW, modes=1, harmonics=1, **settings).errors_of({"1 mm": 1, "2 mm": 1})["eta1"]
        for settings in ({"unknowns": unknowns[:1]},
                         *({"unknowns": unknowns, "priors": dict.fromkeys(levels, (1.0, std))} for std in (1e-6, 0.05)))
    )  # fmt: skip
    assert certain == pytest.approx(informed, rel=1e-4) and loose > 1.2 * informed


@pytest.mark.slow
def test_estimates_from_simulated_records_scatter_as_expected(values, release):
    """The squared errors in units of the expected covariance are chi-squared; the limits are those of 99.9 %."""
    for planned, model, law, unknowns, runs in (
        (values, LEVEL, None, PROPERTIES, 24), (release, MODEL, LAW, ["elastic_modulus"], 2),
    ):  # fmt: skip
        fit = fit_beam(model, planned.records, law, unknowns=unknowns)
        covariance = np.linalg.inv(planned.design.total(np.ones(len(planned.names))))
        rng, total = np.random.default_rng(0), 0.0
        for _ in range(runs):
            noise = fit.solution.problem.scale * rng.standard_normal(len(fit.fit.residuals))
            estimates = dict(zip(fit.estimates, fit.resampled(noise), strict=True))
            # in units of the scales; the reciprocals of stiffnesses are nearly linear
            z = [
                unknown.guess / estimates[unknown.name] - 1
                if unknown.offset is not None
                else estimates[unknown.name] / unknown.guess - 1
                for unknown in planned.unknowns
            ]
            total += float(z @ np.linalg.solve(covariance, z))
        low, high = chi2.ppf([0.0005, 0.9995], runs * len(planned.unknowns))
        assert low < total < high


@pytest.mark.slow
def test_errors_over_time_are_those_of_shorter_records(release):
    times, errors = release.over_time("release")
    assert errors["eta1"][-1] == pytest.approx(release.errors_of({"release": 1})["eta1"])
    assert (errors["eta1"][1:] <= errors["eta1"][:-1] * (1 + 1e-9)).all()
    start = static_equilibrium(MODEL, tip_force=(4e-3, 0.0))
    sensors = [channel.sensor for channel in release.records[0].own_channels]
    half = PlannedRecord.motion(sensors, duration=0.5, sample_rate=40.0, std=2e-4, start=start)
    separate_errors = plan(MODEL, {"half": half}, LAW, unknowns=["elastic_modulus"]).errors_of({"half": 1})
    k = int(np.argmin(np.abs(times - 0.5)))
    assert {name: values[k] for name, values in errors.items()} == pytest.approx(separate_errors, rel=1e-4)
    assert release.duration("release", "eta1", separate_errors["eta1"] * 1.001) == pytest.approx(0.5)
    assert math.isinf(release.duration("release", "eta1", 1e-9))


@pytest.mark.slow
def test_sensor_places_are_the_best_of_all(release):
    record = release.expected[0]

    def loss(pair):
        return -np.linalg.slogdet(record.series_information(list(pair)))[1]

    best = min(combinations(range(4), 2), key=loss)
    assert release.places("release", 2) == tuple(record.places[list(best)])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("goal", "place"), [("D", math.atan(math.sqrt(2)) / math.pi), ("ratio1", 0.5), ("ratio2", 0.25)]
)
def test_the_best_place_for_two_modes_of_a_pinned_beam_is_that_of_the_closed_form(two_modes, goal, place):
    """Modes of orthogonal decays determine their ratios in proportion to sin^2(pi x) and sin^2(2 pi x)."""
    assert two_modes.places("pluck", 1, goal)[0] / 0.5 == pytest.approx(place, abs=0.0126)


@pytest.fixture(scope="module")
def two_modes():
    beam = Beam.uniform(
        **STEEL, elements=6, axis=(1.0, 0.0), gravity=(0.0, 0.0), supports=(Pin(0.0), Roller(0.5, (1.0, 0.0)))
    )
    model = Model(beam)
    law = ModalDamping(natural_modes(model, count=2), (0.01, 0.01))
    loaded = static_equilibrium(model, loads=[PointLoad(force=(0.0, 1e-4), point=0.15)]).coordinates
    start = State(loaded, np.zeros(loaded.size))
    sensors = [Sensor("displacement", x, (0.0, 1.0)) for x in 0.5 * np.arange(1, 21) / 40]
    pluck = PlannedRecord.motion(sensors, duration=2.0, sample_rate=160.0, std=1e-6, start=start)
    return plan(model, {"pluck": pluck}, law)


@pytest.mark.parametrize(
    ("goal", "weights"), [("D", None), ("A", np.array([1.0, 1.0])), ("density", np.array([0.0, 1.0]))]
)
def test_a_goal_weighs_the_errors_of_the_unknowns(values, goal, weights):
    gains = values.gains(dict.fromkeys(values.names, 1), goal)
    assert [*gains.values()] == pytest.approx(values.design.gains(np.ones(3), weights))


@pytest.mark.slow
def test_an_earlier_fit_counts_with_its_information_and_its_noise(release):
    law = RayleighDamping(0.5)
    start = static_equilibrium(MODEL, tip_force=(4e-3, 0.0))
    record = plan(MODEL, {"release": PlannedRecord(release.records[0])}, law).records[0]
    rng = np.random.default_rng(0)
    noisy = [
        type(channel.measurement)(
            channel.measurement.time, channel.measurement.values + 2e-4 * rng.standard_normal(41), sensor=channel.sensor
        )
        for channel in record.own_channels
    ]
    fit = fit_beam(MODEL, type(record)(noisy, start=start), law)
    sensors = [channel.sensor for channel in record.own_channels]
    again = PlannedRecord.motion(sensors, duration=1.0, sample_rate=40.0, start=start)
    planned = plan(MODEL, {"again": again}, law, before=fit)
    assert planned.errors_of({})["alpha"] == pytest.approx(fit.standard_errors["alpha"])
    errors_of_both = planned.errors_of({"again": 1})["alpha"]
    assert errors_of_both == pytest.approx(fit.standard_errors["alpha"] / math.sqrt(2), rel=0.05)
    with pytest.raises(InputError, match="again: std: is needed"):
        plan(MODEL, {"again": again}, law)


def test_an_earlier_fit_far_from_the_guess_keeps_its_standard_errors():
    frequencies = natural_modes(Model(LEVEL.beam.with_(elastic_modulus=420e9)), count=3).frequencies
    tones = FrequencyRecord(LEVEL, frequencies * [1.001, 0.999, 1.0005], std=1e-3 * frequencies)
    fit = fit_beam(LEVEL, tones, unknowns=["elastic_modulus"])
    errors = plan(LEVEL, {"tones": TONES}, unknowns=["elastic_modulus"], before=fit).errors_of({})
    assert errors == pytest.approx(fit.standard_errors)


def test_a_relative_prior_at_the_guess_is_the_absolute_one_to_first_order():
    errors = [
        plan(LEVEL, {"tones": TONES}, unknowns=PROPERTIES, priors={"density": prior}).errors_of({"tones": 1})
        for prior in ((8000.0, 80.0), (8000.0, 0.01, "log-normal"))
    ]
    assert errors[1] == pytest.approx(errors[0]) and errors[0]["density"] == pytest.approx(80.0, rel=0.05)


def test_priors_count_once_however_often_a_record_is_repeated(values):
    informed = plan(LEVEL, {"tones": TONES}, unknowns=PROPERTIES, priors={"density": (8000.0, 80.0)})
    assert informed.errors_of({"tones": 1e6})["density"] == pytest.approx(80.0, rel=1e-3)
    assert informed.errors_of({"tones": 1e6})["elastic_modulus"] == pytest.approx(2.1e9, rel=1e-2)


def test_what_the_candidates_leave_open_is_said():
    found = plan(MODEL, {"tones": TONES}, unknowns=PROPERTIES)
    assert found.errors_of({"tones": 1}) == {"elastic_modulus": math.inf, "density": math.inf}
    (warning,) = found.warnings
    assert "not determine elastic_modulus density" in warning
    with pytest.raises(FitError, match="not determine"):
        found.best(4)


def test_a_budget_that_buys_too_little_to_determine_the_goal_is_refused(values, monkeypatch):
    """As of two candidates that determine one unknown each, if the budget buys one."""
    nothing = dict.fromkeys(values.errors_of({"sag": 1}), math.inf)
    monkeypatch.setattr(type(values), "errors_of", lambda plan, counts: nothing)
    with pytest.raises(FitError, match="no list within the budget determines"):
        values.best(4)


def test_a_plan_has_text_data_and_can_be_sent(values):
    text = values.report()
    assert "sag" in text and "all together" in text
    assert values.to_dict()["candidates"][2]["cost"] == 2.0
    assert pickle.loads(pickle.dumps(values)).errors_of({"sag": 1, "tones": 1}) == values.errors_of(
        {"sag": 1, "tones": 1}
    )


@pytest.mark.parametrize(("call", "message"), [
    (lambda planned: plan(MODEL, {}), "candidates: must hold at least one"),
    (lambda planned: plan(MODEL, {"a": 1}), "candidates: a: must be"),
    (lambda planned: planned.errors_of({"other": 1}), "counts: must be one of sag"),
    (lambda planned: planned.errors_of({"sag": -1}), "counts: sag: must be positive"),
    (lambda planned: planned.best(0.5), "budget: pays for no candidate"),
    (lambda planned: planned.best(4, "E"), "goal: must be one of D, A, elastic_modulus"),
    (lambda planned: planned.places("sag"), "name: sag is no motion"),
    (lambda planned: planned.duration("tones", "density", 1.0), "name: tones is no motion"),
])  # fmt: skip
def test_what_cannot_be_planned_is_refused(values, call, message):
    with pytest.raises(InputError, match=message):
        call(values)
