"""``ancf-casadi run STUDY.toml response``: peaks, folds and jumps as text, JSON, CSV and figure, or one line."""

import json

import numpy as np
import pytest

from ancf_casadi import HarmonicBase, periodic_motion
from problems.cli import main
from problems.spec.motion import ResponseTables
from tests.problems.conftest import STRIP

STUDY = f"""{STRIP}elements = 4

[[damping]]
law = "modal"
ratios = [0.005, 0.003]

[response]
frequencies = [10.2, 10.8]
base_amplitudes = [5e-5, 2e-4]
modes = 2
points = 20

[markers]
middle = 0.25
"""


@pytest.fixture
def study(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "study.toml"
    path.write_text(STUDY)
    return path


@pytest.mark.slow
def test_a_point_of_the_table_is_the_steady_vibration_at_its_frequency(study, capsys):
    assert main(["run", "study.toml", "response", "--out", "new"]) == 0
    text = capsys.readouterr().out
    assert "fold at" in text and "0.2 mm" in text
    table = np.genfromtxt("new/response.csv", delimiter=",", names=True)
    row = table[table["level_m"] == 5e-5][3]
    task = ResponseTables.of("study.toml")
    motion = periodic_motion(task.body, base=HarmonicBase(5e-5, row["frequency_hz"]))
    assert motion.amplitude() == pytest.approx(row["tip_amplitude_m"], rel=1e-4)
    assert motion.amplitude(0.25) == pytest.approx(row["middle_amplitude_m"], rel=1e-4)
    assert np.exp(1j * motion.phase(0.25)) == pytest.approx(np.exp(1j * row["middle_phase_rad"]), abs=1e-4)


@pytest.mark.slow
def test_friction_is_followed_at_the_default_tolerance(study, capsys):
    """The ratio at the peak is above that of the modal law, and falls with the level."""
    study.write_text(STUDY.replace("[response]", '[[damping]]\nlaw = "friction"\neta0 = 0.02\n\n[response]'))
    assert main(["run", "study.toml", "response", "--json"]) == 0
    small, large = (level["curve"] for level in json.loads(capsys.readouterr().out)["response"])
    assert 0.003 < large["peak_damping_ratio"] < small["peak_damping_ratio"]
    assert large["peak_amplitude_m"] > 4.1 * small["peak_amplitude_m"]


@pytest.mark.parametrize(
    ("old", "new", "message", "code"),
    [
        ("frequencies = [10.2, 10.8]", "frequencies = [10.2]", "[response]: frequencies: must", 2),
        ("elastic_modulus = 210e9", "elastic_modulus = 210e9\naxis = [0.0, 1.0]\ngravity = [0.0, -1e3]", "snaps", 1),
    ],
)
def test_what_cannot_be_followed_is_one_line(study, capsys, old, new, message, code):
    assert old in STUDY
    study.write_text(STUDY.replace(old, new))
    assert main(["run", "study.toml", "response", "--out", "new"]) == code
    captured = capsys.readouterr()
    (line,) = captured.err.splitlines()
    assert captured.out == "" and message in line
    assert not (study.parent / "new" / "response.csv").exists()
