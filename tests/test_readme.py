"""The README is correct: its Python runs, its commands and pages exist."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from ancf_casadi import Measurement
from problems import fit_decay
from problems.cli import COMMANDS, main

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


def shell_lines():
    return [line for block in re.findall(r"```sh\n(.*?)```", README, re.S) for line in block.strip().splitlines()]


@pytest.mark.slow
def test_the_python_runs_and_finds_the_damping_it_put_in(capsys):
    code = "".join(re.findall(r"```python\n(.*?)```", README, re.S))
    names = {}
    exec(compile(code, "README.md", "exec"), names)
    assert "linear decay" in capsys.readouterr().out
    assert names["match"].max_relative_error < 1e-6
    assert names["fit"].frequency == pytest.approx(1.85, rel=1e-3)
    assert names["fit"].damping_ratio == pytest.approx(0.0100, rel=0.03)
    errors = names["fit"].standard_errors
    assert names["fit"].damping_ratio == pytest.approx(0.0100, abs=3 * errors["damping_ratio"])
    assert names["fit"].frequency == pytest.approx(names["modes"].frequencies[0], abs=3 * errors["frequency"])


def test_the_commands_exist(capsys):
    named = {line.split()[1] for line in shell_lines() if line.startswith("ancf-casadi ")}
    assert named == set(COMMANDS)
    for command in named:
        with pytest.raises(SystemExit) as ended:
            main([command, "--help"])
        assert ended.value.code == 0
        assert "--json" in capsys.readouterr().out


def test_the_example_of_a_measured_file_runs(tmp_path, monkeypatch, capsys):
    """Synthetic: a decay from 400 pixels."""
    t = np.arange(0.0, 10.0, 0.01)
    x = 400 * np.exp(-0.01 * 2 * np.pi * 1.85 * t) * np.cos(2 * np.pi * 1.85 * t)
    x += np.random.default_rng(1).normal(0.0, 3.0, len(t))
    np.savetxt(tmp_path / "tip.csv", np.column_stack([t, x]), delimiter=",", header="time_s,x", comments="")
    monkeypatch.chdir(tmp_path)
    lines = [shlex.split(line) for line in shell_lines() if " tip.csv" in line]
    assert len(lines) == 2
    for _, *arguments in lines:
        capsys.readouterr()
        assert main([*arguments, "--json"]) == 0
    fit = json.loads(capsys.readouterr().out)
    assert fit["amplitude_m"] == pytest.approx(0.1, rel=0.01)  # 400 pixels of 0.25 mm
    assert fit["frequency_hz"] == pytest.approx(1.85, rel=1e-3)
    (python,) = re.findall(r"`(fit_decay\(Measurement.*?\))`", README)
    assert eval(python, {"fit_decay": fit_decay, "Measurement": Measurement}).amplitude == fit["amplitude_m"]


def test_the_pages_and_pictures_that_it_names_exist():
    named = re.findall(r"\[.*?\]\(((?:docs|examples)/[^)#]+)\)", README)
    assert len(named) > 10
    assert all((ROOT / path).exists() for path in named)
