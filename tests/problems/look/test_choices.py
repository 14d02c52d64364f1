"""What a user has chosen, as a command and as a study."""

import shlex
import tomllib

import numpy as np
import pytest

from ancf_casadi.exceptions import InputError
from problems import run_study
from problems.cli import _parser
from problems.look.choices import Choices
from problems.look.computation import fit_chosen


@pytest.fixture
def tip(tmp_path):
    """The file of a decay that is released at 1 s."""
    time = np.linspace(0.0, 8.0, 1601)
    after = np.maximum(time - 1.0, 0.0)
    y = 20.0 * np.exp(-0.25 * after) * np.cos(12.3 * after) + 0.05 * np.random.default_rng(0).normal(size=time.size)
    path = tmp_path / "tip 1.csv"
    np.savetxt(path, np.column_stack([time, y]), delimiter=",", header="t (s),tip (mm)", comments="")
    return str(path)


def test_the_command_has_the_chosen_options():
    choices = Choices("a b.csv", unit="0.25 mm", begin=0.0, band=(1.0, 2.5), law="quadratic", robust=True)
    _, *words = shlex.split(choices.command())
    options = vars(_parser().parse_args(words))
    assert options["files"] == ["a b.csv"]
    assert {name: options[name] for name in choices.options()} == choices.options()
    assert options["end"] is None and options["frequency_law"] is None


def test_the_study_has_the_chosen_options_and_names_those_that_it_cannot_have():
    choices = Choices('a "b".csv', column="tip", begin=0.0, law="power", band=(1.0, 2.0))
    text = choices.study()
    assert tomllib.loads(text) == {
        "decays": [{"file": 'a "b".csv', "column": "tip", "begin": 0.0}],
        "steps": [{"kind": "decays", "law": "power"}],
    }
    assert text.endswith("# only the command has: band\n")


def test_a_study_gives_back_the_choices(tmp_path):
    choices = Choices(str(tmp_path / "tip.csv"), column="2", unit="0.25 mm", end=7.5, law="auto", rest="drift")
    (tmp_path / "study.toml").write_text(choices.study())
    assert Choices.of(str(tmp_path / "study.toml")) == choices
    (tmp_path / "plain.toml").write_text('[[decays]]\nfile = "tip.csv"\n')
    assert Choices.of(str(tmp_path / "plain.toml")) == Choices(str(tmp_path / "tip.csv"))
    (tmp_path / "none.toml").write_text("[beam]\nlength = 0.5\n")
    with pytest.raises(InputError, match="decays"):
        Choices.of(str(tmp_path / "none.toml"))


@pytest.mark.parametrize("law", [None, "quadratic", "auto"])
def test_page_and_study_give_the_same_numbers(tip, tmp_path, law):
    choices = Choices(tip, begin=1.5, end=7.25, law=law)
    view = fit_chosen(choices)
    study = tmp_path / "study.toml"
    study.write_text(choices.study())
    (decay,) = run_study(study, tmp_path / "out").results["decays"]
    assert decay["frequency_hz"] == view.fit.frequency
    assert decay["damping_ratio_stderr"] == view.fit.standard_errors["damping_ratio"]


def test_a_comparison_states_the_probabilities_of_the_laws_and_wants_no_robust_fit(tip):
    view = fit_chosen(Choices(tip, law="auto", frequency_law="constant", rest="constant"))
    assert view.probabilities["linear"] > 0.5 and sum(view.probabilities.values()) == pytest.approx(1.0)
    assert not fit_chosen(Choices(tip)).probabilities
    with pytest.raises(InputError, match="outliers"):
        fit_chosen(Choices(tip, law="auto", robust=True))


def test_a_band_is_fitted_as_by_the_command(tip):
    assert fit_chosen(Choices(tip, band=(1.0, 3.0))).fit.frequency == pytest.approx(12.3 / 2 / np.pi, rel=1e-3)
    with pytest.raises(InputError):
        fit_chosen(Choices(tip, band=(100.0, 101.0)))
