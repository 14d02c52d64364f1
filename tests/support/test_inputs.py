"""Checks of arguments: each public function refuses unusable input in one line that states the expected value."""

import math
from functools import partial

import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    EquilibriumError,
    HarmonicBase,
    InputError,
    Measurement,
    ModalDamping,
    Model,
    PointLoad,
    RayleighDamping,
    SampledBase,
    SampledLoad,
    Section,
    State,
    SweepBase,
    mac,
    motion,
    natural_modes,
    periodic_motion,
    reduce_model,
    run_all,
    simulate,
    simulate_reduced,
    static_equilibrium,
)
from ancf_casadi.support.inputs import whole
from problems import (
    MarkerRecord,
    MeasuredModes,
    compare_decay_laws,
    compare_laws,
    fit_beam,
    fit_decay,
    fit_decays,
    fit_rayleigh,
    match_frequencies,
    monte_carlo,
)

TIME = np.arange(0.0, 1.0, 0.1)
SWING = np.cos(11.0 * TIME)
POSITIONS = np.column_stack([SWING, TIME])
BEAM = Beam.uniform(length=0.5, width=5e-3, thickness=5e-4, density=8000.0, elastic_modulus=210e9, elements=2)
MODEL = Model(BEAM)
MODES = natural_modes(MODEL, count=2)
LAW = RayleighDamping(alpha=0.5)
RECORD = MarkerRecord(TIME, POSITIONS)
FIRST = (1.9,)

