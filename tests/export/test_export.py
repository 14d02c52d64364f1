"""Exported Functions against the model, closed forms, differences, and another process."""

import subprocess
import sys

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import (
    FrictionDamping,
    InputError,
    ModalDamping,
    Model,
    Pin,
    QuadraticDamping,
    RayleighDamping,
    natural_modes,
    reduce_model,
    simulate,
    static_equilibrium,
)
from ancf_casadi.export import ReducedFunctions, beam_functions, load_functions, save_functions, values

MOTION = ("q", "v", "base", "p")


@pytest.fixture(scope="module")
def model(paper_beam):
    return Model(paper_beam(3, axis=(1.0, -1.0)))


@pytest.fixture(scope="module", params=["local", "generic"])
def functions(request, model):
    generic = ModalDamping(natural_modes(model), (0.01, 0.02)) + QuadraticDamping(eta1=0.1, eta2=0.2)
    laws = {
        "local": RayleighDamping(alpha=0.2, beta=3e-5) + QuadraticDamping(eta2=0.2) + FrictionDamping(0.05),
        "generic": generic,
    }
    return beam_functions(model, laws[request.param], markers=(0.2, 0.35), modes=3)


def state_of(functions, seed=0):
    """Return a bent and moving state on a moving base, by the names of the inputs."""
    random = np.random.default_rng(seed)
    n = functions.free
    q = values(functions.states)[:n] + random.normal(size=n) * 1e-5
    return {
        "q": q,
        "v": random.normal(size=n) * 0.1,
        "a": random.normal(size=n),
        "base": random.normal(size=9) * 0.01,
        "p": values(functions.parameters) * (1 + 0.02 * random.random(len(functions.parameters))),
    }


def call(function, state):
    outputs = function(*(state[name] for name in function.name_in()))
    return outputs if isinstance(outputs, tuple) else (outputs,)


def test_the_signals_name_each_entry_once(functions):
    for table, size in (
        (functions.parameters, functions.rhs.size1_in("p")),
        (functions.states, 2 * functions.rhs.size1_in("q")),
        (functions.base, functions.rhs.size1_in("base")),
        (functions.outputs, 2 + functions.markers.numel_out(0) + 3 + 2),
    ):
        assert len({signal.name for signal in table}) == len(table) == size
        assert all(signal.name.isidentifier() and signal.unit and signal.description for signal in table)


def test_laws_with_the_same_parameter_get_different_names(model):
    law = RayleighDamping(alpha=0.1) + RayleighDamping(alpha=0.2)
    last = beam_functions(model, law, modes=1).parameters[-2:]
    assert [(signal.name, signal.value) for signal in last] == [("alpha", 0.1), ("alpha_2", 0.2)]


def test_the_residual_is_zero_for_the_accelerations_of_rhs(functions):
    state = state_of(functions)
    inertia = call(functions.residual, state)[0] - call(functions.residual, {**state, "a": 0 * state["a"]})[0]
    (state["a"],) = call(functions.rhs, state)
    assert float(cs.norm_inf(call(functions.residual, state)[0])) < 1e-9 * float(cs.norm_inf(inertia)) + 1e-9


def test_the_residual_equals_the_terms_of_the_equation_of_motion(model):
    """The terms come from the model and the law, and the motion of the clamped node from closed formulas."""
    law = ModalDamping(natural_modes(model), (0.01, 0.02)) + RayleighDamping(alpha=0.2, beta=3e-5)
    functions = beam_functions(model, law, modes=1)
    state = state_of(functions)
    state["p"] = values(functions.parameters)
    (x, y, angle), (vx, vy, turn), (ax, ay, turning) = state["base"].reshape(3, 3)
    direction = np.angle(complex(*model.beam.axis)) + angle
    along, across = np.array([np.cos(direction), np.sin(direction)]), np.array([-np.sin(direction), np.cos(direction)])
    e = np.concatenate([[x, y], along, state["q"]])
    e_t = np.concatenate([[vx, vy], turn * across, state["v"]])
    e_tt = np.concatenate([[ax, ay], turning * across - turn**2 * along, state["a"]])
    P = model.properties
    expected = model.mass(P) @ e_tt + cs.evalf(law.force(model, cs.MX(cs.DM(e)), cs.MX(cs.DM(e_t))))
    expected += model.elastic_force(e, P) - model.gravity_force(P, model.beam.gravity)
    found = call(functions.residual, state)[0].full().ravel()
    np.testing.assert_allclose(found, expected.full().ravel()[slice(4, model.size)], rtol=1e-9, atol=1e-9)


