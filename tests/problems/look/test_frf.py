"""Modes that a user has chosen by poles, and the command that does the same."""

import shlex

import numpy as np
import pytest

from ancf_casadi.exceptions import InputError
from problems.cli import _parser
from problems.look.computation import over_frequency
from problems.look.frf import FrfChoices, choose_pole, fit_modes, frf_poles


@pytest.fixture
def functions(tmp_path):
    """A file of one function with modes at 12 and 35 Hz."""
    f, noise = np.linspace(5.0, 50.0, 901), np.random.default_rng(0).normal(0.0, 1e-5, (2, 901))
    values = sum(1.0 / (f0**2 - f**2 + 0.02j * f0 * f) for f0 in (12.0, 35.0)) + noise[0] + 1j * noise[1]
    path, table = tmp_path / "tip.csv", np.column_stack([f, values.real, values.imag])
    np.savetxt(path, table, delimiter=",", header="f (Hz),H real (m/N),H imag (m/N)", comments="")
    return FrfChoices((str(path),))


def test_the_command_has_the_chosen_options():
    choices = FrfChoices(("a b.uff", "c.uff"), kind="mobility", frequencies=(1.5, 2.0), band=(1.0, 3.0))
    options = vars(_parser().parse_args(shlex.split(choices.command())[1:]))
    assert options["files"] == ["a b.uff", "c.uff"]
    assert {name: options[name] for name in choices.options()} == choices.options()
    assert options["modes"] is None


def test_a_pole_is_chosen_and_left_out(functions):
    chart, modes = frf_poles(functions), fit_modes(functions).frequencies.tolist()
    at_35 = next(k for k in chart.recurring.tolist() if chart.frequencies[k] > 30.0)
    fewer = choose_pole(functions, modes, chart, at_35)
    assert fewer.frequencies == pytest.approx((12.0,), rel=1e-3)
    both = choose_pole(fewer, fewer.frequencies, chart, at_35)
    np.testing.assert_allclose(fit_modes(both).frequencies, modes, rtol=1e-6)
    first = next(k for k in chart.recurring.tolist() if chart.frequencies[k] < 30.0)
    assert choose_pole(fewer, fewer.frequencies, chart, first) == functions


def test_poles_are_those_of_the_band(functions):
    chart = frf_poles(FrfChoices(functions.files, band=(20.0, 50.0)))
    assert chart.frequencies.min() >= 20.0


def test_what_is_over_frequency_is_seen_in_the_file(functions, tmp_path):
    (tmp_path / "none.csv").write_text("nothing")
    assert over_frequency(functions.files)
    assert not over_frequency([*functions.files, str(tmp_path / "none.csv")])
    assert not over_frequency([str(tmp_path / "missing.csv")])
    assert not over_frequency([str(tmp_path / "study.toml")])


def test_a_frequency_outside_the_band_is_refused_as_by_the_command(functions):
    with pytest.raises(InputError, match="outside the band"):
        fit_modes(FrfChoices(functions.files, frequencies=(12.0, 60.0)))
