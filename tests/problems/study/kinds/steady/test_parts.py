"""Parts with steady vibration: curves of the file, and curves of simulated experiments."""

import numpy as np
import pytest

from ancf_casadi import InputError
from problems.schema.response import read_response
from problems.study.kinds.steady.resonances import range_of
from problems.study.part import FULL, Finding
from problems.study.reading import read_study
from problems.study.study import StudyReport, run_study
from tests.problems.study.conftest import BEAM

pytestmark = pytest.mark.slow  # all tests need the study

RESPONSE = """
[[damping]]
law = "modal"
ratios = [0.01, 0.003]

[response]
frequencies = [10.2, 10.8]
base_amplitudes = [5e-5, 2e-4]
modes = 2
points = 20
"""
LAWS = """
[[laws]]
name = "modal"
terms = [{law = "modal", ratios = [0.05, 0.02]}]

[[laws]]
name = "drag"
title = "air drag"
terms = [{law = "quadratic", eta1 = 1.2, eta2 = 2.0}]

[[laws]]
name = "none"
terms = []
"""
EXPERIMENTS = """
[[parts]]
kind = "transients"
name = "driven"
draw = false
laws = ["modal", "drag"]
runs = [{mode = 1, amplitude = 0.02, stop = 340.0}]

[[parts]]
kind = "resonances"
name = "steady"
transients = "driven"
laws = ["modal", "drag"]
modes = 3
"""


@pytest.fixture(scope="module")
def report(tmp_path_factory) -> StudyReport:
    folder = tmp_path_factory.mktemp("steady")
    (folder / "study.toml").write_text(BEAM + LAWS + EXPERIMENTS, encoding="utf-8")
    return run_study(folder / "study.toml", folder / "results", quick=True)


def test_the_table_response_adds_its_curves_to_a_study(study_file, tmp_path):
    path = study_file(BEAM, RESPONSE)
    found = run_study(path, tmp_path / "results")
    task = read_response(str(path))
    assert [level["level"] for level in found.results["response"]] == [5e-5, 2e-4]
    for level in found.results["response"]:
        curve = task.curve(level["level"])
        assert level["curve"]["frequency_hz"] == curve.frequencies.tolist()
        assert level["curve"]["points"]["tip"]["amplitude_m"] == curve.amplitude().tolist()
        assert level["curve"]["stable"] == curve.stable.tolist()
    assert not all(found.results["response"][1]["curve"]["stable"])
    assert (tmp_path / "results" / "figures").exists()


def test_a_long_experiment_ends_on_its_curve(report):
    """After 10 s of excitation (a quick study drives for 3 % of the time), the vibration is steady."""
    for run in report.results["steady"]:
        frequency = np.array(run["curve"]["frequency_hz"])
        amplitude = np.array(run["amplitude_m"])
        order = np.argsort(frequency)
        steady = np.interp(run["drive_hz"], frequency[order], amplitude[order])
        assert run["reached_amplitude_m"] == pytest.approx(steady, rel=0.01)
        assert run["curve"]["peak_amplitude_m"] > 0.9 * steady


def test_the_curve_of_a_linear_law_has_its_damping_ratio(report):
    """But for the share of the other modes in the motion of the tip, 1 % of it."""
    modal, drag = report.results["steady"]
    assert (modal["law"], drag["law"]) == ("modal", "drag")
    assert modal["curve"]["peak_damping_ratio"] == pytest.approx(0.05, rel=0.03)
    assert drag["curve"]["peak_damping_ratio"] > 1.2 / (4 * np.pi * 1.876)


def test_each_mode_has_a_figure_with_all_laws(report):
    part = report.parts[1]
    ((_, table),) = part.tables
    assert table.columns[1].values == ("modal", "air drag")
    assert len(part.figures) == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (EXPERIMENTS.replace('transients = "driven"\n', ""), "steady: the key 'transients' is missing"),
        (
            EXPERIMENTS.replace('"driven"\nlaws = ["modal", "drag"]\nmodes', '"driven"\nlaws = []\nmodes'),
            "steady: laws: must be a list of 1 or more names",
        ),
        (EXPERIMENTS.replace("modes = 3", "modes = 0"), "steady: modes: must be"),
        (EXPERIMENTS.replace('transients = "driven"', 'transients = "other"'), "needs the part 'other'"),
        ('[[parts]]\nkind = "response"\n', "[response]: the table is missing"),
    ],
)
def test_what_makes_no_sense_is_refused_before_any_computation(study_file, text, message):
    with pytest.raises(InputError) as caught:
        read_study(study_file(BEAM, LAWS, text))
    assert message in str(caught.value)


def test_a_part_without_experiments_and_a_law_without_damping_are_refused(study_file):
    beam = '[[parts]]\nkind = "beam"\nname = "driven"\n'
    steady = EXPERIMENTS[EXPERIMENTS.index('[[parts]]\nkind = "resonances"') :]
    study = read_study(study_file(BEAM, LAWS, beam, steady))
    part, file = study.parts[1], Finding(None, beam=study.beam)
    with pytest.raises(InputError, match="the part 'driven' has no experiments; name one of the kind transients"):
        part.tasks({"": file, "driven": Finding({})}, FULL)
    run = {"law": "modal", "mode": 1, "natural_frequency_hz": 2.0, "expected_damping_ratio": 0.0}
    with pytest.raises(InputError, match="the law 'modal' does not damp mode 1; a steady vibration needs damping"):
        part.tasks({"": file, "driven": Finding({"runs": [{**run, "base_amplitude_m": 1e-3}]})}, FULL)


def test_the_range_reaches_the_peak_of_a_mode_that_softens_and_ends_at_three_per_cent():
    """The peak at the amplitude of the steady vibration has four times the change of frequency of the decay."""
    run = {"law": "modal", "mode": 2, "natural_frequency_hz": 10.0, "expected_damping_ratio": 0.002, "stop_s": 1e3,
           "requested_amplitude_m": 0.02, "amplitude_m": 0.01, "frequency_hz": 9.99}  # fmt: skip
    first, last = range_of(run)
    assert first == pytest.approx(10.0 * 1.01)
    assert 9.8 < last < 10.0 * (1 - 4e-3 - 5 * 0.002)
    assert range_of({**run, "frequency_hz": 9.9})[1] == pytest.approx(9.7)
    assert range_of({**run, "frequency_hz": 10.01})[0] > 10.0 * (1 + 4e-3 + 5 * 0.002)
