"""``run`` on the file that ``init`` writes, and on measured records of another beam."""

import json
import shutil
from pathlib import Path

import pytest

from ancf_casadi.export import read_document

DATA = Path(__file__).parents[4] / "shared" / "data" / "silicone_beam"
SHORT = {"duration = 2.0 ": "duration = 0.5 ", "stop = 1.0 ": "stop = 0.2 ", "elements = 8": "elements = 4"}
SILICONE = """
[study]
title = "A silicone beam released from straight"

[beam]
length = 0.1
width = 0.03
thickness = 0.03
density = 1070.0
elastic_modulus = 264e3
elements = 4
axis = [1.0, 0.0]

[[decays]]
file = "beam_gravity_tip.csv"

[[decays]]
file = "beam_load52_tip.csv"

[[damping]]
law = "rayleigh"
beta = 1e-3

[[records]]
file = "beam_gravity_tip.csv"
sensor = "displacement"
direction = [0.0, 1.0]
start = "straight"
release_time = 0.71
end = 1.9

[[predictions]]
file = "beam_load52_tip.csv"
sensor = "displacement"
direction = [0.0, 1.0]
start = "straight"
release_time = 0.44
end = 1.9
tip_mass = 0.052

[fit]
unknowns = ["elastic_modulus"]
"""


@pytest.mark.slow
def test_the_file_of_init_is_a_study(run, tmp_path):
    """Beam, modes, match, simulation and the fit that recovers the law of the simulation, as one document."""
    assert run("init").code == 0
    path, text = tmp_path / "study.toml", (tmp_path / "study.toml").read_text()
    for long, short in SHORT.items():
        assert long in text
        text = text.replace(long, short)
    path.write_text(text)
    assert run("run", "study.toml", "simulation", "--out", "results").code == 0
    done = run("run", "study.toml", "--out", "results", "--jobs", "1", "--json")
    assert done.code == 0, done.err
    results = json.loads(done.out)
    steps = [step["name"] for step in results["study"]["steps"]]
    assert steps == ["motion", "beam", "modes", "match", "simulation", "response"]
    assert results["match"]["matched_hz"] == pytest.approx([1.85, 10.19, 26.84], rel=1e-6)
    estimates = {estimate["name"]: estimate for estimate in results["motion"]["fit"]["estimates"]}
    assert estimates.keys() == {"ratio1", "ratio2", "eta2"}
    for name, truth in (("ratio1", 0.005), ("ratio2", 0.003), ("eta2", 0.11)):
        assert estimates[name]["value"] == pytest.approx(truth, rel=0.01)
        low, high = estimates[name]["interval_95"]
        assert low < truth < high
    document = read_document(tmp_path / "results/identified.json")
    assert document.identifications[0].kind == "beam"
    assert document.damping.parameters[0].value == pytest.approx(estimates["ratio1"]["value"])
    assert "A hanging strip of spring steel" in (tmp_path / "results" / "report.html").read_text()


@pytest.mark.slow
@pytest.mark.skipif(not DATA.exists(), reason="the measured records are not part of the repository")
def test_two_silicone_records_are_a_document(run, tmp_path):
    """Free decays of two records, a fit to one and the prediction of the other, without code."""
    for name in ("beam_gravity_tip.csv", "beam_load52_tip.csv"):
        shutil.copy(DATA / name, tmp_path)
    (tmp_path / "silicone.toml").write_text(SILICONE)
    done = run("run", "silicone.toml", "--out", "results", "--jobs", "1", "--json")
    assert done.code == 0, done.err
    results = json.loads(done.out)
    assert [step["name"] for step in results["study"]["steps"]] == ["motion", "beam", "modes", "decays"]
    free, loaded = results["decays"]
    assert not free["synthetic"]
    assert loaded["frequency_hz"] < 0.7 * free["frequency_hz"]  # 52 g at the tip
    assert results["modes"]["frequency_hz"][0] == pytest.approx(free["frequency_hz"], rel=0.02)  # of the fitted beam
    ((channel,),) = [one["channels"] for one in results["motion"]["predictions"]]
    assert channel["relative_error"] < 0.5
    page = (tmp_path / "results" / "report.html").read_text()
    assert "A silicone beam released from straight" in page
    assert page.count("<svg") == 5
