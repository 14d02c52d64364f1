"""Every example runs and gives the results that its docstring states."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from problems.cli import main

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture
def example(monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "Agg")
    return lambda name: runpy.run_path(str(next(EXAMPLES.glob(f"{name}_*.py"))))


def test_every_example_is_tested():
    tested = {name.removeprefix("test_")[:4] for name in globals() if name.startswith("test_ex")}
    assert {path.name[:4] for path in EXAMPLES.glob("ex*.py")} == tested


def test_ex01_gravity_shifts_the_frequencies(example):
    found = example("ex01")
    assert found["weightless"] == pytest.approx(found["exact"], rel=2e-4)
    assert found["weightless"][0] == pytest.approx(1.6553, abs=5e-5)
    assert found["hanging"][0] == pytest.approx(1.8761, abs=1e-4)  # power series, 40 digits: 1.87613156
    assert found["standing"][0] == pytest.approx(1.3994, abs=1e-4)  # power series, 40 digits: 1.39944159


def test_ex02_the_circle_closes(example):
    found = example("ex02")
    assert found["gap"] < 1e-4
    assert found["top"] == pytest.approx([0.0, 1 / np.pi], abs=1e-4)


def test_ex03_standard_errors_are_the_cramer_rao_bounds(example):
    fit = example("ex03")["fit"]
    assert fit.standard_errors["frequency"] == pytest.approx(8.4060e-5, rel=0.05)
    assert fit.standard_errors["damping_ratio"] == pytest.approx(4.5321e-5, rel=0.05)
    assert abs(fit.frequency - 1.85) < 3 * 8.4060e-5
    assert abs(fit.damping_ratio - 0.01) < 3 * 4.5321e-5


@pytest.mark.slow
def test_ex04_no_energy_goes_missing(example):
    found = example("ex04")
    assert found["swing"] > 0.5
    assert found["run"].dissipated_energy[-1] == pytest.approx(found["lost"], rel=2e-3)
    assert found["lost"] > 0.1 * np.ptp(found["run"].kinetic_energy)


@pytest.mark.slow
def test_ex05_all_frequencies_are_met_within_the_bounds(example):
    found = example("ex05")
    assert found["match"].max_relative_error < 1e-6
    assert found["largest_change"] < 0.1
    assert found["match"].at_bound == ()


@pytest.mark.slow
def test_ex06_the_gap_grows_at_the_same_mass(example):
    found = example("ex06")
    assert np.diff(found["after"]) > 1.3 * np.diff(found["before"])
    assert found["profile"].mean() == pytest.approx(0.5e-3, rel=1e-7)
    assert found["profile"].min() > 0.5 * 0.5e-3 - 1e-10 and found["profile"].max() < 2 * 0.5e-3 + 1e-10
    assert found["solution"].value(found["f"]) == pytest.approx(found["after"], rel=1e-7)


@pytest.mark.slow
def test_ex07_the_planned_motion_leaves_no_swing(example):
    found = example("ex07")
    plain, planned = found["swings"]
    assert plain > 0.01
    assert planned < plain / 40
    assert found["runs"][1].tip[-1] == pytest.approx(found["runs"][1].tip[0] + (0.1, 0.0), abs=2e-4)


@pytest.mark.slow
def test_ex08_scipy_finds_the_profile(example):
    found = example("ex08")
    assert found["fit"].x == pytest.approx(found["truth"], rel=1e-6)


@pytest.mark.slow
def test_ex09_the_decay_after_the_blow_gives_frequency_and_damping(example):
    found = example("ex09")
    run, (frequency, ratio) = found["run"], found["truth"]
    assert found["fit"].frequency == pytest.approx(frequency, rel=2e-5)
    assert found["fit"].damping_ratio == pytest.approx(ratio, rel=1e-3)
    assert run.load_work[-1] == pytest.approx(run.dissipated_energy[-1] + run.energy[-1] - run.energy[0], rel=1e-4)
    assert abs(run.tip[run.time < 0.5, 0]).max() < 1e-9


@pytest.mark.slow
def test_ex10_the_resonance_leans_and_the_air_straightens_it(example):
    curves = example("ex10")["curves"]
    first, second = curves["material"].bifurcations
    assert first.kind == second.kind == "fold"
    assert curves["material"].jumps == ((first.motion.frequency,), (second.motion.frequency,))
    assert 0.002 < 1 - second.motion.frequency / first.motion.frequency < 0.03
    assert curves["material and air"].jumps == ((), ())
    assert curves["material and air"].amplitude().max() < 0.7 * curves["material"].amplitude().max()


@pytest.mark.slow
def test_the_toml_examples_run(capsys):
    assert main(["run", str(EXAMPLES / "beam.toml"), "modes"]) == 0
    assert "1.87613" in capsys.readouterr().out
    assert main(["run", str(EXAMPLES / "beam.toml"), "match"]) == 0
    assert "at a bound: nothing" in capsys.readouterr().out


@pytest.mark.slow
def test_the_toml_study_runs(capsys, monkeypatch, tmp_path):
    monkeypatch.delenv("ANCF_CASADI_COMPILE", raising=False)  # as users run it
    motion = tmp_path / "motion.csv"
    assert main(["run", str(EXAMPLES / "study.toml"), "simulation", "--out", str(tmp_path)]) == 0
    assert "travel" in capsys.readouterr().out
    time, x = np.loadtxt(motion, delimiter=",", skiprows=1, usecols=(0, 1)).T
    assert time[-1] == pytest.approx(8.0)
    assert 0.05 < np.ptp(x) < 0.5
