"""Tables show the digits that a standard error supports, and keep all digits in files."""

import csv
import io
import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ancf_casadi.support.tables import Table
from problems.study.formatting import difference, formatted_table, numeric_table, shown

FINITE = st.floats(-1e12, 1e12, allow_nan=False).filter(lambda value: value == 0.0 or abs(value) > 1e-12)
ERRORS = st.floats(1e-12, 1e12)


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (1.8500123, 0.000456, "1.85001 ± 0.00046"),
        (10.19, 0.0234, "10.190 ± 0.023"),
        (3.18013e-5, 2.1e-7, "(3.180 ± 0.021)e-5"),
        (2.1e11, 1.5e9, "(2.100 ± 0.015)e11"),
        (0.0, 0.034, "0.000 ± 0.034"),
        (0.05, 1.0, "0.1 ± 1.0"),
        (-0.5, 0.01, "-0.500 ± 0.010"),
        (1.23456789, None, "1.235"),
        (1.23456789, math.nan, "1.235"),
        (3.18e-5, None, "3.18e-5"),
        (7, None, "7"),
        ("modal", None, "modal"),
        (None, 0.1, "–"),
        (math.nan, 0.1, "–"),
    ],
)
def test_a_value_has_the_digits_of_its_standard_error(value, error, text):
    assert shown(value, error) == text


@given(FINITE, ERRORS)
def test_the_shown_numbers_are_those_given(value, error):
    """Rounded to two digits of the standard error, or to whole numbers."""
    text = shown(value, error)
    mantissa, _, power = text.strip("()").replace(")", "").partition("e")
    scale = 10.0 ** int(power or 0)
    told, told_error = (float(part) * scale for part in mantissa.split(" ± "))
    step = max(abs(error) / 10, 1.0 if not power else 0.0)
    assert told == pytest.approx(value, abs=0.51 * step + 1e-12 * abs(value))
    assert told_error == pytest.approx(error, abs=0.51 * step)


@pytest.mark.parametrize(
    ("value", "printed", "text"),
    [(1.02, 1.0, "+2 %"), (0.98, 1.0, "-2 %"), (3.18e-5, 3.18e-4, "-90 %"), (1.0 + 1e-8, 1.0, "0"), (1.0, None, ""),
     (math.nan, 1.0, ""), ("modal", 1.0, ""), (0.5, 0.0, "+0.5"), (0.0, 0.0, "0"), (-1.0, 1.0, "-200 %"),
     (1.0001, 1.0, "+0.01 %"), (-2.0, -1.0, "+100 %")],
)  # fmt: skip
def test_a_difference_is_relative_to_the_printed_number(value, printed, text):
    assert difference(value, printed) == text


@pytest.fixture
def table() -> Table:
    head = "frequency, Hz"
    rows = [(1, 1.85001234567890123, '"modal", generic'), (2, 10.19, "η2")]
    errors, printed = {head: (0.00123, math.nan)}, {head: (1.85, None)}
    return Table("modes", "Modes", ("mode", head, "law"), rows, ("A note.",), errors, printed, "paper")


def test_a_table_has_the_printed_number_and_the_difference_beside(table):
    assert formatted_table(table).columns == ["mode", "frequency, Hz", "paper", "difference", "law"]
    assert formatted_table(table).rows == [
        ("1", "1.8500 ± 0.0012", "1.85", "+0.00067 %", '"modal", generic'), ("2", "10.19", "–", "", "η2"),
    ]  # fmt: skip


def test_a_file_has_all_digits_in_one_number_per_cell(table):
    head, first, second = csv.reader(io.StringIO(numeric_table(table).csv()))
    assert head == ["mode", "frequency (Hz)", "standard error of frequency (Hz)", "paper frequency (Hz)", "law"]
    assert float(first[1]) == table.rows[0][1]
    assert (first[0], float(first[2]), float(first[3]), first[4]) == ("1", 0.00123, 1.85, '"modal", generic')
    assert second == ["2", "10.19", "", "", "η2"]


def test_text_has_title_and_notes(table):
    text = formatted_table(table).text()
    assert text.startswith("Modes\n")
    assert "A note." in text
    assert re.search(r"1\.850", text)


@pytest.mark.parametrize("values", [(1e300, 1e-300), (5e-324, -1e308)])
def test_files_keep_any_number(values):
    table = numeric_table(Table("t", "t", ["x"], [[value] for value in values]))
    _, *rows = csv.reader(io.StringIO(table.csv()))
    assert tuple(float(cell) for (cell,) in rows) == values
