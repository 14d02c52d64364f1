"""The tables of a plan, and the command."""

import json

import pytest

from ancf_casadi import InputError, QuadraticDamping, RayleighDamping
from ancf_casadi.estimation.criteria import Expectation
from problems import PlannedComparison, plan, run_study
from problems.cli import main
from problems.spec.plan import PlanTables
from tests.problems.conftest import BEAM

FITTED = (
    BEAM
    + """
[fit]
unknowns = ["elastic_modulus", "density"]
tolerance = 1e-6
"""
)
SAG = """
[[candidates]]
name = "sag"
axis = [1.0, 0.0]
loads = [{mass = 1e-3, point = 0.4}, {force = [0.0, -0.02]}]
channels = [{direction = [0.0, -1.0], std = 1e-4}, {sensor = "slope", point = 0.3, std = 1e-3}]
cost = 2.0
"""
TONES = """
[[candidates]]
name = "tones"
tip_mass = 1e-3
modes = [1, 2]
std = [0.01, 0.05]
"""
MOTION = """
[[damping]]
law = "rayleigh"
alpha = 0.5

[[candidates]]
duration = 0.5
sample_rate = 40
points = [0.3, 0.5]
std = 2e-4
zero = [-1e-3, 1e-3]
release = {tip_force = [4e-3, 0.0]}
"""
CURVE = """
[[candidates]]
name = "curve"
frequencies = [1.8, 1.9]
base = {amplitude = 1e-3}
amplitude_std = 1e-4
point = 0.4
"""


@pytest.fixture
def study(tmp_path):
    def written(*tables):
        path = tmp_path / "study.toml"
        path.write_text("\n".join((FITTED, *tables)))
        return str(path)

    return written


def test_each_kind_of_candidate_is_told_by_its_keys(study):
    task = PlanTables.of(study(MOTION, SAG, TONES, CURVE, '[plan]\nbudget = 6\ngoal = "density"'))
    kinds = {name: (one.kind, one.cost) for name, one in task.candidates.items()}
    assert kinds == {"candidate 1": ("motion", 1.0), "sag": ("static", 2.0), "tones": ("frequency", 1.0),
                     "curve": ("response", 1.0)}  # fmt: skip
    motion, sag, tones, curve = (one.template for one in task.candidates.values())
    assert [channel.sensor.point for channel in motion.own_channels] == [0.3, 0.5]
    assert [channel.std for channel in motion.own_channels] == [2e-4, 2e-4]
    assert motion.start.tip[0] > 0.0 and motion.own_channels[0].zero == (-1e-3, 1e-3)
    assert sag.stds.tolist() == [1e-4, 1e-3, 1e-4, 1e-3] and sag.model.beam.axis == (1.0, 0.0)
    assert tones.model.beam.tip_mass == 1e-3
    assert curve.sensor.point == 0.4 and curve.base.amplitude == 1e-3
    assert (task.table.budget, task.table.goal) == (6.0, "density")
    assert task.settings == {"unknowns": ("elastic_modulus", "density")}


@pytest.mark.slow
def test_the_command_prints_the_errors_and_the_best_list(study, capsys, tmp_path):
    task = PlanTables.of(study(SAG, TONES))
    found = plan(task.model, task.candidates, **task.settings)
    best = found.best(4)
    assert main(["run", study(SAG, TONES), "plan"]) == 0
    text = capsys.readouterr().out
    listed = ", ".join(f"{count} x {name}" for name, count in best.items() if count)
    assert "all together" in text and f"best list within the budget 4 for D: {listed}\n" in text
    report = run_study(study(SAG, TONES), tmp_path / "results", quick=True)
    data = report.results["plan"]
    assert data["best"] == best and data["kind"] == "plan"
    assert data["standard_errors"] == pytest.approx(found.errors_of(best))
    table, best_list = report.steps[-1].tables
    assert [row[0] for row in table.rows] == ["sag", "tones", "all together"]
    assert best_list.title == f"best list within the budget 4 for D: {listed}"
    assert [tuple(row[:3]) for row in best_list.rows] == [
        (name, found.units[name], pytest.approx(error)) for name, error in found.errors_of(best).items()
    ]


@pytest.mark.parametrize(("tables", "message"), [
    ([], r"\[candidates\]: the table is missing"),
    (["[[candidates]]\nname = 'a'"], r"\[candidates\]: a: needs duration"),
    ([TONES, TONES], r"name: must be a text that no other candidate has"),
    ([TONES.replace("std", "deviation")], r"tones: .*deviation"),
    ([SAG.replace(", std = 1e-3", "")], r"sag: channels: 2: the key 'std' is missing"),
    ([TONES, "[plan]\nbudget = 0"], r"\[plan\]: budget: must be positive"),
    ([TONES, "[plan]\nlaws = true\nbudget = 3"], r"\[plan\]: budget: .*laws = true"),
])  # fmt: skip
def test_what_is_wrong_in_the_tables_is_said(study, tables, message):
    with pytest.raises(InputError, match=message):
        PlanTables.of(study(*tables))


DRAG = """
[[damping]]
law = "quadratic"
eta2 = 1.0
"""


def test_the_command_compares_the_laws_of_the_file(tmp_path, capsys, monkeypatch):
    asked = {}

    def found(model, candidates, laws, **settings):
        asked.update(settings, candidates=list(candidates), laws=[type(law) for law in laws])
        return PlannedComparison(("first", "second"), {("candidate 1", 0, 1): Expectation(difference=3.0, right=0.8)})

    monkeypatch.setattr("problems.spec.plan.plan_comparison", found)
    path = tmp_path / "study.toml"
    path.write_text(
        "\n".join((BEAM, MOTION, DRAG, "[plan]\nlaws = true\n[fit]\nlaws = [[2], [1]]\nunknowns = ['density']"))
    )
    assert main(["run", str(path), "plan", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["plan"]["right"] == {"candidate 1": 0.8}
    assert asked == {
        "candidates": ["candidate 1"], "laws": [QuadraticDamping, RayleighDamping], "unknowns": ("density",),
    }  # fmt: skip


def test_one_law_is_no_comparison(study, capsys):
    assert main(["run", study(MOTION, "[plan]\nlaws = true"), "plan"]) == 2
    assert "needs two laws at least" in capsys.readouterr().err
