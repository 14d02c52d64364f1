"""Beams with an axial stress while they have their length."""

import math

import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    Clamp,
    EquilibriumError,
    Model,
    Pin,
    StrainMeasures,
    natural_modes,
    simulate,
    static_equilibrium,
)

STRIP = {"length": 0.5, "width": 20e-3, "thickness": 1e-3, "density": 7850.0, "elastic_modulus": 200e9}
AREA, BENDING = 2e-5, 200e9 * 20e-3 * 1e-9 / 12
BUCKLING = math.pi**2 * BENDING / (AREA * 0.5**2)  # Pa, between hinges
HINGED, CLAMPED = (Pin(0.0), Pin(0.5)), (Clamp(0.0), Clamp(0.5))


def strip(supports, elements=12, **given):
    weightless = {"axis": (1.0, 0.0), "gravity": (0.0, 0.0)}
    return Beam.uniform(**STRIP, elements=elements, supports=supports, **weightless | given)


@pytest.mark.parametrize("measures", [StrainMeasures(), StrainMeasures("green", "small")])
@pytest.mark.parametrize("ratio", [-0.9, 3.0, 60.0])
def test_the_frequency_between_hinges_is_that_of_a_beam_under_tension(ratio, measures):
    rest = Model(strip(HINGED, prestress=ratio * BUCKLING), measures)
    unloaded = math.pi / 2 * math.sqrt(BENDING / (7850 * AREA)) / 0.5**2
    found = natural_modes(rest, count=1).frequencies[0]
    assert found == pytest.approx(unloaded * math.sqrt(1 + ratio), rel=1e-4)


def test_a_support_that_stretches_the_strip_has_the_same_effect():
    strain = 1e-5
    stretched = strip((Clamp(0.0), Clamp(0.5, displacement=(0.5 * strain, 0.0))))
    found, expected = (
        natural_modes(Model(beam), count=3).frequencies for beam in (strip(CLAMPED, prestress=2e6), stretched)
    )
    np.testing.assert_allclose(found, expected, rtol=3 * strain)
    assert found[0] > 1.1 * natural_modes(Model(strip(CLAMPED)), count=1).frequencies[0]


def test_a_strip_buckles_beyond_the_critical_stress():
    natural_modes(Model(strip(HINGED, prestress=-0.999 * BUCKLING)), count=1)
    with pytest.raises(EquilibriumError):
        natural_modes(Model(strip(HINGED, prestress=-1.001 * BUCKLING)), count=1)


@pytest.mark.slow
def test_stresses_of_elements_even_out_between_supports_and_vanish_beside_a_free_end():
    """Between supports the tension is the mean; beyond the last one the strip becomes shorter."""
    beam = strip((Clamp(0.0), Pin(0.25)), prestress=[4e6] * 3 + [8e6] * 3 + [10e6] * 6)
    run = simulate(Model(beam), duration=0.01, sample_rate=200.0)
    assert run.axial_force(0.125) == pytest.approx(6e6 * AREA, rel=1e-3)
    assert run.axial_force(0.45) == pytest.approx(0.0, abs=1e-3 * 6e6 * AREA)
    tip = static_equilibrium(Model(beam)).tip
    assert 0.5 - tip[0] == pytest.approx(0.25 * 10e6 / 200e9, rel=1e-3)
