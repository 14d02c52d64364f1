"""Floquet multipliers against closed forms, the Mathieu functions and time integration."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import eigvals
from scipy.special import mathieu_a, mathieu_b

from ancf_casadi.exceptions import NumericsError
from ancf_casadi.response.floquet import bifurcations, floquet_multipliers, is_stable


def phases(samples):
    return (2 * np.pi * np.arange(samples) / samples)[:, None, None]


def mathieu(a, q, damping=0.0, samples=32):
    """x_tt + damping x_t + (a - 2 q cos 2t) x = 0, of period pi."""
    return floquet_multipliers(a - 2 * q * np.cos(phases(samples)), np.eye(1) * damping, np.eye(1), np.pi)


def constant_multipliers(K, D, M, period):
    size = len(K)
    state = np.block([[np.zeros((size, size)), np.eye(size)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    return np.exp(eigvals(state) * period)


def distance(found, expected):
    """Return the largest distance of an expected multiplier from the nearest one found."""
    return np.abs(np.asarray(found)[:, None] - np.asarray(expected)).min(axis=0).max()


def lightly_damped(size, highest):
    """Return matrices with frequencies from 1 to `highest`, damping ratios from 0 to 1e-3, and full coupling."""
    V = np.eye(size) + 0.3 * np.random.default_rng(size).standard_normal((size, size))
    ω = np.geomspace(1, highest, size)
    ζ = np.linspace(0, 1e-3, size)
    return V.T @ np.diag(ω**2) @ V, V.T @ np.diag(2 * ζ * ω) @ V, V.T @ V


@pytest.mark.parametrize(("samples", "highest"), [(32, 8), (64, 16), (128, 32)])
def test_constant_matrices_give_the_exponentials_of_their_eigenvalues(samples, highest):
    K, D, M = lightly_damped(6, highest)
    found = floquet_multipliers(np.broadcast_to(K, (samples, 6, 6)), D, M, 2 * np.pi)
    expected = constant_multipliers(K, D, M, 2 * np.pi)
    assert distance(found, expected) < 3e-6  # at N/4 oscillations per period; much less below
    assert np.all(np.diff(np.abs(found)) <= 0)
    finer = floquet_multipliers(np.broadcast_to(K, (2 * samples, 6, 6)), D, M, 2 * np.pi)
    assert distance(finer, expected) < 1e-9


@pytest.mark.parametrize("q", [0.2, 1.0, 5.0])
@pytest.mark.parametrize(
    ("m", "characteristic"), [(1, mathieu_a), (1, mathieu_b), (2, mathieu_a), (2, mathieu_b), (3, mathieu_a)]
)
def test_the_multipliers_on_the_boundaries_of_the_mathieu_equation_are_plus_or_minus_one(q, m, characteristic):
    multipliers = mathieu(characteristic(m, q), q)
    assert multipliers.sum() == pytest.approx(2 * (-1) ** m, abs=1e-9)  # each has an error of a root: they coincide
    assert multipliers.prod() == pytest.approx(1, abs=1e-10)


@pytest.mark.parametrize("m", [1, 2])
def test_the_mathieu_equation_is_unstable_in_its_tongues_only(m):
    q = 0.8
    low, high = sorted((mathieu_a(m, q), mathieu_b(m, q)))
    assert is_stable(mathieu(low - 1e-4, q)) and is_stable(mathieu(high + 1e-4, q))
    assert not is_stable(mathieu(low + 1e-4, q)) and not is_stable(mathieu(high - 1e-4, q))


def test_viscous_damping_shifts_the_mathieu_equation():
    a, q, c = 1.3, 0.8, 0.06
    undamped = mathieu(a, q)
    damped = mathieu(a + c**2 / 4, q, damping=c)
    assert distance(damped, np.exp(-c * np.pi / 2) * undamped) < 1e-11


@pytest.mark.parametrize("stiff", [1e2, 1e8, 1e10])
def test_a_constant_system_seen_from_rotating_axes_keeps_its_multipliers(stiff):
    """A mass on a stiff rod along an axis that turns: x = R(t) y, with constant coefficients for y."""
    samples, Ω = 64, 2 * np.pi
    φ, J = phases(samples), np.array([[0.0, -1.0], [1.0, 0.0]])
    R = np.cos(φ) * np.eye(2) + np.sin(φ) * J
    K, D = np.diag([7.0**2, stiff]), np.diag([0.02, 1e-3 * stiff**0.5])
    D_turning = R @ D @ R.transpose(0, 2, 1)
    K_turning = R @ (K - Ω * D @ J) @ R.transpose(0, 2, 1)  # the damper turns with the axes
    found = floquet_multipliers(K_turning, D_turning, np.eye(2), 1.0)
    expected = constant_multipliers(K - Ω**2 * np.eye(2), D + 2 * Ω * J, np.eye(2), 1.0)
    slow = expected[np.argsort(-np.abs(expected))][:2]
    assert distance(found, slow) < max(1e-10, 1e-17 * stiff)  # rounding of the stiffness
    assert is_stable(found) == is_stable(slow)


def varying_system(φ):
    """Return matrices of three coupled degrees of freedom, all of which vary."""
    K, D, M = lightly_damped(3, 4.0)
    return (
        K * (1 + 0.2 * np.exp(np.cos(φ))) + 0.3 * np.sin(2 * φ),
        D + 0.1 * np.exp(np.sin(φ)),
        M * (1 + 0.1 * np.cos(φ)),
    )


def test_the_product_of_the_multipliers_follows_the_integral_of_the_damping():
    period = 5.0
    K, D, M = varying_system(phases(64))
    traces = np.trace(np.linalg.solve(M, D), axis1=1, axis2=2)
    assert floquet_multipliers(K, D, M, period).prod() == pytest.approx(np.exp(-period * traces.mean()), rel=1e-9)


def test_the_multipliers_are_those_of_the_monodromy_matrix_by_time_integration():
    def rate(t, z):
        (K, D, M), z = varying_system(2 * np.pi * t / 5), z.reshape(6, 6)
        return np.concatenate([z[3:], -np.linalg.solve(M, K @ z[:3] + D @ z[3:])]).ravel()

    run = solve_ivp(rate, (0, 5), np.eye(6).ravel(), method="DOP853", rtol=1e-12, atol=1e-13)
    expected = np.linalg.eigvals(run.y[:, -1].reshape(6, 6))
    assert distance(floquet_multipliers(*varying_system(phases(64)), 5.0), expected) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("samples", [64, 512])
def test_fast_vibrations_of_a_fine_mesh_stay_stable_and_leave_slow_ones_alone(samples):
    size = 40
    φ = phases(samples)
    ω = np.geomspace(1, 1e5, size)
    generator = np.random.default_rng(3)
    V = np.linalg.qr(generator.standard_normal((size, size)))[0]
    turn = 0.3 * np.sin(φ) * (np.eye(size, k=1) - np.eye(size, k=-1))
    R = V @ np.linalg.solve(np.eye(size) - turn, np.eye(size) + turn)  # rotates soft directions into stiff ones
    K = (R * ω**2) @ R.transpose(0, 2, 1)
    assert is_stable(floquet_multipliers(K, 1e-3 * np.eye(size), np.eye(size), 2 * np.pi))


@pytest.mark.parametrize("matrix", [0, 1, 2])
def test_matrices_that_are_not_finite_give_one_clear_line(matrix):
    matrices = [np.tile(np.eye(2), (8, 1, 1)) for _ in range(3)]
    matrices[matrix][3, 1, 1] = np.nan
    with pytest.raises(NumericsError, match="Floquet multipliers"):
        floquet_multipliers(*matrices, 1.0)


def test_a_loss_of_stability_is_named_after_the_multiplier_that_crosses_the_unit_circle():
    inside = np.array([0.9 + 0.1j, 0.9 - 0.1j, 0.95, 0.3], dtype=complex)
    above, below = inside.copy(), inside.copy()
    above[2], below[3] = 1.05, -1.1
    pair = np.array([0.9 + 0.5j, 0.9 - 0.5j, 0.95, 0.3], dtype=complex)
    assert bifurcations(inside, above, turned=True) == ("fold",)
    assert bifurcations(above, inside, turned=False) == ("branch point",)
    assert bifurcations(inside, below, turned=False) == ("period doubling",)
    assert bifurcations(pair, inside, turned=False) == ("Neimark-Sacker",)
    assert bifurcations(inside, inside, turned=False) == ()


def test_several_multipliers_may_cross_between_two_points():
    inside = np.array([0.9 + 0.1j, 0.9 - 0.1j, 0.95, -0.9], dtype=complex)
    outside = np.array([1.0 + 0.5j, 1.0 - 0.5j, 1.1, -1.2], dtype=complex)
    assert bifurcations(inside, outside, turned=True) == ("fold", "period doubling", "Neimark-Sacker")
    both = np.array([1.3, 1.2, 0.95, -0.9], dtype=complex)
    assert bifurcations(inside, both, turned=False) == ("branch point",)


def test_conjugates_that_meet_on_the_real_axis_outside_the_circle_do_not_bifurcate():
    pair, reals = np.array([-1.2 + 0.1j, -1.2 - 0.1j]), np.array([-1.3 + 0j, -1.1 + 0j])
    assert bifurcations(pair, reals, turned=False) == ()
    assert bifurcations(np.array([0.9, 0.8]) + 0j, np.array([0.7 + 0.1j, 0.7 - 0.1j]), turned=False) == ()


def test_rounding_of_undamped_vibrations_is_no_instability():
    undamped = np.exp(1j * np.array([0.3, -0.3, 2.0, -2.0])) * (1 + 1e-8)
    assert is_stable(undamped)
    assert not is_stable(undamped * (1 + 2e-6))


@pytest.mark.parametrize(("m", "name"), [(1, "period doubling"), (2, "branch point")])
def test_the_tongues_of_the_damped_mathieu_equation_begin_at_named_bifurcations(m, name):
    q = 0.8
    low, high = sorted((mathieu_a(m, q), mathieu_b(m, q)))
    outside, within = (mathieu(a, q, damping=0.01) for a in (low - 0.05, (low + high) / 2))
    assert bifurcations(outside, within, turned=False) == (name,)


def test_a_combination_resonance_of_two_oscillators_is_a_neimark_sacker_point():
    """Coupled by the excitation at the sum of their frequencies 1 and 2^1/2 (Nayfeh and Mook, Section 5.4)."""
    coupling = np.array([[0.0, 1.0], [1.0, 0.0]])

    def multipliers(strength):
        K = np.diag([1.0, 2.0]) + strength * coupling * np.cos(phases(64))
        return floquet_multipliers(K, 0.02 * np.eye(2), np.eye(2), 2 * np.pi / (1 + 2**0.5))

    assert bifurcations(multipliers(0.0), multipliers(0.2), turned=False) == ("Neimark-Sacker",)
    assert is_stable(multipliers(0.02))
