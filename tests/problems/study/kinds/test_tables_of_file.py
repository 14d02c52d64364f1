"""Parts that show what other commands compute: the beam, its modes, a motion, and laws compared on measured motion."""

import base64

import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    HarmonicBase,
    InputError,
    Model,
    NumericsError,
    RayleighDamping,
    StrainMeasures,
    natural_modes,
    simulate,
)
from ancf_casadi.export import Document, write_document
from problems import BeamFit, FrequencyRecord
from problems.command.init import STUDY
from problems.study.formatting import formatted_table
from problems.study.reading import read_study
from problems.study.study import run_study
from tests.problems.conftest import BEAM, column

MOTION = """
[[damping]]
law = "quadratic"
eta1 = 2.0

[base]
file = "clamp.csv"
x = "x_m"

[simulation]
duration = 0.5
sample_rate = 200.0
method = "radau"
"""


def clamp(path, amplitude: float) -> None:
    time = np.linspace(0.0, 0.5, 101)
    np.savetxt(path, np.c_[time, amplitude * np.sin(2 * np.pi * 2.0 * time) ** 2], delimiter=",", header="time_s,x_m",
               comments="")  # fmt: skip


def test_without_a_folder_nothing_is_written_and_the_reports_are_there(study_file, tmp_path):
    path = study_file(BEAM, '[[steps]]\nkind = "modes"\nmodes = 2\n')
    before = sorted(tmp_path.iterdir())
    report = run_study(path, None)
    assert report.page is None and sorted(tmp_path.iterdir()) == before
    assert report.report() == natural_modes(Model(Beam.from_toml(path)), count=2).report()


def test_a_step_keeps_the_results_of_others_in_the_folder(study_file, tmp_path):
    path = study_file(BEAM)
    times = run_study(path, tmp_path / "results").steps[-1].times
    run_study(path, tmp_path / "results", steps=["beam"])
    assert run_study(path, tmp_path / "results").steps[-1].times == times


def test_properties_that_vary_are_means_and_say_so(study_file, tmp_path):
    text = BEAM.replace("width = 5e-3", "width = [4e-3, 5e-3, 6e-3]").replace(
        "elements = 3", "elements = 3\ntip_mass = 2e-3"
    )
    report = run_study(study_file(text, '[[steps]]\nkind = "beam"\n'), tmp_path / "results")
    (table,) = report.steps[0].tables
    assert column(table, "value") == pytest.approx([500.0, 5.0, 0.5, 8000.0, 210.0])
    assert any("width vary along the beam" in note for note in table.notes)
    assert any("2 g" in note for note in table.notes)
    assert report.results["beam"]["width"] == [4e-3, 5e-3, 6e-3]


