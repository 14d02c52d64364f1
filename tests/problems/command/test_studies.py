"""Commands on TOML files: what ``init`` writes runs, shapes and markers are written, and laws are recovered."""

import os
import subprocess
import sys

import numpy as np
import pytest

from ancf_casadi import Beam, Model, natural_modes

SHORT = {"duration = 2.0 ": "duration = 0.5 ", "stop = 1.0 ": "stop = 0.2 ", "elements = 8": "elements = 4"}


@pytest.fixture
def study(run, tmp_path):
    """Write the file of ``init``, with a shorter motion."""
    assert run("init", "study.toml").code == 0
    path = tmp_path / "study.toml"
    text = path.read_text()
    for long, short in SHORT.items():
        assert long in text
        text = text.replace(long, short)
    path.write_text(text)
    return path


class TestInit:
    def test_a_record_that_the_simulation_makes_is_asked_for_by_the_command(self, run, study, tmp_path):
        done = run("run", "study.toml", "fit")
        assert done.code == 2
        assert done.err.splitlines() == [
            "ancf-casadi: results/motion.csv: does not exist; if it is to hold the motion of [simulation], run: "
            "ancf-casadi run study.toml simulation --out results"
        ]
        assert not (tmp_path / "results").exists()

    def test_it_never_overwrites(self, run, tmp_path):
        assert run("init").code == 0
        before = (tmp_path / "study.toml").read_bytes()
        done = run("init")
        assert (done.code, done.out) == (2, "")
        assert done.err == "ancf-casadi: study.toml: exists already; choose another name\n"
        assert (tmp_path / "study.toml").read_bytes() == before

    @pytest.mark.parametrize(
        ("name", "what"), [("study.txt", "must end in .toml"), ("a/b.toml/c.toml", "not a folder")]
    )
    def test_other_names_are_refused(self, run, tmp_path, name, what):
        (tmp_path / "a").mkdir()
        (tmp_path / "a/b.toml").write_text("")
        done = run("init", name)
        assert done.code == 2 and what in done.err

    def test_a_name_with_a_line_break_makes_no_broken_file(self, run):
        assert run("init", "a\nb = 1.toml").code == 0
        assert run("run", "a\nb = 1.toml", "modes").code == 0


class TestModes:
    def test_shapes_are_written_and_drawn(self, run, study, tmp_path):
        study.write_text(study.read_text() + '[[steps]]\nkind = "modes"\nmodes = 2\n')
        assert run("run", "study.toml", "modes", "--out", "new").code == 0
        header, *_ = (tmp_path / "new/shapes.csv").read_text().splitlines()
        assert header == "arc_length_m,mode1_x,mode1_y,mode2_x,mode2_y"
        table = np.loadtxt(tmp_path / "new/shapes.csv", delimiter=",", skiprows=1)
        modes = natural_modes(Model(Beam.from_toml(study)), count=2)
        for s, *row in table[::25].tolist():
            exact = modes.model.interpolation(s) @ modes.shapes / modes.tip_amplitudes()
            assert row == pytest.approx(exact.T.ravel(), abs=1e-12)
        assert np.hypot(*table[-1, 1:3]) == pytest.approx(1.0)
        assert (tmp_path / "new/figures/figure_01.png").read_bytes().startswith(b"\x89PNG")


class TestSimulate:
    def test_markers_are_in_the_output(self, run, study, tmp_path):
        text = study.read_text().replace("middle = 0.25", "middle = 0.25\nend = 0.5\nroot = 0")
        study.write_text(text)
        assert run("run", "study.toml", "simulation", "--out", "results").code == 0
        motion = tmp_path / "results/motion.csv"
        names = motion.read_text().splitlines()[0].split(",")
        table = dict(zip(names, np.loadtxt(motion, delimiter=",", skiprows=1).T, strict=True))
        assert names[5:] == ["middle_x_m", "middle_y_m", "end_x_m", "end_y_m", "root_x_m", "root_y_m"]
        for axis in "xy":
            assert table[f"end_{axis}_m"] == pytest.approx(table[f"tip_{axis}_m"], abs=1e-15)
            assert table[f"root_{axis}_m"] == pytest.approx(table[f"base_{axis}_m"], abs=1e-15)
        assert table["middle_y_m"] == pytest.approx(-0.25, abs=1e-3)

    @pytest.mark.parametrize(
        ("marker", "what"),
        [
            ("middle = 0.6", "[markers]: middle: point: the point must be on the beam, 0 to 0.5 m, got 0.6"),
            ("tip = 0.2", "[markers]: 'tip': a name must be made of letters and digits and differ from time, tip,"),
        ],
    )
    def test_markers_that_are_refused(self, run, study, marker, what):
        study.write_text(study.read_text().replace("middle = 0.25", marker))
        done = run("run", "study.toml", "simulation")
        assert done.code == 2 and what in done.err


def test_a_motion_that_would_fill_the_memory_is_refused(run, study):
    study.write_text(study.read_text().replace("sample_rate = 200.0", "sample_rate = 1e7"))
    done = run("run", "study.toml", "simulation")
    assert done.code == 2
    assert "[simulation]: sample_rate: 5e+06 samples of 4 elements would take 1.6 GB; lower sample_rate" in done.err


class TestCompareLaws:
    @pytest.mark.slow
    def test_on_a_motion(self, run, study):
        assert run("run", "study.toml", "simulation", "--out", "results").code == 0
        done = run("run", "study.toml", "compare")
        assert done.code == 0 and max(map(len, done.out.splitlines())) <= 100
        assert "most probable: ModalDamping(ratio1, ratio2) + QuadraticDamping(eta2)" in done.out

    def test_parameters_that_are_kept_are_refused(self, run, study):
        assert run("run", "study.toml", "simulation", "--out", "results").code == 0
        study.write_text(study.read_text().replace("# fixed", "fixed"))
        done = run("run", "study.toml", "compare")
        assert done.code == 2 and "[fit]: all parameters of the laws are compared" in done.err


@pytest.mark.slow
def test_a_fit_shows_progress_on_a_terminal(run, study, tmp_path):
    """The number of computed motions, on a line that is gone in the end."""
    pty, termios = pytest.importorskip("pty"), pytest.importorskip("termios")
    assert run("run", "study.toml", "simulation", "--out", "results").code == 0
    ours, theirs = pty.openpty()
    termios.tcsetwinsize(theirs, (24, 80))
    command = [sys.executable, "-m", "problems.cli", "run", "study.toml", "fit"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=theirs, cwd=tmp_path) as process:
        os.close(theirs)
        shown = b""
        try:
            while block := os.read(ours, 4096):
                shown += block
        except OSError:  # the other end is closed
            pass
        assert process.wait(timeout=60) == 0
    os.close(ours)
    assert b"run: " in shown and b" steps" in shown
    assert b"Traceback" not in shown
