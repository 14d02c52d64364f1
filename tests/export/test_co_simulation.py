"""The co-simulation FMU: validity, its motion against ``simulate``, independent instances, states and failures."""

import math
import shutil

import casadi as cs
import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Slave, fmi3LogMessageCallback
from fmpy.validation import validate_fmu

from ancf_casadi import (
    BaseMotion,
    Clamp,
    ModalDamping,
    Model,
    Pin,
    QuadraticDamping,
    RayleighDamping,
    Spring,
    TipLoad,
    natural_modes,
    reduce_model,
    simulate,
    simulate_reduced,
)
from ancf_casadi.dynamics.base_motion import Piece
from ancf_casadi.export import beam_functions, fmu, values, write_fmu
from ancf_casadi.export.co_simulation import advance_function
from ancf_casadi.export.solved_functions import KENNEDY_CARPENTER, KENNEDY_CARPENTER_ERROR, stage_instants

STEP = 0.02  # of communication, s
INPUTS = ("base_x_acceleration", "base_y_acceleration", "base_angle_acceleration", "tip_force_x", "tip_force_y")
OUTPUTS = ("tip_x", "tip_y", "clamp_force_x", "clamp_force_y")
MARKER = 0.25
STEPS = 36  # of communication under control
FORCED = (6, 18)  # steps with a force

slow = pytest.mark.slow
pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")


class HeldBase(BaseMotion):
    """Accelerations of the base that are constant over each step of communication."""

    def __init__(self, accelerations):
        self.accelerations = np.asarray(accelerations, dtype=float)

    def pieces(self):
        u, u_t, begin, found, held = np.zeros(3), np.zeros(3), 0.0, [], self.accelerations
        for k, a in enumerate(held, start=1):
            if k < len(held) and np.array_equal(a, held[k]):
                continue
            end = k * STEP
            found.append(Piece(end, place(begin, u, u_t, a)))
            u, u_t, begin = u + (end - begin) * u_t + (end - begin) ** 2 / 2 * a, u_t + (end - begin) * a, end
        return *found, Piece(math.inf, place(begin, u, u_t, 0 * u))


def place(begin, u, u_t, a):
    return lambda t, _: cs.DM(u) + cs.DM(u_t) * (t - begin) + cs.DM(a) * (t - begin) ** 2 / 2


class HeldLoad(TipLoad):
    """A force at the tip that is constant between two times."""

    point, follower = None, False

    def __init__(self, force, begin, end):
        self.force, self.times = force, (begin, end)

    def pieces(self):
        begin, end = self.times
        held, zero = (lambda t, _, f=f: cs.DM([*f, 0.0]) + 0 * t for f in (self.force, (0.0, 0.0)))
        return *([Piece(begin, zero)] if begin else []), Piece(end, held), Piece(math.inf, zero)


class Unit:
    """An instance of an FMU, with the messages that it sent."""

    def __init__(self, path, folder, start=None, tolerance=None):
        about = fmpy.read_model_description(path)
        self.references = {variable.name: variable.valueReference for variable in about.modelVariables}
        self.slave = FMU3Slave(
            guid=about.instantiationToken,
            unzipDirectory=folder,
            modelIdentifier=about.coSimulation.modelIdentifier,
            instanceName="beam",
        )
        self.said, self.time = [], 0.0
        self.listen = fmi3LogMessageCallback(lambda _, status, kind, text: self.said.append((status, text.decode())))
        self.slave.instantiate(loggingOn=True, logMessage=self.listen)
        self.set(start or {})
        self.slave.enterInitializationMode(tolerance=tolerance)
        self.slave.exitInitializationMode()

    def set(self, values):
        self.slave.setFloat64([self.references[name] for name in values], [float(v) for v in values.values()])

    def get(self, names=OUTPUTS):
        return np.array(self.slave.getFloat64([self.references[name] for name in names]))

    def step(self, given=(), size=STEP):
        self.set(dict(zip(INPUTS, given, strict=False)))
        self.slave.doStep(self.time, size)
        self.time += size
        return self.get()

    def run(self, inputs):
        return np.array([self.get(), *(self.step(given) for given in inputs)])


@pytest.fixture(scope="module")
def law():
    """Return all kinds of damping, with the parameters alpha, beta, eta1, eta2, ratio1, ratio2."""

    def law_of(model):
        rayleigh, air = RayleighDamping(alpha=0.3, beta=2e-4), QuadraticDamping(eta1=0.5, eta2=2.0)
        return rayleigh + air + ModalDamping(natural_modes(model, count=2), (0.02, 0.01))

    return law_of


@pytest.fixture(scope="module")
def full(paper_beam, law):
    model = Model(paper_beam(3, axis=(0.6, -0.8)))
    return beam_functions(model, law(model), markers=(MARKER,), modes=1), model, law(model)


