"""The FMU: validity, description, and its motion in fmpy against ``simulate``."""

import importlib.util
import math
import shutil
import types
import zipfile

import casadi as cs
import fmpy
import numpy as np
import pytest
from fmpy.fmi3 import FMU3Model
from fmpy.validation import validate_fmu

from ancf_casadi import (
    BaseMotion,
    Clamp,
    Dashpot,
    InputError,
    ModalDamping,
    Model,
    PointMass,
    QuadraticDamping,
    RayleighDamping,
    Spring,
    State,
    natural_modes,
    reduce_model,
    simulate,
    simulate_reduced,
    static_equilibrium,
)
from ancf_casadi.dynamics.base_motion import Piece
from ancf_casadi.export import DataFile, Document, Identification, Provenance, fmu, read_document
from ancf_casadi.export.fmu import write_fmu
from ancf_casadi.export.motion_functions import beam_functions, load_functions, save_functions

MARKERS = (0.2, 0.375)
ACCELERATION = np.array([8.0, -4.0, 40.0])  # of the clamp: x, y (m/s^2), rotation (rad/s^2)
PHASE = 0.05  # s
DURATION = 0.12  # s
RATE = 1000.0
MODES = 4  # of the reduced model

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")


class Shove(BaseMotion):
    """Constant acceleration of the clamp, constant deceleration, then rest."""

    def pieces(self):
        a = cs.DM(ACCELERATION)
        return (
            Piece(PHASE, lambda t, _: a * t**2 / 2),
            Piece(2 * PHASE, lambda t, _: a * (PHASE**2 - (t - 2 * PHASE) ** 2 / 2)),
            Piece(math.inf, lambda t, _: a * PHASE**2 + 0 * t),
        )


@pytest.fixture(scope="module")
def document(paper_beam) -> Document:
    model = Model(paper_beam(4, axis=(0.6, -0.8)))
    law = (
        ModalDamping(natural_modes(model, count=2), (0.02, 0.01))
        + QuadraticDamping(eta1=0.5, eta2=2.0)
        + RayleighDamping(beta=1e-5)
    )
    known = {"name": "frequency", "value": 1.85, "unit": "Hz", "standard_error": 0.01}
    result = {"kind": "decay", "estimates": [known, {**known, "name": "drift", "standard_error": None}]}
    identifications = Identification.of(result), Identification(result, [DataFile("tip<&.csv", "0f" * 32)])
    return Document(model, law, identifications, Provenance.of_this(written="2025-01-31T12:00:00Z"))


@pytest.fixture(scope="module")
def functions(document):
    return beam_functions(document.model, document.damping, markers=MARKERS, modes=1)


