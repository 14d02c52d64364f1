"""Studies that run in a moment: texts of TOML files, and the study of the paper in small."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ancf_casadi.support.tables import Table
from problems.paper import inputs, table_11
from problems.paper.reproduce import PAPER
from problems.study.study import StudyReport, run_study

STRIP = """
[beam]
length = 0.5
width = 5e-3
thickness = 0.5e-3
density = 8000.0
elastic_modulus = 210e9
"""
BEAM = f"{STRIP}elements = 3\n"
SMALL = {
    "element", "standard_beam", "photographs", "modal_identification", "proportional", "quadratic",
    "frequency_matching", "damping_comparison",
}  # fmt: skip
RAYLEIGH = """
[[steps]]
kind = "rayleigh"
frequencies = [1.85, 10.19]
ratios = [0.0100, 0.0028]
"""
DECAYS = """
[[decays]]
file = "mode1.csv"

[[decays]]
file = "mode2.csv"

[[steps]]
kind = "decays"
"""


def write_decays(folder: Path) -> None:
    """Write the records of ``DECAYS``: damping ratios of 2 % at 3 Hz and 1 % at 9 Hz, and white noise."""
    rng, time = np.random.default_rng(0), np.arange(0.0, 2.0, 0.005)
    for mode, (frequency, ratio) in enumerate([(3.0, 0.02), (9.0, 0.01)], start=1):
        omega = 2 * np.pi * frequency
        motion = 0.01 * np.exp(-ratio * omega * time) * np.cos(omega * np.sqrt(1 - ratio**2) * time)
        columns = np.column_stack([time, motion + 0.2e-3 * rng.standard_normal(time.size)])
        np.savetxt(folder / f"mode{mode}.csv", columns, delimiter=",", header="time_s,tip_m", comments="")


@pytest.fixture
def study_file(tmp_path) -> Callable[..., Path]:
    """Write a study from pieces of TOML, and return its path."""

    def write(*pieces: str, name: str = "study.toml") -> Path:
        path = tmp_path / name
        path.write_text("\n".join(pieces), encoding="utf-8")
        if DECAYS in pieces:
            write_decays(tmp_path)
        return path

    return write


def run_in(folder: Path, text: str, *, quick: bool = False, name: str = "study.toml") -> StudyReport:
    """Run a study in the folder ``results`` beside its file."""
    (folder / name).write_text(text, encoding="utf-8")
    write_decays(folder)
    return run_study(folder / name, folder / "results", quick=quick)


def column(table: Table, head: str) -> list[Any]:
    """Return the cells below the first head that is, or begins with, a text."""
    k = next(k for k, name in enumerate(table.columns) if name.startswith(head))
    return [row[k] for row in table.rows]


def toml(tables: dict[str, Any]) -> str:
    """Return tables as TOML, each in one line."""
    return "\n".join(f"{json.dumps(name)} = {_toml(value)}" for name, value in tables.items())


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {_toml(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value) if isinstance(value, str | bool) else repr(value)


def without_times(results: dict[str, Any]) -> dict[str, Any]:
    """Return the numbers of a study without computing times."""

    def kept(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: kept(item) for key, item in value.items() if key != "timing" and not key.endswith("_seconds")}
        return [kept(item) for item in value] if isinstance(value, list) else value

    return kept(results)


@pytest.fixture(scope="session")
def small_study(tmp_path_factory) -> StudyReport:
    """A user's study of every means: decays, their law, a matched beam, and a moment of an experiment on it."""
    experiment = """
[[laws]]
name = "proportional"
terms = [{step = "rayleigh"}]

[match]
targets = [1.85, 10.19]

[[steps]]
kind = "match"

[[steps]]
kind = "transients"
beam = "match"
laws = ["proportional"]
runs = [{mode = 1, amplitude = 0.02, stop = 1.0}]
"""
    return run_in(
        tmp_path_factory.mktemp("study"), BEAM + DECAYS + RAYLEIGH + experiment, quick=True, name="small.toml"
    )


@pytest.fixture(scope="session")
def small_paper(tmp_path_factory) -> StudyReport:
    """The study of the paper in small: the promised steps, with a moment of the first experiment."""

    def short(*laws: Any) -> list[Any]:
        return [replace(run, amplitude=0.02, stop=1.0) for run in inputs.experiments(*laws, modes=(1,))]

    study = replace(PAPER, steps=tuple(step for step in PAPER.steps if step.name in SMALL))
    options = {"executor": None, "jobs": 1, "progress": False, "command": "reproduce"}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(table_11, "experiments", short)
        patch.setattr(table_11, "PRINTED", {law: values[:1] for law, values in table_11.PRINTED.items()})
        return run_study(study, tmp_path_factory.mktemp("paper") / "results", quick=True, **options)
