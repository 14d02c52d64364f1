"""Decay with friction: averaged equation, limits, numerical solution, and derivatives."""

import math

import casadi as cs
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ancf_casadi.decay.closed_forms import (
    equivalent_damping_ratio,
    friction_decay,
    friction_envelope,
)

ω, E0 = 11.6, 0.076
TIME = np.arange(0.0, 5.0, 1 / 500)
TERMS = [  # eta0 in m/s^2, eta1 in 1/s, eta2 in 1/m: each alone, and all signs of a^2/4 - b c
    (0.05, 0.0, 0.0),
    (0.0, 0.15, 0.0),
    (0.0, 0.0, 0.11),
    (0.05, 0.15, 0.0),
    (0.05, 0.15, 0.11),
    (0.02, 0.0, 0.33),
    (1e-9, 0.15, 0.11),
    (0.01, 0.5, 0.2),
]


def numbers(value):
    return np.asarray(value).ravel()


def motion(η0, η1, η2, e0=E0, end=5.0):
    """Eq. (26) with friction, by half swings: sign(r') is constant in each, so that the integrator sees no jump."""
    times, values, state, start, sign = [], [], [e0, 0.0], 0.0, -1.0

    def turn(t, y, sign):
        return sign * y[1] if t > start + 1e-9 else 1.0

    turn.terminal, turn.direction = True, -1
    while start < end and abs(state[0]) * ω**2 > η0:
        run = solve_ivp(
            lambda t, y, s: [y[1], -η0 * s - η1 * y[1] - η2 * y[1] * abs(y[1]) - ω**2 * y[0]],
            (start, min(end, start + 1.0)),
            state,
            events=turn,
            args=(sign,),
            method="DOP853",
            rtol=1e-11,
            atol=1e-14,
            dense_output=True,
        )
        now = (start <= TIME) & (run.t[-1] > TIME)
        times.append(TIME[now])
        values.append(run.sol(TIME[now]))
        start, state, sign = run.t[-1], [run.y[0, -1], 0.0], -sign
    return np.concatenate(times), np.concatenate(values, axis=1)


@pytest.mark.parametrize(("η0", "η1", "η2"), TERMS)
def test_the_decay_approximates_a_numerical_solution(η0, η1, η2):
    """Within the band of rest, which each half swing is off by, and the first order in the damping ratio."""
    times, (r, v) = motion(η0, η1, η2)
    assert times[-1] > 4.0
    closed = numbers(friction_decay(cs.DM(times), ω, η0, η1, η2, E0, 0.0))
    assert np.abs(closed - r).max() < 1.2 * η0 / ω**2 + 1.1 * E0 * equivalent_damping_ratio(η1, η2, ω, E0)
    last = slice(-542, None)  # two periods
    amplitude = np.hypot(r, v / ω)[last].mean()
    closed, without = (numbers(friction_envelope(cs.DM(times), ω, f, η1, η2, E0))[last].mean() for f in (η0, 0.0))
    assert closed == pytest.approx(amplitude, rel=0.03)
    assert without - amplitude > 8 * abs(closed - amplitude) or η0 < 1e-6


def test_friction_alone_takes_the_same_off_each_period_to_the_end():
    """4 eta0/omega^2 a period: exact, and what the peaks of a numerical solution show."""
    η0, period = 0.05, 2 * math.pi / ω
    peaks = numbers(friction_envelope(cs.DM(period * np.arange(20)), ω, η0, 0.0, 0.0, E0))
    np.testing.assert_allclose(-np.diff(peaks), 4 * η0 / ω**2, rtol=1e-12)
    times, (r, _) = motion(η0, 0.0, 0.0)
    measured = [r[np.argmin(np.abs(times - k * period))] for k in range(8)]
    np.testing.assert_allclose(measured, peaks[:8], rtol=1e-3)
    ends = E0 * math.pi * ω / (2 * η0)
    quarter = period / 4
    last = numbers(friction_envelope(cs.DM([ends - quarter, ends, ends + quarter, 10 * ends]), ω, η0, 0.0, 0.0, E0))
    np.testing.assert_allclose(last, np.array([1.0, 3 / 16, 0.0, 0.0]) * η0 / ω**2, atol=1e-8)


def test_with_all_terms_the_mode_stops_once_and_for_all():
    envelope = numbers(friction_envelope(cs.DM(np.linspace(0.0, 500.0, 20001)), ω, 0.05, 0.15, 5.0, E0))
    stop = int(np.argmin(envelope))
    assert 0 < stop < 2000
    assert (np.diff(envelope[: stop + 1]) < 0.0).all()
    assert (envelope[stop:] == 0.0).all()


@pytest.mark.parametrize("η0", [0.0, 1e-6, 0.03, 0.0612, 0.08])
@pytest.mark.parametrize("symbol", [cs.SX.sym, cs.MX.sym])
def test_derivatives_agree_with_differences(η0, symbol):
    x = symbol("x", 6)
    a = friction_decay(2.0, *(x[i] for i in range(6)))
    point = np.array([ω, η0, 0.3, 0.33, E0, 0.2])
    evaluate = cs.Function("evaluate", [x], [a, cs.gradient(a, x), cs.hessian(a, x)[0]])
    gradient, hessian = (item.full() for item in evaluate(point)[1:])
    assert np.isfinite(hessian).all()
    for i, h in enumerate((1e-5, 1e-5, 1e-4, 1e-4, 1e-5, 1e-4)):
        step = h * np.eye(6)[i]
        (above, slope_above, _), (below, slope_below, _) = evaluate(point + step), evaluate(point - step)
        assert gradient[i, 0] == pytest.approx(float(above - below) / (2 * h), rel=1e-5, abs=1e-7)
        np.testing.assert_allclose(
            hessian[i], (slope_above - slope_below).full().ravel() / (2 * h), rtol=1e-3, atol=1e-5
        )
