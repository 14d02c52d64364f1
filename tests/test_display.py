"""Every public object is shown on one line and can be pickled; every computed result has text, data and a figure."""

import json
import pickle
from dataclasses import replace

import casadi as cs
import numpy as np
import pytest

import ancf_casadi
import problems
from ancf_casadi import (
    Beam,
    Clamp,
    Dashpot,
    Footage,
    FrictionDamping,
    Guide,
    HarmonicBase,
    HarmonicForce,
    HarmonicLoad,
    InputError,
    LineLoad,
    Measurement,
    ModalDamping,
    Model,
    MovingForce,
    Parameter,
    Pin,
    PointLoad,
    PointMass,
    QuadraticDamping,
    RayleighDamping,
    Roller,
    RotationalSpring,
    SampledBase,
    SampledLoad,
    SecondOrderSystem,
    Sensor,
    Spring,
    SweepBase,
    backbone,
    critical_load,
    damped_modes,
    damping_curve,
    equilibrium_path,
    frequency_response,
    linear_frf,
    natural_modes,
    periodic_motion,
    read_recording,
    reduce_model,
    simulate,
    simulate_reduced,
    static_equilibrium,
)
from ancf_casadi.estimation.criteria import Expectation
from ancf_casadi.estimation.prediction import RecordPrediction
from ancf_casadi.estimation.result import FitResult
from ancf_casadi.support.tables import Reported
from problems import (
    Camera,
    Channel,
    FrequencyRecord,
    FrfRecord,
    Global,
    LeastChange,
    MarkerRecord,
    MeasuredModes,
    MotionRecord,
    PerElement,
    PlannedComparison,
    PlannedRecord,
    ResponseRecord,
    SavedFit,
    Smooth,
    Smoothness,
    StaticRecord,
    compare_decay_laws,
    fit_beam,
    fit_decay,
    fit_decays,
    fit_frf,
    fit_mode,
    fit_modes,
    fit_rayleigh,
    isolate_mode,
    law_curve,
    load_fit,
    match_frequencies,
    monte_carlo,
    plan,
    run_study,
)

LEFT_OUT = dict.fromkeys(("BaseMotion", "DampingLaw", "TipLoad", "Support", "Attachment"), "abstract")
CLASSES = {
    name: found
    for package in (ancf_casadi, problems)
    for name in package.__all__
    if isinstance(found := getattr(package, name), type)
}
RESULTS = sorted(name for name, found in CLASSES.items() if issubclass(found, Reported) and name not in LEFT_OUT)
COMPUTED = [name for name in RESULTS if not issubclass(CLASSES[name], FitResult | SavedFit | RecordPrediction)]
FITS = [name for name in RESULTS if issubclass(CLASSES[name], FitResult | SavedFit)]
TIME = np.arange(0.0, 4.0, 0.02)
SWING = 0.05 * np.exp(-0.2 * TIME) * np.cos(12.0 * TIME) + 1e-4 * np.sin(300.0 * TIME**2)
STUDY = """
[beam]
length = 0.5
width = 5e-3
thickness = 0.5e-3
density = 8000.0
elastic_modulus = 210e9
elements = 4

[[steps]]
kind = "beam"
"""


