"""Steady vibration on its way to and from other processes."""

import pickle

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import (
    HarmonicBase,
    HarmonicForce,
    Model,
    Parameter,
    QuadraticDamping,
    RayleighDamping,
    SecondOrderSystem,
    natural_modes,
    periodic_motion,
    reduce_model,
)

LAW = RayleighDamping(alpha=0.2) + QuadraticDamping(eta2=2.0)


@pytest.fixture(scope="module")
def model(paper_beam):
    return Model(paper_beam(3))


@pytest.fixture(scope="module")
def base(model):
    return HarmonicBase(1e-3, 1.02 * natural_modes(model, count=1).frequencies[0])


@pytest.fixture(scope="module")
def reduced(model):
    return reduce_model(model, modes=2, damping=LAW)


def duffing():
    q, v, a, u, mu = (cs.SX.sym(name) for name in ("q", "v", "a", "u", "mu"))
    return SecondOrderSystem.of(
        q, v, a, u, mu, conservative=a + q + mu * q**3, damping=0.05 * v, excitation=u,
        parameters=[Parameter("mu", 0.5, "1/m^2", "cubic stiffness")],
    )  # fmt: skip


@pytest.fixture(scope="module", params=["full", "reduced", "system"])
def motion(request, model, reduced, base):
    if request.param == "system":
        return periodic_motion(duffing(), force=HarmonicForce(0.1, frequency=0.17))
    full = request.param == "full"
    return periodic_motion(model if full else reduced, damping=LAW if full else None, base=base)


def test_a_pickled_motion_is_the_same_and_can_be_evaluated(motion):
    again = pickle.loads(pickle.dumps(motion))
    np.testing.assert_array_equal(again.coefficients, motion.coefficients)
    assert again.stable == motion.stable
    assert again.dissipated_energy == motion.dissipated_energy
    samples = 16
    for here, there in zip(
        motion.balance.system.functions(samples), again.balance.system.functions(samples), strict=True
    ):
        inputs = [np.full(here.size_in(k), 0.1 + 0.01 * k) for k in range(here.n_in())]
        for output, same in zip(here.call(inputs), there.call(inputs), strict=True):
            np.testing.assert_allclose(same, output, rtol=1e-12)
