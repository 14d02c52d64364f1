"""Fits of beams with any supports and attachments: recovery of a known truth, and what the records leave open."""

import math

import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    Clamp,
    Dashpot,
    FitError,
    Guide,
    HarmonicBase,
    InputError,
    Measurement,
    Model,
    Pin,
    PointLoad,
    PointMass,
    RayleighDamping,
    Roller,
    RotationalSpring,
    SampledLoad,
    Sensor,
    Spring,
    State,
    natural_modes,
    simulate,
    static_equilibrium,
)
from problems import Channel, FrequencyRecord, MotionRecord, StaticRecord, fit_beam
from problems.beam.properties import property_owners, scaled_model

STRIP = {"length": 0.5, "width": 20e-3, "thickness": 1e-3, "density": 7850.0, "elements": 8, "axis": (1.0, 0.0)}
WEIGHTS = ((), (PointLoad.hung(5e-3, point=0.3),), (PointLoad.hung(15e-3, point=0.3),))


def strip(modulus=200e9, **given):
    return Model(Beam.uniform(**{**STRIP, "elastic_modulus": modulus, **given}))


def heights(model):
    """Return the heights of two points in three cases of load, and their sensors."""
    sensors = [Sensor("position", s, (0.0, 1.0)) for s in (0.2, 0.3)]
    rows = [static_equilibrium(model, loads=loads) for loads in WEIGHTS]
    return np.array([[rest.position(sensor.point)[1] for sensor in sensors] for rest in rows]), sensors


def propped(curvature, modulus=200e9):
    """Return a coiled strip that a clamp and a hinge hold level, wherever its curvature would take the hinge."""
    coiled = strip(modulus, natural_curvature=[curvature] * 4 + [0.5 * curvature] * 4)
    x, y = coiled.natural_nodes[0][-1].tolist()
    supports = (Clamp(0.0), Pin(0.5, displacement=(0.4999 - x, -y)))
    return Model(coiled.beam.with_(supports=supports))


@pytest.mark.parametrize(
    ("make", "first"),
    [(lambda k, E: strip(E, natural_curvature=k), 0.1), (propped, -0.15)],
    ids=["cantilever", "propped"],
)
def test_natural_curvature_and_modulus_from_a_static_test(make, first):
    """The beam of the fit has the measured heights, so its supports stayed in place."""
    truth, start = make(-0.3, 200e9), make(first, 190e9)
    measured, sensors = heights(truth)
    record = StaticRecord(start, WEIGHTS, measured, sensors, std=1e-5)
    fit = fit_beam(start, record, unknowns=["natural_curvature", "elastic_modulus"])
    assert fit.estimates == pytest.approx({"natural_curvature": -0.3, "elastic_modulus": 200e9}, rel=1e-5)
    assert fit.units["natural_curvature"] == "1/m"
    np.testing.assert_allclose(heights(fit.model)[0], measured, atol=1e-9)
    for support, true in zip(fit.model.beam.supports, truth.beam.supports, strict=True):
        assert (*support.displacement, support.angle) == pytest.approx((*true.displacement, true.angle), abs=1e-6)


def test_a_curvature_that_bends_nothing_is_open():
    """Between two clamps at the length of the strip, a uniform curvature changes their moments alone."""
    coiled = strip(natural_curvature=0.2)
    (x, y), (along, across) = coiled.natural_nodes[0][-1].tolist(), coiled.natural_nodes[1][-1].tolist()
    level = Clamp(0.5, displacement=(0.5 - x, -y), rotation=-np.arctan2(across, along))
    model = Model(coiled.beam.with_(supports=(Clamp(0.0), level)))
    measured, sensors = heights(model)
    record = StaticRecord(model, WEIGHTS, measured, sensors, std=1e-5)
    with pytest.raises(FitError, match="the records do not depend on natural_curvature"):
        fit_beam(model, record, unknowns=["natural_curvature", "elastic_modulus"])


