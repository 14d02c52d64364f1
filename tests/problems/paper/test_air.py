"""Air drag and viscous damping, against closed forms, limits, and the integral equation of the flow around a strip."""

import numpy as np
import pytest
from scipy.special import kv

from ancf_casadi import Model, QuadraticDamping, natural_modes
from problems.paper.air import (
    Air,
    circular_function,
    hydrodynamic_function,
    implied_drag_coefficient,
    viscous_damping_ratios,
)

NU = 1.81e-5 / 1.2


@pytest.fixture(scope="module")
def modes(weightless):
    return natural_modes(weightless)


def strip_function(reynolds: float, points: int = 300) -> complex:
    """Gamma of an infinitely thin strip, from the oscillating Stokes flow of forces across it.

    In units of the half width, a force f per length at 0 moves the fluid at x by f A(lambda |x|)/(4 pi eta), with
    A(R) = 2 (K0 + K1/R - 1/R^2) and lambda^2 = -i Re.  Collocation finds the density g(theta) of the forces, x = cos
    theta, that gives every point the velocity of the strip.  The logarithm in A is integrated exactly:
    int_0^pi ln|cos s - cos t| cos n t dt = -pi/n cos n s, and -pi ln 2 for n = 0.
    """
    lam = np.sqrt(-1j * reynolds)
    n = np.arange(points)
    theta = (n + 0.5) * np.pi / points
    distance = abs(np.cos(theta)[:, None] - np.cos(theta)) + 2 * np.eye(points)
    R = lam * distance
    smooth = 2 * (kv(0, R) + kv(1, R) / R - 1 / R**2) + np.log(distance)
    np.fill_diagonal(smooth, -np.log(lam / 2) - np.euler_gamma - 0.5)
    to_cosines = np.where(n == 0, 1, 2)[:, None] / points * np.cos(np.outer(n, theta))
    logarithm = np.cos(np.outer(theta, n)) * -np.pi * np.where(n == 0, np.log(2), 1 / np.maximum(n, 1))
    density = np.linalg.solve(np.pi / points * smooth - logarithm @ to_cosines, np.ones(points))
    return 4j / reynolds * np.pi * density.mean()


@pytest.mark.parametrize("reynolds", [1e-3, 0.1, 1.0, 4.8, 30.0, 200.0])
def test_the_hydrodynamic_function_is_that_of_the_flow_around_a_strip(reynolds):
    assert hydrodynamic_function(np.array(reynolds)) == pytest.approx(strip_function(reynolds), rel=2e-3)


def test_at_large_reynolds_numbers_a_cylinder_loses_energy_in_its_boundary_layer_only():
    """Surface velocity 2 U sin(theta) over a Stokes layer: Im Gamma = (8/Re)^1/2; added mass of an ideal fluid, 1."""
    reynolds = np.array([1e6, 1e8])
    gamma = circular_function(reynolds)
    np.testing.assert_allclose(gamma.imag, np.sqrt(8 / reynolds), rtol=3e-3)
    np.testing.assert_allclose(gamma.real, 1.0, atol=3e-3)


def test_air_viscosity_causes_nearly_a_tenth_of_the_damping_of_mode_1(modes):
    """pi rho_air b Im Gamma/(8 rho h) at 1.85 Hz: 0.088 % for a strip; 0.098 % with Gamma of a circular cylinder."""
    tuned = natural_modes(Model(modes.model.beam.with_(elastic_modulus=210e9 * (1.85 / modes.frequencies[0]) ** 2)))
    ratio = viscous_damping_ratios(tuned, Air())[0]
    factor = np.pi * 1.2 * 5e-3 / (8 * 8000 * 0.5e-3)
    assert ratio == pytest.approx(factor * strip_function(2 * np.pi * 1.85 * 5e-3**2 / (4 * NU)).imag, rel=2e-3)
    assert 0.085 < 100 * ratio < 0.102


@pytest.mark.slow
def test_the_viscous_force_on_a_tapered_strip_takes_the_energy_that_the_ratio_says(paper_beam):
    """Loss 4 pi zeta times the energy; the loss is pi omega int c phi^2 dp, with c of the width at each point."""
    beam = paper_beam(4, width=(7e-3, 6e-3, 4.5e-3, 3e-3), gravity=(0.0, 0.0))
    modes = natural_modes(Model(beam), count=2)
    omega, width = modes.angular_frequencies, np.array(beam.width)
    gamma = np.array([[strip_function(ω * b**2 / (4 * NU)) for ω in omega] for b in width])
    c = np.pi / 4 * 1.2 * omega * width[:, None] ** 2 * gamma.imag
    points = (np.arange(1000) + 0.5) / 1000 * 0.5
    squares = np.array([((modes.model.interpolation(s) @ modes.shapes) ** 2).sum(axis=0) for s in points])
    loss = np.pi * omega * (np.repeat(c, 250, axis=0) * squares).mean(axis=0) * 0.5  # at unit modal amplitude
    np.testing.assert_allclose(viscous_damping_ratios(modes, Air()), loss / (4 * np.pi * omega**2 / 2), rtol=3e-3)


def test_the_drag_coefficients_of_the_first_three_modes_of_table_4_are_0_99_0_54_and_0_45(paper_beam):
    coefficients = [implied_drag_coefficient(eta2, paper_beam(), Air())[0] for eta2 in (0.11, 0.06, 0.05)]
    assert coefficients == pytest.approx([0.99, 0.54, 0.45], abs=5e-3)
    assert coefficients[0] == pytest.approx(2 * 8000 * 0.5e-3 * 0.11 * 1183 / 876 / 1.2)


def test_the_drag_coefficient_returns_the_law_from_which_it_follows(paper_beam):
    beam = paper_beam(thickness=tuple(0.5e-3 * np.linspace(1.1, 0.9, 20)))
    eta2 = QuadraticDamping.from_drag(1.3, 1.18, beam).eta2
    assert implied_drag_coefficient(eta2, beam, Air(density=1.18))[0] == pytest.approx(1.3)


@pytest.mark.slow
def test_errors_of_eta2_and_of_the_density_of_the_air_add_up_as_in_seeded_draws(paper_beam):
    rng, beam = np.random.default_rng(0), paper_beam()
    draws = [
        implied_drag_coefficient(eta2, beam, Air(density=density))[0]
        for eta2, density in zip(rng.normal(0.11, 0.004, 4000), rng.normal(1.2, 0.03, 4000), strict=True)
    ]
    _, error = implied_drag_coefficient(0.11, beam, Air(density_std=0.03), eta2_error=0.004)
    assert error == pytest.approx(np.std(draws), rel=0.05)
