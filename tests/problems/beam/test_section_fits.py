"""Fits of beams with round sections and sections of given stiffness: recovery of the truth, and refusals."""

import math

import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    HarmonicBase,
    InputError,
    Measurement,
    Model,
    PointLoad,
    RayleighDamping,
    Section,
    Sensor,
    natural_modes,
    simulate,
)
from problems import FrequencyRecord, MotionRecord, PlannedRecord, ResponseRecord, StaticRecord, fit_beam, plan
from problems.beam.fitting import FitSettings, beam_problem
from problems.beam.properties import property_owners

D = 3e-3
MATERIAL = {"density": 1500.0, "elastic_modulus": 3e9}
CABLE = Section.stiffness(bending=0.03, axial=5e4, mass_per_length=0.02, depth=3e-3)
DOWN = (0.0, -1.0)
LOADS = [PointLoad.hung(mass, 0.45) for mass in (2e-3, 5e-3, 1e-2)]


def model_of(section, elements=8, **changes):
    material = {} if section.elastic_modulus else MATERIAL
    return Model(Beam.uniform(length=0.5, axis=(1.0, 0.0), section=section, elements=elements, **material, **changes))


def tones(guess, truth, count=3, std=1e-3):
    values = natural_modes(truth, count=count).frequencies
    return FrequencyRecord(guess, values, std=std * values)


def readings(guess, truth, sensor, std, loads=LOADS):
    """Return a static record of a true beam."""
    ideal = StaticRecord(truth, loads, np.ones(len(loads)), sensor).response(property_owners(truth.beam, []))
    return StaticRecord(guess, loads, ideal(np.ones(0))[0], sensor, std=std)


@pytest.mark.parametrize("section", [Section.circle(D), Section.tube(D, 0.8 * D)], ids=["rod", "tube"])
@pytest.mark.parametrize("first", [0.9, 1.15])
def test_frequencies_recover_a_diameter(section, first):
    truth = model_of(section)
    guess = Model(truth.beam.with_(diameter=first * D))
    fit = fit_beam(guess, tones(guess, truth), unknowns=["diameter"])
    assert fit.estimates["diameter"] == pytest.approx(D, rel=1e-6) and fit.units["diameter"] == "m"
    assert fit.model.beam.sections[0].depth == pytest.approx(D, rel=1e-6)
    assert fit.model.beam.section_shape == truth.beam.section_shape
    value, error = fit.combinations["bending_stiffness"]  # as d^4, the mass per length as d^2
    relative = fit.standard_errors["diameter"] / fit.estimates["diameter"]
    assert error / value == pytest.approx(4 * relative, rel=1e-6)
    value, error = fit.combinations["mass_per_length"]
    assert value == pytest.approx(truth.beam.mass_per_length[0], rel=1e-5)
    assert error / value == pytest.approx(2 * relative, rel=1e-6)


@pytest.mark.parametrize("first", [0.8, 1.2])
def test_frequencies_and_sag_recover_a_beam_of_given_stiffness(first):
    truth = model_of(CABLE)
    guess = model_of(Section.stiffness(0.03 * first, 5e4 * first, 0.02 / first, depth=3e-3))
    records = [tones(guess, truth), readings(guess, truth, Sensor("displacement", 0.45, DOWN), 1e-5)]
    fit = fit_beam(guess, records, unknowns=["bending_stiffness", "mass_per_length"])
    assert fit.estimates["bending_stiffness"] == pytest.approx(0.03, rel=1e-5)
    assert fit.estimates["mass_per_length"] == pytest.approx(0.02, rel=1e-5)


def test_a_strain_gauge_tells_the_diameter_of_a_rod_of_known_bending():
    """At a known moment, the strain on the surface is 32 M/(pi E d^3): its relative error is three times that of d."""
    truth, guess = (model_of(Section.circle(d), gravity=(0.0, 0.0)) for d in (D, 1.1 * D))
    masses = np.array([5e-5, 1e-4, 2e-4])
    loads = [PointLoad.hung(mass, 0.45) for mass in masses]
    fit = fit_beam(guess, readings(guess, truth, Sensor("strain", 0.02), 1e-7, loads), unknowns=["diameter"])
    assert fit.estimates["diameter"] == pytest.approx(D, rel=1e-5)
    strains = 32 * masses * 9.81 * (0.45 - 0.02) / (math.pi * 3e9 * D**3)
    assert fit.standard_errors["diameter"] == pytest.approx(1e-7 / np.linalg.norm(3 * strains / D), rel=0.01)


