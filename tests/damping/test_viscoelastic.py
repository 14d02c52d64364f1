"""A material that relaxes: against linear differential equations, creep, statics, and both integrators."""

import casadi as cs
import numpy as np
import pytest
import scipy.linalg

from ancf_casadi import (
    Beam,
    HarmonicBase,
    Model,
    PointLoad,
    RayleighDamping,
    SampledLoad,
    State,
    ViscoelasticDamping,
    critical_load,
    damped_modes,
    frequency_response,
    linear_frf,
    motion,
    natural_modes,
    reduce_model,
    simulate,
    static_equilibrium,
)
from ancf_casadi.damping.spec import LawSpec
from ancf_casadi.dynamics.radau import newton
from ancf_casadi.dynamics.radau.tableau import RADAU, overstrain_weights
from ancf_casadi.exceptions import InputError
from ancf_casadi.export import Document, beam_functions, read_document, write_document, write_pyelastica
from ancf_casadi.support.specs import convert
from problems import MarkerRecord, fit_beam

BRANCH = ViscoelasticDamping(ratios=[0.3], times=[0.03])
TWO = ViscoelasticDamping(ratios=[0.3, 1.0], times=[0.03, 0.002])


def strip(elements=3, gravity=(0.0, 0.0), density=1070.0, **changes):
    """A soft horizontal strip of 100 x 30 x 10 mm."""
    return Model(
        Beam.uniform(
            length=0.1, width=0.03, thickness=0.01, density=density, elastic_modulus=240e3, elements=elements,
            axis=(1.0, 0.0), gravity=gravity, **changes,
        )
    )  # fmt: skip


def decay(omega, ratios, times, instants):
    """One mode that is released relaxed at 1: x_tt + omega^2 (x + sum g (x - z)) = 0, tau z_t = x - z."""
    g, tau = np.array(ratios), np.array(times)
    system = np.zeros((2 + g.size, 2 + g.size), g.dtype)
    system[0, 1] = 1.0
    system[1, [0, *range(2, 2 + g.size)]] = omega**2 * np.array([-1 - g.sum(), *g])
    system[2:, 0] = 1 / tau
    system[2:, 2:] = -np.diag(1 / tau)
    first = np.array([1.0, 0.0, *np.ones(g.size)])
    return np.array([(scipy.linalg.expm(system * t) @ first)[0] for t in instants])


@pytest.mark.parametrize("law", [BRANCH, TWO, BRANCH + ViscoelasticDamping([1.0], [0.002])])
@pytest.mark.parametrize(("method", "tolerance", "error"), [("radau", 1e-10, 1e-6), ("idas", 1e-11, 1e-4)])
def test_small_vibration_of_a_mode_obeys_its_linear_equation(law, method, tolerance, error):
    model = strip()
    modes = natural_modes(model, count=1)
    shape = modes.shapes[:, 0] / modes.tip_amplitudes()[0]
    start = State(model.straight + 1e-5 * shape, 0 * shape)
    settings = {"duration": 0.3, "sample_rate": 100.0, "tolerance": tolerance}
    run = simulate(model, damping=law, start=start, method=method, **settings)
    branches = BRANCH if law == BRANCH else TWO
    reference = decay(modes.angular_frequencies[0], branches.ratios, branches.times, run.time)
    np.testing.assert_allclose(run.tip[:, 1] / 1e-5, reference, atol=error)


def test_creep_from_the_statics_at_time_zero_to_those_after_relaxation():
    """Under a constant load, u = u_1 (1 - g/(1 + g) exp(-t/((1 + g) tau))); at time zero, the modulus is (1 + g) E."""
    g, tau, force = 0.5, 2.0, [0.0, 1e-5]
    model = strip(elements=2, density=1.0)
    at_once = Model(model.beam.with_(elastic_modulus=(1 + g) * 240e3))
    first, last = (static_equilibrium(beam, tip_force=force) for beam in (at_once, model))
    start = State(first.coordinates, np.zeros(model.size), internal=np.zeros(8))
    law, load = ViscoelasticDamping([g], [tau]) + RayleighDamping(beta=1e-4), SampledLoad([0.0, 10.0], [force, force])
    run = simulate(model, damping=law, start=start, load=load, duration=10.0, sample_rate=2.0, tolerance=1e-10)
    expected = last.tip[1] * (1 - g / (1 + g) * np.exp(-run.time / ((1 + g) * tau)))
    np.testing.assert_allclose(run.tip[:, 1], expected, rtol=1e-3)  # of inertia