@pytest.fixture(scope="module")
def samples(tmp_path_factory):
    """Return an object of each public class by name."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ANCF_CASADI_COMPILE", "0")
        return made(tmp_path_factory.mktemp("samples"))


def made(folder):
    beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8e3, elastic_modulus=210e9, elements=4)
    model, law = Model(beam), RayleighDamping(alpha=0.5)
    modes, rest = natural_modes(model, count=3), static_equilibrium(model, tip_force=(0.02, 0.0))
    base, record = HarmonicBase(amplitude=5e-3, frequency=1.9), Measurement(TIME, SWING, "tip <b>")
    reduced, system = reduce_model(model, modes=2, damping=law), duffing()
    run = simulate(model, damping=law, base=base, duration=0.02)
    force = HarmonicForce(amplitude=0.05, frequency=0.1)
    (folder / "run.csv").write_text("t (s),x (mm)\n0.0,1.5\n0.1,1.4\n0.2,1.3\n")
    (folder / "study.toml").write_text(STUDY)
    errors = (ancf_casadi.EquilibriumError, ancf_casadi.FitError, ancf_casadi.NumericsError)
    drift = np.outer(SWING, (1.0, 0.0))
    found = [
        beam, beam.sections[0], model, model.measures, PointLoad(force=(0.0, 1e-3)), *set_up(beam),
        Parameter("k", 2.0, "N/m", "k"),
        law, QuadraticDamping(eta2=0.1), FrictionDamping(eta0=1e-4), ModalDamping(modes, (0.01, 0.003, 0.003)),
        ancf_casadi.FixedBase(), base, SweepBase(5e-3, (1.0, 2.0), stop=9.0), SampledBase(TIME, drift), force,
        HarmonicLoad(force=(1e-3, 0.0), frequency=2.0), SampledLoad(TIME, drift), MovingForce((0.0, 1e-3), 1.0),
        rest, modes, run, run.state(-1), Footage((0.0, 0.1), np.zeros((2, 8, 8), np.uint8), 1e-3, (4.0, 0.0)),
        reduced, simulate_reduced(reduced, base=base, duration=0.1, sample_rate=100.0), system,
        periodic_motion(system, force=force), backbone(system, amplitude=0.1, points=2),
        frequency_response(system, (0.1, 0.12), force=force), linear_frf(model, law, [1.0, 2.0, 3.0]),
        Sensor("strain", point=0.1), ancf_casadi.TableLayout(names_row=2),
        record, read_recording(folder / "run.csv"), damping_curve(record),
        law_curve(fit_decay(record)), Channel(record), Camera(scale=(0.9, 1.1)), MotionRecord([record], base=base),
        MarkerRecord(TIME, np.column_stack([SWING, SWING])), MeasuredModes((1.9, 10.4), 0.01),
        StaticRecord(model, [PointLoad(force=(1e-3, 0.0))], [0.01], Sensor()), FrequencyRecord(model, [1.9, 10.4]),
        ResponseRecord([1.8, 1.9, 2.0], [0.01, 0.02, 0.01], base=base), Global("thickness"), PerElement("thickness"),
        Smooth("thickness"), LeastChange(), Smoothness(), FrfRecord(np.arange(1.0, 9.0), np.ones(8), "receptance"),
        isolate_mode(record, band=(1.0, 3.0)), run_study(folder / "study.toml", folder / "results"),
        *fits(folder, model, record),
        ancf_casadi.AncfError("no"), InputError("must be positive", "width"), *(error("no") for error in errors),
        ancf_casadi.SimulationError("no", time=1.0), ancf_casadi.ContinuationError("no", partial=rest),
    ]  # fmt: skip
    return {type(own).__name__: own for own in found}


def set_up(beam):
    """Return supports, attachments, loads, and the results about critical loads."""
    column = Model(beam.with_(axis=(1.0, 0.0), gravity=(0.0, 0.0)))
    push = [PointLoad((-0.1, 0.0))]
    path = equilibrium_path(column, loads=push, largest_factor=2.0)
    return [
        Clamp(), Pin(0.5), Roller(0.5), Guide(0.5), PointMass(0.5, 1e-3), Spring(0.5, (0.0, 1.0)),
        RotationalSpring(0.0, 1.0), Dashpot(0.5, (0.0, 0.1)), LineLoad((0.0, 0.1)), damped_modes(column, count=2),
        critical_load(column, push, largest_factor=2.0, steps=4), path, path.critical_points[0],
    ]  # fmt: skip


def fits(folder, model, record):
    """Return the result of each fit, and predictions."""
    decay, frequencies = fit_decay(record), FrequencyRecord(model, [1.9, 10.8])
    decay.save(folder / "fit.json")
    beam = fit_beam(model, frequencies, unknowns=["elastic_modulus"])
    tones = PlannedRecord.natural_frequencies(model, [1, 2], std=0.01)
    lines = np.linspace(1.0, 3.0, 41)
    receptance = 1.0 / (2.0**2 - lines**2 + 0.04j * lines) + 0.05 * np.random.default_rng(1).standard_normal(41)
    return [
        decay, load_fit(folder / "fit.json"), decay.predict(record), beam, beam.predict(frequencies),
        tones, plan(model, {"tones": tones}, unknowns=["elastic_modulus"]),
        decay.log_density(), fit_decays([record, record]), fit_modes(record, modes=1), fit_mode(record),
        fit_rayleigh((1.0, 5.0, 9.0), (0.01, 0.02, 0.04)),
        fit_frf(FrfRecord(lines, receptance, "receptance"), frequencies=[2.0]), monte_carlo(decay, runs=2),
        match_frequencies(model.beam, targets=(1.9, 10.4), unknowns=[Global("thickness"), Global("density")]),
        compare_decay_laws(record, laws=("linear", "quadratic"), frequency_laws=("constant",)),
        PlannedComparison(("a", "b"), {("tap", k, 1 - k): Expectation(9.0, 0.99) for k in (0, 1)}),
    ]  # fmt: skip


def duffing():
    q, v, a, u, mu = (cs.SX.sym(name) for name in ("q", "v", "a", "u", "mu"))
    return SecondOrderSystem.of(
        q, v, a, u, mu, conservative=a + q + mu * q**3, damping=0.05 * v, excitation=u,
        parameters=[Parameter("mu", 0.5, "1/m^2", "cubic stiffness")],
    )  # fmt: skip


def test_every_public_class_has_a_sample_or_a_reason(samples):
    assert set(CLASSES) == samples.keys() | LEFT_OUT.keys()
    assert not samples.keys() & LEFT_OUT.keys()


@pytest.mark.parametrize("name", sorted(CLASSES.keys() - LEFT_OUT.keys()))
def test_an_object_is_shown_on_one_line_and_can_be_pickled(samples, name):
    own = samples[name]
    text = repr(own)
    assert text.startswith(f"{name}(") and len(text) < 200 and "\n" not in text
    again = pickle.loads(pickle.dumps(own))
    assert type(again) is type(own) and repr(again) == text


@pytest.mark.parametrize("name", COMPUTED)
def test_a_computed_result_has_text_html_data_and_a_file(samples, name, tmp_path):
    own = samples[name]
    assert own.table().title in own.report() and own._repr_html_().startswith("<table>")
    data = own.to_dict()
    own.save(tmp_path / "result.json")
    assert json.loads((tmp_path / "result.json").read_text()) == json.loads(json.dumps(data))
    assert pickle.loads(pickle.dumps(own)).to_dict() == data


@pytest.mark.parametrize("name", FITS)
def test_every_fit_has_warnings_errors_text_data_and_a_figure(samples, name):
    """As the README says."""
    fit = samples[name]
    assert fit.report() and fit.to_dict()["kind"] and fit.standard_errors.keys() and isinstance(fit.warnings, tuple)
    assert fit.figure().axes


def test_each_computed_result_states_its_own_kind(samples):
    assert len({samples[name].to_dict()["kind"] for name in COMPUTED}) == len(COMPUTED) == 12


@pytest.mark.parametrize("name", COMPUTED)
def test_two_of_a_kind_are_drawn_over_each_other(samples, name):
    own = samples[name]
    alone, both = own.figure(), own.figure(own, labels=("one", "the $other"))
    assert len(alone.axes) == len(both.axes)
    assert len(both.axes[0].lines) > len(alone.axes[0].lines)
    legends = [*both.legends, *(axes.get_legend() for axes in both.axes if axes.get_legend())]
    names = [text.get_text() for legend in legends for text in legend.get_texts()]
    assert any(text.startswith("one") for text in names) and any(text.startswith("the $other") for text in names)


def test_a_full_and_a_reduced_motion_are_of_one_kind(samples):
    legend = samples["Trajectory"].figure(samples["ReducedTrajectory"]).axes[0].get_legend()
    assert [text.get_text() for text in legend.get_texts()] == ["1", "2"]


def test_a_motion_that_failed_at_once_is_shown_and_not_drawn(samples):
    run = samples["Trajectory"]
    failed = replace(run, time=run.time[:0])
    assert repr(failed) == "Trajectory(0 s, 0 samples, 4 elements, tip travel 0 mm, radau)"
    assert "0 samples" in failed.report() and failed.to_dict()["tip_m"] == []
    with pytest.raises(InputError, match=r"^figure: the motion has no samples$"):
        failed.figure()


def test_results_of_different_kinds_are_not_drawn_together(samples):
    run, curve, system = samples["Trajectory"], samples["ResponseCurve"], samples["SecondOrderSystem"]
    with pytest.raises(InputError, match=r"^figure: a Trajectory cannot be drawn with a Modes$"):
        run.figure(samples["Modes"])
    with pytest.raises(InputError, match=r"^labels: must be 2 different names$"):
        run.figure(run, labels=("same", "same"))
    with pytest.raises(InputError, match=r"^labels: must be 1 different names$"):
        run.figure(labels=("same", "same"))
    with pytest.raises(InputError, match=r"^labels: must be a sequence of str"):
        run.figure(run, labels="ab")
    free = ancf_casadi.amplitude_response(system, (0.02, 0.05), force=samples["HarmonicForce"])
    with pytest.raises(InputError, match=r"^figure: the curves must be over the same quantity, here frequency$"):
        curve.figure(free)
    other = linear_frf(samples["Model"], samples["RayleighDamping"], [1.0, 2.0], kind="mobility")
    with pytest.raises(InputError, match=r"^figure: the functions must be of the same kind, here receptance$"):
        samples["LinearFrf"].figure(other)