def test_the_jacobians_agree_with_differences(functions):
    state = state_of(functions)
    rounding = 1e-15 * np.abs(call(functions.residual, state)[0].full()).max()
    steps = {"q": 1e-6, "v": 1e-4, "a": 1.0, "base": 1e-6}
    jacobians = zip(("q", "v", "a", "base", "p"), call(functions.residual_jacobians, state), strict=True)
    for name, jacobian in jacobians:
        for k in range(state[name].size):
            h = steps.get(name, 1e-4 * max(abs(state[name][k]), 1.0 * (k < 2)))
            change = np.zeros(state[name].size)
            change[k] = h
            ends = [call(functions.residual, {**state, name: state[name] + s * change})[0].full() for s in (1, -1)]
            expected = ((ends[0] - ends[1]) / (2 * h)).ravel()
            np.testing.assert_allclose(jacobian[:, k].full().ravel(), expected, rtol=2e-5, atol=10 * rounding / h)


def test_the_damping_force_dissipates_and_is_zero_at_rest(functions):
    state = state_of(functions)
    state["base"] = np.zeros(9)
    assert float(cs.dot(call(functions.damping_force, state)[0], state["v"])) > 0
    assert float(cs.norm_inf(call(functions.damping_force, {**state, "v": 0 * state["v"]})[0])) < 1e-15


@pytest.mark.slow
def test_tip_markers_and_energies_agree_with_the_trajectory(model):
    law = RayleighDamping(alpha=0.2, beta=3e-5)
    functions = beam_functions(model, law, markers=(0.2, 0.35), modes=1)
    start = static_equilibrium(model, tip_force=(0.0, 0.02))
    run = simulate(model, damping=law, start=start, duration=0.1, method="radau")
    state = {"q": run.coordinates[-1][slice(4, model.size)], "v": run.velocities[-1][slice(4, model.size)]}
    state |= {"base": np.zeros(9), "p": values(functions.parameters)}
    assert call(functions.tip, state)[0].full().ravel() == pytest.approx(run.tip[-1], abs=1e-15)
    expected = np.column_stack([run.position(s)[-1] for s in (0.2, 0.35)])
    np.testing.assert_allclose(call(functions.markers, state)[0], expected, atol=1e-15)
    energies = [run.kinetic_energy[-1], run.strain_energy[-1], run.potential_energy[-1]]
    assert [float(energy) for energy in call(functions.energies, state)] == pytest.approx(energies, rel=1e-12)


@pytest.mark.parametrize(("axis", "factor"), [((0.0, -1.0), 0.5), ((1.0, 0.0), 1.0), ((0.0, -1.0), 2.0)])
def test_statics_and_modes_far_from_the_model_agree_with_a_new_model(paper_beam, axis, factor):
    beam = paper_beam(8, axis=axis)
    functions = beam_functions(Model(beam))
    taper = beam.thickness[0] * np.linspace(1.3, 0.7, 8)
    other = Model(beam.with_(thickness=taper, elastic_modulus=factor * beam.elastic_modulus[0]))
    p = np.concatenate([beam.gravity, other.properties.T.ravel()])
    found = functions.equilibrium(p).full().ravel()
    np.testing.assert_allclose(found, static_equilibrium(other).coordinates[4:], atol=1e-11)
    assert functions.frequencies(p).full().ravel() == pytest.approx(natural_modes(other).frequencies, rel=1e-7)


