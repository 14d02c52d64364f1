"""Amplitude, its integrals and the phase, against numerical integration of the averaged equations and of Duffing's."""

import math
from itertools import product

import casadi as cs
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import gammaln

from ancf_casadi.decay.closed_forms import (
    friction_envelope,
    mean_power,
    power_coefficient,
    power_envelope,
    power_ratio,
    quadratic_envelope,
)
from ancf_casadi.decay.phase import frequency_change, integral
from ancf_casadi.decay.smooth import flow_amplitude
from tests.decay.integration import integrated

ω, E0 = 11.6, 0.076
NODES = E0 * 50.0 ** (-np.arange(7) / 6)  # of a smooth frequency


def two_steps(A):
    """Return a change of the frequency in two of the steps of a smooth one, from its value at the third node."""
    small, large = ([a**2 / (a**2 + c**2) for a in (A, NODES[2])] for c in (0.02 * E0, 1.5 * E0))
    return 0.01 * (small[0] - small[1]) - 0.02 * (large[0] - large[1])


TIME = np.linspace(0.0, 5.0, 101)
TERMS = [  # eta0 in m/s^2, eta1 in 1/s, eta2 in 1/m: each alone, all pairs, limits, and all signs of a^2/4 - b c
    (0.0, 0.0, 0.0),
    (0.0, 0.15, 0.0),
    (0.0, 0.0, 0.33),
    (0.0, 0.15, 0.11),
    (0.0, 1e-9, 0.33),
    (0.0, 3.0, 1e-7),
    (0.0, 1e-3, 50.0),
    (0.05, 0.0, 0.0),
    (0.02, 0.15, 0.0),
    (0.02, 0.0, 0.33),
    (0.02, 0.15, 0.11),
    (1e-9, 0.15, 0.11),
    (0.03, 1e-8, 1e-8),
    (0.01, 0.5, 0.2),
]
EXPONENTS = [0.0, 0.3, 0.5, 0.9, 0.9999, 1.0, 1.0001, 1.5, 2.0, 3.0, 4.0]


def numbers(envelope, time=TIME):
    """Amplitude, and the integrals of it and of its square, for a function of time."""
    parts = envelope(cs.MX(cs.DM(time))), integral(envelope, time), integral(lambda t: envelope(t) ** 2, time)
    return [cs.evalf(part).full().ravel() for part in parts]


def quadratic(η1, η2):
    return lambda t: quadratic_envelope(t, ω, η1, η2, E0)


def friction(η0, η1, η2):
    return lambda t: friction_envelope(t, *map(cs.MX, (ω, η0, η1, η2, E0)))


def power(rate, p):
    return lambda t: power_envelope(t, ω, rate, p, E0)


def averaged(rate):
    """Amplitude and its integrals by an integrator of order 8."""
    return integrated(lambda A, *_: [rate(A), A, A**2], [E0, 0.0, 0.0], TIME)


@pytest.mark.parametrize(("η0", "η1", "η2"), TERMS)
def test_amplitude_and_integrals_solve_the_averaged_equation(η0, η1, η2):
    a, b, c = η1 / 2, 4 * ω * η2 / (3 * math.pi), 2 * η0 / (math.pi * ω)
    expected = averaged(lambda A: -(c + a * A + b * A**2))
    for envelope in [friction(η0, η1, η2), *([] if η0 else [quadratic(η1, η2)])]:
        for computed, right in zip(numbers(envelope), expected, strict=True):
            np.testing.assert_allclose(computed, right, rtol=1e-10)


@pytest.mark.parametrize("p", EXPONENTS)
def test_the_flow_of_the_power_law_solves_its_averaged_equation(p):
    expected = averaged(lambda A: -0.15 * E0 * (A / E0) ** p)
    for computed, right in zip(numbers(power(0.15, p)), expected, strict=True):
        np.testing.assert_allclose(computed, right, rtol=1e-10)


