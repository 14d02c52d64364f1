"""What a user has chosen, as a command and as a study."""

import shlex
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from ancf_casadi.exceptions import InputError
from problems import run_study
from problems.cli import _parser
from problems.look.choices import Choices, beside, change_takes, command, has_beam, read_takes, study
from problems.look.computation import compare_takes, fit_chosen


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
    _, *words = shlex.split(command((choices,)))
    options = vars(_parser().parse_args(words))
    assert options["files"] == ["a b.csv"]
    assert {name: options[name] for name in choices.options()} == choices.options()
    assert options["end"] is None and options["frequency_law"] is None


def test_the_study_has_the_chosen_options_and_names_those_that_it_cannot_have():
    choices = Choices('a "b".csv', column="tip", begin=0.0, law="power", band=(1.0, 2.0))
    text = study((choices,))
    assert tomllib.loads(text) == {
        "decays": [{"file": 'a "b".csv', "column": "tip", "begin": 0.0}],
        "steps": [{"kind": "decays", "law": "power"}],
    }
    assert text.endswith("# only the command has: band\n")


def test_a_study_gives_back_the_choices(tmp_path):
    choices = Choices(str(tmp_path / "tip.csv"), column="2", unit="0.25 mm", end=7.5, law="auto", rest="drift")
    (tmp_path / "study.toml").write_text(study((choices,)))
    assert read_takes([str(tmp_path / "study.toml")]) == (choices,)
    (tmp_path / "plain.toml").write_text('[[decays]]\nfile = "tip.csv"\n')
    assert read_takes([str(tmp_path / "plain.toml")]) == (Choices(str(tmp_path / "tip.csv")),)
    (tmp_path / "none.toml").write_text("[beam]\nlength = 0.5\n")
    with pytest.raises(InputError, match="decays"):
        read_takes([str(tmp_path / "none.toml")])


def test_takes_have_one_command_unless_their_parts_differ(tmp_path):
    takes = (Choices("a.csv", release_time=1.0, law="quadratic"), Choices("b.csv", release_time=1.5, law="quadratic"))
    assert command(takes) == "ancf-casadi fit-decay a.csv b.csv --release-time 1.0,1.5 --law quadratic"
    for changes in ({"begin": 0.5}, {"release_time": None}, {"law": "auto"}):
        changed = change_takes(takes, 1, **changes)
        assert command(changed) == "ancf-casadi run study.toml"
        (tmp_path / "study.toml").write_text(study(changed))
        there = tuple(replace(take, file=str(tmp_path / take.file)) for take in changed)
        assert read_takes([there[0].file, str(tmp_path / "study.toml")]) == there
        assert [beside(take.file, tmp_path) for take in there] == ["a.csv", "b.csv"]


def test_a_change_is_one_of_all_takes_that_were_alike_but_a_part_is_that_of_one_take():
    takes = (Choices("a.csv"), Choices("b.csv"), Choices("c.csv", column="3"))
    changed = change_takes(takes, 0, column="2", begin=1.0, law="power")
    assert [take.options() for take in changed] == [
        {"column": "2", "begin": 1.0, "law": "power"},
        {"column": "2", "law": "power"},
        {"column": "3", "law": "power"},
    ]


@pytest.mark.parametrize("release_time", [None, 1.25])
def test_takes_are_compared_as_by_the_command_and_fitted_alone_as_by_the_study(tip, tmp_path, release_time):
    takes = change_takes((Choices(tip, begin=0.5), Choices(tip, begin=0.5, end=7.0)), 0, release_time=release_time)
    fits = compare_takes(takes)
    assert [agreement.name for agreement in fits.agreements] == ["frequency", "damping_ratio"]
    path = tmp_path / "study.toml"
    path.write_text(study(takes))
    decays = run_study(path, tmp_path / "out").results["decays"]
    assert [fit.frequency for fit in fits.alone] == [decay["frequency_hz"] for decay in decays]
    with pytest.raises(InputError, match="one record"):
        compare_takes(change_takes(takes, 0, rest="auto"))


@pytest.mark.parametrize("law", [None, "auto"])
def test_page_and_study_give_the_same_numbers(tip, tmp_path, law):
    choices = Choices(tip, begin=1.5, end=7.25, law=law)
    view = fit_chosen(choices)
    path = tmp_path / "study.toml"
    path.write_text(study((choices,)))
    (decay,) = run_study(path, tmp_path / "out").results["decays"]
    assert decay["frequency_hz"] == view.fit.frequency
    assert decay["damping_ratio_stderr"] == view.fit.standard_errors["damping_ratio"]


def test_a_comparison_states_the_probabilities_of_the_laws_and_wants_no_robust_fit(tip):
    view = fit_chosen(Choices(tip, law="auto", frequency_law="constant", rest="constant"))
    probabilities = {name.rsplit(" ", 2)[0]: float(name.split()[-2]) for name in view.laws}
    assert probabilities["linear"] > 50.0 and sum(probabilities.values()) == pytest.approx(100.0, abs=0.5)
    assert not fit_chosen(Choices(tip)).laws
    with pytest.raises(InputError, match="outliers"):
        fit_chosen(Choices(tip, law="auto", robust=True))


def test_a_band_is_fitted_as_by_the_command(tip):
    assert fit_chosen(Choices(tip, band=(1.0, 3.0))).fit.frequency == pytest.approx(12.3 / 2 / np.pi, rel=1e-3)
    with pytest.raises(InputError):
        fit_chosen(Choices(tip, band=(100.0, 101.0)))


def test_a_study_with_a_beam_is_told_from_other_files(study_file):
    assert has_beam([str(study_file("[beam]"))])
    assert not has_beam([str(study_file("[[decays]]"))])
    assert not has_beam(["motion.csv"]) and not has_beam([])