@pytest.mark.slow
def test_a_motion_is_computed_again_if_a_file_changes(study_file, tmp_path):
    """The clamp moves twice as far: the tip does too, and damping takes four times the energy."""
    found, path = [], study_file(BEAM, MOTION, '[[steps]]\nkind = "simulation"\nanimate = true\n')
    for amplitude in (1e-4, 2e-4, 2e-4):
        clamp(tmp_path / "clamp.csv", amplitude)
        report = run_study(path, tmp_path / "results")
        found.append((report.results["simulation"], report.steps[-1].times))
    (one, first), (two, second), (three, third) = found
    assert two["tip_position_range_m"][0] == pytest.approx(2 * one["tip_position_range_m"][0], rel=1e-3)
    assert two["dissipated_energy_j"] == pytest.approx(4 * one["dissipated_energy_j"], rel=1e-3)
    assert two["balance_error_j"] < 1e-3 * two["dissipated_energy_j"]
    assert three == two
    assert not first.keys() & second.keys()
    assert third == second  # the times of the kept results
    moving = (tmp_path / "results" / "figures" / "figure_01.gif").read_bytes()
    quick = run_study(path, tmp_path / "results", quick=True)
    assert quick.steps[-1].times == third  # whatever the formats of its figure
    assert not (tmp_path / "results" / "figures" / "figure_01.png").exists()
    assert moving.startswith(b"GIF89a") and base64.b64encode(moving).decode() in report.page.read_text()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("unknowns", "first"),
    [(["bending_stiffness", "tip_mass"], {"tip_mass": 1e-3}), (["density"], {})],
)
def test_a_fit_shows_the_identified_beam_first_and_calls_the_guess_a_guess(study_file, tmp_path, unknowns, first):
    text = BEAM.replace("elements = 3", "\n".join(["elements = 6", *(f"{k} = {v}" for k, v in first.items())]))
    study_file(text)
    guess = Beam.from_toml(tmp_path / "study.toml")
    kind = "density" if "density" in unknowns else "elastic_modulus"
    true = Model(guess.with_(**{kind: 1.1 * getattr(guess, kind)[0]}))
    base = HarmonicBase(amplitude=5e-3, frequency=1.7)
    run = simulate(true, damping=RayleighDamping(alpha=0.5), base=base, duration=1.5, sample_rate=50.0)
    noise = 1e-4 * np.random.default_rng(2).normal(size=run.time.size)
    np.savetxt(tmp_path / "tip.csv", np.c_[run.time, run.tip[:, 0] + noise], delimiter=",", header="time_s,x_m",
               comments="")  # fmt: skip
    fit = (
        f"[fit]\nunknowns = {unknowns}\n" + '[[damping]]\nlaw = "rayleigh"\nalpha = 0.4\n[base]\namplitude = 5e-3\n'
        'frequency = 1.7\n[[records]]\nfile = "tip.csv"\nsensor = "position"\n'
    )
    report = run_study(study_file(text, fit), tmp_path / "results", quick=True)
    motion, beam, modes = report.steps
    assert [step["kind"] for step in report.results["study"]["steps"]] == ["motion", "beam", "modes"]
    (properties,), (frequencies,) = beam.tables, modes.tables
    assert properties.title == "Properties of the identified beam"
    assert list(properties.columns) == ["property", "unit", "guess", "value"]
    row, scale = column(properties, "property").index(kind.replace("_", " ")), 1e-9 if "elastic" in kind else 1.0
    found, error = column(properties, "value")[row], properties.errors["value"][row]
    assert column(properties, "guess")[row] == pytest.approx(scale * getattr(guess, kind)[0])
    assert 0.0 < error < 0.2 * found and abs(found - scale * getattr(true.beam, kind)[0]) < 4 * error
    assert bool(first) == any("Tip mass" in note and "±" in note and "guess 1 g" in note for note in properties.notes)
    measured, errors = column(frequencies, "f_Hz"), frequencies.errors["f_Hz"]
    expected = natural_modes(true, count=len(measured)).frequencies
    assert abs(measured[0] - expected[0]) < 4 * errors[0] < 0.05
    assert "Properties of the identified beam" in report.page.read_text()
    ends = [row[-3:-1] for row in formatted_table(motion.tables[0]).rows]
    assert all(low != high for low, high in ends)


def test_a_comparison_needs_two_laws(study_file, tmp_path):
    clamp(tmp_path / "motion.csv", 1e-3)
    text = STUDY.partition("[[damping]]")
    one_law = (
        f'{text[0]}[[damping]]\nlaw = "quadratic"\neta2 = 0.1\n[[records]]\nfile = "motion.csv"\nsensor = "position"\n'
    )
    with pytest.raises(InputError, match=r"\[steps\]: comparison: there is only one law; add tables \[\[damping\]\]"):
        read_study(study_file(one_law, '[[steps]]\nkind = "comparison"\n'))


def test_a_beam_with_other_strain_measures_is_refused(study_file, tmp_path, paper_beam):
    """The steps compute with the default measures, and must not pretend otherwise."""
    write_document(tmp_path / "beam.json", Document(Model(paper_beam(3), StrainMeasures(axial="green"))))
    with pytest.raises(InputError, match=r"\[beam\]: the document has strain measures that this step does not support"):
        read_study(study_file('[beam]\ndocument = "beam.json"\n'))
    write_document(tmp_path / "beam.json", Document(Model(paper_beam(3))))
    assert len(read_study(study_file('[beam]\ndocument = "beam.json"\n')).steps) == 2


def test_a_prediction_that_fails_keeps_its_place(study_file, tmp_path, monkeypatch):
    clamp(tmp_path / "tip.csv", 1e-3)
    channel = 'file = "tip.csv"\nsensor = "displacement"\ndirection = [1.0, 0.0]\nstd = 1e-4\n'
    fit = '[[frequencies]]\nfrequencies = [1.85]\nstd = [0.01]\n[fit]\nunknowns = ["elastic_modulus"]\n'
    path = study_file(BEAM, fit, f"[[predictions]]\n{channel}" * 2)
    predict, records = BeamFit.predict, []

    def failing_first(self, record):
        if not records:
            records.append(record)
            raise NumericsError("no motion")
        return predict(self, FrequencyRecord(self.given, [1.8]))

    monkeypatch.setattr(BeamFit, "predict", failing_first)
    failed, predicted = run_study(path, None, steps=["motion"]).results["motion"]["predictions"]
    assert failed is None and predicted["kind"] == "prediction of beam"
