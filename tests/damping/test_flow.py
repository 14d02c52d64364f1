"""Quadratic damping in a uniform flow: closed forms, a base that moves through still air, derivatives and exports."""

import math

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    HarmonicBase,
    Model,
    QuadraticDamping,
    RayleighDamping,
    damped_modes,
    motion,
    natural_modes,
    periodic_motion,
    reduce_model,
    simulate,
    static_equilibrium,
)
from ancf_casadi.damping import DRAG_CONSTANT
from ancf_casadi.dynamics.base_motion import BaseMotion, Piece
from ancf_casadi.export import beam_functions, values
from problems import MarkerRecord, fit_beam

STRIP = {"length": 0.5, "width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elastic_modulus": 210e9}
LINE_DENSITY, BENDING = 8000.0 * 2.5e-6, 210e9 * 5e-3 * 0.5e-3**3 / 12
HANGING = Model(Beam.uniform(**STRIP, elements=4))
WIND = QuadraticDamping(eta1=0.05, eta2=0.5, flow=(3.0, 1.0))


def resting(model, law):
    return static_equilibrium(model, loads=law.loads(model.beam))


@pytest.mark.parametrize(("flow", "factor"), [((0.0, 2.0), 2), ((2.0, 0.0), 1)])
def test_a_stiff_cantilever_sags_and_is_damped_along_and_across_the_flow_as_in_closed_form(flow, factor):
    """q = (gamma1 + gamma2 |u|) u, tip q L^4/(8 E I); 2 zeta omega = (gamma1 + gamma2 |u| (2 or 1))/mu."""
    model = Model(Beam.uniform(**STRIP, elements=8, axis=(1.0, 0.0), gravity=(0.0, 0.0)))
    law = QuadraticDamping(eta1=0.05, eta2=0.02, flow=flow)
    gamma1, gamma2 = 0.05 * LINE_DENSITY, 0.02 * DRAG_CONSTANT * LINE_DENSITY
    deflection = (gamma1 + gamma2 * 2.0) * flow[1] * 0.5**4 / (8 * BENDING)
    assert resting(model, law).tip[1] == pytest.approx(deflection, rel=1e-4, abs=1e-9)
    modes = damped_modes(model, law, count=3)
    rates = 2 * modes.damping_ratios * 2 * np.pi * modes.frequencies
    np.testing.assert_allclose(rates, (gamma1 + factor * gamma2 * 2.0) / LINE_DENSITY, rtol=1e-4)
    undamped = natural_modes(model, count=3, equilibrium=resting(model, law))
    np.testing.assert_allclose(law.damping_ratios(undamped, [0.0] * 3), modes.damping_ratios, rtol=2e-4)
    fast = law.damping_ratios(undamped, [1e4] * 3)  # far above the speed of the flow
    still = QuadraticDamping(law.eta1, law.eta2).damping_ratios(undamped, [1e4] * 3)
    np.testing.assert_allclose(fast, still, rtol=1e-3)


class Departing(BaseMotion):
    """A clamp that moves against the flow."""

    def pieces(self):
        ux, uy = WIND.flow
        return (Piece(math.inf, lambda t, parameters: cs.vertcat(-ux * t, -uy * t, 0.0)),)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["radau", "idas"])
def test_a_flow_is_still_air_for_a_base_that_moves_with_the_opposite_velocity(method):
    gust = {"start": static_equilibrium(HANGING), "method": method, "tolerance": 5e-10}
    settings = gust | {"duration": 0.3, "sample_rate": 100.0}
    blown = simulate(HANGING, damping=WIND, **settings)
    still = QuadraticDamping(WIND.eta1, WIND.eta2)
    towed = simulate(HANGING, damping=still, base=Departing(), **settings)
    assert np.ptp(blown.tip[:, 0]) > 0.05
    np.testing.assert_allclose(blown.tip, towed.tip - towed.base, atol=1e-7)
    kinetic = np.ptp(blown.kinetic_energy)
    assert blown.dissipated_energy.min() < -kinetic  # the flow drives the beam
    assert abs(blown.balance_error).max() < 1e-6 * kinetic


@pytest.mark.slow
def test_a_beam_of_two_thicknesses_stays_at_rest_in_a_flow():
    beam = HANGING.beam.with_(thickness=[0.5e-3, 0.5e-3, 0.3e-3, 0.3e-3])
    law = RayleighDamping(alpha=0.1) + WIND
    assert [load.begin for load in law.loads(beam)] == [0.0, 0.25]
    run = simulate(Model(beam), damping=law, duration=0.1)
    assert abs(run.tip[:, 0]).min() > 0.05
    np.testing.assert_allclose(run.tip, np.tile(run.tip[0], (len(run.time), 1)), atol=1e-10)


