"""Every public object is shown on one line and can be pickled; every computed result has text, data and a figure."""

import json
import pickle
from dataclasses import replace

import pytest

import ancf_casadi
import problems
from ancf_casadi import InputError, Model, PointLoad, critical_load, equilibrium_path, linear_frf
from ancf_casadi.estimation.criteria import Expectation
from ancf_casadi.estimation.prediction import RecordPrediction
from ancf_casadi.estimation.result import FitResult
from ancf_casadi.support.tables import Reported
from problems import PlannedComparison, SavedFit
from tests.hostile_calls import calls

ABSTRACT = {"BaseMotion", "DampingLaw", "TipLoad", "Support", "Attachment"}
CLASSES = {
    name: public
    for package in (ancf_casadi, problems)
    for name in package.__all__
    if isinstance(public := getattr(package, name), type) and name not in ABSTRACT
}
RESULTS = sorted(name for name, public in CLASSES.items() if issubclass(public, Reported))
COMPUTED = [name for name in RESULTS if not issubclass(CLASSES[name], FitResult | SavedFit | RecordPrediction)]
FITS = [name for name in RESULTS if issubclass(CLASSES[name], FitResult | SavedFit)]
SLOW = {"compare_laws", "fit_beam, curves", "plan_comparison", "reproduce", "track_video", "write_c", "write_fmu"}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Results of calls of public functions and classes, by name."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ANCF_CASADI_COMPILE", "0")
        every = calls(tmp_path_factory.mktemp("samples"))
        return {name: function(**arguments) for name, (function, arguments) in every.items() if name not in SLOW}


@pytest.fixture(scope="module")
def samples(results):
    """An object of each public class, by name."""
    fit = results["fit_decay"]
    column = Model(results["Beam.uniform"].with_(axis=(1.0, 0.0), gravity=(0.0, 0.0)))
    push = {"loads": [PointLoad((-0.1, 0.0))], "largest_factor": 2.0}
    no_place = (ancf_casadi.AncfError, ancf_casadi.EquilibriumError, ancf_casadi.FitError, ancf_casadi.NumericsError)
    objects = [
        *results.values(), critical_load(column, steps=4, **push), equilibrium_path(column, **push).critical_points[0],
        fit.log_density(), fit.predict(results["Measurement"]),
        PlannedComparison(("a", "b"), {("tap", k, 1 - k): Expectation(9.0, 0.99) for k in (0, 1)}),
        InputError("must be positive", "width"), *(error("no") for error in no_place),
        ancf_casadi.SimulationError("no", time=1.0), ancf_casadi.ContinuationError("no", partial=fit),
    ]  # fmt: skip
    return {type(sample).__name__: sample for sample in objects}


@pytest.mark.parametrize("name", sorted(CLASSES))
def test_an_object_is_shown_on_one_line_and_can_be_pickled(samples, name):
    text = repr(samples[name])
    assert text.startswith(f"{name}(") and len(text) < 200 and "\n" not in text
    copy = pickle.loads(pickle.dumps(samples[name]))
    assert type(copy) is type(samples[name]) and repr(copy) == text


@pytest.mark.parametrize("name", COMPUTED)
def test_a_computed_result_has_text_html_data_and_a_file(samples, name, tmp_path):
    result = samples[name]
    assert result.table().title in result.report() and result._repr_html_().startswith("<table>")
    data = result.to_dict()
    result.save(tmp_path / "result.json")
    assert json.loads((tmp_path / "result.json").read_text()) == json.loads(json.dumps(data))
    assert pickle.loads(pickle.dumps(result)).to_dict() == data


@pytest.mark.parametrize("name", FITS)
def test_every_fit_has_warnings_errors_text_data_and_a_figure(samples, name):
    """As the README says."""
    fit = samples[name]
    assert fit.report() and fit.to_dict()["kind"] and fit.standard_errors.keys() and isinstance(fit.warnings, tuple)
    assert fit.figure().axes


def test_each_computed_result_states_its_own_kind(samples):
    assert len({samples[name].to_dict()["kind"] for name in COMPUTED}) == len(COMPUTED) == 13


@pytest.mark.parametrize("name", COMPUTED)
def test_two_of_a_kind_are_drawn_over_each_other(samples, name):
    result = samples[name]
    alone, both = result.figure(), result.figure(result, labels=("first", "the $other"))
    assert len(alone.axes) == len(both.axes)
    assert len(both.axes[0].lines) > len(alone.axes[0].lines)
    legends = [*both.legends, *(axes.get_legend() for axes in both.axes if axes.get_legend())]
    names = [text.get_text() for legend in legends for text in legend.get_texts()]
    assert any(text.startswith("first") for text in names) and any(text.startswith("the $other") for text in names)


def test_a_full_and_a_reduced_motion_are_of_one_kind(samples):
    legend = samples["Trajectory"].figure(samples["ReducedTrajectory"]).axes[0].get_legend()
    assert [text.get_text() for text in legend.get_texts()] == ["1", "2"]


def test_a_motion_that_failed_at_once_is_shown_and_not_drawn(samples):
    run = samples["Trajectory"]
    failed = replace(run, time=run.time[:0])
    assert "0 samples" in repr(failed) and "0 samples" in failed.report() and failed.to_dict()["tip_m"] == []
    with pytest.raises(InputError, match=r"^figure: .* no samples"):
        failed.figure()


@pytest.mark.parametrize(
    ("labels", "message"), [(("same", "same"), "2 different"), (("a", "b", "c"), "2 different"), ("ab", "sequence")]
)
def test_each_result_in_a_figure_needs_a_label_of_its_own(samples, labels, message):
    with pytest.raises(InputError, match=f"^labels: .*{message}"):
        samples["Trajectory"].figure(samples["Trajectory"], labels=labels)


def test_results_of_different_kinds_are_not_drawn_together(results, samples):
    mobility = linear_frf(samples["Model"], samples["RayleighDamping"], [1.0, 2.0], kind="mobility")
    for result, other, message in (
        (results["simulate"], samples["Modes"], "a Trajectory cannot be drawn with a Modes"),
        (results["frequency_response"], results["amplitude_response"], "same quantity, here frequency"),
        (results["linear_frf"], mobility, "same kind, here receptance"),
    ):
        with pytest.raises(InputError, match=f"^figure: .*{message}"):
            result.figure(other)
