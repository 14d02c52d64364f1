"""A study that is changed one value at a time."""

import tomllib

import pytest

from ancf_casadi.exceptions import InputError
from problems.command.init import STUDY
from problems.spec.editing import EditedStudy, parse_value, toml_value

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


@pytest.mark.parametrize(
    "law", ['[damping]  # of air\nlaw = "friction"', 'damping = {law = "friction"}', 'damping.law = "friction"']
)
def test_one_table_of_damping_becomes_the_first_of_several(edited, law):
    study = edited(f"{law}\n[beam]\nlength = 0.5  # m\n").with_value(("damping", 0, "eta0"), 0.1)
    assert tomllib.loads(study.text) == {"beam": {"length": 0.5}, "damping": [{"law": "friction", "eta0": 0.1}]}
    assert "# of air" in study.text or "# of air" not in law
    study = study.with_value(("damping", 1), {"law": "quadratic"}).with_value(("damping", 0), None)
    assert study.text.endswith('[[damping]]\nlaw = "quadratic"\n\n[beam]\nlength = 0.5  # m\n')


@pytest.mark.parametrize(
    ("text", "place", "value", "changed"),
    [
        ("beam = {length = 0.5}  # m\n", ("beam", "length"), 0.6, "beam = {length = 0.6}  # m\n"),
        ("beam = {length = 0.5}  # m\n", ("beam", "width"), 0.1, "beam = {length = 0.5, width = 0.1}  # m\n"),
        ("beam.length = 0.5  # m\n", ("beam", "length"), 0.6, "beam.length = 0.6  # m\n"),
        ("beam.length = 0.5  # m\nbeam.width = 1\n", ("beam", "width"), None, "beam.length = 0.5  # m\n"),
        ('[beam]\n"length" = 0.5  # m\n', ("beam", "length"), 0.6, '[beam]\n"length" = 0.6  # m\n'),
        ("[beam]\n# length = 1\n\n# air\n[load]\n", ("beam", "width"), 2.1e11,
         "[beam]\nwidth = 2.1e+11\n# length = 1\n\n# air\n[load]\n"),
        ('damping = [{law = "friction"}]  # air\n', ("damping", 0, "eta0"), 0.1,
         'damping = [{law = "friction", eta0 = 0.1}]  # air\n'),
        ('[[damping]]  # air\nlaw = "friction"\n# base\n[base]\n', ("damping", 0), {"law": "modal", "ratios": [0.1]},
         '[[damping]]  # air\nlaw = "modal"\nratios = [0.1]\n# base\n[base]\n'),
        ('[beam]\n[[beam.supports]]  # tip\nkind = "pin"\n', ("beam", "supports", 0, "point"), 0.1,
         '[beam]\n[[beam.supports]]  # tip\nkind = "pin"\npoint = 0.1\n'),
        ('[beam]\n[[beam.supports]]\nkind = "pin"\n', ("beam", "supports", 0), None, "[beam]\nsupports = []\n"),
    ],
)  # fmt: skip
def test_a_value_is_changed_however_the_file_states_it(edited, text, place, value, changed):
    assert edited(text).with_value(place, value).text == changed


def test_a_list_of_several_lines_keeps_its_comments(edited):
    lines = ['    {kind = "clamp"},  # at the root\n', '    {kind = "pin", point = 0.1},  # a nail\n']
    study = edited("".join(["[beam]\nsupports = [  # two\n", *lines, "]\n"]))
    moved = study.with_value(("beam", "supports", 1, "point"), 0.2)
    assert moved.text == study.text.replace("0.1", "0.2")
    added = moved.with_value(("beam", "supports", 2), PIN)
    assert added.text == moved.text.replace("a nail\n", 'a nail\n    {kind = "pin", point = 0.25},\n')
    assert added.with_value(("beam", "supports", 0), None).text == added.text.replace(lines[0], "")


def test_a_value_without_a_table_is_refused(edited):
    for text in ("beam = 3", "beam = [1]"):
        with pytest.raises(InputError, match=r"\[beam\]: length: belongs to a table, and none stands there"):
            edited(text).with_value(("beam", "length"), 0.6)


def test_a_study_with_nan_is_changed(edited):
    changed = edited("[beam]\nlength = 0.5\n[[statics]]\nstd = nan\n").with_value(("beam", "length"), 0.6)
    assert changed.text == "[beam]\nlength = 0.6\n[[statics]]\nstd = nan\n"


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