def test_the_motion_rests_after_the_stop():
    """Friction stops the mode near e0 pi omega/(2 eta0) = 1.4 s, a force with p = 1/2 at 1/(rate (1 - p)) = 2 s."""
    late = np.linspace(2.8, 40.0, 50)
    slowing, rubbing = numbers(power(1.0, 0.5), late), numbers(friction(1.0, 0.1, 0.5), late)
    assert np.abs(rubbing[0]).max() == 0.0
    assert np.abs(slowing[0]).max() < 1e-20
    assert np.isfinite([*rubbing, *slowing]).all()


@pytest.mark.parametrize(("rate", "last"), [(0.0, 1.0), (1e-3, 1.0), (3.0, 1.0), (600.0, 1.0), (0.3, 2e4)])
def test_the_integrals_hold_at_any_rate_and_in_any_order_of_times(rate, last):
    """With linear damping, int A dt = e0 (1 - exp(-a t))/a and int A^2 dt = e0^2 (1 - exp(-2 a t))/(2 a)."""
    time = np.random.default_rng(0).permutation(np.concatenate([np.geomspace(1e-6, 1.0, 200), [0.0, 0.5]])) * last
    _, first, second = numbers(quadratic(2 * rate, 0.0), time)
    scale = rate or 1e-30
    np.testing.assert_allclose(first, -E0 * np.expm1(-scale * time) / scale, rtol=1e-10, atol=1e-25)
    np.testing.assert_allclose(second, -(E0**2) * np.expm1(-2 * scale * time) / (2 * scale), rtol=1e-10, atol=1e-25)


@pytest.mark.parametrize("law", ["quadratic", "friction", "power"])
def test_derivatives_of_the_integrals_agree_with_differences(law):
    """At the series of the closed forms too: eta1, eta2 and 1 - p are zero or nearly so."""
    points = {
        "quadratic": [(0.3, 0.2, E0), (0.0, 0.2, E0), (0.3, 0.0, E0), (1e-3, 1e-3, E0)],
        "friction": [(0.02, 0.3, 0.2, E0), (0.0, 0.3, 0.2, E0), (0.02, 0.0, 0.0, E0), (0.0612, 0.3, 0.33, E0)],
        "power": [(0.3, 1.5, E0), (0.3, 1.0, E0), (0.3, 0.2, E0), (0.0, 2.0, E0)],
    }[law]
    x, time = cs.MX.sym("x", len(points[0])), np.array([2.0])
    u = cs.vertsplit(x)
    function = {"quadratic": quadratic_envelope, "friction": friction_envelope, "power": power_envelope}[law]
    integrals = [integral(lambda t, n=n: function(t, cs.MX(ω), *u) ** n, time) for n in (1, 2)]
    for part, point in product(integrals, points):
        hessian, gradient = cs.hessian(part, x)
        evaluate = cs.Function("evaluate", [x], [part, gradient, hessian])
        steps = 1e-5 * np.diag(np.maximum(np.abs(point), 0.01))
        _, slope, bend = (np.asarray(item) for item in evaluate(point))
        for k, step in enumerate(steps):
            above, below = evaluate(np.add(point, step)), evaluate(np.subtract(point, step))
            width = 2 * step[k]
            size = np.abs(slope).max()
            assert slope[k, 0] == pytest.approx(float(above[0] - below[0]) / width, rel=1e-6, abs=1e-7 * size)
            difference = np.asarray(above[1] - below[1]).ravel() / width
            np.testing.assert_allclose(bend[k], difference, rtol=1e-5, atol=1e-5 * np.abs(bend).max())


@pytest.mark.parametrize("p", [0.0, 0.5, 1.0, 2.0, 3.3, 4.0])
def test_the_mean_power_of_a_force_is_that_of_its_integral(p):
    phase = (np.arange(200_000) + 0.5) / 200_000 * math.pi / 2
    assert float(mean_power(cs.DM(p))) == pytest.approx(np.mean(np.sin(phase) ** (p + 1)), rel=1e-9)
    exact = math.exp(gammaln(p / 2 + 1) - gammaln(p / 2 + 1.5)) / math.sqrt(math.pi)
    assert float(mean_power(cs.DM(p))) == pytest.approx(exact, rel=1e-14)


