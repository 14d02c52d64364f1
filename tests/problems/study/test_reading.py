"""A study file gives its steps, and each mistake in it gives one line with file, table and key."""

import copy
import math
import random
import tomllib
from typing import Any, ClassVar

import pytest

from ancf_casadi.exceptions import AncfError, InputError
from problems import run_study
from problems.study.reading import read_study
from tests.problems.conftest import BEAM, DECAYS, RAYLEIGH, toml

LAWS = """
[[laws]]
name = "weak"
terms = [{law = "quadratic", eta1 = 0.1}]

[[laws]]
name = "found"
terms = [{step = "rayleigh", stiffness = "tangent"}]
"""
MATCH = """
[match]
targets = [1.85, 10.19]
bounds = 0.1
unknowns = {width = "global", thickness = {smooth = 2, relative_bounds = 0.05}}

[[steps]]
kind = "match"
printed = {standard = [1.67, 10.47], optimum = [1.84, 10.18], value = [5.0, 0.49, 8108.0, 205.130]}
"""
OTHERS = """
[[steps]]
kind = "beam"
printed = {value = [500.0, 5.0, 0.5, 8000.0, 210.0]}

[[steps]]
kind = "modes"
modes = 2
beam = "match"
figures = ["Figure 7"]
printed = {frequency = [1.0, 2.0]}

[[steps]]
kind = "transients"
name = "swing"
title = "A swing"
tables = ["Table 3"]
notes = ["By hand."]
beam = "match"
laws = ["weak", "found"]
runs = [{mode = 1, amplitude = 0.01, stop = 0.5, frequency = 1.8, window = 1.0, measured_ratio = 0.01, laws = ["weak"]}]
printed = {weak = [1.0]}

[[steps]]
kind = "transients"
name = "shapes"
laws = ["weak"]
runs = [{mode = 1, amplitude = 0.01, frequency = 1.8, ramp = 0.5, stop = 0.5}]
"""
ALL = BEAM + LAWS + DECAYS + RAYLEIGH + MATCH + OTHERS
RUN = "mode = 1, amplitude = 0.01, stop = 0.5, frequency = 1.8, window = 1.0, measured_ratio = 0.01"
VALUES: list[Any] = [
    0, -1, 0.5, 1e300, -1e300, 1e-300, math.nan, math.inf, 10000, 99999999999999999999, True, "x", "", [], [[]],
    [1, 2], [math.nan, 1.0], {}, {"a": 1}, [{}], ["x"], [{"step": "x"}], {"step": "rayleigh"}, "match", "weak",
    "Table 1", [[1.0, 2.0], [3.0]], [1.0],
]  # fmt: skip
KEYS = ("x", "beam", "laws", "records", "printed", "runs", "name", "file", "identified_by")


