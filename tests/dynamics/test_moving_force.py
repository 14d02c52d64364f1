"""A force that travels along the beam against the modal series of a simply supported beam."""

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    InputError,
    Model,
    MovingForce,
    Pin,
    RayleighDamping,
    Roller,
    frequency_response,
    motion,
    simulate,
    static_equilibrium,
)
from ancf_casadi.dynamics.placed_load import load_force
from ancf_casadi.mechanics.loads import PointLoad

LENGTH, LINE_DENSITY, BENDING = 0.5, 8000.0 * 2.5e-6, 210e9 * 5e-3 * 0.5e-3**3 / 12
STRIP = {"length": LENGTH, "width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elastic_modulus": 210e9}
BRIDGE = Model(Beam.uniform(**STRIP, elements=8, axis=(1.0, 0.0), gravity=(0.0, 0.0),
                            supports=[Pin(0.0), Roller(LENGTH)]))  # fmt: skip
FORCE, SPEED = 1e-4, 2.0


def modal_series(points, times, terms=30):
    """Return w (times, points) under a unit force that enters at 0 and leaves at the end.

    Mode n, sin(n pi x/L), has q'' + omega^2 q = 2/(mu L) sin(W t), W = n pi v/L, until L/v.
    """
    n = np.arange(1, terms + 1)
    omega, drive = (n * np.pi / LENGTH) ** 2 * np.sqrt(BENDING / LINE_DENSITY), n * np.pi * SPEED / LENGTH
    t, left = times[:, None], LENGTH / SPEED
    size = 2 / (LINE_DENSITY * LENGTH) / (omega**2 - drive**2)
    on = np.clip(t, 0.0, left)
    q = size * (np.sin(drive * on) - drive / omega * np.sin(omega * on))
    rate = size * drive * (np.cos(drive * on) - np.cos(omega * on))
    after = np.maximum(t - left, 0.0)
    q = q * np.cos(omega * after) + rate / omega * np.sin(omega * after)
    return q @ np.sin(np.outer(n, np.pi * points / LENGTH))


@pytest.mark.slow
@pytest.mark.parametrize(("method", "begin"), [("radau", 0.0), ("idas", 0.05)])
def test_a_simply_supported_beam_follows_the_modal_series_on_and_after_the_way(method, begin):
    load = MovingForce((0.0, -FORCE), speed=SPEED, begin=begin)
    run = simulate(BRIDGE, load=load, duration=0.4, sample_rate=200.0, method=method)
    points = np.array([0.125, 0.25, 0.45])
    expected = -FORCE * modal_series(points, run.time - begin)
    found = np.column_stack([run.position(point)[:, 1] for point in points.tolist()])
    np.testing.assert_allclose(found, expected, atol=1e-3 * abs(expected).max())
    assert abs(run.balance_error).max() < 1e-4 * run.energy.max()
    assert run.load_work[-1] == pytest.approx(run.energy[-1], rel=2e-4)
    on = (run.time > begin) & (run.time <= begin + LENGTH / SPEED)
    np.testing.assert_array_equal(run.tip_force[1:], np.outer(on[1:], [0.0, -FORCE]))


def test_the_generalized_force_is_that_of_a_load_at_the_same_place():
    """On a mesh of unequal elements, at inner points, at nodes and at the end."""
    model = Model(BRIDGE.beam.with_(supports=[Pin(0.0), Roller(0.21), Roller(LENGTH)]))
    places = np.array([0.0, 0.03, 0.21, 0.3, LENGTH])
    e, load = cs.MX.sym("e", model.size, places.size), cs.MX.sym("load", 4, places.size)
    found = cs.Function("Q", [load], [load_force(model, None, e, load)])
    columns = np.vstack([np.full(5, 0.3), np.full(5, -0.2), np.zeros(5), places])
    for place, Q in zip(places.tolist(), found(columns).full().T, strict=True):
        fixed = load_force(model, PointLoad(point=place), cs.DM(model.straight), cs.DM([0.3, -0.2, 0.0]))
        np.testing.assert_allclose(Q, cs.evalf(fixed).full().ravel(), atol=1e-15)


@pytest.mark.slow
def test_a_force_on_the_beam_at_time_0_starts_from_equilibrium_also_with_derivatives():
    load = MovingForce((0.0, -1e-3), speed=0.5, point=0.1, end=0.2)
    settings = {"load": load, "damping": RayleighDamping(alpha=0.2), "duration": 0.05, "sample_rate": 100.0}
    run = simulate(BRIDGE, **settings)
    assert run.integrators[0].tolerance < 1e-7  # 3e-7 if nothing were expected to move
    rest = static_equilibrium(BRIDGE, loads=[PointLoad((0.0, -1e-3), point=0.1)])
    np.testing.assert_allclose(run.coordinates[0], rest.coordinates, atol=1e-12)
    function, alpha = motion(BRIDGE, tolerance=1e-12, **settings), cs.MX.sym("alpha")
    last = function(alpha, np.zeros(0), BRIDGE.properties)[:, -1]
    value, slope = cs.Function("J", [alpha], [last, cs.jacobian(last, alpha)])(0.2)
    np.testing.assert_allclose(value.full().ravel(), run.coordinates[-1], atol=1e-6)
    changed = [cs.Function("last", [alpha], [last])(0.2 + h).full() for h in (5e-2, -5e-2)]
    np.testing.assert_allclose(slope.full(), (changed[0] - changed[1]) / 0.1, atol=1e-4 * abs(slope.full()).max())


def test_a_travelling_force_is_refused_where_it_makes_no_sense():
    load = MovingForce((0.0, -1e-2), speed=1.0)
    with pytest.raises(InputError, match=r"loads.*MovingForce"):
        static_equilibrium(BRIDGE, loads=[load])
    with pytest.raises(InputError, match=r"load.*MovingForce"):
        frequency_response(BRIDGE, load=load, frequencies=(4.0, 5.0))
    with pytest.raises(InputError, match="beyond the tip"):
        simulate(BRIDGE, load=MovingForce((0.0, -1e-2), speed=1.0, end=0.6), duration=0.1)
    for settings in ({"speed": 0.0}, {"speed": -1.0}, {"speed": 1.0, "point": 0.2, "end": 0.1}):
        with pytest.raises(InputError):
            MovingForce((0.0, -1e-2), **settings)