def test_friction_linear_and_quadratic_damping_are_powers():
    """Equivalent ratios 2 eta0/(pi omega^2 A), eta1/(2 omega) and 4 eta2 A/(3 pi) with p = 0, 1, 2."""
    A, R = 0.03, 0.05
    for p, η in ((0.0, 0.2), (1.0, 0.3), (2.0, 0.7)):
        ratio = {0.0: 2 * η / (math.pi * ω**2 * A), 1.0: η / (2 * ω), 2.0: 4 * η * A / (3 * math.pi)}[p]
        at_reference = ratio * (A / R) ** (1 - p)
        assert power_ratio(A, at_reference, p, R) == pytest.approx(ratio)
        assert float(power_coefficient(cs.DM(at_reference), cs.DM(p), ω, R)) == pytest.approx(η, rel=1e-12)


@pytest.mark.parametrize("p", [0.5, 1.5, 3.0])
def test_the_power_law_is_the_decay_of_the_oscillator(p):
    """The closed form has an error of first order in the damping ratio, here 0.5 %."""
    ratio = 0.005
    η = float(power_coefficient(cs.DM(ratio), cs.DM(p), ω, E0))
    time = np.linspace(0.0, 12.0, 2001)
    motion = integrated(lambda r, v: [v, -η * abs(v) ** p * np.sign(v) - ω**2 * r], [E0, 0.0], time)
    amplitude = numbers(power(ratio * ω, p), time)[0]
    measured = np.hypot(motion[0], motion[1] / ω)
    assert amplitude[-1] < 0.75 * E0
    assert np.abs(measured - amplitude).max() < 2 * ratio * E0
    other = numbers(power(ratio * ω, p + 0.5), time)[0]
    assert np.abs(measured - other).max() > 3 * ratio * E0


@pytest.mark.parametrize("hardening", [1, -1])
def test_the_phase_of_a_decaying_duffing_oscillator_follows_its_amplitude(hardening):
    """k2 = 3 alpha/(8 omega^2): correct to first order over 30 periods; a constant frequency is off by 1 rad."""
    k2 = hardening * 0.01 / E0**2
    α, η1, η2 = 8 * k2 * ω**2 / 3, 0.05, 0.1
    time = np.linspace(0.0, 60 * math.pi / ω, 6001)
    motion, _ = integrated(lambda r, v: [v, -η1 * v - η2 * v * abs(v) - ω**2 * r - α * r**3], [E0, 0.0], time)
    amplitude, _, second = numbers(quadratic(η1, η2), time)
    late = time > 50 * math.pi / ω
    error = np.abs(amplitude * np.cos(ω * (time + k2 * second)) - motion)[late].max() / amplitude[late].max()
    constant = np.abs(amplitude * np.cos(ω * time) - motion)[late].max() / amplitude[late].max()
    assert error < 0.04
    assert constant > 0.5


def test_the_phase_near_a_stop_is_that_of_the_stopping_amplitude():
    """Friction stops the mode at 2.5 s: the quadrature crosses a corner of the amplitude, over a fine one by panels."""
    time = np.linspace(0.0, 5.0, 2001)
    envelope = friction(0.5, 0.1, 0.3)
    amplitude, first, second = numbers(envelope, time)
    stop = int(np.argmax(amplitude == 0.0))
    assert 400 < stop < 1500
    fine = np.linspace(0.0, 5.0, 200_001)
    exact = cs.evalf(envelope(cs.MX(cs.DM(fine)))).full().ravel()
    for found, values in ((first, exact), (second, exact**2)):
        sums = np.append(0.0, np.cumsum((values[1:] + values[:-1]) / 2 * (fine[1] - fine[0])))
        np.testing.assert_allclose(found, sums[::100], atol=1e-3 * sums[-1])


