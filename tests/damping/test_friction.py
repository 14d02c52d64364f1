"""Dry friction along the beam: its force, the energy that it takes, and the decay of one mode."""

import math
import re

import casadi as cs
import numpy as np
import pytest
from scipy.integrate import quad

from ancf_casadi import FrictionDamping, InputError, Model, RayleighDamping, State, natural_modes, simulate
from ancf_casadi.damping import FRICTION_CONSTANT
from ancf_casadi.damping.quadratic import ASSUMED_SHAPE
from ancf_casadi.decay.closed_forms import friction_envelope

ETA0 = 0.05


@pytest.fixture(scope="module")
def modes(paper_beam):
    """Modes of a weightless beam of eight elements, along -y."""
    return natural_modes(Model(paper_beam(8, gravity=(0.0, 0.0))), count=3)


def force(law, model, e_t):
    x, v = cs.MX.sym("e", model.size), cs.MX.sym("e_t", model.size)
    return cs.Function("force", [x, v], [law.force(model, x, v)])(model.straight, e_t).full().ravel()


def test_a_translating_beam_meets_a_force_that_does_not_depend_on_its_speed(modes):
    model, law = modes.model, FrictionDamping(ETA0, smoothing_speed=1e-6)
    for speed in (0.1, 1.0, 10.0):
        falling = np.tile([0.6 * speed, -0.8 * speed, 0.0, 0.0], model.size // 4)
        total = force(law, model, falling).reshape(-1, 4)[:, :2].sum(axis=0)
        expected = model.beam.mass * ETA0 * 52 / 81 * np.array([0.6, -0.8])
        np.testing.assert_allclose(total, expected, rtol=1e-9)


def test_well_below_the_smoothing_speed_friction_is_linear_in_the_velocity(modes):
    model, law = modes.model, FrictionDamping(ETA0, smoothing_speed=2e-3)
    slow = 1e-8 * np.random.default_rng(0).normal(size=model.size)
    linear = force(RayleighDamping(alpha=ETA0 * 52 / 81 / 2e-3), model, slow)
    np.testing.assert_allclose(force(law, model, slow), linear, atol=1e-6 * abs(linear).max())


def test_the_shape_of_eq_21_gives_the_equation_of_one_mode(paper_beam):
    """The generalized force of the shape, divided by its mass, is eta0 sign(r')."""
    assert pytest.approx(quad(lambda x: ASSUMED_SHAPE(x) ** 2, 0, 1)[0] / quad(ASSUMED_SHAPE, 0, 1)[0], rel=1e-12) == (
        FRICTION_CONSTANT
    )
    model, nodes = Model(paper_beam(20)), np.linspace(0.0, 1.0, 21)
    shape = np.zeros((21, 4))
    shape[:, 0], shape[:, 2] = ASSUMED_SHAPE(nodes), ASSUMED_SHAPE.deriv()(nodes) / model.beam.length
    mass = shape.ravel() @ model.inertia_force(shape.ravel(), model.properties).full().ravel()
    for rate in (0.5, -0.5):
        push = shape.ravel() @ force(FrictionDamping(ETA0, 1e-9), model, rate * shape.ravel())
        assert push / mass == pytest.approx(math.copysign(ETA0, rate), rel=1e-5)


def test_with_a_zero_coefficient_there_is_no_force_and_no_parameter(modes):
    law = FrictionDamping()
    assert law.parameters == ()
    assert not force(law, modes.model, np.ones(modes.model.size)).any()
    assert not law.damping_ratios(modes, [0.01, 0.01, 0.01]).any()


@pytest.mark.parametrize("seed", range(3))
def test_friction_takes_energy_out_of_every_motion(modes, seed):
    rate = np.random.default_rng(seed).normal(size=modes.model.size)
    assert rate @ force(FrictionDamping(ETA0), modes.model, rate) > 0.0


def test_neither_the_tip_mass_nor_the_elastic_clamp_rubs(paper_beam):
    plain, loaded = (Model(paper_beam(4, **extra)) for extra in ({}, {"tip_mass": 0.01, "clamp_stiffness": 5.0}))
    rate = np.random.default_rng(0).normal(size=plain.size)
    padded = np.concatenate([[1.0, 2.0, 3.0, 4.0], rate])
    expected = np.concatenate([np.zeros(4), force(FrictionDamping(ETA0), plain, rate)])
    np.testing.assert_allclose(force(FrictionDamping(ETA0), loaded, padded), expected, atol=1e-15)


@pytest.mark.parametrize("amplitude", [2e-4, 2e-3, 0.05])
def test_the_equivalent_ratio_loses_the_energy_of_friction_in_each_period(modes, amplitude):
    """Energy per period by adaptive quadrature, at tip speeds from about twice the smoothing speed upwards."""
    law, model = FrictionDamping(ETA0), modes.model
    ratios = law.damping_ratios(modes, np.full(3, amplitude))
    for zeta, omega, shape in zip(ratios, modes.angular_frequencies, modes.shapes.T, strict=True):
        tip = shape / abs(shape[-4])
        v, unit = cs.MX.sym("v", model.size), cs.MX(cs.DM(model.straight))
        power = cs.Function("power", [v], [cs.dot(v, law.force(model, unit, v))])

        def loss(phase, omega=omega, tip=tip, power=power):
            return float(power(omega * amplitude * math.cos(phase) * tip)) / omega

        lost = 4 * quad(loss, 0.0, math.pi / 2, epsabs=0.0, epsrel=1e-9)[0]
        mass = tip @ model.inertia_force(tip, model.properties).full().ravel()
        assert zeta == pytest.approx(lost / (2 * math.pi * omega**2 * amplitude**2 * mass), rel=1e-6)


def test_the_equivalent_ratio_of_ideal_friction_falls_with_the_amplitude(modes):
    """2 eta0 b/(pi omega^2 A), with b = 52/81 int |phi|/int phi^2 of the exact first mode, by midpoint sums."""
    x, k = (np.arange(20_000) + 0.5) / 20_000, 1.875104068711961
    share = (math.cosh(k) + math.cos(k)) / (math.sinh(k) + math.sin(k))
    phi = np.cosh(k * x) - np.cos(k * x) - share * (np.sinh(k * x) - np.sin(k * x))
    b = 52 / 81 * 2.0 * phi.mean() / (phi**2).mean()
    omega = modes.angular_frequencies[0]
    for amplitude in (0.01, 0.02):
        zeta = FrictionDamping(ETA0, smoothing_speed=1e-7).damping_ratios(modes, np.full(3, amplitude))[0]
        assert zeta == pytest.approx(2 * ETA0 * b / (math.pi * omega**2 * amplitude), rel=1e-4)


def test_at_zero_amplitude_the_ratio_is_that_of_the_linear_damping_of_the_smoothing(modes):
    linear = RayleighDamping(alpha=ETA0 * 52 / 81 / 1e-3).damping_ratios(modes, np.zeros(3))
    np.testing.assert_allclose(FrictionDamping(ETA0).damping_ratios(modes, np.zeros(3)), linear, rtol=1e-9)


@pytest.mark.slow
def test_a_simulated_decay_is_linear_as_in_the_closed_form_of_one_mode(modes):
    """Amplitude from the energy, after each of four periods; the true mode rubs 0.53 % more than the assumed shape."""
    amplitude, eta0, omega = 2e-3, 0.005, modes.angular_frequencies[0]
    shape = modes.shapes[:, 0] / modes.tip_amplitudes()[0]
    start = State(modes.equilibrium.coordinates, omega * amplitude * shape)
    law, period = FrictionDamping(eta0, smoothing_speed=1e-5), 2 * math.pi / omega
    run = simulate(modes.model, damping=law, start=start, duration=4 * period, sample_rate=50 / period, method="radau")
    found = amplitude * np.sqrt(run.energy[::50] / run.energy[0])
    lost = amplitude - found
    periods = np.arange(5)
    np.testing.assert_allclose(lost[1:], periods[1:] * 4 * eta0 / omega**2, rtol=0.01)
    closed = amplitude - friction_envelope(cs.DM(periods * period), omega, eta0, 0.0, 0.0, amplitude).full().ravel()
    np.testing.assert_allclose(lost[1:], closed[1:], rtol=0.01)
    ratio = law.damping_ratios(modes, np.full(3, amplitude))[0]  # falls with 1/A, so that the loss is constant
    np.testing.assert_allclose(lost[1:], periods[1:] * 2 * math.pi * ratio * amplitude, rtol=1e-2)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda modes: FrictionDamping(-1.0), "eta0: must not be negative, got -1"),
        (lambda modes: FrictionDamping(np.inf), "eta0: must be a finite number, got inf"),
        (lambda modes: FrictionDamping(0.1, smoothing_speed=0.0), "smoothing_speed: must be positive, got 0"),
        (lambda modes: FrictionDamping(0.1, "slow"), "smoothing_speed: must be a finite number, got 'slow'"),
        (lambda modes: FrictionDamping(0.1).damping_ratios(modes, [0.1]), "amplitudes: has 1 values for 3 modes"),
    ],
)
def test_values_that_make_no_sense_are_refused_by_name(modes, make, message):
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        make(modes)