def quickly(functions, path, document=None) -> str:
    """Write an FMU compiled without optimisation, which takes a fifth of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fmu, "FMU_FLAGS", ("-O0", *fmu.FMU_FLAGS[1:]))
        write_fmu(functions, path, document=document)
    return str(path)


@pytest.fixture(scope="module")
def exported(functions, document, tmp_path_factory) -> str:
    return quickly(functions, tmp_path_factory.mktemp("fmu") / "my beam.fmu", document)


def run_fmu(path, start_values, size=1.0, relative_tolerance=1e-8):
    """Simulate the FMU under the shove; return the samples at the instants of ``simulate``."""
    names = [f"base_{c}_acceleration" for c in ("x", "y", "angle")]
    steps = [(0.0, 1), (PHASE, 1), (PHASE, -1), (2 * PHASE, -1), (2 * PHASE, 0), (DURATION, 0)]
    dtype = [("time", float), *((name, float) for name in names)]
    accelerations = np.array([(t, *(sign * size * ACCELERATION)) for t, sign in steps], dtype=dtype)
    outputs = ["tip_x", "tip_y", "marker_1_x", "marker_1_y", "marker_2_x", "marker_2_y", "kinetic_energy",
               "strain_energy", "base_x", "base_y"]  # fmt: skip
    settings = {"stop_time": DURATION, "output_interval": 1 / RATE, "relative_tolerance": relative_tolerance}
    samples = fmpy.simulate_fmu(path, start_values=start_values, input=accelerations, output=outputs, **settings)
    last = np.append(np.diff(samples["time"]) > 1e-9, True)  # of two samples at an event
    assert np.allclose(samples["time"][last], np.arange(round(DURATION * RATE) + 1) / RATE, atol=1e-9)
    return {name: samples[name][last] for name in outputs}


def check(found, run, energies, tolerance=1e-7):
    """Compare each output with the reference, positions relative to the travel of the tip."""
    base = run.base[:, :2]
    travel = np.ptp(run.tip - base, axis=0).max()
    assert travel > 0.02
    points = {"tip": run.tip, "base": base}
    points |= {f"marker_{k}": run.position(s) for k, s in enumerate(MARKERS, start=1)}
    for name, truth in points.items():
        for c, component in enumerate("xy"):
            assert np.abs(found[f"{name}_{component}"] - truth[:, c]).max() < tolerance * travel, name
    for name, truth in zip(("kinetic_energy", "strain_energy"), energies, strict=True):
        assert np.abs(found[name] - truth).max() < 1e-5 * truth.max()


def truth(model, law):
    return simulate(
        model, damping=law, base=Shove(), duration=DURATION, sample_rate=RATE, method="radau", tolerance=1e-9
    )


@pytest.fixture(scope="module")
def reference(document):
    return truth(document.model, document.damping)


@pytest.mark.slow
def test_fmpy_finds_no_errors(exported):
    assert validate_fmu(exported) == []


@pytest.mark.slow
def test_the_motion_in_fmpy_agrees_with_simulate(exported, reference):
    check(run_fmu(exported, {}), reference, (reference.kinetic_energy, reference.strain_energy))


@pytest.mark.slow
def test_another_beam_and_law_by_parameters(exported, functions, document, reference):
    """Parameters and states are set before the start, the states to the equilibrium under the new gravity."""
    beam = document.model.beam
    beam = beam.with_(thickness=(0.6e-3, 0.55e-3, 0.45e-3, 0.4e-3), elastic_modulus=1.9e11, gravity=(1.0, -8.0))
    model = Model(beam)
    law = document.damping.with_parameters((0.05, 0.0, 1.0, 3.0, 2e-5))
    values = {"gravity_x": 1.0, "gravity_y": -8.0, "ratio1": 0.05, "ratio2": 0.0, "eta1": 1.0, "eta2": 3.0,
              "beta": 2e-5}  # fmt: skip
    values |= {f"thickness_{k}": h for k, h in enumerate(beam.thickness, start=1)}
    values |= {f"elastic_modulus_{k}": 1.9e11 for k in range(1, 5)}
    names = [state.name for state in functions.states[:16]]
    values |= dict(zip(names, static_equilibrium(model).coordinates[4:], strict=True))
    run = truth(model, law)
    check(run_fmu(exported, values), run, (run.kinetic_energy, run.strain_energy))
    assert np.abs(run.tip - reference.tip).max() > 1e-3


@pytest.mark.slow
def test_directional_derivatives_agree_with_differences(exported, tmp_path):
    """Central differences of the derivatives of the states."""
    about = fmpy.read_model_description(exported)
    folder = fmpy.extract(exported, str(tmp_path))
    instance = FMU3Model(
        guid=about.guid,
        unzipDirectory=folder,
        modelIdentifier=about.modelExchange.modelIdentifier,
        instanceName="beam",
    )
    instance.instantiate()
    instance.enterInitializationMode()
    instance.exitInitializationMode()
    states = [d.variable.derivative for d in about.derivatives]
    derivatives = [d.variable.valueReference for d in about.derivatives]
    known = [s.valueReference for s in states]
    known += [v.valueReference for v in about.modelVariables if v.causality in ("input", "parameter")]
    draw = np.random.default_rng(4)
    at = np.array(instance.getFloat64(known))
    at[: len(states)] += 1e-3 * draw.standard_normal(len(states))
    size = np.where(at == 0.0, 1.0, np.abs(at))
    size[: len(states)] = 1.0
    seed = size * draw.standard_normal(len(known))

    def derivative(x):
        instance.setFloat64(known, x.tolist())
        return np.array(instance.getFloat64(derivatives))

    h = 1e-6
    differences = (derivative(at + h * seed) - derivative(at - h * seed)) / (2 * h)
    derivative(at)
    forward = np.array(instance.getDirectionalDerivative(derivatives, known, seed.tolist()))
    assert np.abs(forward - differences).max() < 1e-6 * np.abs(forward).max()
    assert np.abs(forward).max() > 1.0
    instance.terminate()
    instance.freeInstance()


def check_declared(about, functions):
    """Compare the variables with the tables of signals."""
    variables = {variable.name: variable for variable in about.modelVariables}
    for signals, causality in (
        (functions.parameters, "parameter"),
        (functions.states, "local"),
        (functions.base[:6], "local"),
        (functions.base[6:], "input"),
        (functions.outputs, "output"),
    ):
        for signal in signals:
            variable = variables[signal.name]
            assert variable.causality == causality
            assert variable.description == signal.description
            assert (variable.unit or "1") == signal.unit
            if causality != "output":
                assert float(variable.start).hex() == signal.value.hex()
    assert not [name for name in variables if "__" in name]


def test_the_declared_variables(exported, functions):
    about = fmpy.read_model_description(exported)
    check_declared(about, functions)
    variables = {variable.name: variable for variable in about.modelVariables}
    assert variables["der(velocity_x_1)"].unit == "m/s2"
    assert variables["der(slope_x_1)"].unit == "1/s"
    units = {unit.name: unit.baseUnit for unit in about.unitDefinitions}
    assert (units["Pa"].kg, units["Pa"].m, units["Pa"].s) == (1, -1, -2)
    assert (units["kg/m3"].kg, units["kg/m3"].m) == (1, -3)


def test_the_description_names_beam_and_identifications(exported, document, tmp_path):
    about = fmpy.read_model_description(exported)
    assert (about.fmiVersion, about.modelName) == ("3.0", "my beam")
    assert about.coSimulation is None
    assert about.generationTool.startswith("ancf-casadi ")
    assert about.generationDateAndTime == "2025-01-31T12:00:00Z"
    assert "4 elements, 0.5 m long, ModalDamping and QuadraticDamping and RayleighDamping" in about.description
    assert f"decay (tip<&.csv SHA-256 {'0f' * 32}, frequency 1.85 +- 0.01 Hz)" in about.description
    with zipfile.ZipFile(exported) as archive:
        assert b'providesAdjointDerivatives="false" providesDirectionalDerivatives="true"' in archive.read(
            "modelDescription.xml"
        )
        archive.extract("resources/beam.json", tmp_path)
        assert {"sources/beam.c", "sources/buildDescription.xml"} < set(archive.namelist())
    assert read_document(tmp_path / "resources" / "beam.json").to_dict() == document.to_dict()


@pytest.fixture(scope="module")
def reduced(paper_beam):
    model = Model(paper_beam(8, axis=(0.6, -0.8)))
    law = RayleighDamping(beta=1e-5) + QuadraticDamping(eta1=0.5, eta2=2.0)
    return reduce_model(model, modes=MODES, damping=law, markers=MARKERS)


@pytest.fixture(scope="module")
def small(reduced, tmp_path_factory) -> str:
    document = Document(reduced.model, reduced.law)
    return quickly(reduced, tmp_path_factory.mktemp("fmu") / "small.fmu", document)


@pytest.fixture(scope="module")
def rest(reduced):
    """The state in which all modal coordinates are 0."""
    zero = np.zeros(MODES)
    return State(*(part.full().ravel() for part in reduced.coordinates(zero, zero, np.zeros(9))))


@pytest.mark.slow
def test_the_reduced_model_is_valid_and_agrees_with_simulate_reduced(small, reduced, rest):
    """With a small tolerance, and with that of the file."""
    assert validate_fmu(small) == []
    run = simulate_reduced(reduced, base=Shove(), duration=DURATION, sample_rate=RATE, start=rest)
    for tolerance, error in ((1e-10, 1e-6), (None, 2e-5)):
        check(run_fmu(small, {}, relative_tolerance=tolerance), run, run.energy.T[:2], error)


def test_the_declared_variables_of_the_reduced_model(small, reduced):
    about = fmpy.read_model_description(small)
    check_declared(about, reduced)
    assert "Beam of 8 elements, 0.5 m long, RayleighDamping and QuadraticDamping; modes kept: 4" in about.description
    assert float(about.defaultExperiment.tolerance) == 1e-8
    units = {unit.name: unit.baseUnit for unit in about.unitDefinitions}
    assert units["m kg^0.5"] is None and units["m kg^0.5/s2"] is None
    assert units["m/s2"].s == -2


def test_the_time_is_a_variable_that_importers_may_read(small, tmp_path):
    about, folder = fmpy.read_model_description(small), fmpy.extract(small, str(tmp_path))
    (time,) = (variable.valueReference for variable in about.modelVariables if variable.causality == "independent")
    assert time < len(about.modelVariables)  # beyond, the FMU reads memory that is not its own
    instance = FMU3Model(
        guid=about.guid,
        unzipDirectory=folder,
        modelIdentifier=about.modelExchange.modelIdentifier,
        instanceName="beam",
    )
    instance.instantiate()
    instance.enterInitializationMode(startTime=3.0)
    assert instance.getFloat64([time]) == [3.0]
    instance.exitInitializationMode()
    instance.enterContinuousTimeMode()
    instance.setTime(4.0)
    assert instance.getFloat64([time]) == [4.0]
    instance.terminate()
    instance.freeInstance()


@pytest.mark.parametrize(
    ("kind", "acceleration", "rise", "interval"),
    [("small", 20.0, 0.01, 0.01), ("small", 20.0, 0.001, 0.01), ("small", 200.0, 0.01, 0.001),
     ("exported", 20.0, 0.001, 0.001)],
)  # fmt: skip
def test_an_input_that_jumps_does_not_stop_the_importer(request, kind, acceleration, rise, interval):
    """The clamp accelerates for 0.1 s, with inputs that fmpy holds over each interval; the tolerance is the default."""
    steps = [(0.0, 0.0), (0.1, 0.0), (0.1 + rise, acceleration), (0.2, acceleration), (0.2 + rise, 0.0), (0.3, 0.0)]
    given = np.array(steps, dtype=[("time", float), ("base_x_acceleration", float)])
    path, outputs = request.getfixturevalue(kind), ["base_x_velocity"]
    found = fmpy.simulate_fmu(path, stop_time=0.3, output_interval=interval, input=given, output=outputs)
    assert found["time"][-1] == pytest.approx(0.3)
    assert found["base_x_velocity"][-1] == pytest.approx(0.1 * acceleration, rel=0.05)  # by the held inputs


def test_a_failing_compiler_leaves_no_files(functions, tmp_path, monkeypatch):
    (tmp_path / "cc").write_text('#!/bin/sh\ntouch "$TMPDIR/draft.s"\nexit 1\n')
    (tmp_path / "cc").chmod(0o755)
    (tmp_path / "temporary").mkdir()
    monkeypatch.setenv("CC", str(tmp_path / "cc"))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    with pytest.raises(InputError, match="cannot compile"):
        write_fmu(functions, tmp_path / "beam.fmu")
    assert not list((tmp_path / "temporary").iterdir())


class TestRefusals:
    @pytest.fixture(autouse=True)
    def writes_nothing(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        yield
        assert [path for path in tmp_path.iterdir() if path.suffix != ".h"] == []

    def test_without_fmpy(self, functions, monkeypatch):
        monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
        with pytest.raises(InputError, match=r"^fmpy: is not installed, but .*FMI headers; pip install fmpy$"):
            write_fmu(functions, "beam.fmu")

    def test_without_its_headers(self, functions, monkeypatch, tmp_path):
        found = types.SimpleNamespace(origin=str(tmp_path / "__init__.py"))
        monkeypatch.setattr(importlib.util, "find_spec", lambda name: found)
        with pytest.raises(InputError, match=r"lacks fmi3Functions\.h"):
            write_fmu(functions, "beam.fmu")

    def test_without_a_compiler(self, functions, monkeypatch):
        monkeypatch.delenv("CC", raising=False)
        monkeypatch.setenv("PATH", "")
        with pytest.raises(InputError, match=r"^CC: an FMU needs a C compiler"):
            write_fmu(functions, "beam.fmu")

    def test_with_a_compiler_that_is_not_there(self, functions, monkeypatch):
        monkeypatch.setenv("CC", "/no/such/cc")
        with pytest.raises(InputError, match=r"^/no/such/cc: cannot compile the FMU"):
            write_fmu(functions, "beam.fmu")

    def test_a_marker_beside_the_beam(self, document):
        with pytest.raises(InputError, match="the point must be on the beam"):
            beam_functions(document.model, document.damping, markers=(0.6,))

    @pytest.mark.filterwarnings("ignore:the modes of ModalDamping are those of another beam")
    def test_a_document_of_another_beam_or_law(self, functions, document, reduced):
        thicker = Model(document.model.beam.with_(thickness=1e-3))
        with pytest.raises(InputError, match=r"^document: describes another beam"):
            write_fmu(reduced, "beam.fmu", document=Document(thicker, reduced.law))
        for other in (Document(thicker, document.damping), Document(document.model, RayleighDamping(beta=1e-5))):
            with pytest.raises(InputError, match=r"^document: describes another beam or damping law"):
                write_fmu(functions, "beam.fmu", document=other)

    @pytest.mark.parametrize(
        "changes",
        [
            {"attachments": (PointMass(0.25, 1e-6),)},
            {"attachments": (Spring(0.25, (1e-3, 0.0)),)},
            {"attachments": (Dashpot(0.25, (0.0, 1e-6)),)},
            {"supports": (Clamp(displacement=(1e-6, 0.0)),)},
            {"prestress": 1.0},
            {"natural_curvature": 1e-6},
        ],
        ids=lambda changes: next(iter(changes)),
    )
    @pytest.mark.filterwarnings("ignore:the modes of ModalDamping are those of another beam")
    def test_a_document_with_the_same_parameters_of_another_beam(self, document, changes):
        model, law = document.model, RayleighDamping(beta=1e-5)
        other = Document(Model(model.beam.with_(**changes)), law)
        for made in (beam_functions(model, law, modes=1), reduce_model(model, modes=1, damping=law)):
            with pytest.raises(InputError) as caught:
                write_fmu(made, "beam.fmu", document=other)
            assert caught.value.where == "document"

    def test_a_document_of_a_law_with_the_same_parameters(self, document):
        """The modes of the law are those of a beam with another mass."""
        heavy = Model(document.model.beam.with_(attachments=(PointMass(0.25, 1e-6),)))
        laws = [ModalDamping(natural_modes(model, count=1), (0.01,)) for model in (document.model, heavy)]
        with pytest.raises(InputError) as caught:
            write_fmu(
                beam_functions(document.model, laws[0], modes=1), "beam.fmu", document=Document(document.model, laws[1])
            )
        assert caught.value.where == "document"

    def test_a_document_with_functions_from_a_file(self, document, functions, tmp_path_factory):
        path = tmp_path_factory.mktemp("functions") / "beam.casadi"
        save_functions(functions, path)
        with pytest.raises(InputError) as caught:
            write_fmu(load_functions(path), "beam.fmu", document=document)
        assert caught.value.where == "document"
