"""The study of the paper: every table and figure in order, the promised numbers, and their values."""

import json
import math
import runpy
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from ancf_casadi.figures.files import figure_bytes
from ancf_casadi.version import __version__
from problems.cli import main
from problems.paper import reproduce as reproducing
from problems.paper.reproduce import PAPER
from problems.paper.tables_09_10 import frequency_matching
from problems.study.formatting import formatted_table, numeric_table
from tests.problems.paper import numbers as paper
from tests.test_docstrings import check_examples

DOCS = Path(__file__).parents[3] / "docs"
PROPORTIONAL = (0.0100, 0.0028, 0.003358, 0.005656, 0.009057)  # Eq. (16) with alpha 0.228181 and beta 3.18013e-5
PROMISED = {
    "modal_identification": {"mode", "frequency_hz", "frequency_stderr_hz", "damping_ratio", "damping_ratio_stderr"},
    "proportional": {"alpha", "beta"},
    "quadratic": {"mode", "eta1", "eta2_per_m", "equivalent_damping_ratio"},
    "frequency_matching": {
        "target_hz", "standard_hz", "matched_hz", "width_m", "thickness_m", "elastic_modulus", "density",
        "max_relative_error", "at_bound", "iterations", "solve_seconds",
    },
    "damping_comparison": {"experiment", "generic", "proportional", "quadratic"},
}  # fmt: skip


class TestContents:
    """The list of tables and figures, without a run."""

    @pytest.mark.parametrize(("kind", "last"), [("Table", 12), ("Figure", 27)])
    def test_has_every_table_and_figure_in_order(self, kind, last):
        labels = [label for step in PAPER.steps for label in (step.tables if kind == "Table" else step.figures)]
        assert labels == [f"{kind} {number}" for number in range(1, last + 1)]

    def test_a_quick_look_shows_something_of_every_section(self):
        """Of the numbered tables and figures, those of one step are missing, which repeat others with another law."""
        steps = PAPER.shorten().steps
        names = {step.name for step in steps}
        assert [step.section for step in steps if step.section] == [
            step.section for step in PAPER.steps if step.section
        ]
        (missing,) = (step for step in PAPER.steps if step.tables + step.figures and step.name not in names)
        assert missing.tables + missing.figures == ("Table 12", *(f"Figure {k}" for k in range(24, 28)))


@pytest.mark.slow
class TestResults:
    """The study in small."""

    def test_has_the_promised_keys(self, small_paper):
        """The meaning of a key never changes silently."""
        for name, keys in PROMISED.items():
            rows = small_paper.results[name]
            for row in rows if isinstance(rows, list) else [rows]:
                assert keys <= row.keys(), name
        for name in ("modal_identification", "quadratic"):
            assert [row["mode"] for row in small_paper.results[name]] == [1, 2, 3, 4, 5]
        assert list(small_paper.results["timing"]) == [step.name for step in small_paper.steps]

    def test_validates_against_its_schema(self, small_paper):
        folder = small_paper.page.parent
        schema, results = (json.loads((folder / name).read_text()) for name in ("results.schema.json", "results.json"))
        validator = jsonschema.Draft202012Validator(schema)
        validator.check_schema(schema)
        validator.validate(results)
        assert results == small_paper.to_dict()

    @pytest.mark.parametrize(
        ("step", "change"),
        [
            ("modal_identification", lambda rows: rows[0].pop("frequency_hz")),
            ("proportional", lambda numbers: numbers.update(alfa=numbers.pop("alpha"))),
            ("study", lambda about: about.pop("seed")),
        ],
    )
    def test_does_not_validate_otherwise(self, small_paper, step, change):
        schema = json.loads((small_paper.page.parent / "results.schema.json").read_text())
        results = json.loads((small_paper.page.parent / "results.json").read_text())
        change(results[step])
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(results, schema)

    def test_values_are_si_and_fractions(self, small_paper):
        results = small_paper.results
        matching = results["frequency_matching"]
        assert matching["target_hz"] == list(paper.TARGET_FREQUENCIES)
        assert matching["matched_hz"] == pytest.approx(paper.TARGET_FREQUENCIES, rel=1e-6)
        assert matching["width_m"] == pytest.approx([5e-3] * 20, rel=0.1 + 1e-9)
        assert matching["thickness_m"] == pytest.approx([0.5e-3] * 20, rel=0.1 + 1e-9)
        assert matching["density"] == pytest.approx(8000.0, rel=0.1 + 1e-9)
        assert matching["elastic_modulus"] == pytest.approx(210e9, rel=0.1 + 1e-9)
        assert results["proportional"]["alpha"] == pytest.approx(0.228181, abs=5e-7)
        assert results["proportional"]["beta"] == pytest.approx(3.18013e-5, abs=5e-11)
        comparison = results["damping_comparison"]
        assert comparison["experiment"] == [0.01]
        assert comparison["generic"] == pytest.approx([0.01], rel=0.02)
        assert comparison["proportional"] == pytest.approx([0.01], rel=0.02)

    def test_fits_recover_the_numbers_of_the_paper(self, small_paper):
        """Each number of Tables 2 and 4 lies within four standard errors, which the noise determines."""
        for row, f, ratio in zip(
            small_paper.results["modal_identification"], paper.TARGET_FREQUENCIES, paper.DAMPING_RATIOS, strict=True
        ):
            assert abs(row["frequency_hz"] - f) < 4 * row["frequency_stderr_hz"]
            assert abs(row["damping_ratio"] - ratio) < 4 * row["damping_ratio_stderr"]
            assert row["damping_ratio_stderr"] < 0.02 * ratio
            assert row["synthetic"]
        rows = small_paper.results["quadratic"]
        for row, eta1, eta2 in zip(rows, paper.ETA1, paper.ETA2, strict=True):
            assert abs(row["eta1"] - eta1) < 4 * row["eta1_stderr"]
            assert abs(row["eta2_per_m"] - eta2) < 4 * row["eta2_stderr_per_m"]
            assert row["correlation"] < -0.9

    def test_eta2_of_the_higher_modes_is_uncertain(self, small_paper):
        """Erratum 18: with this noise, eta2 of modes 1 to 5 is uncertain by 3, 22, 47, 73 and 18 %."""
        rows = small_paper.results["quadratic"]
        uncertain = [row["eta2_stderr_per_m"] / eta2 for row, eta2 in zip(rows, paper.ETA2, strict=True)]
        assert uncertain == pytest.approx([0.03, 0.22, 0.47, 0.73, 0.18], rel=0.35)

    def test_tables_stand_beside_the_papers_numbers(self, small_paper):
        """The printed numbers, those computed, and the right values beside misprints."""
        tables = {table.name: table for step in small_paper.steps for table in step.tables}
        assert [label for label in tables if "A" not in label] == [
            "Table 1", "Table 2", "Table 3", "Table 4", "Table 9", "Table 10", "Table 11",
        ]  # fmt: skip
        assert {table.source for table in tables.values() if "paper" in formatted_table(table).columns} == {"paper"}
        assert tuple(tables["Table 2"].printed["frequency, Hz"]) == paper.TARGET_FREQUENCIES
        (beta,) = (row for row in numeric_table(tables["Table 3"]).rows if row[0] == "beta")
        assert beta[2] == pytest.approx(3.18e-5, rel=1e-3)
        assert beta[-1] == 3.18e-4
        assert any("ten times" in note for note in tables["Table 3"].notes)

    def test_synthetic_data_say_so(self, small_paper):
        """Erratum 20: no raw record is published; table, note and each figure say that the decays are synthetic."""
        for step in small_paper.steps:
            if step.name in ("modal_identification", "quadratic"):
                for table in step.tables:
                    assert "synthetic" in table.title
                    assert any("no raw record was published" in note for note in table.notes)
                for figure in step.figures:
                    assert "synthetic" in figure.caption
                    assert "SYNTHETIC" in figure.svg