run = partial(simulate, MODEL, duration=0.1)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: natural_modes(BEAM), "model: must be a Model, got a Beam; use Model(beam)"),
        (lambda: natural_modes(Model), "model: must be a Model, got the class Model"),
        (lambda: natural_modes(MODEL, equilibrium=MODES), "equilibrium: must be an Equilibrium, got a Modes; use mode"),
        (lambda: Model(MODEL), "beam: must be a Beam, got a Model; use model.beam"),
        (lambda: Model(BEAM, "green"), "measures: must be a StrainMeasures, got 'green'"),
        (lambda: simulate(BEAM, duration=1.0), "model: must be a Model, got a Beam; use Model(beam)"),
        (lambda: run(damping=[LAW]), "damping: must be a DampingLaw, got a list; use the sum of the laws"),
        (lambda: run(base="x"), "base: must be a BaseMotion, got 'x'"),
        (lambda: run(start=np.zeros(12)), "start: must be a text, an Equilibrium or a State, got an array; use State("),
        (lambda: run(options=[1]), "options: must be a mapping, got a list"),
        (lambda: run(method=np.array(["idas", "radau"])), "method: must be one of auto, idas, radau, got array("),
        (lambda: run(progress=np.ones(2)), "progress: must be True or False, got array([1., 1.])"),
        (lambda: run(largest_step=np.ones(2)), "largest_step: must be a finite number, got array([1., 1.])"),
        (lambda: State([1.0], "x"), "velocities: must be numbers"),
        (lambda: LAW + 1.0, "damping: must be a DampingLaw, got 1.0"),
        (lambda: motion(MODEL, duration=1.0, start_load="x"), "start_load: must be True or False, got 'x'"),
        (lambda: simulate_reduced(MODEL, duration=1.0), "reduced: must be a ReducedModel, got a Model; use reduce_mod"),
        (lambda: ModalDamping(MODEL, (0.01,)), "modes: must be a Modes, got a Model; use natural_modes(model)"),
        (lambda: ModalDamping(MODES, (0.01,), frequencies=1.0), "frequencies: must have one value per mode, got 1.0"),
        (lambda: LAW.damping_ratios(BEAM, [1.0]), "modes: must be a Modes, got a Beam; use natural_modes(Model(beam))"),
        (lambda: LAW.with_parameters(1.0), "values: must be a sequence of numbers, got 1.0"),
        (lambda: MODES.modal_coordinate(np.zeros(3), 0), "coordinates: must have 12 columns, got (3,)"),
        (lambda: MODES.modal_coordinate(np.zeros(12), 2), "mode: must be a whole number, 0 to 1, got 2"),
        (lambda: Section("x", 1.0), "width: must be a finite number, got 'x'"),
        (lambda: Section(1.0, 1e302), "thickness: 1e+302 m is beyond the range of numbers; check the unit"),
        (lambda: mac("x", MODES.shapes), "first: must be numbers"),
        (lambda: mac(np.ones((3, 1)), MODES.shapes), "second: must be columns as long as the first"),
        (lambda: run_all([int], executor=2), "executor: must be an Executor, got 2"),
        (lambda: Beam.uniform(length=1, width=np.array(1.0), thickness=1, density=1, elastic_modulus="x", elements=2),
         "elastic_modulus: must be a finite number, got 'x'"),
        (lambda: BEAM.with_(axis=np.array(1.0)), "axis: must be a pair of numbers (x, y), got array(1.)"),
        (lambda: fit_decay(TIME, SWING, robust="no"), "robust: must be True or False, got 'no'"),
        (lambda: fit_decay(TIME, SWING, law=np.array(["linear", "quadratic"])), "law: must be one of linear, quadrat"),
        (lambda: fit_decays(Measurement(TIME, SWING)), "records: must be a sequence of Measurement, got a Measurement"),
        (lambda: fit_decays([Measurement(TIME, SWING)], release_times=1.0), "release_times: must be a sequence of num"),
        (lambda: compare_decay_laws(TIME, SWING, laws=LAW), "laws: must be a sequence of names, got Rayl"),
        (lambda: fit_rayleigh(1.0, 0.01), "frequencies: must be a sequence of numbers, got 1.0"),
        (lambda: MarkerRecord(TIME, POSITIONS, points=0.5), "points: must be a sequence of numbers, got 0.5"),
        (lambda: MarkerRecord(TIME, POSITIONS, base="x"), "base: must be a BaseMotion, got 'x'"),
        (lambda: MarkerRecord(TIME, POSITIONS, start=POSITIONS), "start: must be a text, an Equilibrium or a State, g"),
        (lambda: match_frequencies(MODEL, targets=FIRST), "beam: must be a Beam, got a Model; use model.beam"),
        (lambda: fit_beam(BEAM, RECORD, LAW), "model: must be a Model, got a Beam; use Model(beam)"),
        (lambda: fit_beam(MODEL, POSITIONS, LAW), "records: must be a MotionRecord, a MarkerRecord or a Measu"),
        (lambda: fit_beam(MODEL, RECORD, [LAW]), "damping: must be a DampingLaw, got a list; use the sum of the"),
        (lambda: fit_beam(MODEL, RECORD, LAW, fixed="alpha"), "fixed: must be a sequence of names, got 'alpha'"),
        (lambda: fit_beam(MODEL, RECORD, LAW, bounds=[1]), "bounds: must be a mapping, got a list"),
        (lambda: compare_laws(MODEL, RECORD, LAW), "laws: must be a sequence of DampingLaw, got a RayleighDamping; pu"),
        (lambda: compare_laws(MODEL, RECORD, []), "laws: is empty; give at least one DampingLaw"),
        (lambda: monte_carlo(MODEL), "fit: must be the result of a fit, got a Model"),
    ],
)  # fmt: skip
def test_a_wrong_class_is_refused_in_one_line_with_what_was_expected(call, message):
    with pytest.raises(InputError) as caught:
        call()
    assert str(caught.value).startswith(message)
    assert len(str(caught.value)) < 200
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("size", [1e-302, 1e302])
@pytest.mark.parametrize(
    "call",
    [
        lambda size: Measurement(size * TIME, SWING),
        lambda size: fit_decay(size * TIME, SWING, law="quadratic"),
        lambda size: MarkerRecord(size * TIME, POSITIONS),
        lambda size: SampledBase(size * TIME, POSITIONS),
        lambda size: HarmonicBase(1e-3, size),
        lambda size: HarmonicBase(1e-3, 1.0, stop=size),
        lambda size: SweepBase(1e-3, (1.0, size), stop=1.0),
        lambda size: SweepBase(1e-3, (1.0, 2.0), stop=size),
        lambda size: simulate(MODEL, duration=size, sample_rate=10 / size),
        lambda size: motion(MODEL, duration=size, sample_rate=10 / size),
        lambda size: simulate_reduced(reduce_model(MODEL, modes=1), duration=size, sample_rate=10 / size),
        lambda size: fit_rayleigh((size, 2 * size), (0.01, 0.02)),
        lambda size: MeasuredModes((size,)),
        lambda size: ModalDamping(MODES, (0.01,), frequencies=(size,)),
    ],
)
def test_a_time_or_a_frequency_beyond_all_experience_is_refused(call, size):
    """Powers of such a time or frequency overflow; usually the unit is wrong."""
    with pytest.raises(InputError, match=r"is not within 1e-30 to 1e\+30; check the unit$"):
        call(size)


