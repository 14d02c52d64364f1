"""Public functions return, or refuse hostile arguments with an error of the package."""

import importlib.util
import inspect
import random

import numpy as np
import pytest

from ancf_casadi import Beam, HarmonicBase, InputError, Measurement, Model, damping_curve, export, run_all
from ancf_casadi.response.harmonic_balance.system import SecondOrderSystem
from problems import isolate_mode, law_curve
from tests import hostile_calls
from tests.hostile_calls import NOT_CALLED, calls, hostile_call, outcome, public


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder for the files of the calls."""
    return tmp_path_factory.mktemp("calls")


@pytest.fixture
def there(folder, monkeypatch):
    """The same folder as the current one."""
    monkeypatch.chdir(folder)
    return folder


@pytest.mark.slow
def test_every_public_function_is_called(folder):
    called = {name.partition(".")[0].partition(",")[0] for name in calls(folder)}
    assert called == set(public())
    assert not called & NOT_CALLED
    for name, (function, arguments) in calls(folder).items():
        inspect.signature(function).bind(**arguments)
        assert len(arguments) or name == "schema"


def faults(folder, seed, count):
    rng = random.Random(seed)
    drawn = (hostile_call(rng, folder) for _ in range(count))
    outcomes = [(name, outcome(function, arguments)) for name, arguments, function in drawn]
    return [fault for fault in outcomes if fault[1] not in ("returned", "refused", "stopped")]


def test_hostile_calls_return_or_are_refused(there):
    assert faults(there, 1, 40) == []


@pytest.mark.slow
def test_many_hostile_calls_return_or_are_refused(there):
    """Thousands of them are in ``benchmarks/robustness.py``."""
    assert faults(there, 2, 150) == []


@pytest.mark.slow
def test_the_calls_are_valid_before_a_value_is_replaced(there, monkeypatch):
    """``reproduce`` takes longer than a call may, and ends at once when it is stopped."""
    valid = calls(there)
    expected = dict.fromkeys(valid, "returned") | {"reproduce": "stopped"}
    if not importlib.util.find_spec("cv2"):
        expected["track_video"] = "refused"
    for name, call in valid.items():
        monkeypatch.setattr(hostile_calls, "SECONDS", 0.5 if name == "reproduce" else 10.0)
        assert outcome(*call) == expected[name], name


TIME = np.linspace(0.0, 1.0, 101)
MODEL = Model(Beam.uniform(length=0.5, width=5e-3, thickness=5e-4, density=8e3, elastic_modulus=2e11, elements=2))
RECORD = Measurement(TIME, np.exp(-TIME) * np.cos(40.0 * TIME))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: export.Document("beam"), "model: must be a Model"),
        (lambda: export.write_document("a.json", {}), "document: must be a Document, got a dict"),
        (lambda: export.write_c(None, "folder"), "functions: must be a MotionFunctions, got None"),
        (lambda: export.save_functions([], "a.casadi"), "functions: must be a BeamFunctions or a ReducedFunctions"),
        (lambda: export.beam_functions(3), "model: must be a Model, got 3"),
        (lambda: export.beam_functions(MODEL, 3), "damping: must be a DampingLaw, got 3"),
        (lambda: export.values([1.0]), "signals: must be a Signal, got 1.0"),
        (lambda: export.Provenance("2025-01-31T12:00:00Z", [1]), "versions: must be a mapping"),
        (lambda: law_curve("x"), "fit: must be a DecayFit or a LawComparison, got 'x'"),
        (lambda: isolate_mode(RECORD, 3.0), "band: must be a pair of numbers"),
        (lambda: damping_curve(RECORD, release_time="x"), "release_time: must be a finite number"),
        (lambda: damping_curve([1.0, 2.0]), "record: must be a Measurement, got a list"),
        (lambda: SecondOrderSystem.of(1, 2, 3, 4, conservative=5), "q: must be a SX, got 1"),
        (lambda: run_all([dict], each=3), "each: must be a function, got 3"),
        (lambda: Measurement(TIME.astype("M8[s]"), TIME), "time: must be numbers"),
        (lambda: HarmonicBase(np.complex128(1j), 2.0), "amplitude: must be a finite number"),
    ],
)
def test_a_wrong_argument_is_named(call, message):
    with pytest.raises(InputError, match=f"^{message}"):
        call()


@pytest.mark.parametrize(
    ("name", "changed", "expected"),
    [
        ("fit_beam, curves", {"unknowns": np.zeros(0), "priors": None}, "returned"),
        ("fit_beam", {"bounds": {1: 2, "a": (0.0, 1.0)}}, "refused"),
        ("fit_beam", {"priors": {1: 2, "a": (0.0, 1.0)}}, "refused"),
        ("ResponseRecord", {"values": [[1.0], [1.0, 2.0]]}, "refused"),
        ("HarmonicBase", {"stop": [[1.0], [1.0, 2.0]]}, "refused"),
        ("damping_curve", {"periods": 1e308}, "refused"),
    ],
)
def test_empty_arrays_names_that_are_no_texts_ragged_lists_and_infinite_products(there, name, changed, expected):
    function, arguments = calls(there)[name]
    assert outcome(function, arguments | changed) == expected