class TestDefaults:
    """A file without [[steps]] has the steps that its tables suggest."""

    TABLES: ClassVar = {
        "match": ("[match]\ntargets = [1.85]\n", ["match"]),
        "decays": ('[[decays]]\nfile = "a.csv"\n[[decays]]\nfile = "a.csv"\n', ["decays"]),
        "simulation": ("[simulation]\nduration = 0.1\n", ["simulation"]),
        "records": ('[[damping]]\nlaw = "quadratic"\neta1 = 0.1\n[[records]]\nfile = "a.csv"\n', ["motion"]),
        "frequencies": ('[[frequencies]]\nfrequencies = [1.8]\n[fit]\nunknowns = ["density"]\n', ["motion"]),
        "statics": ("[[statics]]\nloads = [{mass = 1e-3}]\nvalues = [0.01]\n", ["motion"]),
    }

    def test_of_a_beam(self, study_file):
        study = read_study(study_file(BEAM, name="strip.toml"))
        assert [(step.kind, step.name) for step in study.steps] == [("beam", "beam"), ("modes", "modes")]
        assert (study.title, study.seed) == ("strip", 0)

    @pytest.mark.parametrize("table", TABLES)
    def test_of_a_beam_and_another_table(self, study_file, tmp_path, table):
        rows = "\n".join(f"{0.01 * k},{math.exp(-0.01 * k) * math.cos(0.3 * k)}" for k in range(200))
        (tmp_path / "a.csv").write_text(f"time_s,tip_mm\n{rows}\n")
        text, kinds = self.TABLES[table]
        order = [*kinds, "beam", "modes"] if kinds == ["motion"] else ["beam", "modes", *kinds]
        assert [step.kind for step in read_study(study_file(BEAM, text)).steps] == order

    @pytest.mark.parametrize(
        ("steps", "kinds"),
        [(["match"], ["match"]), (["modes", "match"], ["modes", "match"]), (["beam"], ["beam"]),
         (["compare"], ["comparison"]), (["fit", "modes"], ["motion", "modes"])],
    )  # fmt: skip
    def test_steps_run_with_what_they_need(self, study_file, tmp_path, steps, kinds):
        """A step that no table suggests is made of the others; the beam is an identified one if the fit is a step."""
        rows = "\n".join(f"{0.01 * k},{math.exp(-0.01 * k) * math.cos(0.3 * k)}" for k in range(200))
        (tmp_path / "a.csv").write_text(f"time_s,tip_mm\n{rows}\n")
        laws = '[[damping]]\nlaw = "rayleigh"\nalpha = 0.1\n'  # beside that of the records
        path = study_file(BEAM, self.TABLES["match"][0], laws, self.TABLES["records"][0])
        study = read_study(path, steps)
        assert [step.kind for step in study.steps] == kinds
        origin = "motion" if "fit" in steps else ""  # of the beam; that of the file is empty
        assert all(step.needs == (origin,) for step in study.steps if step.kind == "modes")

    def test_an_unknown_step_is_refused_with_those_there_are(self, study_file):
        with pytest.raises(InputError, match="there is no step 'fly'; steps are beam, modes, fit, compare"):
            read_study(study_file(BEAM), ["fly"])

    def test_decays_need_no_beam(self, study_file, tmp_path):
        (tmp_path / "a.csv").write_text("time_s,tip_mm\n0,1\n0.1,-1\n0.2,0.9\n0.3,-0.9\n")
        (step,) = read_study(study_file('[[decays]]\nfile = "a.csv"\n')).steps
        assert step.kind == "decays"

    def test_names_count_within_a_kind(self, study_file):
        study = read_study(study_file(RAYLEIGH, RAYLEIGH, RAYLEIGH))
        assert [step.name for step in study.steps] == ["rayleigh", "rayleigh_2", "rayleigh_3"]

    def test_all_kinds_together(self, study_file):
        study = read_study(study_file(ALL))
        needs = {step.name: step.needs for step in study.steps if any(step.needs)}
        assert needs == {"modes": ("match",), "swing": ("match",)}
        assert [step.title for step in study.steps if step.name == "swing"] == ["A swing"]


