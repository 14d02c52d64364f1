"""One-mode equation of motion: another integrator, its linear closed form, and its order."""

import math

import casadi as cs
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ancf_casadi.decay.closed_forms import linear_decay, quadratic_decay
from ancf_casadi.decay.one_mode import longest_step, one_mode_decay
from problems import compare_decay_laws, fit_decay

ω = 2 * math.pi * 1.85
TIME = np.arange(0.0, 5.0, 1 / 200)


def decay(η1, η2, r0=0.076, v0=-0.1, time=TIME, angle=0.1):
    return np.asarray(cs.evalf(one_mode_decay(time, *map(cs.MX, (ω, η1, η2, r0, v0)), longest_step=angle / ω))).ravel()


def reference(η1, η2, r0=0.076, v0=-0.1):
    return solve_ivp(
        lambda t, y: [y[1], -η1 * y[1] - η2 * y[1] * abs(y[1]) - ω**2 * y[0]],
        (0.0, TIME[-1]),
        [r0, v0],
        t_eval=TIME,
        rtol=1e-12,
        atol=1e-14,
    ).y[0]


@pytest.mark.parametrize(("η1", "η2"), [(0.15, 0.11), (0.0, 3.0), (1.0, 2.0), (0.0, 0.0)])
@pytest.mark.parametrize("every", [1, 20])
def test_it_is_the_solution_of_another_integrator(η1, η2, every):
    time = TIME[::every]
    np.testing.assert_allclose(decay(η1, η2, time=time), reference(η1, η2)[::every], atol=1.5e-6 * 0.076)


def test_without_drag_it_is_the_closed_form():
    closed = np.asarray(linear_decay(cs.DM(TIME), ω, 0.15 / (2 * ω), 0.076, -0.1)).ravel()
    np.testing.assert_allclose(decay(0.15, 0.0), closed, atol=1e-7 * 0.076)


def test_errors_fall_with_the_third_power_of_the_step_at_least():
    time = TIME[::20]
    exact = reference(0.5, 5.0)[::20]
    coarse, fine = (np.abs(decay(0.5, 5.0, time=time, angle=a) - exact).max() for a in (1.2, 0.15))
    assert coarse > 8**3 * fine


@pytest.mark.parametrize(("η1", "η2"), [(0.0, 0.25), (0.0, 3.0), (0.25, 0.0)])
@pytest.mark.parametrize("error", [1e-4, 1e-5])
def test_the_longest_step_keeps_the_error_asked_for(η1, η2, error):
    """Damping ratios of 1 to 12 % at the release, and steps of 0.14 to 0.35 rad."""
    amplitude = math.hypot(0.076, 0.1 / ω)
    ratio = η1 / (2 * ω) + 4 * η2 * amplitude / (3 * math.pi)
    angle = ω * longest_step(ω, ratio, error)
    assert 0.1 < angle < 0.4
    time = TIME[::20]
    assert np.abs(decay(η1, η2, time=time, angle=angle) - reference(η1, η2)[::20]).max() < error * amplitude


def test_derivatives_are_those_of_differences():
    time = np.random.default_rng(4).permutation(TIME)[:60]
    x, values = cs.MX.sym("x", 5), np.array([ω, 0.15, 0.5, 0.076, -0.1])
    y = one_mode_decay(time, *cs.vertsplit(x), longest_step=0.1 / ω)
    slopes = cs.jtimes(y, x, cs.DM.eye(5))
    bend = cs.hessian(cs.sumsqr(y), x)[0]
    both = cs.Function("both", [x], [y, slopes, cs.gradient(cs.sumsqr(y), x), bend])
    changes = 1e-5 * np.diag(np.abs(values))
    found, jacobian, gradient, hessian = (np.asarray(item) for item in both(values))
    for k, change in enumerate(changes):
        ahead, _, slope_ahead, _ = (np.asarray(item).ravel() for item in both(values + change))
        behind, _, slope_behind, _ = (np.asarray(item).ravel() for item in both(values - change))
        width = 2 * change[k]
        np.testing.assert_allclose(jacobian[:, k], (ahead - behind) / width, atol=1e-7 * np.abs(jacobian[:, k]).max())
        curvature = (slope_ahead - slope_behind) / width
        np.testing.assert_allclose(hessian[:, k], curvature, atol=1e-6 * np.abs(hessian[:, k]).max())
    np.testing.assert_allclose(gradient, 2 * jacobian.T @ found, rtol=1e-9)


def test_times_may_be_uneven_and_in_any_order():
    order = np.random.default_rng(1).permutation(len(TIME))[:50]
    np.testing.assert_allclose(decay(0.15, 0.5, time=TIME[order]), decay(0.15, 0.5)[order], atol=2e-6 * 0.076)


def test_a_fit_of_the_equation_recovers_strong_damping_from_its_first_guess():
    """Eq. (27) is inaccurate here: the equivalent ratio is 15 % at the release."""
    truth = 0.5, 4.0
    y = reference(*truth) + 2e-5 * np.random.default_rng(2).standard_normal(len(TIME))
    fit = fit_decay(TIME, y, law="one-mode")
    assert fit.eta1 == pytest.approx(0.5, abs=4 * fit.standard_errors["eta1"])
    assert fit.eta2 == pytest.approx(4.0, abs=4 * fit.standard_errors["eta2"])
    assert fit.frequency == pytest.approx(1.85, abs=4 * fit.standard_errors["frequency"])
    assert fit.residual_rms == pytest.approx(2e-5, rel=0.1)
    np.testing.assert_allclose(fit.displacement(TIME) - fit.residuals, y, atol=1e-12)
    averaged = fit_decay(TIME, y, law="quadratic")
    assert averaged.residual_rms > 3 * fit.residual_rms
    assert abs(averaged.frequency - 1.85) > 20 * fit.standard_errors["frequency"]
    assert compare_decay_laws(TIME, y, laws=("quadratic", "one-mode")).best.law == "one-mode"


def test_with_little_damping_both_laws_agree():
    y = np.asarray(quadratic_decay(cs.DM(TIME), ω, 0.03, 0.1, 0.076, 0.1)).ravel()
    y += 2e-4 * np.random.default_rng(3).standard_normal(len(TIME))
    averaged, exact = (fit_decay(TIME, y, law=law) for law in ("quadratic", "one-mode"))
    for name in ("frequency", "eta1", "eta2", "amplitude", "damping_ratio"):
        error, value = averaged.standard_errors[name], getattr(averaged, name)
        assert getattr(exact, name) == pytest.approx(value, abs=0.6 * error + 0.1 * averaged.damping_ratio * value)
        assert exact.standard_errors[name] == pytest.approx(error, rel=0.1)


def test_a_fit_starts_from_a_closed_form_that_is_far_off():
    """At the release the equivalent ratio is 1.3, where Eq. (27) would have it 3.5."""
    truth = 0.5, 40.0
    y = reference(*truth) + 2e-5 * np.random.default_rng(5).standard_normal(len(TIME))
    fit = fit_decay(TIME, y, law="one-mode", release_time=0.0)
    assert fit.eta1 == pytest.approx(0.5, abs=4 * fit.standard_errors["eta1"])
    assert fit.eta2 == pytest.approx(40.0, abs=4 * fit.standard_errors["eta2"])
    assert fit.residual_rms == pytest.approx(2e-5, rel=0.1)
