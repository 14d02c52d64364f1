"""The README is correct: its Python runs, its commands exist, and CI runs its test line."""

import re
from pathlib import Path

import pytest

from problems.cli import main

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
    assert names["shaped"].max_relative_error < 1e-6
    assert names["shaped"].identifiability.rank == 5
    assert names["fit"].frequency == pytest.approx(1.85, rel=1e-3)
    assert names["fit"].damping_ratio == pytest.approx(0.0100, rel=0.03)
    assert names["air"].fit["eta2"] < 0.05  # there is none in the record
    by_ratios, by_amplitude = names["sensitivity"](names["law"].ratios, names["base"].amplitude)
    swing = names["run"].tip[:501:5, 0]  # nearly proportional to the amplitude of the base, over the first second
    assert by_amplitude.full()[::2, 0] == pytest.approx(
        swing / names["base"].amplitude, abs=0.02 * abs(swing).max() / 1e-3
    )
    assert abs(by_ratios.full()[:, 0]).max() > 1e-3


def test_two_lines_set_everything_up():
    assert sum("-m pytest" in line for line in shell_lines()) == 1
    assert sum(line.endswith("ancf-casadi reproduce") for line in shell_lines()) == 1
    assert all("venv" in line for line in shell_lines()[:2])


def test_ci_runs_the_test_line():
    assert "grep -m1 -- '-m pytest' README.md" in (ROOT / ".ci" / "run").read_text()


def test_the_commands_exist(capsys):
    named = {line.split()[1] for line in shell_lines() if line.startswith("ancf-casadi ")}
    assert named == {"reproduce", "fit-decay", "modes", "match", "simulate", "export"}
    for command in named:
        with pytest.raises(SystemExit) as ended:
            main([command, "--help"])
        assert ended.value.code == 0
        assert "--json" in capsys.readouterr().out


def test_the_picture_is_there():
    for path in re.findall(r"!\[.*?\]\((.*?)\)", README):
        assert (ROOT / path).stat().st_size > 10_000
