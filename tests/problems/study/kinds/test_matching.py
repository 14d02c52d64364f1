"""A matched beam in a study: its numbers, its figures, and the beam that later steps take."""

import numpy as np
import pytest

from ancf_casadi import Model, natural_modes
from ancf_casadi.mechanics.spec import BeamSpec
from problems.paper.tables_09_10 import frequency_matching
from problems.study.compute import Compute
from problems.study.formatting import formatted_table
from problems.study.reading import read_study
from problems.study.step import Finding
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


@pytest.mark.slow
def test_the_beam_of_the_outcome_has_the_frequencies(study_file):
    study = read_study(study_file(BEAM, MATCH, LATER))
    outcome = study.steps[0].finding(Compute(), {"": Finding(None, beam=BeamSpec.of(study.beam))})
    beam, data = outcome.beam.beam(), outcome.data
    assert natural_modes(Model(beam), count=2).frequencies == pytest.approx([1.85, 10.19], rel=1e-6)
    assert beam.density[0] == data["density"] == data["density_per_element"][0]
    assert beam.elastic_modulus[0] == data["elastic_modulus"]
    assert np.abs(np.array(beam.width) / 5e-3 - 1).max() < 0.1 + 1e-9


def test_extremes_along_the_beam_are_not_named_as_the_range_that_fits_equally_well(report):
    """``lowest`` and ``highest`` are that range, in the report of a match."""
    properties, _ = report.steps[0].tables
    width = 1e3 * np.array(report.results["match"]["width_m"])
    row = dict(zip(properties.columns, properties.rows[0], strict=True))
    assert (row["smallest"], row["largest"]) == pytest.approx((width.min(), width.max()))
    assert not {"lowest", "highest"} & row.keys()


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