def test_a_beam_comes_to_rest_in_the_relaxed_equilibrium_and_loses_the_energy_of_the_fall():
    model = strip(elements=6, gravity=(0.0, -5.0))
    law = ViscoelasticDamping([0.4], [0.03])
    run = simulate(model, damping=law, start="straight", duration=8.0, sample_rate=50.0)
    rest = static_equilibrium(model)
    assert abs(rest.tip[1]) > 0.02  # large motion
    np.testing.assert_allclose(run.tip[-1], rest.tip, atol=1e-5)
    fall = run.energy[0] - run.energy[-1]
    assert run.dissipated_energy[-1] == pytest.approx(fall, rel=1e-4)
    assert np.abs(run.balance_error).max() < 1e-5 * fall


@pytest.mark.parametrize("law", [BRANCH, TWO + RayleighDamping(beta=1e-4)])
def test_both_integrators_agree_on_large_motion_of_a_moving_beam_and_close_its_energy_balance(law):
    model = strip(elements=6, gravity=(0.0, -5.0), tip_mass=5e-3, rotary_sections=True)
    base = HarmonicBase(amplitude=5e-3, frequency=3.0, direction=(0.0, 1.0), stop=0.2)
    settings = {"damping": law, "base": base, "start": "straight", "duration": 0.4, "sample_rate": 100.0}
    radau = simulate(model, method="radau", tolerance=1e-7, **settings)
    idas = simulate(model, method="idas", tolerance=1e-9, **settings)
    np.testing.assert_allclose(radau.tip, idas.tip, atol=1e-6)
    np.testing.assert_allclose(radau.dissipated_energy, idas.dissipated_energy, atol=1e-5 * np.ptp(radau.energy))
    for run in (radau, idas):
        assert np.abs(run.balance_error).max() < 3e-6 * np.ptp(run.energy)
    rates = np.diff(radau.dissipated_energy)
    assert rates.max() > 0.0 > rates.min()  # branches give back what they store


def test_a_branch_that_never_relaxes_is_a_stiffer_beam_and_a_fast_one_damps_by_the_strain_rate():
    model = strip(elements=6, gravity=(0.0, -5.0))
    settings = {"start": "straight", "duration": 0.3, "sample_rate": 100.0}
    stiffer = Model(model.beam.with_(elastic_modulus=1.5 * 240e3))
    damped, law = RayleighDamping(beta=2e-3), RayleighDamping(beta=2e-3 / 1.5)
    expected = simulate(stiffer, damping=law, **settings)
    slow = simulate(model, damping=ViscoelasticDamping([0.5], [1e6]) + damped, **settings)
    np.testing.assert_allclose(slow.tip, expected.tip, atol=2e-6)
    fast = simulate(model, damping=ViscoelasticDamping([200.0], [1e-5]), **settings)
    np.testing.assert_allclose(fast.tip, simulate(model, damping=damped, **settings).tip, atol=5e-5)


def test_damping_ratios_are_those_of_the_complex_frequency_for_small_moduli():
    """tau s^3 + s^2 + (1 + g) tau omega^2 s + omega^2 = 0 for one mode."""
    modes, g, tau = natural_modes(strip(), count=2), 1e-4, 0.03
    ratios = ViscoelasticDamping([g], [tau]).damping_ratios(modes, [0, 0])
    for omega, ratio in zip(modes.angular_frequencies, ratios, strict=True):
        roots = np.roots([tau, 1.0, (1 + g) * tau * omega**2, omega**2])
        s = roots[roots.imag.argmax()]
        assert ratio == pytest.approx(-s.real / abs(s), rel=1e-3)


