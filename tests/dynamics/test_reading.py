"""Sensor readings of a differentiable motion: accuracy, derivatives against differences, rest before the start."""

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import Beam, HarmonicBase, ModalDamping, Model, QuadraticDamping, natural_modes, static_equilibrium
from ancf_casadi.dynamics.derivatives.differentiable import Runs
from ancf_casadi.dynamics.derivatives.reading import SampledMotion
from ancf_casadi.dynamics.derivatives.sensitivity import SensitivityProblem
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.records.sensor import Sensor

SENSORS = [
    Sensor("position", 0.13, (1.0, 2.0)),
    Sensor("velocity", None, (1.0, 0.0), "body"),
    Sensor("acceleration", 0.1, (0.0, 1.0), "body", gravity=True),
    Sensor("slope"),
    Sensor("strain", 0.03),
    Sensor("force"),
    Sensor("force", direction=(0.0, 1.0), frame="body"),
    Sensor("moment"),
]
BASE = HarmonicBase(0.02, 3.0, stop=0.15)
TIMES = np.array([0.05, -0.03, 0.11, 0.1999, 0.17])


@pytest.fixture(scope="module")
def model():
    strip = {"length": 0.2, "width": 0.01, "thickness": 2e-3, "density": 1070.0, "elastic_modulus": 264e3}
    return Model(Beam.uniform(**strip, elements=3, tip_mass=1e-4, clamp_stiffness=0.02))


@pytest.fixture(scope="module")
def readings(model):
    """A Function (theta, b, P, lumped, load, shift) -> readings of all sensors at ``TIMES``, and the values."""
    law = ModalDamping(natural_modes(model, count=2), (0.05, 0.03)) + QuadraticDamping(eta2=2.0)
    equations = Equations(model, law)
    problem = SensitivityProblem(
        equations=equations,
        base=BASE,
        start=static_equilibrium(model, tip_force=(0.001, 0.0)),
        times=TIMES,
        tolerance=1e-10,
        held=True,
        orders=3,
        clocks=np.array([0, 0, 0, 1, 1]),
        span=(0.0, 0.22),
        lumped=True,
    )
    motion = Runs(problem).function()
    symbols = [cs.MX.sym(name, *motion.size_in(k)) for k, name in enumerate("abcdef")]
    parts = cs.vertsplit(motion(*symbols), model.size)
    parameters = equations.parameters_with(properties=cs.vec(symbols[2]), law=symbols[0], lumped=symbols[3])
    sampled = SampledMotion.of(equations, *parts, cs.MX.zeros(3, TIMES.size), parameters)
    outputs = cs.vertcat(*(sampled.read(sensor) for sensor in SENSORS))
    values = [np.array([own.value for own in law.parameters]), np.array([0.02]), model.properties]
    values += [np.array([*model.lumped.values()]), np.array([0.001, 0.0, 0.0, 0.0, 0.0, 0.0]), np.array([0.004, 0.009])]
    return cs.Function("readings", symbols, [outputs]), values


@pytest.mark.slow
@pytest.mark.parametrize(("places", "step"), [((0, 3), 1e-3), ((1, 2, 4), 1e-4), ((5,), 1e-5)])
def test_derivatives_of_all_readings_are_those_of_differences(readings, places, step):
    """Along directions in law and lumped properties, in base, properties and load, and in the shifts.

    The error of the integration determines the step: readings by the law change least.
    """
    function, values = readings
    seeds = [np.zeros(np.shape(value)) for value in values]
    for place in places:
        size = values[place] if place in (0, 2, 3) else [0.02, 1e-3, 1.0][[1, 4, 5].index(place)]
        seeds[place] = size * np.random.default_rng(place).uniform(0.3, 1.0, size=values[place].shape)
    along = function.forward(1)(*values, function(*values), *seeds).full()
    ends = [
        function(*(value + sign * step * seed for value, seed in zip(values, seeds, strict=True))).full()
        for sign in (1.0, -1.0)
    ]
    difference = (ends[0] - ends[1]) / (2 * step)
    size = abs(difference).max(axis=1, keepdims=True)
    assert (size > 0.0).all()
    np.testing.assert_allclose(along / size, difference / size, atol=2e-3)