@pytest.mark.slow
def test_a_beam_too_soft_for_its_weight_is_given_up_soon():
    soft = Beam.uniform(length=0.5, width=5e-3, thickness=5e-4, density=8000.0, elastic_modulus=2.5, elements=4)
    with pytest.raises(EquilibriumError, match=r"a value is in the wrong unit$"):
        static_equilibrium(Model(soft))


def test_an_integer_too_large_for_a_float_is_no_number():
    for call in (lambda: Measurement([0, 10**400], [0, 1]), lambda: State([10**400], [0.0])):
        with pytest.raises(InputError, match=r"must be (a vector of )?numbers"):
            call()


def test_a_load_has_finite_powers():
    """The squares of 1e308 overflow, with a warning of NumPy."""
    for call in (
        lambda: static_equilibrium(MODEL, tip_force=(1e308, -1e308)),
        lambda: static_equilibrium(MODEL, tip_moment=1e308),
        lambda: PointLoad((0.0, 1e308)),
    ):
        with pytest.raises(InputError, match=r"1e\+308 is not within 1e-30 to 1e\+30; check the unit"):
            call()


def test_a_whole_number_is_one_of_32_bits():
    """Larger ones overflow in CasADi, in NumPy and in the executors of Python."""
    assert whole(2**31 - 1, "jobs", 1) == 2**31 - 1
    with pytest.raises(InputError, match=r"^jobs: must be a whole number, 1 to 2147483647, got 1"):
        whole(10**400, "jobs", 1)


def test_instants_of_a_load_have_finite_differences():
    with pytest.raises(InputError, match=r"^time: 1e\+308 is not within 1e-30 to 1e\+30; check the unit$"):
        SampledLoad((-1e308, 1e308), [(0.0, 1.0), (0.0, 1.0)])


def test_a_direction_may_have_any_length():
    """The squares of 1e308 overflow, with a warning of NumPy."""
    swing = periodic_motion(MODEL, damping=RayleighDamping(0.1), base=HarmonicBase(1e-3, 1.0))
    largest, expected = (swing.amplitude(direction=(size, -size)) for size in (1e308, 1.0))
    assert math.isclose(largest, expected, rel_tol=1e-12)


@pytest.mark.parametrize("stop", [1e-30, 1e-14])
def test_a_base_that_stops_as_soon_as_it_starts_has_not_moved(stop):
    """The stop is so close to the start that both count as the same instant."""
    run = simulate(MODEL, duration=0.01, base=HarmonicBase(1e-3, 1.0, stop=stop, stop_at="once"))
    assert np.abs(run.base).max() < 1e-15
    assert math.isclose(run.time[-1], 0.01)
