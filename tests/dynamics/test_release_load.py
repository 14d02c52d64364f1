"""Release from a changing load: state and derivatives against differences of equilibria and of motions."""

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import Beam, InputError, Model, QuadraticDamping, motion, simulate, static_equilibrium
from ancf_casadi.dynamics.derivatives.sensitivity import held_start, start_jacobians
from ancf_casadi.dynamics.start import START_LOAD_NAMES

pytestmark = pytest.mark.filterwarnings("ignore:an element bends")  # of the three elements

LOAD = np.array([4e-3, -1e-3, 1e-4, 0.03, 0.01, 2e-3])  # N, N, N m, and the same per second


@pytest.fixture(scope="module")
def model():
    """A soft strip of silicone, hanging; the load bends it by a third of its length."""
    strip = {"length": 0.2, "width": 0.01, "thickness": 2e-3, "density": 1070.0, "elastic_modulus": 264e3}
    return Model(Beam.uniform(**strip, elements=3))


def rest(model, load):
    return static_equilibrium(model, tip_force=tuple(load[:2]), tip_moment=load[2])


def held(model, load=LOAD):
    return held_start(model, start_jacobians(model), load)


def test_the_velocity_is_that_of_the_equilibria_as_the_load_changes(model):
    h = 1e-4
    ends = [rest(model, LOAD[:3] + sign * h * LOAD[3:]) for sign in (1, -1)]
    start, _ = held(model)
    assert np.linalg.norm(start.coordinates[-4:-2] - rest(model, np.zeros(3)).tip) > 0.05
    np.testing.assert_allclose(start.coordinates, rest(model, LOAD).coordinates, atol=1e-12)
    expected = (ends[0].coordinates - ends[1].coordinates) / (2 * h)
    np.testing.assert_allclose(start.velocities, expected, atol=1e-6 * abs(expected).max())


@pytest.mark.slow
@pytest.mark.parametrize("place", [1.0, -0.4])
def test_derivatives_by_load_and_properties_agree_with_central_differences(model, place):
    load = place * LOAD
    _, jacobian = held(model, load)
    by_properties, by_load = jacobian[:, :12], jacobian[:, 12:]
    for k, size in enumerate((1e-4, 1e-4, 1e-5, 1e-2, 1e-2, 1e-3)):
        ends = [held(model, load + sign * 1e-2 * size * (np.arange(6) == k))[0] for sign in (1, -1)]
        difference = np.concatenate(
            [(getattr(ends[0], name) - getattr(ends[1], name))[4:] for name in ("coordinates", "velocities")]
        )
        expected = difference / (2e-2 * size)
        np.testing.assert_allclose(by_load[:, k], expected, atol=1e-6 * abs(expected).max())
    for k, name in enumerate(("width", "thickness", "density", "elastic_modulus")):
        values = np.array(getattr(model.beam, name))
        ends = [
            held(Model(model.beam.with_(**{name: (values * (1 + sign * 1e-5)).tolist()})), load)[0] for sign in (1, -1)
        ]
        expected = np.concatenate(
            [(getattr(ends[0], part) - getattr(ends[1], part))[4:] / 2e-5 for part in ("coordinates", "velocities")]
        )
        found = by_properties.reshape(-1, 3, 4)[:, :, k] @ values
        assert abs(expected).max() > 1e-3
        np.testing.assert_allclose(found, expected, atol=1e-6 * abs(expected).max())


@pytest.mark.slow
def test_the_motion_from_an_unknown_load_is_that_of_the_state_and_so_are_its_derivatives(model):
    """Compare with ``simulate`` from the state, and with differences of tightly integrated motions."""
    law = QuadraticDamping(eta1=0.6, eta2=4.0)
    settings = {"duration": 0.1, "sample_rate": 100.0}
    run = simulate(model, damping=law, start=held(model)[0], method="radau", tolerance=1e-9, **settings)
    function, tight = (
        motion(model, damping=law, tolerance=tolerance, start_load=True, **settings) for tolerance in (1e-7, 1e-9)
    )
    fixed = [np.array([0.6, 4.0]), np.zeros(0), model.properties]
    assert function.name_in(3) == "start" and function.size_in(3) == (len(START_LOAD_NAMES), 1)
    assert np.ptp(run.tip, axis=0).max() > 0.01
    assert abs(tight(*fixed, LOAD).full().T - run.coordinates).max() < 1e-7 * model.beam.length

    s = cs.MX.sym("s", 6)
    tip = function(*fixed, s)[-4:-2, :]
    jacobian = cs.Function("J", [s], [cs.jacobian(tip, s)])(LOAD).full()
    for part in ((0,), (2, 1), (3,), (5, 4)):
        direction = LOAD * np.isin(np.arange(6), part)
        ends = [tight(*fixed, LOAD + sign * 1e-3 * direction).full()[-4:-2].ravel(order="F") for sign in (1, -1)]
        expected = (ends[0] - ends[1]) / 2e-3
        assert abs(expected).max() > 1e-4
        np.testing.assert_allclose(jacobian @ direction, expected, atol=1e-3 * abs(expected).max())
    weights = np.random.default_rng(1).normal(size=(2, len(run.time)))
    product = cs.Function("G", [s], [cs.jtimes(cs.vec(tip), s, cs.vec(cs.DM(weights)), True)])(LOAD)
    np.testing.assert_allclose(product.full().ravel(), jacobian.T @ weights.ravel(order="F"), rtol=1e-7)


@pytest.mark.parametrize("start", ["straight", "impact"])
def test_a_start_without_a_load_has_none_to_vary(model, start):
    with pytest.raises(InputError, match="start: has no load"):
        motion(model, duration=0.1, start=start, start_load=True)
