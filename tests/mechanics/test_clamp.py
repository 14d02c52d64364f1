"""A beam with a tip mass and an elastic clamp: closed forms, energy balance and both integrators."""

import numpy as np
import pytest
from scipy.optimize import brentq

from ancf_casadi import (
    ModalDamping,
    Model,
    QuadraticDamping,
    RayleighDamping,
    SampledBase,
    natural_modes,
    simulate,
    static_equilibrium,
)

WEIGHTLESS = {"axis": (1.0, 0.0), "gravity": (0.0, 0.0)}


def roots(equation, count):
    """Values beta L of the lowest modes: the first roots above 0 of a frequency equation."""
    grid = np.arange(0.05, 20.0, 0.05)
    values = np.array([equation(x) for x in grid])
    changes = np.flatnonzero(values[:-1] * values[1:] < 0)[:count]
    return np.array([brentq(equation, grid[k], grid[k + 1], xtol=1e-14) for k in changes])


def in_hertz(beam, beta):
    """Frequency f = (beta L)^2/(2 pi L^2) (EI/mu)^1/2."""
    section = beam.sections[0]
    stiffness, line = beam.elastic_modulus[0] * section.second_moment, beam.density[0] * section.area
    return beta**2 / (2 * np.pi * beam.length**2) * np.sqrt(stiffness / line)


@pytest.mark.parametrize("ratio", [0.1, 1.0, 5.0])
def test_a_tip_mass_lowers_the_frequencies_as_the_frequency_equation_says(paper_beam, ratio):
    """Frequency equation 1 + cos x cosh x = (m/M) x (sin x cosh x - cos x sinh x)."""
    beam = paper_beam(40, **WEIGHTLESS)
    beam = beam.with_(tip_mass=ratio * beam.mass)
    beta = roots(
        lambda x: 1 / np.cosh(x) + np.cos(x) - ratio * x * (np.sin(x) - np.cos(x) * np.tanh(x)),
        3,
    )
    found = natural_modes(Model(beam), count=3).frequencies
    np.testing.assert_allclose(found / (1 + (beta / 40) ** 4 / 1440), in_hertz(beam, beta), rtol=2e-6)


@pytest.mark.parametrize("ratio", [1e-3, 1.0, 50.0, 1e4])
def test_an_elastic_clamp_lowers_the_frequencies_as_the_frequency_equation_says(paper_beam, ratio):
    """Frequency equation k L/(E I) (1 + cos x cosh x) = x (sin x cosh x - cos x sinh x)."""
    beam = paper_beam(40, **WEIGHTLESS)
    stiffness = beam.elastic_modulus[0] * beam.sections[0].second_moment
    beam = beam.with_(clamp_stiffness=ratio * stiffness / beam.length)
    beta = roots(
        lambda x: ratio * (1 / np.cosh(x) + np.cos(x)) - x * (np.sin(x) - np.cos(x) * np.tanh(x)),
        3,
    )
    found = natural_modes(Model(beam), count=3).frequencies
    np.testing.assert_allclose(found / (1 + (beta / 40) ** 4 / 1440), in_hertz(beam, beta), rtol=2e-6)


def test_a_very_stiff_clamp_acts_like_a_rigid_one(paper_beam):
    rigid, stiff = (natural_modes(Model(paper_beam(10, clamp_stiffness=k))).frequencies for k in (np.inf, 1e6))
    np.testing.assert_allclose(stiff, rigid, rtol=1e-5)