@pytest.mark.parametrize("law", [BRANCH, TWO])
def test_damped_modes_of_a_weightless_beam_have_the_complex_frequencies_of_one_mode(law):
    """s^2 + omega^2 (1 + sum g tau s/(1 + tau s)) = 0."""
    modes = natural_modes(strip(elements=4), count=4)
    damped = damped_modes(modes.model, law, count=4)
    for omega, s in zip(modes.angular_frequencies, damped.eigenvalues, strict=True):
        numerator, denominator = np.polynomial.Polynomial([omega**2, 0.0, 1.0]), np.polynomial.Polynomial([1.0])
        for g, tau in zip(law.ratios, law.times, strict=True):
            branch = np.polynomial.Polynomial([1.0, tau])
            numerator = numerator * branch + omega**2 * g * np.polynomial.Polynomial([0.0, tau]) * denominator
            denominator = denominator * branch
        roots = numerator.roots()
        assert s == pytest.approx(roots[roots.imag.argmax()], rel=1e-8)


def test_damped_modes_of_a_sagging_beam_are_eigenvalues_of_the_system_with_internal_displacements():
    """s M v = -K q - g V (q - u) - beta V v, s u = (q - u)/tau, with the strain-rate stiffness V."""
    model, (g, tau, beta) = strip(elements=6, gravity=(0.0, -5.0), tip_mass=5e-3), (0.4, 0.03, 1e-4)
    rest, N, eye = static_equilibrium(model), model.freedoms, np.eye(model.freedoms)
    free = model.with_fixed_base(eye)
    p = model.properties
    K, M = (free.T @ matrix.full() @ free for matrix in (model.tangent_stiffness(rest.coordinates, p), model.mass(p)))
    V = free.T @ model.strain_rate_force(rest.coordinates, free, p).full()
    none = np.zeros((N, N))
    by_rate = np.block([[none, eye, none], [-K - g * V, -beta * V, g * V], [eye / tau, none, -eye / tau]])
    expected = scipy.linalg.eigvals(by_rate, scipy.linalg.block_diag(eye, M, eye))
    expected = expected[expected.imag > 0.0]
    expected = expected[np.argsort(np.abs(expected))][:3]
    found = damped_modes(model, ViscoelasticDamping([g], [tau]) + RayleighDamping(beta=beta), count=3)
    np.testing.assert_allclose(found.eigenvalues, expected, rtol=1e-7)


def test_linear_response_of_a_weightless_beam_is_the_sum_over_its_modes():
    """phi^2/(omega_k^2 (1 + phi(i omega)) - omega^2), with all modes."""
    model = strip(elements=4)
    modes, f = natural_modes(model, count=model.freedoms), np.array([0.1, 1.0, 2.4, 10.0])
    response = linear_frf(model, TWO, f, direction=(0.0, 1.0))
    shapes = model.interpolation(0.1)[1] @ modes.shapes
    s = 2j * np.pi * f[:, None]
    modulus = 1 + sum(g * tau * s / (1 + tau * s) for g, tau in zip(TWO.ratios, TWO.times, strict=True))
    expected = (shapes**2 / (modes.angular_frequencies**2 * modulus + s**2)).sum(axis=1)
    np.testing.assert_allclose(response.values.ravel(), expected, rtol=1e-6)


@pytest.mark.parametrize("x", [1.0, 3.0, 10.0])
def test_held_strains_relax_exponentially_over_a_step_and_newton_weights_are_near_the_branch(x):
    """W y is stiffly accurate of order 5; phi(s) = x s/(1 + x s) at the eigenvalues of the collocation."""
    weights, alpha, beta = (output.full() for output in overstrain_weights()(x))
    assert weights[-1].sum() == pytest.approx(np.exp(-1 / x), abs=3e-4 / x**6)
    for s in (RADAU.gamma, RADAU.mu):
        assert abs(alpha.item() + beta.item() * s - x * s / (1 + x * s)) < 0.1


