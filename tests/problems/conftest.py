"""Studies that run in a moment: texts of TOML files, and the study of the paper in small."""

import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from ancf_casadi.support.tables import Table
from problems.paper.reproduce import ALL_KINDS, PAPER_FILE
from problems.study.part import Study
from problems.study.reading import read_study
from problems.study.study import StudyReport, write_study

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
[[parts]]
kind = "rayleigh"
frequencies = [1.85, 10.19]
ratios = [0.0100, 0.0028]
"""
DECAYS = """
[[parts]]
kind = "decays"
sample_rate = 200.0
duration = 2.0
records = [
    {synthetic = {frequency = 3.0, damping_ratio = 0.02, amplitude = 0.01}},
    {synthetic = {frequency = 9.0, damping_ratio = 0.01, amplitude = 0.01}},
]
"""


@pytest.fixture
def study_file(tmp_path) -> Callable[..., Path]:
    """Write a study from pieces of TOML, and return its path."""

    def write(*pieces: str, name: str = "study.toml") -> Path:
        path = tmp_path / name
        path.write_text("\n".join(pieces), encoding="utf-8")
        return path

    return write


def study_in(path: Path) -> Study:
    """Return a study whose parts are of any kind."""
    return read_study(path, ALL_KINDS)


def run_in(folder: Path, text: str, *, quick: bool = False, name: str = "study.toml") -> StudyReport:
    """Run a study whose parts are of any kind, in the folder ``results`` beside its file."""
    (folder / name).write_text(text, encoding="utf-8")
    options = {"executor": None, "jobs": 1, "progress": False, "command": "run_in"}
    return write_study(folder / name, ALL_KINDS, folder / "results", quick=quick, **options)


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
def small_paper(tmp_path_factory) -> StudyReport:
    """The study of the paper in small: eight elements, the promised parts, a moment of the first experiment."""
    tables = tomllib.loads(PAPER_FILE.read_text(encoding="utf-8"))
    tables["beam"]["elements"] = 8
    parts = {part["name"]: part for part in tables["parts"] if part["name"] in SMALL}
    comparison = parts["damping_comparison"]
    comparison["runs"] = [{**comparison["runs"][0], "amplitude": 0.02, "stop": 1.0}]
    comparison["printed"] = {law: values[:1] for law, values in comparison["printed"].items()}
    folder = tmp_path_factory.mktemp("paper")
    return run_in(folder, toml({**tables, "parts": list(parts.values())}), quick=True, name="small.toml")