def test_the_sag_in_a_flow_does_not_loosen_the_default_tolerance():
    settings = {"base": HarmonicBase(amplitude=1e-5, frequency=1.0), "duration": 0.01}
    laws = WIND, QuadraticDamping(WIND.eta1, WIND.eta2)
    blown, still = (simulate(HANGING, damping=law, **settings).integrators[0].tolerance for law in laws)
    assert blown == pytest.approx(still, rel=1e-6)


@pytest.mark.slow
def test_derivatives_by_coefficients_and_flow_agree_with_central_differences():
    settings = {"duration": 0.05, "sample_rate": 40.0, "tolerance": 1e-10}
    function, theta = motion(HANGING, damping=WIND, **settings), cs.MX.sym("theta", 4)
    tip = cs.vec(function(theta, np.zeros(0), HANGING.properties)[-4:-2, :])
    at = np.array([own.value for own in WIND.parameters])
    (found,) = cs.Function("J", [theta], [cs.jacobian(tip, theta)]).call([at])
    for k, step in enumerate(np.diag(1e-4 * at)):
        ends = [resting(HANGING, WIND.with_parameters(at + sign * step)).tip for sign in (1, -1)]
        difference = np.tile((ends[0] - ends[1]) / (2 * step[k]), 3)
        np.testing.assert_allclose(found.full()[:, k], difference, rtol=1e-6, atol=1e-9)


@pytest.mark.slow
def test_the_reduced_model_and_the_exported_equations_are_those_in_the_flow():
    functions = beam_functions(HANGING, WIND, modes=1)
    p = values(functions.parameters)
    assert [signal.name for signal in functions.parameters][-2:] == ["flow_x", "flow_y"]
    p[-2:] = [2.0, -1.0]
    rest = functions.equilibrium(p)
    assert float(cs.norm_inf(functions.residual(rest, 0, 0, 0, p))) < 1e-6
    slower = QuadraticDamping(WIND.eta1, WIND.eta2, (2.0, -1.0))
    np.testing.assert_allclose(rest.full().ravel(), resting(HANGING, slower).coordinates[4:], atol=1e-8)
    reduced = reduce_model(HANGING, modes=3, damping=WIND)
    at_rest = reduced.rhs(np.zeros(3), np.zeros(3), np.zeros(9), reduced.values)
    assert float(cs.norm_inf(at_rest)) < 2e-2 * float(
        cs.norm_inf(reduced.rhs(np.zeros(3), 0, 0, [*reduced.values[:4], 0, 0]))
    )


@pytest.mark.slow
def test_steady_vibration_in_a_flow_also_of_modes_about_rest_in_still_air():
    """The mean of the reduced motion is the sag that the flow adds to the equilibrium of the modes."""
    base = HarmonicBase(amplitude=2e-3, frequency=1.9)
    law = QuadraticDamping(eta1=0.05, eta2=0.2, flow=(2.0, 0.0))
    still = natural_modes(HANGING, count=4)
    means = []
    for modes in (still, natural_modes(HANGING, count=4, equilibrium=resting(HANGING, law))):
        found = periodic_motion(reduce_model(HANGING, modes=modes, damping=law), base=base)
        means.append((found.displacement().mean(), found.amplitude()))
    np.testing.assert_allclose(means[0], means[1], rtol=5e-3)
    assert means[0][0] == pytest.approx(resting(HANGING, law).tip[0], rel=0.02)


@pytest.mark.slow
def test_a_fit_finds_the_drag_and_the_flow():
    base = HarmonicBase(amplitude=5e-3, frequency=1.9)
    run = simulate(HANGING, damping=WIND, base=base, duration=1.0, sample_rate=100.0)
    noise = 1e-4 * np.random.default_rng(1).standard_normal(run.tip.shape)
    guess = QuadraticDamping(eta1=0.05, eta2=0.4, flow=(2.5, 0.5))
    fit = fit_beam(HANGING, MarkerRecord(run.time, run.tip + noise, base=base), guess, fixed=["eta1"])
    for name, true in {"eta2": 0.5, "flow_x": 3.0, "flow_y": 1.0}.items():
        assert abs(fit.estimates[name] - true) < 4 * fit.standard_errors[name] < 0.1 * abs(true)