def test_the_clamp_rotates_by_the_moment_over_its_stiffness(paper_beam):
    """The clamp also carries the weight of a hanging beam and its tip mass."""
    beam = paper_beam(10, **WEIGHTLESS, clamp_stiffness=0.02)
    rest = static_equilibrium(Model(beam), tip_moment=2e-3)
    first, base = rest.coordinates[4:8], rest.coordinates[:4]
    assert np.arctan2(first[3], first[2]) == pytest.approx(0.1, rel=1e-9)
    np.testing.assert_allclose(base, [0.0, 0.0, 1.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(first[:2], 0.0, atol=1e-12)
    hanging = paper_beam(10, tip_mass=0.05, clamp_stiffness=1.0)
    run = simulate(Model(hanging), duration=0.01)
    weight = 9.81 * (hanging.mass + 0.05)
    np.testing.assert_allclose(run.clamp_force[:, :2], [[0.0, weight]] * len(run.time), atol=1e-6 * weight)
    assert run.axial_force(0.5)[0] == pytest.approx(9.81 * (0.05 + hanging.mass / 40), rel=0.02)


@pytest.mark.parametrize("method", [pytest.param("idas", marks=pytest.mark.slow), "radau"])
def test_the_energy_of_a_large_motion_balances(paper_beam, method):
    """With a tip mass, an elastic clamp and all damping laws at once."""
    model = Model(paper_beam(4, tip_mass=0.005, clamp_stiffness=0.3))
    law = ModalDamping(natural_modes(model, count=2), (0.02, 0.01))
    law += QuadraticDamping(eta1=0.2, eta2=0.3) + RayleighDamping(beta=1e-4)
    start = static_equilibrium(model, tip_force=(0.05, 0.0))
    run = simulate(model, damping=law, start=start, duration=0.4, method=method)
    assert np.ptp(run.tip[:, 0]) > 0.15
    assert run.dissipated_energy[-1] > 0.02 * np.ptp(run.kinetic_energy)
    assert np.abs(run.balance_error).max() < 2e-3 * run.dissipated_energy[-1]


@pytest.mark.slow
def test_a_small_release_swings_with_the_natural_frequency_and_its_damping_ratio(paper_beam):
    """The linear drag acts on the beam alone, mass-proportional damping on the mass at its tip too."""
    model = Model(paper_beam(4, tip_mass=0.01, clamp_stiffness=0.5))
    modes = natural_modes(model, count=1)
    omega = modes.angular_frequencies[0]
    for law in (QuadraticDamping(eta1=0.8), RayleighDamping(alpha=0.8), RayleighDamping(beta=3e-3)):
        expected = law.damping_ratios(modes, [0.0])
        run = simulate(
            model,
            damping=law,
            start=static_equilibrium(model, tip_force=(1e-4, 0.0)),
            duration=float(3.2 * 2 * np.pi / omega),
            method="radau",
            tolerance=1e-10,
        )
        swing = modes.modal_coordinate(run.relative_coordinates, 0)
        peaks = [k for k in range(1, len(swing) - 1) if swing[k - 1] < swing[k] >= swing[k + 1]]
        decrement = np.log(swing[0] / swing[peaks[2]])
        assert decrement / (6 * np.pi) == pytest.approx(float(expected[0]), rel=0.01)
    light, heavy = QuadraticDamping(eta1=0.8), RayleighDamping(alpha=0.8)
    assert light.damping_ratios(modes, [0.0])[0] < 0.7 * heavy.damping_ratios(modes, [0.0])[0]


@pytest.mark.slow
def test_a_rotating_clamp_takes_the_beam_along(paper_beam):
    """Rotated by 90 degrees in 2 s and held, the beam comes to rest in the new direction with a relaxed spring."""
    model = Model(paper_beam(4, axis=(1.0, 0.0), gravity=(0.0, 0.0), tip_mass=0.002, clamp_stiffness=0.4))
    time = np.linspace(0.0, 2.0, 201)
    angle = np.pi / 2 * (time / 2) ** 3 * (10 - 15 * time / 2 + 6 * (time / 2) ** 2)
    base = SampledBase(time, np.zeros((time.size, 2)), rotation=angle)
    run = simulate(model, damping=RayleighDamping(alpha=8.0), base=base, duration=6.0, sample_rate=20.0, method="radau")
    np.testing.assert_allclose(run.tip[-1], [0.0, 0.5], atol=1e-5)
    np.testing.assert_allclose(run.slope(0.0)[-1], np.pi / 2, atol=1e-5)
