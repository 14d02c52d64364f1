"""Reading a study converts its tables; a file of measurements is opened when a step needs it, and once."""

import json
import pickle
import sys
from pathlib import Path

import numpy as np
import pytest

from ancf_casadi import Beam, Model, RayleighDamping, simulate, static_equilibrium
from problems.cli import main
from problems.spec.motion import SimulationTables
from problems.spec.records import Measurements
from problems.study.reading import read_study
from tests.problems.conftest import STRIP

STUDY = f"""{STRIP}elements = 2
[base]
file = "swing.csv"
x = "clamp_mm"
[release]
tip_force = [1e-3, 0.0]
[simulation]
duration = 0.1
[[decays]]
file = "swing.csv"
column = "tip_mm"
[[records]]
file = "swing.csv"
end = 0.5
column = "tip_mm"
channels = [{{}}, {{begin = 0.1}}]
[fit]
tolerance = 0.01
[[steps]]
kind = "decays"
[[steps]]
kind = "simulation"
[[steps]]
kind = "motion"
"""
RAYLEIGH = '[[damping]]\nlaw = "rayleigh"\nalpha = 0.5\n'
MODAL = '[[damping]]\nlaw = "modal"\nratios = [0.01]\n'
CURVE = '[[curves]]\nfile = "sweep.csv"\nbase = {amplitude = 1e-3}\n'
STATIC = '[[statics]]\nfile = "sag.csv"\ncolumn = "sag (mm)"\nload = {mass = "m (g)"}\ndirection = [0.0, 1.0]\n'
opened: list[str] = []


def note_opening(event: str, arguments: tuple) -> None:
    if event == "open" and arguments[1] is not None:  # without a mode: of the function that ``open`` calls to open it
        opened.append(str(arguments[0]))


sys.addaudithook(note_opening)


@pytest.fixture
def study(tmp_path, monkeypatch):
    """Return a function that writes a study, whose steps need the same record."""
    monkeypatch.chdir(tmp_path)
    sweep = [[1.8, 1.0, 11.0, -12.0], [1.9, 1.0, 52.0, -91.0]]
    np.savetxt("sweep.csv", sweep, delimiter=",", header="f (Hz),base (mm),tip (mm),phase (deg)", comments="")

    def write(*tables: str) -> str:
        Path("study.toml").write_text(STUDY + "".join(tables))
        opened.clear()
        return "study.toml"

    Path("sag.csv").write_text("m (g),sag (mm)\n1,-0.2\n2,-0.4\n")
    write_record(0.4)
    return write


def write_record(alpha: float) -> None:
    """Write the simulated motion of the strip after a release."""
    Path("beam.toml").write_text(f"{STRIP}elements = 2\n")
    model = Model(Beam.from_toml("beam.toml"))
    start = static_equilibrium(model, tip_force=(1e-3, 0.0))
    run = simulate(model, damping=RayleighDamping(alpha), start=start, duration=3.0, sample_rate=50.0)
    columns = np.column_stack([run.time, 1e3 * run.tip[:, 0], 0.0 * run.time])
    np.savetxt("swing.csv", columns, delimiter=",", header="t_s,tip_mm,clamp_mm", comments="")


def times_opened(name: str) -> int:
    return sum(Path(path).name == name for path in opened)


def test_parsing_opens_no_record_and_solves_nothing(study, monkeypatch):
    def refuse(*arguments, **settings):
        raise AssertionError("parsing must not solve")

    path = study(MODAL, CURVE, STATIC)
    for function in ("modes.lowest_modes", "statics._follow_load", "statics._follow_path"):
        monkeypatch.setattr(f"ancf_casadi.vibration.{function}", refuse)
    read_study(path)
    assert [times_opened(name) for name in ("swing.csv", "sweep.csv", "sag.csv")] == [0, 0, 0]
    for tables in (SimulationTables, Measurements):
        with pytest.raises(AssertionError, match="must not solve"):
            tables.of(path).read()


def test_a_task_has_the_contents_of_the_files_with_it(study):
    """It opens no file, in whatever process it runs."""
    path = study(RAYLEIGH, CURVE, STATIC)
    file = Measurements.of(path).read().file
    assert [times_opened(name) for name in ("swing.csv", "sweep.csv", "sag.csv")] == [1, 1, 1]
    motion, static, curve = Measurements.of(pickle.loads(pickle.dumps(file))).records
    assert [times_opened(name) for name in ("swing.csv", "sweep.csv", "sag.csv")] == [1, 1, 1]
    assert len(motion.channels) == 2 and len(curve.frequencies) == 2 and len(static.cases) == 2


@pytest.mark.slow
def test_a_run_opens_each_record_once(study):
    """Also if several steps need it, and if all computations are kept from an earlier run of the same record."""
    path, estimates = study(RAYLEIGH), []
    for alpha in (0.4, 0.4, 0.2):
        write_record(alpha)
        opened.clear()
        assert main(["run", path, "--out", "results", "--jobs", "1"]) == 0
        assert times_opened("swing.csv") == 1
        estimates.append(json.loads(Path("results/results.json").read_text())["motion"]["fit"]["estimates"])
    assert estimates[0] == estimates[1] != estimates[2]
