"""Matching of beams with any supports and attachments to their frequencies."""

import numpy as np
import pytest

from ancf_casadi import Beam, Clamp, InputError, Model, Pin, PointMass, Spring, natural_modes
from problems import Global, MeasuredModes, match_frequencies

STRIP = {"length": 0.5, "width": 20e-3, "thickness": 1e-3, "density": 7850.0, "elements": 8, "axis": (1.0, 0.0)}


def strip(modulus=200e9, **settings):
    return Beam.uniform(**{**STRIP, "elastic_modulus": modulus, **settings})


def clamped(modulus, stiffness):
    """A strip between a rigid clamp and one that yields."""
    return strip(modulus, supports=(Clamp(0.0), Clamp(0.5, stiffness)))


def soft(modulus, stiffness):
    """A strip on two soft springs, free to move along itself."""
    springs = tuple(Spring(s, (0.0, stiffness)) for s in (0.1, 0.4))
    return strip(modulus, gravity=(0.0, 0.0), supports=(), attachments=springs)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "name", "truth", "rigid"),
    [(clamped, "clamp_stiffness", 3.0, 0), (soft, "spring_stiffness", 20.0, 1)],
)
def test_modulus_and_stiffness_from_six_noisy_frequencies(make, name, truth, rigid):
    """The errors are those of the estimates over six draws of the noise."""
    given_beam, unknowns = make(170e9, 1.4 * truth), [Global("elastic_modulus"), Global(name)]
    frequencies = natural_modes(Model(make(200e9, truth)), count=6 + rigid).frequencies[rigid:]
    std, draw, scores = 2e-3 * frequencies, np.random.default_rng(2), []
    for _ in range(6):
        noisy = frequencies + std * draw.standard_normal(6)
        measured = MeasuredModes(tuple(noisy.tolist()), frequency_std=tuple(std.tolist()))
        match = match_frequencies(given_beam, targets=measured, unknowns=unknowns, bounds=0.6)
        assert match.modes == tuple(range(rigid + 1, rigid + 7)) and match.identifiability.rank == 2
        errors = np.array([*match.estimates.values()]) - [200e9, truth]
        scores.append(errors / [*match.standard_errors.values()])
    assert np.abs(scores).max() < 3.5
    assert max(match.standard_errors.values()) > 0.0
    assert "The data determine all 2 unknowns." in match.report()
    assert match.to_dict()["lumped"] == match.beam.lumped


@pytest.mark.slow
def test_one_frequency_determines_a_product_of_modulus_and_stiffness():
    beam = clamped(200e9, 3.0)
    target = 1.01 * natural_modes(Model(beam), count=1).frequencies
    match = match_frequencies(beam, targets=target, unknowns=[Global("elastic_modulus"), Global("clamp_stiffness")])
    (determined, statement) = match.identifiability.statements()
    assert determined.startswith("The data determine 1 independent combinations of the 2 unknowns")
    assert statement.startswith("Of elastic_modulus, clamp_stiffness, they determine only elastic_modulus clamp_stiff")


@pytest.mark.slow
def test_the_curvature_of_an_arch_whose_hinges_stay():
    """The frequencies of an arch between two hinges depend on its curvature, here a negative one."""
    bent = Model(strip(natural_curvature=-0.5))
    x, y = bent.natural_nodes[0][-1].tolist()

    def arch(curvature):
        model = Model(strip(natural_curvature=curvature, gravity=(0.0, 0.0)))
        shift = np.array([x, y]) - model.natural_nodes[0][-1]
        return model.beam.with_(supports=(Pin(0.0), Pin(0.5, displacement=tuple(shift.tolist()))))

    targets = natural_modes(Model(arch(-0.45)), count=3).frequencies
    measured = MeasuredModes(tuple(targets.tolist()), frequency_std=tuple((1e-3 * targets).tolist()))
    match = match_frequencies(arch(-0.5), targets=measured, unknowns=[Global("natural_curvature")], bounds=0.3)
    assert match.estimates["natural_curvature"] == pytest.approx(-0.45, rel=1e-5)
    low, high = match.intervals()["natural_curvature"]
    assert low < -0.45 < high < 0.0 < match.standard_errors["natural_curvature"]
    assert match.profile("natural_curvature") == pytest.approx((low, high), rel=1e-2)
    assert natural_modes(Model(match.beam), count=3).frequencies == pytest.approx(targets, rel=1e-6)
    assert match.beam.supports[1].displacement == pytest.approx(arch(-0.45).supports[1].displacement, abs=1e-6)


@pytest.mark.slow
def test_the_prestress_of_a_strip_between_two_clamps():
    def pulled(prestress):
        return strip(supports=(Clamp(0.0), Clamp(0.5)), gravity=(0.0, 0.0), prestress=prestress)

    targets = natural_modes(Model(pulled(2e6)), count=3).frequencies
    match = match_frequencies(pulled(1.5e6), targets=targets, unknowns=[Global("prestress")], bounds=0.5)
    assert match.estimates["prestress"] == pytest.approx(2e6, rel=1e-5)
    assert match.beam.prestress == pytest.approx([2e6] * match.beam.elements, rel=1e-5)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["mass_2"], "unknowns: the beam has no mass_2 to change; give the beam a first value of it"),
        (["natural_curvature"], "natural_curvature: cannot be estimated for a beam with a Spring at 0.25 m"),
        (["spring_y", "spring_stiffness"], "unknowns: spring_stiffness changes the same property as spring_y"),
    ],
)
def test_unknowns_that_a_beam_does_not_have_are_refused(names, message):
    beam = strip(natural_curvature=0.1, attachments=(PointMass(0.2, 1e-3), Spring(0.25, (0.0, 5.0))))
    with pytest.raises(InputError) as caught:
        match_frequencies(beam, targets=[3.0], unknowns=[Global(name) for name in names])
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize("count", [4, 5])
def test_modes_of_equal_frequency_are_not_told_apart(count):
    """Two halves beside a clamp in the middle: rounding alone decides which of a pair is the lower one."""
    beam = strip(gravity=(0.0, 0.0), supports=(Clamp(0.25),))
    frequencies = natural_modes(Model(beam), count=count).frequencies
    targets = tuple((frequencies * (1.01 + 1e-9 * np.arange(count))).tolist())
    match = match_frequencies(beam, targets=targets, unknowns=[Global("thickness")])
    assert match.modes == tuple(range(1, count + 1)) and not match.warnings
