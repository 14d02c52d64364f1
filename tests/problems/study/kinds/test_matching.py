"""A matched beam in a study: its numbers, its figures, and the beam that later steps take."""

import pytest

from problems.paper.tables_09_10 import frequency_matching
from problems.study.compute import Compute
from problems.study.formatting import formatted_table
from problems.study.study import run_study
from tests.problems.conftest import BEAM, column

MATCH = """
[match]
targets = [1.85, 10.19]
bounds = 0.1
"""
LATER = """
[[steps]]
kind = "match"
printed = {standard = [1.67, 10.47]}

[[steps]]
kind = "modes"
modes = 2
beam = "match"
"""


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("match")
    (folder / "study.toml").write_text(BEAM + MATCH + LATER, encoding="utf-8")
    return run_study(folder / "study.toml", folder / "results")


@pytest.mark.slow
def test_later_parts_take_the_matched_beam(report):
    assert report.results["modes"]["frequency_hz"] == pytest.approx([1.85, 10.19], rel=1e-6)
    assert report.results["match"]["matched_hz"] == pytest.approx([1.85, 10.19], rel=1e-6)


def test_tables_name_properties_and_frequencies(report):
    properties, frequencies = report.steps[0].tables
    assert column(properties, "property") == ["width", "thickness", "density", "elastic modulus"]
    heads = formatted_table(frequencies).columns
    assert heads[:5] == ["mode", "target", "before", "printed", "difference"]
    assert any("IPOPT" in note for note in properties.notes)


@pytest.mark.slow
def test_the_standard_frequencies_need_another_density_and_no_gravity():
    """Erratum 1: the column beside the match of the paper has those of Table 10."""
    _, table = frequency_matching.finding(Compute(formats=()), {}).tables
    (head,) = (head for head, numbers in table.printed.items() if numbers[0] == 1.67)
    assert head == "7850 kg/m³, no gravity"
    assert column(table, head) == pytest.approx([1.67, 10.47, 29.32, 57.46, 94.97], rel=1e-3)
