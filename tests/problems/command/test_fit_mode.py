"""``fit-mode``: decays in files and response curves in tables together, as text, JSON and figure; what is refused."""

import json

import numpy as np
import pytest

F = np.linspace(2.9, 3.1, 21)


def curve_table(phase=0.0, scale=1.0, **extra):
    """Return a table of the response to 0.1 N of a mode of 3 Hz and 2 kg with a damping ratio of 1 %."""
    omega = 2 * np.pi * 3.0
    values = 0.1 / 2.0 / (omega**2 - (2 * np.pi * F) ** 2 + 2j * 0.01 * omega * 2 * np.pi * F)
    values = values * (1 + 0.01 * np.random.default_rng(0).standard_normal((2, F.size)).T @ [1, 1j])
    keys = {"frequencies": F, "values": np.abs(values), "phases": np.angle(values) + phase,
            "levels": np.full(F.size, 0.1 * scale)}  # fmt: skip
    lines = [f"{key} = {np.array(value).tolist()}" for key, value in keys.items()]
    return "\n".join(["[[curves]]", *lines, *(f"{key} = {json.dumps(value)}" for key, value in extra.items())]) + "\n"


@pytest.mark.slow
def test_a_decay_and_a_curve_together(run, tmp_path):
    t = np.arange(0.0, 20.0, 0.01)
    noise = 1e-5 * np.random.default_rng(1).standard_normal(t.size)
    y = 0.01 * np.exp(-0.06 * np.pi * t) * np.cos(6 * np.pi * t * (1 - 5e-5)) + noise
    np.savetxt(tmp_path / "a.csv", np.column_stack([t, y]), delimiter=",", header="t (s),x (m)", comments="")
    (tmp_path / "curves.toml").write_text(curve_table(np.pi, excitation_unit="N"))
    data = json.loads(run("fit-mode", "a.csv", "curves.toml", "--json").out)
    found = {one["name"]: one["value"] for one in data["estimates"]}
    assert (data["kind"], data["law"]) == ("mode", "linear")
    assert found["frequency"] == pytest.approx(3.0, rel=1e-4) and found["damping_ratio"] == pytest.approx(
        0.01, rel=5e-3
    )
    assert found["modal_constant"] == pytest.approx(0.5, rel=0.02)
    assert any("180 degrees were added" in note for note in data["warnings"])
    done = run("fit-mode", "curves.toml", "--plot", "mode.svg")
    assert done.code == 0 and "modal_constant" in done.out and (tmp_path / "mode.svg").read_text().startswith("<?xml")


def test_curves_in_files_need_no_table(run, tmp_path):
    """A mode of 3 Hz and 2 kg under 100 mN, with its acceleration in g."""
    omega, W = 6 * np.pi, 2 * np.pi * F
    values = -(W**2) * 0.1 / 2.0 / (omega**2 - W**2 + 0.02j * omega * W) / 9.80665
    columns = np.column_stack([F, np.full(F.size, 100.0), np.abs(values), np.degrees(np.angle(values))])
    np.savetxt(tmp_path / "up.csv", columns, delimiter=",", header="f (Hz),force (mN),tip (g),phase (deg)", comments="")
    (tmp_path / "curves.toml").write_text('[[curves]]\nfile = "up.csv"\n')
    for given in (["--curve", "up.csv"], ["curves.toml"]):
        found = {one["name"]: one["value"] for one in json.loads(run("fit-mode", *given, "--json").out)["estimates"]}
        assert [found["frequency"], found["damping_ratio"]] == pytest.approx([3.0, 0.01], rel=1e-4)
        assert found["modal_constant"] == pytest.approx(0.5, rel=1e-4)
    done = run("fit-mode")
    assert done.code == 2 and "give the file of a decay, or response curves" in done.err


@pytest.mark.parametrize(
    ("table", "options", "code", "text"),
    [
        (curve_table(), [], 2, "or excitation_unit"),
        (curve_table(excitation_unit="kN"), [], 2, "excitation_unit"),
        (curve_table(excitation_unit="N", tip_mass=1.0), [], 2, "tip_mass"),
        ("[beam]\nlength = 1.0\n", [], 2, "curves"),
        (curve_table(excitation_unit="N"), ["--begin", "1"], 2, "--begin: belongs to the file of a record"),
        (curve_table(excitation_unit="N"), ["--modal-constant", "-1"], 2, "modal_constant"),
        ("[[curves]]\nfrequencies = [1.0, 1.1, 1.2]\nvalues = [1.0, 2.0, 3.0]\nphases = [-1.6, -1.5, -1.6]\n"
         'excitation_unit = "N"\n', [], 1, "determine zeta/modal_constant"),
    ],
)  # fmt: skip
def test_unusable_files_and_options_are_refused_in_one_line(run, tmp_path, table, options, code, text):
    (tmp_path / "curves.toml").write_text(table)
    done = run("fit-mode", "curves.toml", *options)
    assert (done.code, done.out) == (code, "") and text in done.err and done.err.count("\n") == 1


@pytest.mark.parametrize("wanted", ["drive", "1"])
def test_a_curve_without_clear_frequencies_is_read_by_the_option_that_the_message_names(run, tmp_path, wanted):
    omega, W = 6 * np.pi, 2 * np.pi * F
    values = 0.05 / (omega**2 - W**2 + 0.02j * omega * W)
    columns = np.column_stack([F, np.full(F.size, 0.1), np.abs(values), np.degrees(np.angle(values))])
    header = "drive,force (N),tip (m),phase (deg)"
    np.savetxt(tmp_path / "up.csv", columns, delimiter=",", header=header, comments="")
    done = run("fit-mode", "--curve", "up.csv")
    assert done.code == 2 and "choose with --frequency" in done.err
    estimates = json.loads(run("fit-mode", "--curve", "up.csv", "--frequency", wanted, "--json").out)["estimates"]
    assert {one["name"]: one["value"] for one in estimates}["frequency"] == pytest.approx(3.0, rel=1e-4)
    refused = run("fit-mode", "up.csv", "--frequency", wanted)
    assert refused.code == 2 and "--frequency: names a column of --curve" in refused.err