@pytest.mark.slow
def test_a_buckled_beam_is_nan(paper_beam):
    """A standing strip has no modes under ten times its weight."""
    functions = beam_functions(Model(paper_beam(6, axis=(0.0, 1.0))))
    p = values(functions.parameters)
    assert np.isfinite(functions.frequencies(p).full()).all()
    p[1] *= 10
    assert np.isnan(functions.frequencies(p).full()).all()
    derivative = functions.frequencies.jacobian()(p, functions.frequencies(p))
    assert np.isnan(derivative.full()).any()


def test_a_pendulum_without_gravity_has_no_frequencies(paper_beam):
    """It turns about its pin as a rigid body, at 0 Hz."""
    functions = beam_functions(Model(paper_beam(4, supports=(Pin(0.0),))), modes=2)
    p = values(functions.parameters)
    assert np.isfinite(functions.frequencies(p).full()).all()
    p[:2] = 0.0
    assert np.isnan(functions.frequencies(p).full()).all()


def test_frequencies_are_nan_where_one_of_the_lowest_is_missing(paper_beam):
    """A hanging rod: 1.5 times as thick, its fourth mode stretches it, which no mode of bending can turn into."""
    beam = paper_beam(4, thickness=0.02)
    functions, thicker = beam_functions(Model(beam), modes=4), Model(beam.with_(thickness=[0.03] * 4))
    assert np.isfinite(functions.frequencies(values(functions.parameters)).full()).all()
    p = np.concatenate([beam.gravity, thicker.properties.T.ravel()])
    assert np.isnan(functions.frequencies(p).full()).all()
    bends = np.abs(natural_modes(thicker, count=4).shapes[::2]).max(axis=0) > 1e-6
    assert bends.tolist() == [True, True, True, False]


@pytest.mark.slow
def test_frequencies_of_a_weightless_beam_scale_with_its_properties(paper_beam):
    """Logarithmic derivatives of f are 0, 1, -1/2 and 1/2 for width, thickness, density and E; second ones are 0."""
    functions = beam_functions(Model(paper_beam(6, axis=(1.0, 0.0), gravity=(0.0, 0.0))), modes=3)
    x = cs.MX.sym("x", 4)  # logarithms of common factors
    p = cs.vertcat(cs.DM(2, 1), cs.DM(values(functions.parameters)[2:]) * cs.repmat(cs.exp(x), 6, 1))
    f = cs.log(functions.frequencies(p))
    first, second = cs.Function("d", [x], [cs.jacobian(f, x), cs.hessian(f[1], x)[0]])(0)
    np.testing.assert_allclose(first, np.tile([0.0, 1.0, -0.5, 0.5], (3, 1)), atol=1e-6)
    np.testing.assert_allclose(second, 0.0, atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("what", ["equilibrium", "frequencies"])
def test_first_and_second_derivatives_of_statics_and_modes_agree_with_differences(paper_beam, what):
    functions = beam_functions(Model(paper_beam(3, axis=(1.0, -0.5))), modes=2)
    function, p0 = getattr(functions, what), values(functions.parameters)
    x = cs.MX.sym("x", p0.size)
    p = cs.DM(p0) * (1 + x)
    weights = np.random.default_rng(1).normal(size=function.numel_out(0))
    value = cs.dot(weights, function(p))
    gradient = cs.gradient(value, x)
    evaluate = cs.Function("evaluate", [x], [value, gradient, cs.jacobian(gradient, x)])
    direction = np.random.default_rng(2).normal(size=p0.size)
    h = 1e-4
    (_, g0, H), up, down = (evaluate(s * h * direction) for s in (0, 1, -1))
    assert float((up[0] - down[0]) / (2 * h)) == pytest.approx(float(cs.dot(g0, direction)), rel=2e-5)
    expected = ((up[1] - down[1]) / (2 * h)).full().ravel()
    np.testing.assert_allclose((H @ direction).full().ravel(), expected, rtol=1e-4, atol=1e-5 * np.abs(expected).max())


def test_the_step_is_of_order_two(paper_beam):
    """A small oscillation in mode 1 over one period, sin(omega t) in closed form."""
    model = Model(paper_beam(3))
    functions, modes = beam_functions(model, modes=1), natural_modes(model, count=1)
    rest, p = values(functions.states)[: functions.free], values(functions.parameters)
    omega = modes.angular_frequencies[0]
    shape = 1e-5 * modes.shapes[slice(4, model.size), 0] / modes.tip_amplitudes()[0]
    errors = []
    for steps in (40, 80, 160):
        q, v = rest, omega * shape
        for _ in range(steps):
            q, v = functions.step(q, v, np.zeros((9, 2)), p, 2 * np.pi / omega / steps)
        errors.append(float(cs.norm_2(q - rest)) / np.linalg.norm(shape))
    assert errors[0] < 0.02
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2.0, atol=0.1)