def configurations(mass, stiffness):
    """Return a clamped-clamped strip with a sensor on a spring at mid-span, and with a known mass beside it."""
    sensor = (PointMass(0.25, mass), Spring(0.25, (0.0, stiffness)))
    models = [strip(supports=(Clamp(0.0), Clamp(0.5)), attachments=sensor)]
    heavier = (*sensor, PointMass(0.35, 20e-3))
    return [*models, Model(models[0].beam.with_(attachments=heavier))]


@pytest.mark.slow
def test_mass_and_spring_at_mid_span_from_frequencies_of_two_configurations():
    truth = {"mass": 12e-3, "spring_y": 900.0}
    true, start = configurations(*truth.values()), configurations(5e-3, 3000.0)
    draw = np.random.default_rng(3)
    scores = []
    for _ in range(6):
        records = []
        for model, first in zip(true, start, strict=True):
            frequencies = natural_modes(model, count=3).frequencies
            std = 1e-3 * frequencies
            records.append(FrequencyRecord(first, frequencies + std * draw.standard_normal(3), std=std))
        fit = fit_beam(start[0], records, unknowns=list(truth))
        scores += [(fit.estimates[name] - value) / fit.standard_errors[name] for name, value in truth.items()]
        assert fit.standard_errors["mass"] < 0.05 * truth["mass"]
        assert fit.standard_errors["spring_y"] < 0.05 * truth["spring_y"]
    assert np.abs(scores).max() < 3.5
    assert fit.model.beam.lumped == pytest.approx(dict(fit.estimates))


@pytest.mark.slow
def test_modulus_and_springs_of_a_free_beam_from_six_frequencies():
    """Two modes are those of the strip as a rigid body on its springs; its motion along itself is none of them."""

    def soft(modulus, stiffness):
        springs = tuple(Spring(s, (0.0, stiffness)) for s in (0.1, 0.4))
        return strip(modulus, gravity=(0.0, 0.0), supports=(), attachments=springs)

    start, draw, scores = soft(150e9, 60.0), np.random.default_rng(0), []
    frequencies = natural_modes(soft(200e9, 20.0), count=7).frequencies
    assert frequencies[0] == 0.0
    std = 2e-3 * frequencies[1:]
    for _ in range(6):
        record = FrequencyRecord(start, frequencies[1:] + std * draw.standard_normal(6), std=std)
        assert record.labels[0] == "mode 2"
        fit = fit_beam(start, record, unknowns=["elastic_modulus", "spring_stiffness"])
        errors = np.array([*fit.estimates.values()]) - [200e9, 20.0]
        scores.append(errors / [*fit.standard_errors.values()])
        assert max(fit.standard_errors["elastic_modulus"] / 200e9, fit.standard_errors["spring_stiffness"] / 20) < 0.01
    assert np.abs(scores).max() < 3.5
    assert len({*fit.model.beam.lumped.values()}) == 1


@pytest.mark.slow
def test_a_dashpot_and_a_spring_from_a_motion():
    """A strip on a hinge and a roller is let go; the strip of the fit has other values."""

    def held(coefficient, stiffness):
        attached = (Dashpot(0.2, (0.0, coefficient)), Spring(0.35, (0.0, stiffness)))
        return strip(supports=(Pin(0.0), Roller(0.5)), attachments=attached, elements=5)

    truth, start = held(0.4, 300.0), held(0.2, 350.0)
    pulled = static_equilibrium(truth, loads=[PointLoad.hung(0.2, point=0.2)])
    let_go = State(pulled.coordinates, 0.0 * pulled.coordinates)
    run = simulate(truth, start=let_go, duration=0.12, sample_rate=400.0, tolerance=1e-8)
    sensor = Sensor("position", 0.3, (0.0, 1.0))
    record = MotionRecord([Measurement(run.time, run.position(0.3)[:, 1], sensor=sensor)], start=let_go)
    fit = fit_beam(start, record, unknowns=["dashpot_y", "spring_y"])
    assert fit.estimates == pytest.approx({"dashpot_y": 0.4, "spring_y": 300.0}, rel=1e-3)