@pytest.mark.slow
def test_reverse_derivatives_are_the_transposed_of_the_forward_ones(readings):
    function, values = readings
    rng = np.random.default_rng(1)
    seed = cs.vvcat([rng.normal(size=part.shape) * np.maximum(abs(part), 1e-3) for part in map(np.array, values)])
    x = cs.MX.sym("x", seed.shape[0])  # all inputs
    parts = zip(cs.vertsplit(x, np.cumsum([0, *map(np.size, values)]).tolist()), function.mx_in(), strict=True)
    output = cs.vec(function(*(cs.reshape(part, one.shape) for part, one in parts)))
    weights = cs.DM(rng.normal(size=output.shape))
    forward = cs.dot(cs.jtimes(output, x, seed), weights)
    reverse = cs.dot(cs.jtimes(output, x, weights, True), seed)
    found = cs.Function("both", [x], [forward, reverse])(cs.vvcat(values))
    assert float(found[0]) == pytest.approx(float(found[1]), rel=1e-7)


@pytest.mark.slow
def test_the_beam_rests_under_its_load_before_the_start(readings, model):
    function, values = readings
    held = static_equilibrium(model, tip_force=(0.001, 0.0))
    read = dict(zip(SENSORS, function(*values).full()[:, 1], strict=True))
    assert read[SENSORS[1]] == 0.0
    place = model.interpolation(0.13) @ held.coordinates
    assert read[SENSORS[0]] == pytest.approx(place @ [1.0, 2.0] / np.sqrt(5.0), rel=1e-9)
    up = model.slope_interpolation(0.1) @ held.coordinates
    normal = np.array([-up[1], up[0]]) / np.linalg.norm(up)
    assert read[SENSORS[2]] == pytest.approx(9.81 * normal[1], rel=1e-6)
    assert read[SENSORS[5]] == pytest.approx(-0.001, rel=1e-6)


def test_the_clamp_carries_weight_and_load_at_rest():
    """A lying beam with a small deflection, held by a load at its tip: closed forms."""
    stiff = {"length": 0.2, "width": 0.01, "thickness": 2e-3, "density": 1070.0, "elastic_modulus": 2e9}
    model = Model(Beam.uniform(**stiff, elements=4, axis=(1.0, 0.0)))
    equations = Equations(model, QuadraticDamping(eta2=0.1))
    held = static_equilibrium(model, tip_force=(0.0, -0.01)).coordinates
    still = cs.MX.zeros(model.size)
    motion = SampledMotion.of(
        equations, cs.MX(cs.DM(held)), still, still, cs.MX.zeros(3), cs.MX(cs.DM(equations.parameters))
    )

    def read(sensor):
        return float(cs.evalf(motion.read(sensor)))

    weight, inertia = 1070.0 * 0.01 * 2e-3 * 0.2 * 9.81, 0.01 * 2e-3**3 / 12
    assert read(Sensor("force")) == pytest.approx(0.0, abs=1e-9)
    assert read(Sensor("force", direction=(0.0, 1.0))) == pytest.approx(weight + 0.01, rel=1e-6)
    assert read(Sensor("moment")) == pytest.approx(weight * 0.1 + 0.01 * 0.2, rel=2e-3)
    place = 0.05 * (0.5 - 3**-0.5 / 2)
    moment = weight * (0.2 - place) ** 2 / 0.4 + 0.01 * (0.2 - place)
    assert read(Sensor("strain", place)) == pytest.approx(1e-3 * moment / (2e9 * inertia), rel=5e-3)
    assert read(Sensor("strain", place, distance=-1e-3)) == pytest.approx(-read(Sensor("strain", place)), rel=2e-3)
    assert read(Sensor("slope")) == pytest.approx(
        -(weight * 0.2**2 / 6 + 0.01 * 0.2**2 / 2) / (2e9 * inertia), rel=5e-3
    )
