import math
import re

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import FixedBase, HarmonicBase, InputError, SampledBase, SweepBase


def motion(base, instants, order=0):
    """Displacement and rotation (k, 3) of a base, or their derivatives, from the piece at each instant."""
    t, result = cs.MX.sym("t"), []
    values = cs.DM([parameter.value for parameter in base.parameters])
    functions = []
    for piece in base.pieces():
        u = cs.densify(piece.at(t, values))
        for _ in range(order):
            u = cs.jacobian(u, t)
        functions.append((piece.end, cs.Function("u", [t], [cs.densify(u)])))
    for instant in instants:
        function = next(function for end, function in functions if instant <= end)
        result.append(function(instant).full().ravel())
    return np.array(result)


def frames(**changes):
    """A smooth recorded motion of 2 s."""
    time = np.linspace(0.0, 2.0, 81)
    displacement = np.column_stack([np.sin(time) ** 2, 0.1 * time**3])
    return {"time": time, "displacement": displacement, "rotation": 0.2 * np.sin(3 * time)} | changes


def test_a_fixed_base_stays_where_it_is_for_ever():
    (piece,) = FixedBase().pieces()
    assert piece.end == math.inf
    assert not motion(FixedBase(), [0.0, 1.0, 100.0]).any()


def test_a_harmonic_base_moves_as_a_sin_2_pi_f_t_along_its_direction():
    t = np.linspace(0.0, 2.0, 41)
    expected = 5e-3 * np.outer(np.sin(2 * np.pi * 1.85 * t), [0.6, -0.8, 0.0])
    np.testing.assert_allclose(motion(HarmonicBase(5e-3, 1.85, direction=(3.0, -4.0)), t), expected, atol=1e-16)


@pytest.mark.parametrize("stop", [1e-6, 0.1, 0.3, 1 / (4 * 1.85), 3 / (4 * 1.85), 15.0])
def test_it_stops_at_the_first_instant_of_rest_after_the_asked_time_and_holds(stop):
    base = HarmonicBase(5e-3, 1.85, stop=stop)
    stopped = base.stop_time
    assert stop - 1e-9 <= stopped < stop + 1 / (2 * 1.85)
    assert abs(motion(base, [stopped], order=1)).max() < 1e-12
    reached, held, later = motion(base, [stopped, stopped + 1e-9, stopped + 7.0])
    assert abs(reached[0]) == pytest.approx(5e-3, rel=1e-12)
    np.testing.assert_allclose([held, later], [reached, reached], atol=1e-15)


@pytest.mark.parametrize(
    ("base", "moving"),
    [
        (HarmonicBase(5e-3, 1.85, stop=0.2, stop_at="once"), True),
        (SweepBase(2e-3, [1, 2.2], stop=0.2, direction=(0.0, 2.0), stop_at="once"), True),
        (HarmonicBase(5e-3, 88.6, stop=10 / 88.6, ramp=10.0, stop_at="once"), False),
    ],
)
def test_it_can_be_told_to_stop_at_once_and_holds(base, moving):
    stop = base.stop
    assert base.stop_time == stop
    before, *after = motion(base, [stop, stop + 1e-12, 5.0])
    np.testing.assert_allclose(after, [before, before], atol=1e-15)
    speed_before, speed_after = motion(base, [stop, stop + 1e-12], order=1)
    assert (abs(speed_before).max() > 0.01 or not moving) and not speed_after.any()


def test_a_sweep_begins_with_the_first_frequency_and_ends_with_the_last():
    """The velocity is the amplitude times the derivative of the phase, 2 pi times mean frequency times time."""
    base = SweepBase(2e-3, (1.0, 4.0), stop=3.0)
    t = np.linspace(0.0, 3.0, 3001)
    u, v = motion(base, t)[:, 0], motion(base, t, order=1)[:, 0]
    assert (np.diff(np.sign(u[1:])) != 0).sum() == 2 * 2.5 * 3.0 - 1  # half periods, the last just ending
    rate = np.hypot(v, 0.0)[[0]] / 2e-3
    np.testing.assert_allclose(rate, 2 * np.pi * 1.0, rtol=1e-12)
    expected = 2 * np.pi * (1.0 + (4.0 - 1.0) * t / 3.0) * np.sqrt((2e-3) ** 2 - u**2)
    np.testing.assert_allclose(abs(v), expected, atol=1e-6 * abs(v).max())


