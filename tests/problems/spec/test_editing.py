"""A study that is changed one value at a time."""

import tomllib

import pytest

from ancf_casadi.exceptions import InputError
from problems.command.init import STUDY
from problems.spec.editing import EditedStudy, guess_places, has_beam, parse_value, toml_value

PIN = {"kind": "pin", "point": 0.25}


@pytest.fixture
def edited(study_file):
    """A function that reads a study from its text."""
    return lambda text: EditedStudy.of(str(study_file(text)))


@pytest.mark.parametrize(
    ("place", "value", "removed", "added"),
    [
        (("beam", "length"), 0.6, "length = 0.5                # m", "length = 0.6                # m"),
        (("beam", "tip_mass"), 1e-3, None, "tip_mass = 0.001"),
        (("beam", "elements"), None, "elements = 8", None),
        (("beam", "supports"), [PIN], None, 'supports = [{kind = "pin", point = 0.25}]'),
        (("damping", 0, "ratios", 1), 0.004, "ratios = [0.005, 0.003]     # damping ratio of each mode",
         "ratios = [0.005, 0.004]     # damping ratio of each mode"),
        (("base", "stop"), 2.0, "stop = 1.0                  # s; the clamp stops at the next instant of zero velocity",
         "stop = 2.0                  # s; the clamp stops at the next instant of zero velocity"),
    ],
)  # fmt: skip
def test_a_change_of_a_value_changes_its_line_alone(edited, place, value, removed, added):
    study = edited(STUDY)
    changed = study.with_value(place, value)
    before, after = (set(text.splitlines()) for text in (STUDY, changed.text))
    assert before - after == ({removed} if removed else set())
    assert after - before == ({added} if added else set())
    assert changed.value(place) == value
    assert tomllib.loads(changed.text) == changed.file.tables


def test_tables_of_laws_are_added_replaced_and_removed(edited):
    study, friction = edited(STUDY), {"law": "friction", "eta0": 0.01}
    added = study.with_value(("damping", 2), friction)
    assert [law["law"] for law in added.value(("damping",))] == ["modal", "quadratic", "friction"]
    replaced = added.with_value(("damping", 1), {"law": "rayleigh"}).with_value(("damping", 1, "alpha"), 0.1)
    assert replaced.value(("damping", 1)) == {"law": "rayleigh", "alpha": 0.1}
    for _ in range(3):
        replaced = replaced.with_value(("damping", 0), None)
    assert "damping" not in tomllib.loads(replaced.text)
    assert tomllib.loads(replaced.text)["records"] == study.value(("records",))


def test_a_value_of_several_lines_and_a_single_table_are_changed(edited):
    study = edited('[beam]\nsupports = [  # two\n    {kind = "pin", point = 0.0},\n]\n[damping]\nlaw = "friction"')
    study = study.with_value(("beam", "supports"), [PIN]).with_value(("damping", 0, "eta0"), 0.1)
    assert tomllib.loads(study.text) == {"beam": {"supports": [PIN]}, "damping": [{"law": "friction", "eta0": 0.1}]}


@pytest.mark.parametrize("text", ["beam = {length = 0.5}", "beam.length = 0.5", '[beam]\n"length" = 0.5'])
def test_a_value_that_no_line_of_its_table_holds_is_refused(edited, text):
    with pytest.raises(InputError, match=r"\[beam\]: length: stands in the file where"):
        edited(text).with_value(("beam", "length"), 0.6)
    with pytest.raises(InputError, match="none stands there"):
        edited("beam = 3").with_value(("beam", "length"), 0.6)


def test_a_study_with_nan_is_changed(edited):
    changed = edited("[beam]\nlength = 0.5\n[[statics]]\nstd = nan\n").with_value(("beam", "length"), 0.6)
    assert changed.text == "[beam]\nlength = 0.6\n[[statics]]\nstd = nan\n"


def test_places_of_guesses_are_those_of_the_parameters_and_properties(edited):
    names = ["ratio2", "eta2", "elastic_modulus", "bending_stiffness", "tip_mass", "base_amplitude"]
    study = edited(STUDY)
    places = guess_places(study.file, names)
    assert places == {
        "ratio2": ("damping", 0, "ratios", 1),
        "eta2": ("damping", 1, "eta2"),
        "elastic_modulus": ("beam", "elastic_modulus"),
        "bending_stiffness": ("beam", "elastic_modulus"),
    }
    scaled = study.scaled(places["ratio2"], 1.5).with_value(("beam", "elastic_modulus"), [2e11, 1e11])
    assert scaled.value(("damping", 0, "ratios")) == [0.005, 0.0045]
    assert scaled.scaled(places["elastic_modulus"], 1.1).value(("beam", "elastic_modulus")) == [2.2e11, 1.1e11]


def test_a_second_law_of_a_kind_has_its_own_place(edited):
    law = '[[damping]]\nlaw = "quadratic"\neta2 = 0.1\n'
    study = edited(STUDY[STUDY.index("[beam]") : STUDY.index("[match]")] + 2 * law)
    assert guess_places(study.file, ["eta2", "eta2_2"]) == {
        "eta2": ("damping", 0, "eta2"),
        "eta2_2": ("damping", 1, "eta2"),
    }


@pytest.mark.parametrize(
    "value", [5e-3, 210e9, 8000.0, 8, True, 'a "b"', [0.0, -1.0], [{"kind": "pin", "point": 0.1}], {}]
)
def test_values_are_written_as_toml(value):
    written = parse_value(toml_value(value))
    assert written == value and type(written) is type(value)


@pytest.mark.parametrize("text", ["wide", "1\nlength = 2", "[1", "= 3"])
def test_other_texts_than_values_are_refused(text):
    with pytest.raises(InputError, match="must be a value of TOML"):
        parse_value(text)
    assert parse_value(" ") is None


def test_a_study_with_a_beam_is_told_from_other_files(study_file):
    assert has_beam([str(study_file("[beam]"))])
    assert not has_beam([str(study_file("[[decays]]"))])
    assert not has_beam(["motion.csv"]) and not has_beam([])