@pytest.mark.slow
def test_loaded_functions_give_the_same_numbers_in_another_process(functions, tmp_path):
    path = tmp_path / "beam.casadi"
    save_functions(functions, path)
    code = f"""
from ancf_casadi.export import load_functions, values
loaded = load_functions({str(path)!r})
p, s = values(loaded.parameters), values(loaded.states)
n = loaded.free
a = loaded.rhs(s[:n] * 1.00001, s[n:] + 0.1, 0.01, p)
print([x.hex() for x in (*a.full().ravel().tolist(), *loaded.frequencies(p * 1.01).full().ravel().tolist())])
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    p, s, n = values(functions.parameters), values(functions.states), functions.free
    a = functions.rhs(s[:n] * 1.00001, s[n:] + 0.1, 0.01, p)
    here = [*a.full().ravel().tolist(), *functions.frequencies(p * 1.01).full().ravel().tolist()]
    assert run.stdout.strip() == str([x.hex() for x in here])
    assert load_functions(path).parameters == functions.parameters


def test_the_reduced_model_survives_a_round_trip(model, tmp_path):
    """The numbers agree to the last bit; the file replaces that of a full model."""
    law = RayleighDamping(beta=3e-5) + QuadraticDamping(eta2=0.2)
    reduced = reduce_model(model, modes=2, damping=law, markers=(0.2,))
    path = tmp_path / "beam.casadi"
    save_functions(beam_functions(model, modes=1), path)
    save_functions(reduced, path)
    loaded = load_functions(path)
    assert isinstance(loaded, ReducedFunctions)
    for table in ("parameters", "states", "base", "outputs"):
        assert getattr(loaded, table) == getattr(reduced, table)
    assert list(loaded.named) == list(reduced.named)
    random = np.random.default_rng(1)
    for name, function in loaded.named.items():
        inputs = [1e-3 * random.normal(size=function.size_in(k)) for k in range(function.n_in())]
        for found, expected in zip(function.call(inputs), reduced.named[name].call(inputs), strict=True):
            assert np.array_equal(found.full(), expected.full())


def test_unusable_files_are_refused(functions, tmp_path):
    path = tmp_path / "beam.casadi"
    save_functions(functions, path)
    first, _, rest = path.read_text().partition("\n")
    for text, said in (
        ("hello", "is not a file of Functions"),
        (f"{first}\n{rest[:1000]}", "is damaged"),
        (first.replace('"full"', '"reduced"') + f"\n{rest[:1000]}", "is damaged"),
        (first.replace('"full"', '"half"') + f"\n{rest}", "is not a file of Functions"),
        (first.replace(cs.CasadiMeta.version(), "1.2.3") + "\n" + rest, "was written by CasADi 1.2.3"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=said):
            load_functions(path)
    with pytest.raises(InputError, match="cannot be read"):
        load_functions(tmp_path / "none.casadi")
    path.write_text("mine")
    with pytest.raises(InputError, match="already exists"):
        save_functions(functions, path)
    assert path.read_text() == "mine"