@pytest.mark.slow
def test_a_modulus_from_the_motion_under_a_blow_beside_the_tip():
    """The clamp force balances the blow where it acts; at the tip, the modulus would be another one."""
    blow = SampledLoad([0.0, 0.01, 0.02], [[0.0, 0.0], [0.0, -1.0], [0.0, 0.0]], point=0.2)
    run = simulate(strip(), load=blow, duration=0.12, sample_rate=400.0, tolerance=1e-8)
    channels = [
        Measurement(run.time, run.position(0.3)[:, 1], sensor=Sensor("position", 0.3, (0.0, 1.0))),
        Measurement(run.time, run.clamp_force[:, 1], "N", sensor=Sensor("force", direction=(0.0, 1.0))),
    ]
    fit = fit_beam(strip(195e9), MotionRecord(channels, load=blow), unknowns=["elastic_modulus"])
    assert fit.estimates == pytest.approx({"elastic_modulus": 200e9}, rel=1e-4)


@pytest.mark.slow
def test_a_first_value_of_a_spring_by_which_the_decay_slips_two_cycles_does_no_harm():
    """The decay has 5.9 Hz, the first beam 6.7 Hz; from there alone, the fit ends at 30.7 N/m."""

    def sprung(stiffness):
        return strip(gravity=(0.0, 0.0), attachments=(Spring(0.5, (0.0, stiffness)),), elements=2)

    truth, first, law = sprung(20.0), sprung(30.0), RayleighDamping(alpha=1.0, beta=4e-4)  # no tones of the mesh last
    starts = [static_equilibrium(model, tip_force=(0.0, 0.02)) for model in (truth, first)]
    run = simulate(truth, damping=law, start=starts[0], duration=2.7, sample_rate=35.0, tolerance=1e-7)
    values = run.tip[:, 1] + 5e-5 * np.random.default_rng(0).standard_normal(run.time.size)
    sensor = Sensor("position", direction=(0.0, 1.0))
    record = MotionRecord([Measurement(run.time, values, sensor=sensor)], start=starts[1])
    fit = fit_beam(first, record, law, unknowns=["spring_y"], fixed=["alpha", "beta"])
    assert abs(fit.estimates["spring_y"] - 20.0) < 3.0 * fit.standard_errors["spring_y"] < 0.5


def level_strip(stiffness, prestress, curvature):
    """Return a coiled strip that a rigid and an elastic clamp hold level."""
    coiled = strip(
        70e9, density=2700.0, elements=3, gravity=(0.0, 0.0), natural_curvature=curvature, prestress=prestress
    )
    (x, y), (c, s) = (part[-1].tolist() for part in coiled.natural_nodes)
    far = Clamp(0.5, stiffness, displacement=(0.5 - x, -y), rotation=-math.atan2(s, c))
    return Model(coiled.beam.with_(supports=(Clamp(0.0), far)))


@pytest.mark.slow
def test_a_soft_clamp_prestress_and_curvature_from_the_decays_of_two_modes():
    """From twice its stiffness, a clamp as soft as the strip would run to a hinge in the coordinate 1/k."""
    truth, law = {"clamp_stiffness": 0.1, "prestress": 2e5, "natural_curvature": 0.3}, RayleighDamping(alpha=6.0)
    model, first = level_strip(*truth.values()), level_strip(0.2, 1e5, 0.25)
    rng, sensors = np.random.default_rng(0), [Sensor("position", s, (0.0, 1.0)) for s in (0.125, 0.25)]
    records = []
    for f, periods in zip(natural_modes(model, count=2).frequencies, (6, 8), strict=True):
        base = HarmonicBase(1e-4, f, stop=3 / f, direction=(0.0, 1.0))
        run = simulate(model, damping=law, base=base, duration=periods / f, sample_rate=8 * f, method="radau")
        channels = []
        for sensor in sensors:
            noisy = run.position(sensor.point)[:, 1] + 5e-6 * rng.standard_normal(len(run.time))
            channels.append(Channel(Measurement(run.time, noisy, sensor=sensor), std=5e-6))
        records.append(MotionRecord(channels, base=base, start=static_equilibrium(first)))
    fit = fit_beam(first, records, law, unknowns=[*truth], fixed=["alpha"])
    errors = {name: (fit.estimates[name] - true) / fit.standard_errors[name] for name, true in truth.items()}
    assert max(map(abs, errors.values())) < 3.0
    assert fit.standard_errors["clamp_stiffness"] < 0.02 and fit.standard_errors["natural_curvature"] < 0.003