def test_the_diameters_of_some_elements_are_unknowns():
    truth = Model(model_of(Section.circle(D)).beam.with_(diameter=[D] * 4 + [1.2 * D] * 4))
    guess = model_of(Section.circle(D))
    fit = fit_beam(guess, tones(guess, truth, 4), unknowns=["diameter[1:4]", "diameter[5:8]"])
    assert list(fit.estimates.values()) == pytest.approx([D, 1.2 * D], rel=1e-5)
    assert fit.model.beam.diameter == pytest.approx(truth.beam.diameter, rel=1e-5)


def test_some_round_elements_of_a_beam_have_a_diameter():
    sections = [Section.circle(D)] * 4 + [Section.rectangle(D, D)] * 4
    truth, guess = (Model(model_of(sections[0]).beam.with_(section=[section] * 4 + sections[4:]))
                    for section in (sections[0], Section.circle(1.1 * D)))  # fmt: skip
    fit = fit_beam(guess, tones(guess, truth), unknowns=["diameter[1:4]"])
    assert fit.estimates["diameter[1:4]"] == pytest.approx(D, rel=1e-5)
    with pytest.raises(InputError, match=r"^diameter: only circles and tubes have one"):
        fit_beam(guess, tones(guess, truth), unknowns=["diameter[1:5]"])


@pytest.mark.slow
def test_a_large_motion_recovers_a_diameter():
    law = RayleighDamping(alpha=0.5, beta=1e-4)
    truth, guess = model_of(Section.circle(D), 6), model_of(Section.circle(1.03 * D), 6)
    run = simulate(truth, damping=law, start="straight", duration=2.0, sample_rate=200.0)
    height = Measurement(run.time, run.tip[:, 1], sensor=Sensor("position", direction=(0.0, 1.0)))
    record = MotionRecord([height], start="straight")
    fit = fit_beam(guess, record, law, unknowns=["diameter"], fixed=["alpha", "beta"])
    assert fit.estimates["diameter"] == pytest.approx(D, rel=1e-3)


def test_an_experiment_for_a_diameter_is_planned():
    """Without gravity, each frequency is proportional to the diameter."""
    model = model_of(Section.circle(D), gravity=(0.0, 0.0))
    deviations = 1e-3 * natural_modes(model, count=3).frequencies
    tones = PlannedRecord.natural_frequencies(model, [1, 2, 3], std=deviations.tolist())
    found = plan(model, {"tones": tones}, unknowns=["diameter"])
    assert found.errors_of({"tones": 1})["diameter"] == pytest.approx(1e-3 / math.sqrt(3) * D, rel=1e-4)


def test_the_usual_unknown_beside_response_curves_is_one_that_the_section_has():
    for section, name in ((CABLE, "bending_stiffness"), (Section.circle(D), "elastic_modulus")):
        model = model_of(section)
        frequencies = natural_modes(model, count=1).frequencies[0] * np.array([0.97, 0.99, 1.0, 1.01, 1.03])
        curve = ResponseRecord(frequencies, np.ones(5), base=HarmonicBase(1e-3, 1.0), sweep="up")
        _, _, first = beam_problem(model, [curve, tones(model, model)], RayleighDamping(alpha=0.2), FitSettings())
        assert list(first) == [name]


@pytest.mark.parametrize(
    ("section", "unknowns", "message"),
    [
        (Section.circle(D), ["width"], "width: changes with the diameter of a circle or a tube; estimate its diameter"),
        (Section.circle(D), ["thickness[1:3]"], r"thickness\[1:3\]: changes with the diameter"),
        (Section(D, D), ["diameter"], "diameter: only circles and tubes have one"),
        (CABLE, ["diameter"], "diameter: only circles and tubes have one"),
        (
            CABLE,
            ["density"],
            "density: is not a property of a section of given stiffness; estimate its mass_per_length",
        ),
        (CABLE, ["thickness"], "thickness: is not a property of a section of given .* estimate its bending_stiffness"),
        (Section.circle(D), ["diameter", "bending_stiffness"], "unknowns: bending_stiffness contains diameter"),
        (
            Section.circle(D),
            ["diameter", "diameter[2]"],
            r"unknowns: diameter\[2\] changes the same property as diameter",
        ),
    ],
)
def test_properties_that_a_section_does_not_have_are_refused(section, unknowns, message):
    model = model_of(section)
    with pytest.raises(InputError, match=f"^{message}"):
        fit_beam(model, FrequencyRecord(model, [1.0, 6.0]), unknowns=unknowns)