def test_newton_weights_are_exact_for_long_and_short_relaxation_times():
    for x, expected in ((1e6, (1.0, 0.0)), (1e-6, (0.0, 1e-6))):
        _, *found = overstrain_weights()(x)
        np.testing.assert_allclose([float(value) for value in found], expected, atol=2e-5 * max(expected))


@pytest.fixture
def equal_steps(monkeypatch):
    """Steps of 0.5 ms, solved to rounding, so that no difference of two motions comes from the choice of steps."""
    trial_length = newton.StepControl.trial_length

    def equal(control, remaining, largest_step):
        assert not control.length or control.proposal > 4e-4  # no step is repeated
        return trial_length(control._replace(proposal=5e-4), remaining, largest_step)

    monkeypatch.setattr(newton.StepControl, "trial_length", equal)
    monkeypatch.setattr(newton, "NEWTON_RATIO", 1e-6)
    return {"tolerance": 1e-6}


@pytest.mark.slow
@pytest.mark.parametrize("start", ["equilibrium", "straight"])
def test_derivatives_of_a_motion_agree_with_differences_forward_and_in_reverse(start, equal_steps):
    """Central differences of large motion, whose own error is below 1e-7."""
    model = strip(elements=4, gravity=(0.0, -5.0), tip_mass=5e-3)
    base, law = HarmonicBase(amplitude=5e-3, frequency=3.0, direction=(0.0, 1.0), stop=0.1), TWO
    settings = {"damping": law, "base": base, "duration": 0.1, "sample_rate": 50.0, "start": start, **equal_steps}
    f = motion(model, lumped=True, **settings)
    x, P = cs.MX.sym("x", 6), cs.DM(model.properties)  # parameters of the law, relative, and modulus and thickness
    values = [parameter.value for parameter in law.parameters]
    properties = cs.vertcat(P[0, :], P[1, :] * x[5], P[2, :], P[3, :] * x[4])
    tip = model.interpolation(0.1) @ f(cs.DM(values) * x[:4], [p.value for p in base.parameters], properties, 5e-3)
    y = tip[1, :].T
    motion_of = cs.Function("motion_of", [x], [y, cs.jacobian(y, x), cs.gradient(cs.sum1(y), x)])
    value, jacobian, gradient = (result.full() for result in motion_of(np.ones(6)))
    tip_of = cs.Function("tip_of", [x], [y])
    np.testing.assert_allclose(value.ravel(), simulate(model, **settings).tip[:, 1], atol=1e-10)
    for k, step in enumerate(2e-4 * np.eye(6)):
        ends = [tip_of(np.ones(6) + side * step).full().ravel() for side in (1, -1)]
        difference = (ends[0] - ends[1]) / 4e-4
        np.testing.assert_allclose(jacobian[:, k], difference, atol=1e-6 * np.abs(difference).max())
    np.testing.assert_allclose(gradient.ravel(), jacobian.sum(axis=0), rtol=1e-9)