@pytest.mark.parametrize("frequencies", [(1.0, 2.2), (2.2, 1.0), (4.0, 0.1), (1.5, 1.5)])
def test_a_sweep_stops_at_rest(frequencies):
    """At the first instant of zero velocity after the requested time: at most half a period later."""
    base = SweepBase(2e-3, frequencies, stop=1.7)
    assert 1.7 <= base.stop_time < 1.7 + 0.55 / (2 * frequencies[1] if frequencies[1] > 1 else 0.1)
    t = np.linspace(1.7, base.stop_time, 201)
    velocity = motion(base, t, order=1)[:, 0]
    assert abs(velocity[-1]) < 1e-9 and (np.diff(np.sign(velocity[:-1])) == 0).all()
    np.testing.assert_allclose(*motion(base, [base.stop_time, base.stop_time + 1.0]), atol=1e-12)


RAMPED = [
    (HarmonicBase(5e-3, 1.85, stop=4.0, ramp=3.0), HarmonicBase(5e-3, 1.85, stop=4.0), 3.0 / 1.85),
    (HarmonicBase(5e-3, 1.85, ramp=0.5), HarmonicBase(5e-3, 1.85), 0.5 / 1.85),
    (SweepBase(5e-3, (1.0, 4.0), stop=3.0, ramp=2.5), SweepBase(5e-3, (1.0, 4.0), stop=3.0), (6**0.5 - 1)),
    (SweepBase(5e-3, (4.0, 1.0), stop=3.0, ramp=4.0), SweepBase(5e-3, (4.0, 1.0), stop=3.0), 4 - 8**0.5),
]  # with a ramp, without, and its end by f t + f_t t^2/2 = ramp


@pytest.mark.parametrize(("base", "steady", "end"), RAMPED)
def test_an_amplitude_that_grows_starts_from_rest_and_becomes_that_of_the_steady_oscillation(base, steady, end):
    assert base.pieces()[0].end == pytest.approx(end, rel=1e-12)
    assert len(base.pieces()) == len(steady.pieces()) + 1
    for order in range(3):
        assert not motion(base, [0.0], order).any()
        just, after = motion(base, end * np.array([1 - 1e-12, 1 + 1e-12]), order)
        scale = abs(motion(steady, np.linspace(0.0, end, 50), order)).max()
        np.testing.assert_allclose(just, after, atol=1e-8 * scale)
        later = end * np.array([1.1, 1.5, 7.0])
        np.testing.assert_array_equal(motion(base, later, order), motion(steady, later, order))
    assert base.stop_time == steady.stop_time


@pytest.mark.parametrize(("base", "steady", "end"), RAMPED)
def test_it_grows_all_the_time_and_its_velocity_and_acceleration_are_exact(base, steady, end):
    """Against central differences, whose error is h^2/6 times the third derivative."""
    t, h = np.linspace(0.05, 0.95, 181) * end, 1e-4 * end
    share = motion(base, t)[:, 0] / motion(steady, t)[:, 0]
    assert (np.diff(share) > 0.0).all() and 0.0 < share[0] < 2e-3 and 0.99 < share[-1] < 1.0
    for order in (1, 2):
        exact = motion(base, t, order)
        difference = (motion(base, t + h, order - 1) - motion(base, t - h, order - 1)) / (2 * h)
        np.testing.assert_allclose(exact, difference, atol=1e-5 * abs(exact).max())


