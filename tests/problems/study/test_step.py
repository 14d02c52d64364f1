"""A finding is what a result says of itself, beside the numbers that others have printed."""

import pytest

from ancf_casadi import Beam, Model, natural_modes
from problems import fit_rayleigh
from problems.study.formatting import formatted_table
from problems.study.step import Finding, join_findings, study_table


@pytest.fixture(scope="module")
def modes():
    beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9, elements=3)
    return natural_modes(Model(beam), count=2)


def test_a_finding_is_what_the_result_says_of_itself(modes):
    finding = Finding.of(modes, "caption", ("svg",))
    assert finding.data == modes.to_dict() and finding.text == modes.report()
    assert finding.tables == modes.tables() and finding.warnings == ()
    (figure,) = finding.figures
    assert figure.caption == "caption" and "mode 2" in figure.svg and not figure.png
    fit = fit_rayleigh((1.0, 2.0, 3.0), (0.01, 0.05, 0.07), ratio_std=1e-3)
    assert Finding.of(fit, "", ()).warnings == fit.warnings != ()


def test_others_stand_in_place_of_some(modes):
    finding = Finding.of(modes, "", (), data={"f": 1.0}, text="shorter")
    assert (finding.data, finding.text) == ({"f": 1.0}, "shorter") and finding.tables == modes.tables()


def test_several_findings_become_one(modes):
    finding = Finding.of(modes, "", ())
    both = join_findings([1, 2], [finding, Finding(None, warnings=("failed",), text="no")])
    assert both.data == [1, 2] and both.tables == finding.tables and both.warnings == ("failed",)
    assert both.text == f"{modes.report()}\n\nno"


def test_printed_numbers_stand_beside_the_columns_of_each_table(modes):
    finding = Finding.of(modes, "", ()).beside_print({"f_Hz": (1.9, None), "mode": None})
    assert formatted_table(finding.tables[0]).columns == ["mode", "f_Hz", "printed", "difference"]
    assert finding.beside_print({}).tables[0].printed == {}


def test_a_number_has_the_digits_that_its_table_states(modes):
    (table,) = modes.tables()
    assert formatted_table(table).rows[0][1] == f"{modes.frequencies[0]:.6g}"
    assert formatted_table(study_table("t", ["x"], [(1.23456789,)])).rows == [("1.235",)]