@pytest.fixture(scope="module")
def reduced(paper_beam, law):
    model = Model(paper_beam(8, axis=(0.6, -0.8)))
    return reduce_model(model, modes=3, damping=law(model), markers=(MARKER,))


@pytest.fixture(scope="module")
def write(tmp_path_factory):
    def written(functions):
        path = tmp_path_factory.mktemp("fmu") / "beam.fmu"
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(fmu, "FMU_FLAGS", ("-O0", *fmu.FMU_FLAGS[1:]))
            write_fmu(functions, path, kind="co-simulation")
        return str(path)

    return written


@pytest.fixture(scope="module")
def full_path(full, write):
    return write(full[0])


@pytest.fixture(scope="module")
def reduced_path(reduced, write):
    return write(reduced)


@pytest.fixture
def unit(tmp_path):
    """Return a function that makes instances of one library, which end with the test."""
    made, folder = [], str(tmp_path / "extracted")

    def make(path, **settings):
        if not made:
            fmpy.extract(path, folder)
        made.append(Unit(path, folder, **settings))
        return made[-1]

    yield make
    for one in made:
        one.slave.freeInstance()


def controlled(unit, force):
    """Let a controller move the base after the tip, under a force in the middle; return inputs and outputs."""
    inputs, outputs, rest = [], [unit.get()], unit.get()
    for k in range(STEPS):
        if k % 3 == 0:  # steps of the controller
            x, y = outputs[-1][:2] - rest[:2]
            speed, turning = unit.get(["base_x_velocity", "base_angle_velocity"])
            a = (80 * ((0.05 if k < STEPS // 2 else 0.0) - x) - 8 * speed, -20 * y, -30 * turning - 100 * y)
        inputs.append((*a, *(force if FORCED[0] <= k < FORCED[1] else (0.0, 0.0))))
        outputs.append(unit.step(inputs[-1]))
    return np.array(inputs), np.array(outputs)


@slow
def test_fmpy_finds_no_errors(full_path, reduced_path, full):
    assert validate_fmu(full_path) == validate_fmu(reduced_path) == []
    about = fmpy.read_model_description(full_path)
    assert about.modelExchange is None and about.coSimulation.canGetAndSetFMUstate
    named = {variable.name: variable for variable in about.modelVariables}
    for signal in (*full[0].parameters, *full[0].states, *full[0].base):
        assert float(named[signal.name].start) == signal.value and named[signal.name].description == signal.description
    assert {name for name, own in named.items() if own.causality == "input"} == set(INPUTS)


@slow
def test_the_full_beam_with_a_controlled_base_follows_simulate(full_path, full, unit):
    """The reference has the accelerations that the controller chose, and the force."""
    _, model, law = full
    force = (0.02, -0.01)
    inputs, outputs = controlled(unit(full_path), force)
    load = HeldLoad(force, *(k * STEP for k in FORCED))
    run = simulate(model, damping=law, base=HeldBase(inputs[:, :3]), load=load, duration=STEPS * STEP,
                   sample_rate=1 / STEP, tolerance=1e-8)  # fmt: skip
    travel = np.ptp(run.tip - run.base[:, :2], axis=0).max()
    assert travel > 0.05
    assert np.abs(outputs[:, :2] - run.tip).max() < 1e-4 * travel
    smooth = np.arange(STEPS + 1) % 3 > 0  # the reference is before a jump, and the outputs are after it
    error = (outputs[:, 2:] - run.clamp_force[:, :2])[smooth]
    assert np.abs(error).max() < 0.02 * np.ptp(run.clamp_force[:, :2], axis=0).max()


@slow
def test_the_reduced_beam_with_a_controlled_base_follows_simulate(reduced_path, reduced, unit):
    inputs, outputs = controlled(unit(reduced_path), (0.0, 0.0))
    settings = {"base": HeldBase(inputs[:, :3]), "duration": STEPS * STEP, "sample_rate": 1 / STEP}
    run = simulate(reduced.model, damping=reduced.law, tolerance=1e-8, **settings)
    own = simulate_reduced(reduced, steps_per_period=40, **settings)
    travel = np.ptp(run.tip - run.base[:, :2], axis=0).max()
    assert travel > 0.05
    assert np.abs(outputs[:, :2] - own.tip).max() < 2e-5 * travel
    assert np.abs(outputs[:, :2] - run.tip).max() < 1e-3 * travel  # three modes


@slow
def test_a_force_at_the_tip_of_the_reduced_beam_moves_it_to_the_equilibrium(reduced_path, reduced, unit):
    beam = unit(reduced_path, start={"alpha": 30.0})
    rest = beam.get()
    found = beam.run([(0.0, 0.0, 0.0, 2e-3, 0.0)] * 100)[-1]
    run = simulate(reduced.model, load=HeldLoad((2e-3, 0.0), 0.0, 1.0), duration=0.01)  # starts in this equilibrium
    moved = np.abs(run.tip[0] - rest[:2]).max()
    assert np.abs(found[:2] - run.tip[0]).max() < 4e-3 * moved and moved > 4e-3  # three modes
    weight = reduced.projection.total_mass * 9.81
    assert found[2:] == pytest.approx([-2e-3, weight], rel=1e-3, abs=1e-3 * weight)


@slow
@pytest.mark.parametrize("kept", [("alpha", "beta"), ("eta1", "eta2"), ("ratio1", "ratio2")])
def test_each_kind_of_damping_agrees_with_simulate(full_path, full, unit, kept):
    """After a shove; the same motion without damping disagrees."""
    _, model, law = full
    names = [own.name for own in law.parameters]
    assert set(kept) < set(names)
    values = [own.value if own.name in kept else 0.0 for own in law.parameters]
    inputs = [(6.0, -3.0)] * 5 + [(-6.0, 3.0)] * 5 + [(0.0, 0.0)] * 20
    found, undamped = (
        unit(full_path, start=dict(zip(names, own, strict=True))).run(inputs) for own in (values, np.zeros(6))
    )
    base = HeldBase([(*a, 0.0) for a in inputs])
    run = simulate(model, damping=law.with_parameters(values), base=base, duration=30 * STEP, sample_rate=1 / STEP,
                   tolerance=1e-8)  # fmt: skip
    travel = np.ptp(run.tip - run.base[:, :2], axis=0).max()
    assert np.abs(found[:, :2] - run.tip).max() < 1e-4 * travel
    assert np.abs(undamped[:, :2] - run.tip).max() > 1e-3 * travel


@slow
@pytest.mark.parametrize("path", ["full_path", "reduced_path"])
def test_instances_do_not_disturb_each_other(path, unit, request):
    path = request.getfixturevalue(path)
    plans = [[(a, 0.0, 10 * a, 0.01, 0.0)] * 8 for a in (5.0, -3.0)]
    alone = [unit(path).run(plan) for plan in plans]
    first, second = unit(path), unit(path)
    together = [[one.get()] for one in (first, second)]
    for pair in zip(*plans, strict=True):
        for one, given, outputs in zip((first, second), pair, together, strict=True):
            outputs.append(one.step(given))
    assert np.array_equal(alone, together)
    assert not np.array_equal(*alone)


@slow
@pytest.mark.parametrize("path", ["full_path", "reduced_path"])
def test_a_state_that_is_set_again_gives_the_same_motion(path, unit, request):
    path = request.getfixturevalue(path)
    beam, plan = unit(path), [(5.0, 0.0, 20.0, 0.0, 0.01)] * 6
    beam.run(plan)
    state, time = beam.slave.getFMUState(), beam.time
    kept = beam.slave.serializeFMUState(state)
    expected = beam.run(plan)
    beam.slave.setFMUState(state)
    beam.time = time
    assert np.array_equal(beam.run(plan), expected)
    other = unit(path)
    other.slave.setFMUState(other.slave.deserializeFMUState(kept))
    other.time = time
    assert np.array_equal(other.run(plan), expected)
    beam.slave.reset()
    assert np.array_equal(beam.get(), unit(path).get())


@slow
@pytest.mark.parametrize("path", ["full_path", "reduced_path"])
def test_a_step_that_does_not_converge_is_an_error_and_keeps_the_state(path, unit, request):
    beam = unit(request.getfixturevalue(path))
    beam.run([(2.0, 0.0)] * 3)
    state = beam.slave.getFMUState()
    before = beam.get([*OUTPUTS, "time"])
    with pytest.raises(FMICallException):
        beam.step((0.0, 0.0, 0.0, 1e300, 0.0))
    status, message = beam.said[-1]
    assert status == 3
    assert message.startswith("at 0.06 s no step converges") and "check inputs" in message
    beam.set({"tip_force_x": 0.0, "base_x_acceleration": 2.0})
    assert np.array_equal(beam.get([*OUTPUTS, "time"]), before)
    with pytest.raises(FMICallException):
        beam.step()
    beam.slave.setFMUState(state)
    beam.step()


@slow
def test_steps_that_become_too_short_are_an_error_and_are_not_kept(reduced_path, unit):
    beam = unit(reduced_path)
    beam.step()
    before = beam.get([*OUTPUTS, "time"])
    with pytest.raises(FMICallException):
        beam.step((0.0, 0.0, 1e14))
    assert 0.02 < float(beam.said[-1][1].split()[1]) < 0.04
    beam.set({"base_angle_acceleration": 0.0})
    assert np.array_equal(beam.get([*OUTPUTS, "time"]), before)


@slow
def test_wrong_calls_are_refused_with_one_line(reduced_path, unit):
    beam = unit(reduced_path)
    beam.step()
    for call, words in (
        (lambda: beam.slave.doStep(0.5, STEP), "is at 0.02 s, and cannot make a step from 0.5 s"),
        (lambda: beam.slave.doStep(STEP, -1.0), "must be positive"),
        (lambda: beam.set({"tip_x": 0.0}), "cannot be set"),
        (lambda: beam.set({"q_1": 0.0}), "before the first step only"),
        (lambda: beam.set({"eta1": math.nan}), "must be finite"),
        (lambda: beam.slave.getFloat64([1000]), "no variable 1000"),
        (lambda: beam.slave.enterEventMode(), "not part of the FMU"),
        (lambda: beam.slave.enterInitializationMode(startTime=9.0), "cannot be called now"),
    ):
        with pytest.raises(FMICallException):
            call()
        assert words in beam.said[-1][1]
    assert beam.get(["time"]) == STEP
    beam.slave.terminate()
    assert "times real time" in beam.said[-1][1]


@slow
def test_a_smaller_tolerance_gives_a_smaller_error(reduced_path, unit):
    plan = [(5.0, 0.0, 20.0, 0.0, 0.01)] * 20
    loose, usual, exact = (unit(reduced_path, tolerance=one).run(plan)[-1, :2] for one in (1e-4, None, 1e-11))
    assert 0 < 10 * np.abs(usual - exact).max() < np.abs(loose - exact).max()


@pytest.mark.parametrize(
    "make", [lambda model: beam_functions(model, modes=1), lambda model: reduce_model(model, modes=2)]
)
def test_a_displaced_clamp_shifts_the_motion_and_keeps_its_error(paper_beam, make):
    """A shift by ten lengths changes positions by the shift, and the estimated error by rounding."""
    ends, shift = [], 5.0
    for displacement in ((0.0, 0.0), (shift, 0.0)):
        functions = make(Model(paper_beam(3, supports=(Clamp(displacement=displacement),))))
        x, p = np.concatenate([values(functions.states), np.zeros(6)]), values(functions.parameters)
        x_next, error = advance_function(functions)(x, [5.0, 0.0, 0.0, 0.0, 0.01], p, 0.01)
        ends.append((x_next.full().ravel()[: functions.free], float(error)))
    (q, error), (shifted_q, shifted_error) = ends
    along_x = [shift * (signal.name[:2] == "x_") for signal in functions.states[: functions.free]]
    np.testing.assert_allclose(shifted_q - along_x, q, rtol=0, atol=1e-10)
    assert shifted_error == pytest.approx(error, rel=1e-3, abs=0.0)


def test_the_tableau_has_order_4_and_its_error_estimate_order_3():
    """Conditions of order for a method and its embedded method, and of the order 2 of its stages."""
    A = np.array([[*row, *[0.0] * (6 - len(row))] for row in KENNEDY_CARPENTER])
    c, b = A.sum(axis=1), A[-1]
    assert np.allclose(c, stage_instants(KENNEDY_CARPENTER)) and np.allclose(A @ c, c**2 / 2)
    trees = [np.ones(6), c, c**2, A @ c, c**3, c * (A @ c), A @ c**2, A @ A @ c]
    assert np.allclose([b @ tree for tree in trees], [1, 1 / 2, 1 / 3, 1 / 6, 1 / 4, 1 / 8, 1 / 12, 1 / 24], rtol=1e-13)
    errors = [np.dot(KENNEDY_CARPENTER_ERROR, tree) for tree in trees]
    assert np.allclose(errors[:4], 0, atol=1e-15) and abs(errors[4]) > 1e-3


@pytest.mark.parametrize("supports", [(Clamp(),), (Clamp(), Pin(0.5)), (Pin(0.0), Spring(0.3, (0.0, 5.0)))])
def test_clamp_supports_and_springs_carry_the_weight(paper_beam, supports):
    """At rest, the force on the full and the reduced beam is the weight."""
    beam = paper_beam(4, axis=(1.0, 0.0), thickness=2e-3)
    springs = [own for own in supports if isinstance(own, Spring)]
    model = Model(beam.with_(supports=[own for own in supports if own not in springs], attachments=springs))
    weight = 0.5 * 5e-3 * 2e-3 * 8000.0 * 9.81
    for functions in (beam_functions(model, modes=1), reduce_model(model, modes=1)):
        rest, zero, p = values(functions.states), np.zeros(functions.free), values(functions.parameters)
        force = functions.clamp_force(rest[: functions.free], zero, zero, np.zeros(9), p).full().ravel()
        assert force == pytest.approx([0.0, weight], abs=1e-6 * weight)