MISTAKES = {  # what is replaced, by what, and the message after the name of the file
    "comments alone": (ALL, "# a study", ": defines no step; add [beam], [[decays]] or [[steps]]"),
    "empty": (ALL, "", ": is empty"),
    "unknown table": ("[beam]", "[bean]", ": unknown key 'bean'"),
    "unknown kind": ('kind = "modes"', 'kind = "mode"', ": [steps]: kind must be one of beam,"),
    "reserved name": ('name = "swing"', 'name = "timing"', ": [steps]: name: must be made of letters"),
    "unusable name": ('name = "swing"', 'name = "a b"', ": [steps]: name: must be made of letters"),
    "repeated name": ('name = "swing"', 'name = "match"', ": [steps]: name: 'match' is taken by an earlier step"),
    "unknown need": ('beam = "match"\nlaws', 'beam = "mach"\nlaws', ": [steps]: swing: needs the step 'mach', which"),
    "unknown key of a step": ("modes = 2", "size = 2", ": [steps]: modes: unknown key 'size'; known are beam, draw"),
    "modes": ("modes = 2", "modes = 13", ": [steps]: modes: modes: must be a whole number, 1 to 12, got 13"),
    "missing key": ("stop = 0.5}", "window = 0.5}", ": [steps]: shapes: runs: 1: the key 'stop' is missing"),
    "no runs": (f"[{{{RUN}, laws = [\"weak\"]}}]", "[]", ": [steps]: swing: runs: must be a list of 1 or more"),
    "mode of a run": ("mode = 1, amplitude = 0.01, stop = 0.5, f", "mode = 13, amplitude = 0.01, stop = 0.5, f",
                      ": [steps]: swing: runs: 1: mode: must be a whole number, 1 to 12, got 13"),
    "amplitude": ("amplitude = 0.01, stop", "amplitude = nan, stop", ": [steps]: swing: runs: 1: amplitude: must be"),
    "ramp": ("ramp = 0.5", "ramp = 1", ": [steps]: shapes: runs: 1: ramp: lasts until 0.555556 s, after the stop"),
    "unknown law": ('laws = ["weak"]}]', 'laws = ["week"]}]', ": [steps]: swing: runs: 1: laws: there is no law"),
    "law without a name": ('name = "weak"', "", ": [laws]: the key 'name' is missing"),
    "repeated law": ('name = "found"', 'name = "weak"', ": [laws]: name: must be made of letters, digits and _, and d"),
    "unknown kind of law": ('law = "quadratic"', 'law = "cubic"', ": [steps]: swing: laws: weak: law: must be one of"),
    "law of a step that is a number": ('step = "rayleigh"', "step = 3", ": [laws]: found: step: must be the name of"),
    "modal law with too many ratios": ('law = "quadratic", eta1 = 0.1', f'law = "modal", ratios = {[0.01] * 13}',
                                       ": [steps]: swing: laws: weak: ratios: "),
    "modal law with too few frequencies": (
        'law = "quadratic", eta1 = 0.1', 'law = "modal", ratios = [0.01, 0.02], frequencies = [1.0]',
        ": [steps]: swing: laws: weak: frequencies: "),
    "printed of another step": ("printed = {frequency", "printed = {ratio", ": [steps]: modes: printed: must be one"),
    "short printed": ("frequency = [1.0, 2.0]", "frequency = [1.0]", ": [steps]: modes: printed: frequency: has 1"),
    "too many frequencies": ("frequencies = [1.85, 10.19]", "frequencies = [1.85, 10.19, 20.0]",
                             ": [steps]: rayleigh: "),
    "decay without a file": (DECAYS, '[[steps]]\nkind = "decays"\n', ": [decays]: the table is missing"),
    "empty label": ('["Table 3"]', '["--"]', ": [steps]: swing: a label must have letters or digits, and differ"),
    "repeated label": ('["Table 3"]', '["figure_07"]', ": [steps]: swing: a label must have letters or digits, and d"),
    "table of earlier versions": ("[[steps]]", "[[parts]]", ": the table [[parts]] is now [[steps]]"),
    "key of earlier versions": ('step = "rayleigh"', 'part = "rayleigh"', ": [laws]: found: part: the key is now step"),
    "no beam": (BEAM, "", ": [beam]: the table is missing; this step needs a beam"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_line_with_file_table_and_key(study_file, mistake):
    old, new, message = MISTAKES[mistake]
    assert old in ALL
    path = study_file(ALL.replace(old, new, 1))
    with pytest.raises(InputError) as raised:
        read_study(path)
    line = str(raised.value)
    assert "\n" not in line
    assert message in line
    assert line.startswith(str(path))


def test_a_file_that_is_absent_is_named_when_its_part_begins(study_file, tmp_path):
    path = study_file('[[decays]]\nfile = "none.csv"\n')
    assert [step.name for step in read_study(path).steps] == ["decays"]
    with pytest.raises(InputError) as raised:
        run_study(path, tmp_path / "results")
    assert str(raised.value).startswith(f"{path}: [decays]: 1: {tmp_path}/none.csv: cannot be read")
    assert not (tmp_path / "results").exists()


def test_parts_that_need_each_other(study_file):
    cycle, other = (f'[[steps]]\nkind = "modes"\nname = "{name}"\nbeam = "{beam}"\n'
                    for name, beam in (("one", "two"), ("two", "one")))  # fmt: skip
    with pytest.raises(InputError, match=r"\[steps\]: the steps one, two need each other"):
        read_study(study_file(BEAM, cycle, other))


def mutated(tables: dict[str, Any], rng: random.Random) -> dict[str, Any]:
    """Return tables with values replaced, removed, added, or copied from another place."""
    tables = copy.deepcopy(tables)
    for _ in range(rng.choice((1, 1, 1, 2))):
        places = list(_places(tables))
        (inside, key), (other, name) = rng.choice(places), rng.choice(places)
        value = copy.deepcopy(rng.choice([rng.choice(VALUES), other[name]]))
        action = rng.randrange(4)
        if action < 2:
            inside[key] = value
        elif action == 2:
            del inside[key]
        elif isinstance(inside, list):
            inside.insert(key, value)
        else:
            inside[rng.choice(KEYS)] = value
    return tables


def _places(value: Any):
    for key, item in value.items() if isinstance(value, dict) else enumerate(value):
        yield value, key
        if isinstance(item, dict | list):
            yield from _places(item)


@pytest.mark.slow
def test_a_mutated_study_is_read_or_refused(study_file):
    """Nothing but our errors comes out, in one line, with the name of the file.

    ``benchmarks/robustness.py`` mutates more.
    """
    rng, refused, times = random.Random(7), 0, 150
    tables = tomllib.loads(ALL)
    for _ in range(times):
        path = study_file(toml(mutated(tables, rng)))
        try:
            read_study(path)
        except AncfError as error:
            refused += 1
            assert "\n" not in str(error)
            assert str(path) in str(error) or "no static equilibrium" in str(error)
    assert 0.5 * times < refused < times


def test_steps_are_chosen_from_a_file_alone(study_file):
    study = read_study(study_file(RAYLEIGH))
    with pytest.raises(InputError, match=r"^steps: are chosen from a file"):
        run_study(study, None, steps=["rayleigh"])
    assert run_study(study, None).results["rayleigh"]["alpha"] == pytest.approx(0.228181, rel=1e-5)
