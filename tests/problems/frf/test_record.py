from dataclasses import replace

import numpy as np
import pytest

from ancf_casadi import InputError, RayleighDamping, linear_frf
from problems import FrfRecord
from problems.frf.record import moving_mean
from problems.frf.selection import _interpolate_lines

F = np.linspace(1.0, 3.0, 201)
ONE = 1.0 / (2.0**2 - F**2 + 0.04j * F)


def test_values_of_one_column_or_one_function_get_all_three_axes():
    assert FrfRecord(F, ONE, "receptance").values.shape == (1, 1, 201)
    assert FrfRecord(F, [ONE, 2 * ONE], "receptance").values.shape == (2, 1, 201)
    matrix = FrfRecord(F, np.tile(ONE, (3, 2, 1)), "mobility", points=[0.1, 0.2, 0.3])
    assert (matrix.outputs, matrix.inputs, matrix.unit) == (3, 2, "m/(N s)")
    assert matrix.names() == [f"{s} m, input {k}" for s in (0.1, 0.2, 0.3) for k in (1, 2)]


def test_a_computed_frf_becomes_a_record(hanging):
    frf = linear_frf(hanging, RayleighDamping(alpha=0.2), points=(0.25, 0.5), kind="accelerance")
    record = FrfRecord(frf.frequencies, frf.values, frf.kind, points=frf.points)
    np.testing.assert_array_equal(record.values, frf.values)


def test_a_band_keeps_what_is_in_it():
    band = FrfRecord(F, ONE, "receptance", coherence=np.linspace(0.0, 1.0, 201)).between(1.5, 2.0)
    assert band.frequencies[0] >= 1.5 and band.frequencies[-1] <= 2.0
    assert band.coherence.shape == band.values.shape == (1, 1, len(band.frequencies))


def test_repeated_measurements_become_their_mean_and_its_standard_deviation():
    rng = np.random.default_rng(0)
    runs = [ONE + rng.normal(0.0, [[0.01], [0.02]], (2, 201)).T @ [1, 1j] for _ in range(5)]
    record = FrfRecord.mean_of([FrfRecord(F, run, "receptance") for run in runs])
    np.testing.assert_allclose(record.values[0, 0], np.mean(runs, axis=0))
    expected = np.sqrt((0.01**2 + 0.02**2) / 5)  # of the complex mean
    assert np.sqrt(np.mean(record.std**2)) == pytest.approx(expected, rel=0.1)
    assert record.std.min() > 0.5 * expected and record.std.max() < 2.0 * expected


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((F, ONE, "stiffness"), "kind: must be one of receptance"),
        ((F[:5], ONE[:5], "receptance"), "frequencies: needs at least 8 frequencies"),
        ((F - 1.0, ONE, "receptance"), "frequencies: must be positive and increase; leave out the line at 0 Hz"),
        ((F[::-1], ONE, "receptance"), "frequencies: must be positive and increase"),
        ((F, ONE[:-1], "receptance"), r"values: must have the shape (outputs, inputs, 201), got (200,)"),
        ((F, ONE[:, None], "receptance"), "values: must have the shape"),
        ((F, 0 * ONE, "receptance"), "values: are all zero in one of the outputs"),
        ((F, ONE * np.nan, "receptance"), "values: must be finite"),
        ((F, "values", "receptance"), "values: must be an array of numbers"),
        ((F, ["a"] * 201, "receptance"), "values: must be numbers"),
        ((F, ONE, "receptance", np.full(201, 1.5)), "coherence: must be between 0 and 1"),
        ((F, ONE, "receptance", None, np.zeros(201)), "std: must be positive"),
        ((F, ONE, "receptance", None, np.ones(200)), "std: must have the shape of the values"),
        ((F, [ONE, ONE], "receptance", None, np.ones((201, 2))), "std: must have the shape of the values"),
        ((F, [ONE, ONE], "receptance", np.ones((1, 2, 201))), "coherence: must have the shape of the values"),
        ((F, ONE, "receptance", None, None, [0.1, 0.2]), "points: has 2 values for 1 outputs"),
    ],
)
def test_what_cannot_be_used_is_refused(arguments, message):
    with pytest.raises(InputError) as raised:
        FrfRecord(*arguments)
    assert str(raised.value).startswith(message)


def test_repetitions_that_differ_in_kind_or_not_at_all_are_refused():
    record = FrfRecord(F, ONE, "receptance")
    with pytest.raises(InputError, match="records: needs at least two"):
        FrfRecord.mean_of([record])
    with pytest.raises(InputError, match="records: differ in frequencies, kind, window or shape"):
        FrfRecord.mean_of([record, FrfRecord(F, ONE, "mobility")])
    with pytest.raises(InputError, match="records: are equal"):
        FrfRecord.mean_of([record, record])
    with pytest.raises(InputError, match="band: has fewer than 8"):
        record.between(1.0, 1.01)


def test_the_mean_belongs_to_one_set_of_points_and_keeps_all_notes():
    first, second = (
        FrfRecord(F, factor * ONE, "receptance", points=[0.1], notes=(note, "both"))
        for factor, note in ((1.0, "first"), (1.1, "second"))
    )
    assert FrfRecord.mean_of([first, second]).notes == ("first", "both", "second")
    with pytest.raises(InputError, match="records: differ in their points"):
        FrfRecord.mean_of([first, replace(second, points=[0.2])])


def test_weights_that_only_some_records_state_are_not_lost_without_a_word():
    bare = FrfRecord(F, ONE, "receptance")
    coherent, scattered = replace(bare, coherence=0.9 + 0 * F), replace(bare, std=1e-3 + 0 * F)
    mixed = FrfRecord.stacked([coherent, bare])
    assert mixed.coherence is None
    assert mixed.notes == ("coherence: left out, because record 2 of 2 has none",)
    with pytest.raises(InputError, match=r"records: .*standard deviations"):
        FrfRecord.stacked([coherent, scattered])
    assert FrfRecord.stacked([coherent, replace(scattered, coherence=coherent.coherence)]).coherence is not None


@pytest.mark.parametrize("lines", [9, 300])
def test_moving_means_keep_their_digits_over_any_range(lines):
    rows = np.random.default_rng(0).random((2, lines)) * np.logspace(20, -20, lines)
    means = [[row[max(k - 12, 0) : k + 13].mean() for k in range(lines)] for row in rows]
    np.testing.assert_allclose(moving_mean(rows, 12), means, rtol=1e-12)


def test_the_whole_band_of_very_uneven_lines_is_searched_for_poles():
    """More than 20 lines of the usual spacing per measured line would be needed: they are wider instead."""
    f = np.concatenate([np.linspace(1.0, 1.1, 50), np.linspace(2.0, 500.0, 20)])
    even, rows = _interpolate_lines(f, np.array([f + 1j * f**2]))
    assert (even[0], even[-1]) == (1.0, 500.0)
    assert len(even) <= 20 * len(f) + 1
    np.testing.assert_allclose(rows[0], even + 1j * np.interp(even, f, f**2))