def test_derivatives_of_small_vibration_are_those_of_its_linear_equation_forward_and_in_reverse():
    """By each modulus and relaxation time, relative, with steps of the integrator's choice."""
    model = strip()
    modes, values = natural_modes(model, count=1), np.array([parameter.value for parameter in TWO.parameters])
    start = State(model.straight + 1e-5 * modes.shapes[:, 0] / modes.tip_amplitudes()[0], np.zeros(model.size))
    f = motion(model, damping=TWO, start=start, duration=0.3, sample_rate=100.0, tolerance=1e-10)
    x = cs.MX.sym("x", 4)
    y = (model.interpolation(0.1) @ f(cs.DM(values) * x, [], model.properties))[1, :].T / 1e-5
    motion_of = cs.Function("motion_of", [x], [y, cs.jacobian(y, x), cs.gradient(cs.sumsqr(y), x)])
    value, jacobian, gradient = (result.full() for result in motion_of(np.ones(4)))
    for k, step in enumerate(1e-30j * np.diag(values)):
        expected = decay(modes.angular_frequencies[0], *np.split(values + step, 2), np.arange(31) / 100).imag / 1e-30
        assert np.abs(expected).max() > 0.03
        np.testing.assert_allclose(jacobian[:, k], expected, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_allclose(gradient, 2 * jacobian.T @ value, rtol=1e-9)


@pytest.mark.slow  # 6 s
@pytest.mark.parametrize("first", [ViscoelasticDamping([0.4], [0.02]), ViscoelasticDamping([0.15], [0.07])])
def test_a_fit_recovers_modulus_and_branch_from_two_starts(first):
    def beam(modulus):
        return Model(
            Beam.uniform(
                length=0.1, width=0.03, thickness=0.03, density=1070.0, elastic_modulus=modulus, elements=4,
                axis=(1.0, 0.0), tip_mass=0.052,
            )
        )  # fmt: skip

    truth = {"modulus1": 0.25, "time1": 0.034, "elastic_modulus": 240e3}
    run = simulate(
        beam(240e3), damping=ViscoelasticDamping([0.25], [0.034]), start="straight", duration=1.2, sample_rate=100.0
    )
    noise = np.random.default_rng(1).normal(0.0, 5e-5, run.tip.shape)
    record = MarkerRecord(run.time, run.tip + noise, start="straight")
    bounds = {"elastic_modulus": (180e3, 330e3)}
    fit = fit_beam(beam(260e3), record, first, unknowns=["elastic_modulus"], bounds=bounds)
    for name, value in truth.items():
        assert abs(fit.estimates[name] - value) < 3 * fit.standard_errors[name]
        assert fit.standard_errors[name] < 0.01 * value


def test_a_document_and_a_toml_table_hold_the_law(tmp_path):
    document = Document(strip(), BRANCH + RayleighDamping(beta=1e-4))
    write_document(tmp_path / "beam.json", document)
    assert read_document(tmp_path / "beam.json").damping == document.damping
    with pytest.raises(InputError, match="times: has 1 values for 2 ratios"):
        convert({"law": "viscoelastic", "ratios": [0.1, 0.2], "times": [0.1]}, LawSpec)


def test_parameters_and_sums():
    law = RayleighDamping(beta=1e-3) + TWO
    assert [parameter.name for parameter in law.parameters] == ["beta", "modulus1", "modulus2", "time1", "time2"]
    changed = law.with_parameters([2e-3, 0.1, 0.2, 0.3, 0.4])
    assert changed.laws[1] == ViscoelasticDamping([0.1, 0.2], [0.3, 0.4])
    for ratios, times in (([0.1], [0.1, 0.2]), ([-0.1], [0.1]), ([0.1], [0.0]), (0.1, [0.1])):
        with pytest.raises(InputError, match=r"ratios|times"):
            ViscoelasticDamping(ratios, times)


def test_everything_else_refuses_the_law(tmp_path):
    model, run = strip(), simulate(strip(), damping=BRANCH, duration=0.02)
    load = [PointLoad((-1.0, 0.0))]
    calls = {
        "force": lambda: BRANCH.force(model, cs.MX.sym("e", model.size), cs.MX.sym("e_t", model.size)),
        "critical": lambda: critical_load(model, load, BRANCH),
        "response": lambda: frequency_response(model, (5.0, 20.0), damping=BRANCH, base=HarmonicBase(1e-4, 10.0)),
        "functions": lambda: beam_functions(model, BRANCH),
        "simulator": lambda: write_pyelastica(model, tmp_path / "beam.py", damping=BRANCH),
        "reduced": lambda: reduce_model(model, modes=2, damping=BRANCH),
        "state": lambda: run.state(-1),
        "clamp": lambda: run.clamp_force,
    }
    for call in calls.values():
        with pytest.raises(InputError, match=r"damping: .*relaxes"):
            call()
    assert not any(tmp_path.iterdir())
