"""Matching of beams with round sections and sections of given stiffness."""

import numpy as np
import pytest

from ancf_casadi import Beam, InputError, Model, Section, natural_modes
from problems import Global, MeasuredModes, PerElement, Smooth, match_frequencies

D = 3e-3
ROD = Beam.uniform(length=0.5, section=Section.tube(D, 1e-3), density=1500.0, elastic_modulus=3e9, elements=6,
                   axis=(1.0, 0.0), gravity=(0.0, 0.0))  # fmt: skip
CABLE = ROD.with_(section=Section.stiffness(0.03, 5e4, 0.02))


def frequencies(beam, count=2):
    return natural_modes(Model(beam), count=count).frequencies


def test_frequencies_are_proportional_to_the_diameter():
    values = 1.04 * frequencies(ROD)
    match = match_frequencies(
        ROD, targets=MeasuredModes(values, frequency_std=1e-3 * values), unknowns=[Global("diameter")]
    )
    assert match.estimates["diameter"] == pytest.approx(1.04 * D, rel=1e-6)
    assert match.beam.sections[0].diameter == pytest.approx(1.04 * D, rel=1e-6)
    assert match.beam.section_shape == ROD.section_shape
    assert match.standard_errors["diameter"] == pytest.approx(1e-3 / np.sqrt(2) * 1.04 * D, rel=1e-5)
    assert match.intervals()["diameter"][1] < 1.1 * D
    assert match.figure() and "diameter" in match.report()


@pytest.mark.parametrize(
    ("beam", "names"),
    [(ROD, {"diameter", "density", "elastic_modulus"}), (CABLE, {"bending_stiffness", "mass_per_length"})],
)
def test_the_usual_unknowns_are_those_of_the_sections(beam, names):
    targets = 1.03 * frequencies(beam)
    match = match_frequencies(beam, targets=targets)
    assert match.frequencies == pytest.approx(targets, rel=1e-5)
    assert {name.partition("[")[0] for name in match.estimates} == names
    assert match.figure()


def test_a_diameter_stays_within_its_bounds():
    match = match_frequencies(ROD, targets=1.5 * frequencies(ROD), unknowns=[Global("diameter", relative_bounds=0.2)])
    assert match.beam.diameter == pytest.approx([1.2 * D] * 6, rel=1e-6) and match.at_bound == ("diameter",)


@pytest.mark.parametrize("unknown", [PerElement("diameter", 0.3), Smooth("diameter", 2, 0.3)])
def test_diameters_vary_along_the_beam(unknown):
    """A taper of a round rod changes width and thickness of each element together."""
    targets = frequencies(ROD.with_(diameter=(1.1 * D, 1.06 * D, 1.02 * D, 0.98 * D, 0.94 * D, 0.9 * D)))
    match = match_frequencies(ROD, targets=targets, unknowns=[unknown])
    assert match.frequencies == pytest.approx(targets, rel=1e-6)
    assert np.ptp(match.beam.diameter) > 0.1 * D and len(match.estimates) == 6
    if isinstance(unknown, Smooth):
        assert match.beam.diameter[0] == pytest.approx(1.1 * D, rel=1e-3)


@pytest.mark.parametrize(("name", "power"), [("bending_stiffness", 0.5), ("mass_per_length", -0.5)])
def test_combined_properties_of_a_beam_of_given_stiffness(name, power):
    match = match_frequencies(CABLE, targets=1.06**power * frequencies(CABLE), unknowns=[Global(name)])
    assert match.estimates[name] == pytest.approx(1.06 * getattr(CABLE, name)[0], rel=1e-6)
    np.testing.assert_allclose(getattr(match.beam, name), match.estimates[name], rtol=1e-12)
    assert match.figure()


@pytest.mark.parametrize(
    ("beam", "names", "message"),
    [
        (ROD, ["width"], "width: changes with the diameter of a circle or a tube; estimate its diameter"),
        (CABLE, ["density"], "density: is not a property of a section of given stiffness"),
        (CABLE, ["diameter"], "diameter: only circles and tubes have one"),
        (ROD, ["diameter", "bending_stiffness"], "unknowns: bending_stiffness contains diameter"),
        (ROD, ["elastic_modulus", "bending_stiffness"], "unknowns: .* changes the same property as"),
    ],
)
def test_properties_that_a_section_does_not_have_are_refused(beam, names, message):
    with pytest.raises(InputError, match=f"^{message}"):
        match_frequencies(beam, targets=[1.0, 6.0], unknowns=[Global(name) for name in names])