@pytest.mark.slow
def test_the_command_prints_what_it_writes(small_study, monkeypatch, capsys):
    """The finished computations are those of the study above."""
    folder = small_study.page.parent
    monkeypatch.chdir(folder.parent)
    assert main(["run", "small.toml", "--out", "results", "--quick", "--jobs", "1", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed.pop("version") == __version__
    assert printed == json.loads((folder / "results.json").read_text()) == small_study.to_dict()
    assert main(["run", "small.toml", "--out", "results", "--quick", "--jobs", "1"]) == 0
    *text, last = capsys.readouterr().out.splitlines()
    assert (folder.parent / last).samefile(small_study.page)
    assert any(line.startswith("Table 1. ") for line in text)


@pytest.mark.slow
def test_the_example_of_the_docstring_prints_what_it_says(tmp_path, monkeypatch):
    """With its step alone."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(reproducing, "PAPER", replace(PAPER, steps=(frequency_matching,)))
    check_examples(reproducing.reproduce)


@pytest.mark.slow
def test_the_command_reproduces_the_paper(tmp_path, likeness):
    """All tables and figures of a quick look, and values within a few per cent."""
    command = [sys.executable, "-m", "problems.cli", "reproduce", "--quick", "--jobs", "2", "--json"]
    done = subprocess.run([*command, "--out", tmp_path / "whole"], capture_output=True, text=True, check=True)
    assert "Warning" not in done.stderr
    results = json.loads(done.stdout)
    assert results.pop("version") == __version__
    assert results == json.loads((tmp_path / "whole" / "results.json").read_text())
    jsonschema.validate(results, json.loads((tmp_path / "whole" / "results.schema.json").read_text()))
    labels = [label for result in results["study"]["steps"] for label in (*result["tables"], *result["figures"])]
    labels += results["photographs"]["omitted"]
    expected = {f"Table {k}" for k in range(1, 12)} | {f"Figure {k}" for k in range(1, 24)}
    assert expected <= set(labels)
    assert len(labels) == len(set(labels))
    comparison = results["damping_comparison"]
    assert comparison["generic"] == pytest.approx(paper.DAMPING_RATIOS, rel=0.05)
    assert comparison["proportional"][:4] == pytest.approx(PROPORTIONAL[:4], rel=0.03)
    ratios = np.array(paper.ETA1[0]) / (4 * math.pi * np.array(paper.TARGET_FREQUENCIES))  # of eta1 alone
    assert (np.array(comparison["quadratic"]) > ratios).all()
    for step in ("independence", "damping_comparison"):
        for row in results[step]["runs"]:
            expected = row["expected_damping_ratio"]
            # the largest of 19 deviations, whose standard errors rest on the few periods of a quick look: mode 5 under
            # drag leaves 3.1; a ratio that is off by a tenth is seen in all runs but two of mode 5
            assert abs(row["damping_ratio"] - expected) < 0.03 * expected + 4 * row["damping_ratio_stderr"]
    assert results["frequency_matching"]["max_relative_error"] < 1e-6
    assert results["uniform_beam"]["max_relative_error"] == pytest.approx(0.0299, abs=2e-4)
    overview = runpy.run_path(str(DOCS / "overview.py"))["overview"]
    (tmp_path / "overview.png").write_bytes(figure_bytes(overview(results)))
    assert likeness(tmp_path / "overview.png", DOCS / "overview.png") > 0.98