@pytest.mark.parametrize(
    ("law", "terms", "expected"),
    [
        ("constant", (), lambda A: 0 * A),
        ("linear", (-0.5,), lambda A: -0.5 * A),
        ("quadratic", (3.0,), lambda A: 3.0 * A**2),
        ("power", (0.01, 0.6), lambda A: 0.01 * (A / E0) ** 0.6),
        ("logarithmic", (-0.004, -3.0), lambda A: -0.004 * np.log((A / E0 + np.exp(-3)) / (1 + np.exp(-3)))),
        ("smooth", np.delete(two_steps(NODES), 2), two_steps),
    ],
)
def test_the_phase_is_the_integral_of_the_frequency(law, terms, expected):
    """Of a decay over three decades, by an integrator of order 8; steps have poles near the real amplitudes."""
    rate, time = 0.7, np.linspace(0.0, 10.0, 51)

    def change(t):
        return frequency_change(law, E0 * cs.exp(-rate * t), [cs.MX(term) for term in terms], E0)

    found = cs.evalf(integral(change, time)).full().ravel()
    right = solve_ivp(
        lambda t, y: expected(E0 * np.exp(-rate * t)), (0.0, 10.0), [0.0], t_eval=time, method="DOP853", rtol=1e-12,
        atol=1e-16,
    ).y[0]  # fmt: skip
    np.testing.assert_allclose(found, right, rtol=1e-9, atol=3e-10 if law == "smooth" else 1e-14)


def test_a_smooth_frequency_passes_through_its_values_and_is_constant_below_them():
    amplitudes = np.append(NODES, [1e-5 * E0, 1e-9 * E0])
    values = np.array([0.01, -0.02, 0.03, 0.0, 0.05, -0.01])  # without that at A_2, which is 0
    *found, small, smallest = cs.evalf(
        frequency_change("smooth", cs.MX(cs.DM(amplitudes)), [*map(cs.MX, values)], E0)
    ).full().ravel()  # fmt: skip
    np.testing.assert_allclose(found, np.insert(values, 2, 0.0), atol=1e-12)
    assert small == pytest.approx(smallest, abs=1e-5)


def test_a_logarithmic_frequency_is_linear_in_small_amplitudes_and_stays_bounded():
    amplitudes = E0 * np.array([1e-12, 1e-6, 1.0])
    change = frequency_change("logarithmic", cs.MX(cs.DM(amplitudes)), [cs.MX(-0.004), cs.MX(-5.0)], E0)
    smallest, small, largest = cs.evalf(change).full().ravel()
    corner = E0 * math.exp(-5)
    assert largest == pytest.approx(0.0, abs=1e-15)
    assert smallest == pytest.approx(0.004 * math.log((E0 + corner) / corner), rel=1e-9)
    assert small - smallest == pytest.approx(-0.004 * 1e-6 * E0 / corner, rel=1e-3)


@pytest.mark.parametrize(
    ("ratio", "closed"),
    [
        (lambda A, _: 0.03 + 0 * A, lambda t: E0 * np.exp(-0.03 * ω * t)),
        (lambda A, _: 4 * 5.0 * A / (3 * math.pi), lambda t: E0 / (1 + 4 * ω * 5.0 * E0 * t / (3 * math.pi))),
        (lambda A, _: 1e-4 * E0 / A, lambda t: E0 * (1 - 1e-4 * ω * t)),
    ],
)
def test_the_flow_of_a_damping_ratio_without_a_closed_form(ratio, closed):
    """Also over decades of the amplitude, and at times in any order."""
    time = np.random.default_rng(0).permutation(np.linspace(0.0, 60.0, 301))
    A = cs.evalf(flow_amplitude(ratio, time, cs.MX(E0), cs.MX(ω), [])).full().ravel()
    np.testing.assert_allclose(A, closed(time), rtol=1e-6)