def test_a_recorded_motion_passes_through_its_samples_counted_from_the_first_and_holds_the_last():
    record = frames(displacement=frames()["displacement"] + [3.0, -1.0], rotation=frames()["rotation"] + 0.5)
    base = SampledBase(**record)
    expected = np.column_stack([record["displacement"] - [3.0, -1.0], record["rotation"] - 0.5])
    np.testing.assert_allclose(motion(base, record["time"]), expected, atol=1e-12)
    np.testing.assert_allclose(motion(base, [2.5, 10.0]), expected[[-1, -1]], atol=1e-12)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_recorded_polynomial_of_degree_5_is_followed_exactly_with_its_velocity_and_acceleration(order):
    time = np.array([0.0, 0.1, 0.25, 0.3, 0.5, 0.6, 0.8, 1.0])
    polynomial = np.polynomial.Polynomial([0.0, 1.0, -2.0, 0.5, 3.0, -1.0])
    base = SampledBase(time, np.column_stack([polynomial(time), -polynomial(time)]))
    t = np.linspace(0.0, 1.0, 21)
    expected = np.outer(polynomial.deriv(order)(t) if order else polynomial(t), [1.0, -1.0, 0.0])
    np.testing.assert_allclose(motion(base, t, order), expected, atol=1e-9)


@pytest.mark.parametrize(("order", "rate"), [(0, 6.0), (1, 5.0), (2, 4.0)])
def test_the_error_of_a_recorded_motion_falls_with_the_sixth_power_of_the_interval(order, rate):
    """The errors of velocity and acceleration fall with the fifth and fourth power."""
    exact = [np.sin, np.cos, lambda t: -np.sin(t)][order]
    t, errors = np.linspace(2.0, 4.0, 201), []
    for samples in (73, 145):
        time = np.linspace(0.0, 6.0, samples)
        base = SampledBase(time, np.column_stack([np.sin(time), np.zeros(samples)]))
        errors.append(abs(motion(base, t, order)[:, 0] - exact(t)).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(rate, abs=0.5)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: HarmonicBase(0.0, 1.85), "amplitude: must be positive, got 0"),
        (lambda: HarmonicBase(5e-3, -1.85), "frequency: must be positive, got -1.85"),
        (lambda: HarmonicBase(5e-3, 1.85, stop=0.0), "stop: must be positive, got 0"),
        (lambda: HarmonicBase(5e-3, 1.85, stop_at="end"), "stop_at: must be one of rest, once, got 'end'"),
        (lambda: HarmonicBase(5e-3, 1.85, direction=(0, 0)), "direction: must not be the zero vector"),
        (lambda: HarmonicBase(5e-3, 1.85, ramp=-1.0), "ramp: must be positive, got -1"),
        (lambda: HarmonicBase(5e-3, 2.0, stop=1.0, ramp=3.0), "ramp: lasts until 1.5 s, after the stop at 1 s"),
        (lambda: SweepBase(1.0, (2.0, 1.0), 1.0, ramp=9.0), "ramp: lasts until 2 s, after the stop at 1 s"),
        (lambda: SweepBase(-1.0, (1.0, 2.0), 1.0), "amplitude: must be positive, got -1"),
        (lambda: SweepBase(1.0, (0.0, 2.0), 1.0), "frequencies: must be positive, got 0"),
        (lambda: SweepBase(1.0, 2.0, 1.0), "frequencies: must be a pair of numbers (x, y), got 2.0"),
        (lambda: SweepBase(1.0, (1.0, 2.0), math.inf), "stop: must be a finite number, got inf"),
        (lambda: SampledBase(range(5), np.zeros((5, 2))), "time: needs at least 6 instants"),
        (lambda: SampledBase([0, 1, 2, 2, 3, 4], np.zeros((6, 2))), "time: must increase"),
        (lambda: SampledBase(range(6), np.zeros((6, 3))), "displacement: must have the shape (6, 2), got (6, 3)"),
        (lambda: SampledBase(**frames(rotation=[0.0])), "rotation: must have the shape (81,), got (1,)"),
    ],
)
def test_motions_that_make_no_sense_are_refused_by_name(make, message):
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        make()