FULL = strip(
    gravity=(1.0, -9.81),
    prestress=[3e6] * 4 + [-1e6] * 4,
    supports=(Clamp(0.0, 3.0), Roller(0.3, (1.0, 0.2), displacement=(0.0, 1e-3)), Clamp(0.5, 5.0, rotation=0.02)),
    attachments=(
        PointMass(0.1, 5e-3, rotary_inertia=2e-6),
        PointMass(0.4, 8e-3),
        Spring(0.2, (50.0, 200.0)),
        RotationalSpring(0.4, 0.5),
    ),
)
COILED = strip(natural_curvature=0.2, supports=(Guide(0.1, (0.0, 1.0)), Pin(0.5)), attachments=(PointMass(0.3, 5e-3),))


@pytest.mark.slow
@pytest.mark.parametrize("model", [FULL, COILED], ids=["full", "coiled"])
@pytest.mark.parametrize("kind", ["static", "frequencies"])
def test_derivatives_by_all_lumped_properties_agree_with_other_beams(model, kind):
    """Each property in turn is changed in the description of the beam; a force is certain to 1e-8 N, 1e-15 of E A."""
    names = ("elastic_modulus", *model.lumped)
    record = FrequencyRecord(model, [1.0] * 5)
    if kind == "static":
        sensors = [Sensor("position", 0.25, (0.0, 1.0)), Sensor("force"), Sensor("moment"), Sensor("strain", 0.2)]
        record = StaticRecord(model, [(), (PointLoad((0.1, -0.2), point=0.33),)], np.ones((2, 4)), sensors)
    owners, factors = property_owners(model.beam, names), np.ones(len(names))
    values, jacobian = record.response(owners)(factors)
    for k, step in enumerate(2e-3 * np.eye(len(names))):
        ends = [record.with_model(scaled_model(model, owners, factors + sign * step)) for sign in (1, -1)]
        up, down = (end.response(owners)(factors)[0] for end in ends)
        np.testing.assert_allclose(jacobian[:, k], (up - down) / 4e-3, rtol=2e-5, atol=5e-6 * np.abs(values).max())


@pytest.mark.parametrize(
    ("model", "names", "message"),
    [
        (FULL, ["dashpot_y"], "dashpot_y: no beam has a dashpot y"),
        (FULL, ["mass_3"], "mass_3: no beam has a mass 3"),
        (FULL, ["glue"], "unknowns: must be properties of the beam, or among"),
        (
            strip(natural_curvature=0.1, attachments=(Spring(0.2, (0.0, 1.0)),)),
            ["natural_curvature"],
            "natural_curvature: cannot be estimated for a beam with a Spring at 0.2 m",
        ),
        (FULL, ["spring_y", "spring_stiffness"], "unknowns: spring_stiffness changes the same property as spring_y"),
        (strip(supports=(Pin(0.0), Pin(0.5))), ["clamp_stiffness"], "clamp_stiffness: no beam has a clamp stiffness"),
    ],
)
def test_unknowns_that_a_beam_does_not_have_are_refused(model, names, message):
    with pytest.raises(InputError) as caught:
        fit_beam(model, FrequencyRecord(model, [1.0, 2.0], std=0.1), unknowns=names)
    assert str(caught.value).startswith(message)
