"""The command: output, files and refusals."""

import contextlib
import errno
import hashlib
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from ancf_casadi import FitError
from ancf_casadi.export import fmu, load_functions, read_document
from ancf_casadi.support.interrupts import ENDING
from ancf_casadi.version import __version__
from ancf_casadi.vibration.modes import natural_modes
from problems.cli import REPLACED, main
from problems.command import fit_decay as fit_decay_command
from problems.spec import motion as motion_tables
from problems.spec.motion import SimulationTables
from problems.study import study as study_module
from problems.study.kinds import beam as beam_kinds

EXAMPLES = Path(__file__).parents[3] / "examples"
KEPT = "finished computations are kept with --out, and the same command continues from there"
PNG = b"\x89PNG\r\n\x1a\n"

BEAM = (EXAMPLES / "beam.toml").read_text()
STUDY = (EXAMPLES / "study.toml").read_text()
SMALL = {"elements = 20": "elements = 4", "duration = 8.0 ": "duration = 0.4 ", "stop = 4.0 ": "stop = 0.2 "}


def edited(text: str, *changes: tuple[str, str]) -> str:
    """Return a text with parts replaced, each of which must occur."""
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return text


@pytest.fixture
def files(tmp_path, monkeypatch) -> Path:
    """The current folder, with a beam, a small study and a decay."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "beam.toml").write_text(BEAM)
    (tmp_path / "study.toml").write_text(edited(STUDY, *SMALL.items()))
    time = np.arange(0.0, 4.0, 0.002)
    omega, zeta = 2 * np.pi * 3.0, 0.02
    decay = 5e-3 * np.exp(-zeta * omega * time) * np.cos(omega * np.sqrt(1 - zeta**2) * time)
    noise = 2e-5 * np.random.default_rng(5).standard_normal(time.size)
    rows = [f"{t:.6f},{1e3 * y:.9f}" for t, y in zip(time, decay + noise, strict=True)]
    (tmp_path / "decay.csv").write_text("\n".join(["time_s,tip_mm", *rows]) + "\n")
    return tmp_path


class TestMatch:
    @pytest.mark.parametrize(
        ("tables", "ratio"),
        [
            ('[[damping]]\nlaw = "modal"\nratios = [0.01, 0.02]\n', 0.01),
            (
                '[[damping]]\nlaw = "modal"\nratios = [0.01]\n[[damping]]\nlaw = "rayleigh"\nalpha = 0.2\n',
                0.01 + 0.2 / (4 * np.pi * 1.85),
            ),
        ],
        ids=["modal", "sum"],
    )
    def test_the_matched_beam_keeps_the_damping_of_the_file(self, files, capsys, tables, ratio):
        """Also that of a document; a modal law has the modes of the matched beam."""
        few = edited(BEAM, ("elements = 20", "elements = 4"), (", 10.19, 26.84, 53.20, 88.60", ""))
        (files / "beam.toml").write_text(few + tables)
        assert main(["export", "beam.toml", "--format", "json", "--out", "before.json"]) == 0
        (files / "again.toml").write_text('[beam]\ndocument = "before.json"\n[match]\ntargets = [1.85]\n')
        for name in ("beam.toml", "again.toml"):
            assert main(["run", name, "match", "--out", "new"]) == 0
            found = read_document("new/matched.json")
            modes = natural_modes(found.model, count=1)
            assert modes.frequencies == pytest.approx([1.85], rel=1e-6)
            assert found.damping.damping_ratios(modes, [0.0]) == pytest.approx([ratio], rel=1e-6)
            assert found.identifications[0].kind == "frequency matching"
        capsys.readouterr()
        assert main(["export", "new/matched.json", "--format", "json", "--out", "after.json"]) == 0
        assert "damping" not in capsys.readouterr().out
        assert main(["run", "new/matched.json", "modes", "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["modes"]["frequency_hz"][0] == pytest.approx(1.85, rel=1e-6)


class TestFitDecay:
    @pytest.mark.slow
    def test_the_law_is_chosen_on_request(self, files, capsys):
        assert main(["fit-decay", "decay.csv", "--law", "auto", "--json"]) == 0
        data = json.loads(capsys.readouterr().out)
        assert data["law"] == data["comparison"]["best"] == "linear"
        assert {"linear", "quadratic", "friction"} <= {law["law"] for law in data["comparison"]["laws"]}
        assert main(["fit-decay", "decay.csv", "--law", "auto"]) == 0
        text = capsys.readouterr().out
        assert "most probable: linear" in text and max(map(len, text.splitlines())) <= 100

    def test_drift_and_outliers_are_borne_on_request(self, files, capsys):
        assert main(["fit-decay", "decay.csv", "--rest", "drift", "--robust", "--json"]) == 0
        data = json.loads(capsys.readouterr().out)
        assert data["frequency_hz"] == pytest.approx(3.0, abs=max(4 * data["frequency_stderr_hz"], 1e-3))
        assert abs(data["drift_m_per_s"]) < 4 * data["drift_stderr_m_per_s"] + 1e-6
        low, high = data["damping_ratio_interval"]
        assert low < data["damping_ratio"] < high

    def test_the_curve_of_damping_against_amplitude_is_written(self, files):
        assert main(["fit-decay", "decay.csv", "--curve", "new/curve.csv"]) == 0
        header, first, *_ = (files / "new" / "curve.csv").read_text().splitlines()
        assert header.startswith("time_s,amplitude_m,damping_ratio")
        assert float(first.split(",")[2]) == pytest.approx(0.02, rel=0.1)
        assert header.endswith(",law_damping_ratio,lower_95,upper_95,law_frequency_hz,lower_95,upper_95")
        ratio, low, high, *_ = map(float, first.split(",")[6:])
        assert low < ratio < high and ratio == pytest.approx(0.02, rel=0.05)


class TestSimulate:
    @pytest.mark.slow
    def test_motion_as_csv(self, files, capsys):
        """All digits; the base stays where it first rests after 0.2 s, at three quarters of a period."""
        part = '\n[[steps]]\nkind = "simulation"\nanimate = true\nslower = 2\nanimation = "motion.html"\n'
        (files / "study.toml").write_text((files / "study.toml").read_text() + part)
        assert main(["run", "study.toml", "simulation", "--out", "new"]) == 0
        assert "samples" in capsys.readouterr().out
        header, *rows = (files / "new" / "motion.csv").read_text().splitlines()
        assert header == "time_s,tip_x_m,tip_y_m,base_x_m,base_y_m"
        motion = np.array([[float(cell) for cell in row.split(",")] for row in rows])
        assert motion[:, 0] == pytest.approx(np.arange(201) / 500.0)
        time = np.minimum(motion[:, 0], 0.75 / 1.876)
        assert motion[:, 3] == pytest.approx(2e-3 * np.sin(2 * np.pi * 1.876 * time), abs=1e-12)
        assert motion[:, 4] == pytest.approx(np.zeros(201), abs=1e-12)
        assert (files / "new" / "figures" / "figure_01.png").read_bytes().startswith(PNG)
        assert "<html" in (files / "new" / "motion.html").read_text()
        with Image.open(files / "new" / "figures" / "figure_01.gif") as moving:
            assert moving.n_frames == 21  # 0.4 s in steps of 0.02 s


def test_version_and_entry_point(capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["--version"])
    assert stopped.value.code == 0
    assert capsys.readouterr().out == f"ancf-casadi {__version__}\n"
    (script,) = entry_points(group="console_scripts", name="ancf-casadi")
    assert script.load() is main


def test_the_package_runs_as_a_module():
    run = subprocess.run(
        [sys.executable, "-m", "ancf_casadi", "--version"], capture_output=True, text=True, check=False
    )
    assert (run.returncode, run.stdout) == (0, f"ancf-casadi {__version__}\n")


@pytest.mark.parametrize(
    ("line", "completions"),
    [
        ("ancf-casadi fit-f", ["fit-frf"]),
        ("ancf-casadi fit-decay a.csv --frequency-l", ["--frequency-law"]),
        ("ancf-casadi fit-decay --law q", ["quadratic"]),
    ],
)
def test_a_shell_is_told_the_completions_of_a_line(line, completions, tmp_path):
    pytest.importorskip("argcomplete")
    asked = {"_ARGCOMPLETE": "1", "_ARGCOMPLETE_IFS": "\n", "_ARGCOMPLETE_STDOUT_FILENAME": str(tmp_path / "answer"),
             "COMP_LINE": line, "COMP_POINT": str(len(line)), "COMP_TYPE": "9"}  # fmt: skip
    subprocess.run([sys.executable, "-m", "problems.cli"], env={**os.environ, **asked}, check=True)
    assert (tmp_path / "answer").read_text().split() == completions


@pytest.mark.parametrize("module", ["numpy", "casadi", "problems.command.run"])
def test_ctrl_c_during_an_import_ends_in_one_line(files, module):
    code = (
        "import signal, sys\n"
        "from problems.cli import main\n"
        "class Finder:\n"
        "    def find_spec(self, name, *_):\n"
        f"        if name == {module!r}: signal.raise_signal(signal.SIGINT)\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "sys.meta_path.insert(0, Finder())\n"
        "sys.exit(main(['run', 'beam.toml', 'modes']))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.returncode == 130
    assert re.fullmatch(r"ancf-casadi: stopped; (nothing was written|finished computations .*)\n", run.stderr)


@pytest.mark.parametrize("megabytes", [400, 500])
def test_too_little_memory_for_the_solver_ends_in_one_line(files, megabytes):
    resource = pytest.importorskip("resource")
    run = subprocess.run(
        [sys.executable, "-m", "problems.cli", "fit-decay", "decay.csv"],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (megabytes * 2**20, megabytes * 2**20)),
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert run.returncode == 1
    assert run.stderr.startswith("ancf-casadi: IPOPT needs 384 MiB of memory") and run.stderr.count("\n") == 1


def test_a_command_draws_where_the_user_names_a_backend_that_does_not_exist(files):
    command = [sys.executable, "-m", "problems.cli", "run", "beam.toml", "modes", "--out", "new"]
    environment = {**os.environ, "MPLBACKEND": "no-such-backend"}
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stderr) == (0, "")
    assert (files / "new/figures/figure_01.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("command", "option"),
    [("fit-mode", "--frequency-l"), ("run", "--qui")],
)
def test_an_abbreviated_option_is_refused(command, option, capsys):
    with pytest.raises(SystemExit) as stopped:
        main([command, "file", option, "2"])
    assert stopped.value.code == 2
    assert f"unrecognized arguments: {option} 2" in one_line(capsys)


@pytest.mark.parametrize("option", ["--version", "--help"])
def test_version_and_help_import_none_of_the_large_packages(option):
    code = (
        "import atexit, sys\n"
        "from problems.cli import main\n"
        "large = ('casadi', 'scipy', 'matplotlib', 'msgspec', 'jinja2', 'tqdm')\n"
        "atexit.register(lambda: print([name for name in large if name in sys.modules], file=sys.stderr))\n"
        f"main([{option!r}])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stderr) == (0, "[]\n")
    assert "ancf-casadi" in run.stdout


def test_data_have_the_numbers_of_the_step_and_say_which_version_made_them(files, capsys):
    """Exact frequencies of the hanging beam: Chebyshev collocation."""
    assert main(["run", "beam.toml", "modes", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert (data["version"], data["study"]["steps"][0]["kind"]) == (__version__, "modes")
    assert data["modes"]["frequency_hz"][:3] == pytest.approx([1.87613156, 10.57854292, 29.25877251], rel=2e-4)


@pytest.mark.parametrize("command", REPLACED)
def test_a_command_of_an_earlier_version_names_what_took_its_place(files, capsys, command):
    assert f"{command} is now: ancf-casadi {REPLACED[command]}" in refused([command, "beam.toml"], files, capsys)


def test_the_help_of_studies_names_every_kind(capsys):
    with pytest.raises(SystemExit):
        main(["run", "--keys"])
    assert re.findall(r'kind\s+=\s+"(\w+)"', capsys.readouterr().out) == list(study_module.KINDS)


def one_line(capsys) -> str:
    """Return the one line that was printed, to standard error."""
    captured = capsys.readouterr()
    assert captured.out == ""
    (line,) = captured.err.splitlines()
    return line


class TestExport:
    def test_json_comes_back_as_the_same_beam_and_law(self, files, capsys):
        assert main(["export", "study.toml", "--format", "json", "--out", "new/beam.json", "--json"]) == 0
        written = json.loads(capsys.readouterr().out)
        assert written["format"] == "json"
        assert written["files"] == [{"path": "new/beam.json", "bytes": (files / "new/beam.json").stat().st_size}]
        given, found = SimulationTables.of("study.toml").arguments, read_document("new/beam.json")
        model, law = given["model"], given["damping"]
        assert found.model == model
        assert np.array_equal(found.damping.projection(found.model), law.projection(model))
        assert found.damping.parameters == law.parameters

    @pytest.mark.parametrize("form", ["json", "exudyn"])
    def test_a_beam_without_damping_is_named(self, files, capsys, form):
        (files / "beam.toml").write_text(edited(BEAM, ("elements = 20", "elements = 2")))
        assert main(["export", "beam.toml", "--format", form, "--out", "beam.out", "--json"]) == 0
        (note,) = json.loads(capsys.readouterr().out)["warnings"]
        assert note.startswith("beam.toml has no damping")

    @pytest.mark.slow
    def test_an_identification_goes_along_with_the_hash_of_its_data(self, files, capsys):
        assert main(["fit-decay", "decay.csv", "--json"]) == 0
        (files / "decay.json").write_text(capsys.readouterr().out)
        assert main(["run", "beam.toml", "match", "--json"]) == 0
        (files / "match.json").write_text(json.dumps(json.loads(capsys.readouterr().out)["match"]))
        call = ["export", "beam.toml", "--format", "json", "--out", "first.json"]
        assert main([*call, "--identification", "decay.json", "--data", "decay.csv"]) == 0
        again = ["export", "first.json", "--format", "json", "--out", "second.json"]
        assert main([*again, "--identification", "match.json"]) == 0
        decay, match = read_document("second.json").identifications
        assert (decay.kind, match.kind) == ("decay", "frequency matching")
        assert decay.result == json.loads((files / "decay.json").read_text())
        assert match.result["matched_hz"] == json.loads((files / "match.json").read_text())["matched_hz"]
        digest = hashlib.sha256((files / "decay.csv").read_bytes()).hexdigest()
        assert [(file.name, file.sha256) for file in decay.data] == [("decay.csv", digest)]

    def test_the_reduced_model_as_casadi_and_c(self, files, capsys):
        (files / "small.toml").write_text(edited(BEAM, ("elements = 20", "elements = 2")))
        call = ["export", "small.toml", "--markers", "0.25", "--reduced", "2", "--format"]
        assert main([*call, "casadi", "--out", "beam.casadi"]) == 0
        functions = load_functions("beam.casadi")
        assert [state.name for state in functions.states] == ["q_1", "q_2", "velocity_q_1", "velocity_q_2"]
        assert functions.markers(0, 0).full().ravel() == pytest.approx([0.0, -0.25], abs=1e-6)
        assert main([*call, "c", "--out", "source"]) == 0
        assert "source/beam.c" in capsys.readouterr().out
        header = (files / "source/beam.h").read_text()
        assert "beam_step(const double q[2]" in header and "thickness_2" not in header

    @pytest.mark.slow
    @pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
    def test_fmu(self, files, capsys, monkeypatch):
        (files / "small.toml").write_text(edited(BEAM, ("elements = 20", "elements = 2")))
        monkeypatch.setattr(fmu, "FMU_FLAGS", ("-O0", *fmu.FMU_FLAGS[1:]))
        assert main(["export", "small.toml", "--format", "fmu", "--out", "beam.fmu", "--markers", "0.1,0.25"]) == 0
        captured = capsys.readouterr()
        size, _, note = captured.out.partition("\n")
        assert size == f"beam.fmu  {(files / 'beam.fmu').stat().st_size} bytes" and "has no damping" in note
        assert "compiler" in captured.err  # what it is at
        with zipfile.ZipFile("beam.fmu") as archive:
            description = archive.read("modelDescription.xml").decode()
        assert "the point at arc length 0.25 m, y" in description
        assert main(["export", "small.toml", "--format", "co-simulation", "--out", "own.fmu", "--reduced", "1"]) == 0
        with zipfile.ZipFile("own.fmu") as archive:
            description = archive.read("modelDescription.xml").decode()
        assert "<CoSimulation" in description and "modes kept: 1" in description

    @pytest.mark.parametrize(
        ("arguments", "what"),
        [
            (["beam.toml", "--out", "x"], "required: --format"),
            (["none.json", "--format", "json", "--out", "x"], "none.json: cannot be read"),
            (["bad.toml", "--format", "json", "--out", "x"], "bad.json: $.format: must be 'ancf-casadi'"),
            (["beam.toml", "--format", "json", "--out", "x", "--markers", "0.1"], "--markers: does not apply to"),
            (["beam.toml", "--format", "fmu", "--out", "x", "--markers", "0.6"], "--markers: point: the point must"),
            (["beam.toml", "--format", "fmu", "--out", "x", "--markers", "nan"], "must be numbers separated by commas"),
            (["beam.toml", "--format", "json", "--out", "x", "--identification", "bad.json"], "result: is not"),
            (["beam.toml", "--format", "json", "--out", "x", "--identification", "decay.csv"], "is not JSON"),
            (["beam.toml", "--format", "c", "--out", "beam.toml"], "beam.toml: is not a folder"),
            (["beam.toml", "--format", "c", "--out", "x", "--identification", "good.json"], "does not apply to c;"),
            (["beam.toml", "--format", "json", "--out", "x", "--data", "decay.csv"], "--data: there are 1 for 0"),
            (["beam.toml", "--format", "json", "--out", "x", "--reduced", "3"], "--reduced: does not apply to json"),
            (["beam.toml", "--format", "fmu", "--out", "x", "--reduced", "99"], "modes: must be a whole number, 1"),
        ],
    )
    def test_refusals(self, files, capsys, arguments, what):
        (files / "bad.json").write_text('{"a": 1}')
        (files / "good.json").write_text('{"kind": "beam", "estimates": []}')
        (files / "bad.toml").write_text('[beam]\ndocument = "bad.json"\n')
        assert what in refused(["export", *arguments], files, capsys)

    def test_a_document_is_named_by_a_text_and_stands_alone(self, files, capsys):
        (files / "bad.toml").write_text("[beam]\ndocument = 3\n")
        assert "[beam]: document: must be a text, got 3" in refused(["run", "bad.toml", "modes"], files, capsys)
        (files / "bad.toml").write_text('[beam]\ndocument = "a.json"\nlength = 1\n')
        assert "[beam]: unknown key 'length'" in refused(["run", "bad.toml", "modes"], files, capsys)


def refused(arguments: list[str], files: Path, capsys) -> str:
    """Return the one line with which the command refuses, having written nothing."""
    before = sorted(path.relative_to(files) for path in files.rglob("*"))
    try:
        code = main(arguments)
    except SystemExit as stopped:  # an option that argparse refuses
        code = stopped.code
    assert code == 2
    assert sorted(path.relative_to(files) for path in files.rglob("*")) == before
    return one_line(capsys)


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (["fit-decay", "decay.csv", "--curve", "./decay.csv"], "decay.csv: is an input, which would be lost"),
        (["export", "beam.toml", "--format", "json", "--out", "beam.toml"], "beam.toml: is an input"),
        (["fit-decay", "decay.csv", "--curve", "x.png", "--plot", "./x.png"], "x.png: is named for two outputs;"),
        (["fit-decay", "decay.csv", "--curve", "pipe"], "pipe: is a device or a pipe; name a file"),
        (["run", "large.toml", "modes"], "large.toml: is larger than 64 MiB"),
    ],
)
def test_files_that_are_not_for_it(files, capsys, arguments, what):
    (files / "link.toml").symlink_to("study.toml")
    os.mkfifo(files / "pipe")
    with open("large.toml", "wb") as file:
        os.truncate(file.fileno(), 64 * 2**20 + 1)
    before = (files / "decay.csv").read_bytes(), (files / "beam.toml").read_bytes()
    assert what in refused(arguments, files, capsys)
    assert before == ((files / "decay.csv").read_bytes(), (files / "beam.toml").read_bytes())


class TestUnusableInput:
    """Exit code 2, and one line that says what and where."""

    @pytest.mark.parametrize(
        ("old", "new", "what"),
        [
            ("thickness = 0.5e-3", "", "[beam]: the key 'thickness' is missing"),
            ("[match]", "[mach]", "unknown key 'mach'; known are base, beam, candidates, curves, damping, decays,"),
            ("density = 8000.0", "density = nan", "[beam]: density: must be a finite number, got nan"),
            ("length = 0.5 ", "length = = 0.5 ", "is not TOML (Invalid value (at line 4, column 10))"),
        ],
    )
    def test_beam(self, files, capsys, old, new, what):
        (files / "beam.toml").write_text(edited(BEAM, (old, new)))
        assert refused(["run", "beam.toml", "modes"], files, capsys).startswith(f"ancf-casadi: beam.toml: {what}")

    @pytest.mark.parametrize(
        ("arguments", "what"),
        [
            (["run", "absent.toml"], "absent.toml: cannot be read (No such file or directory)"),
            (["run", "."], ".: cannot be read (Is a directory)"),
            (["run"], "the following arguments are required: STUDY.toml"),
            (["run", "beam.toml", "fly"], "there is no step 'fly'; steps are beam, modes, match, fit, compare"),
            (["fit-decay", "decay.csv", "--curve", "."], ".: is a folder"),
            (["run", "study.toml", "--out", "beam.toml/new"], "beam.toml: is not a folder"),
            (["reproduce", "--jobs", "0"], "argument --jobs: must be a whole number above 0, got '0'"),
            (["reproduce", "--fast"], "ancf-casadi reproduce: unrecognized arguments: --fast"),
            (["fly"], "argument COMMAND: invalid choice: 'fly'"),
            ([], "the following arguments are required: COMMAND"),
        ],
    )
    def test_arguments(self, files, capsys, arguments, what):
        line = refused(arguments, files, capsys)
        assert line.startswith("ancf-casadi")
        assert what in line


class TestFailure:
    """Exit code 1, and one line that says what to try."""

    def test_a_match_that_is_half_off(self, files, capsys):
        far = "targets = [100.0, 900.0]  # "
        (files / "beam.toml").write_text(edited(BEAM, ("targets = ", far), ("bounds = 0.10", "bounds = 0.01")))
        assert main(["run", "beam.toml", "match"]) == 1
        assert "these unknowns cannot meet the targets" in one_line(capsys)

    def test_a_fit_that_does_not_converge(self, files, capsys, monkeypatch):
        def fails(*_, **__):
            raise FitError("no minimum was found;\nstart elsewhere")

        monkeypatch.setattr(beam_kinds, "match_frequencies", fails)
        assert main(["run", "beam.toml", "match", "--json"]) == 1
        assert one_line(capsys) == "ancf-casadi: match: no minimum was found; start elsewhere"

    def test_an_integrator_that_fails(self, files, capsys):
        """No step can meet a tolerance below rounding; the bar before the line is progress, not the message."""
        text = (files / "study.toml").read_text().replace("[simulation]", "[simulation]\ntolerance = 1e-30")
        (files / "study.toml").write_text(text)
        assert main(["run", "study.toml", "simulation", "--out", "new"]) == 1
        captured = capsys.readouterr()
        assert captured.out == ""
        assert captured.err.splitlines()[-1].startswith("ancf-casadi: simulation: the integrator ")
        assert "Traceback" not in captured.err
        assert "casadi/" not in captured.err
        assert not (files / "new" / "motion.csv").exists()

    def test_out_of_memory(self, files, capsys, monkeypatch):
        def fails(*_, **__):
            raise MemoryError

        monkeypatch.setattr(motion_tables, "simulate", fails)
        assert main(["run", "study.toml", "simulation"]) == 1
        assert "out of memory" in one_line(capsys)


@pytest.fixture
def full_disk(monkeypatch):
    """A disk that is full."""

    def fails(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", fails)
    monkeypatch.setenv("ANCF_CASADI_COMPILE", "0")  # the compiler would complain too


class TestFullDisk:
    """A result that took long to compute is printed even if it cannot be written."""

    @pytest.mark.slow
    @pytest.mark.parametrize(("output", "form"), [(["--curve", "curve.csv"], ["--json"]), (["--plot", "fit.png"], [])])
    def test_the_result_is_printed_first(self, files, capsys, full_disk, output, form):
        assert main(["fit-decay", "decay.csv", *form]) == 0
        expected = capsys.readouterr().out
        before = sorted(files.iterdir())
        assert main(["fit-decay", "decay.csv", *output, *form]) == 2
        captured = capsys.readouterr()
        assert without_times(captured.out) == without_times(expected)
        (line,) = [line for line in captured.err.splitlines() if line.startswith("ancf-casadi: ")]
        assert line == f"ancf-casadi: {output[-1]}: cannot be written (No space left on device)"
        assert sorted(files.iterdir()) == before

    @pytest.mark.slow
    def test_study(self, files, capsys, full_disk):
        """A study cannot keep its first result, and says so."""
        assert main(["run", "beam.toml", "--jobs", "1", "--out", "new"]) == 2
        assert re.fullmatch(
            r"ancf-casadi: new/steps/\w+\.msgpack: cannot be written \(No space left on device\)", one_line(capsys)
        )
        assert not list((files / "new").rglob("*.*"))

    @pytest.mark.slow
    def test_a_limit_of_the_system(self, files):
        """A real failure: the system lets no file grow beyond a few bytes."""
        resource = pytest.importorskip("resource")
        command = [sys.executable, "-m", "problems.cli", "fit-decay", "decay.csv", "--curve", "curve.csv", "--json"]

        def limit():
            resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))

        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, preexec_fn=limit)
        assert done.returncode == 2
        assert json.loads(done.stdout)["kind"] == "decay"
        assert done.stderr.splitlines()[-1] == "ancf-casadi: curve.csv: cannot be written (File too large)"
        assert "Traceback" not in done.stderr
        assert not [path for path in files.iterdir() if "curve" in path.name]

    @pytest.mark.slow
    @pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full")
    def test_standard_output_to_a_full_disk(self, files):
        with open("/dev/full", "w") as full:
            command = [sys.executable, "-m", "problems.cli", "run", "beam.toml", "modes"]
            done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60, check=False)
        assert done.returncode == 2
        assert done.stderr == "ancf-casadi: the result cannot be printed (No space left on device)\n"


def without_times(text: str) -> str:
    """Return a report without the computing time."""
    return re.sub(r"(seconds\"?:?\s+)[\d.e-]+|[\d.]+ s(?=[,.;)]|$)", r"\1", text)


class TestInterrupted:
    """Exit code 128 and the number of the signal, one line, nothing written."""

    @pytest.mark.parametrize("step", ["modes", "simulation", ""])
    def test_anywhere(self, files, capsys, monkeypatch, step):
        def stopped(*_, **__):
            raise KeyboardInterrupt

        called = {"natural_modes": beam_kinds, "simulate": motion_tables, "fit_or_compare": fit_decay_command}
        for name, module in called.items():
            monkeypatch.setattr(module, name, stopped)
        file = {"simulation": "study.toml"}.get(step, "beam.toml")
        before = sorted(files.iterdir())
        assert main(["run", file, step] if step else ["fit-decay", "decay.csv"]) == 130
        assert one_line(capsys) == f"ancf-casadi: stopped; {KEPT if step else 'nothing was written'}"
        assert sorted(files.iterdir()) == before

    @pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
    def test_while_an_fmu_is_compiled(self, files, capsys, monkeypatch):
        def stopped(*_, **__):
            raise KeyboardInterrupt

        monkeypatch.setattr(fmu, "compiler_failure", stopped)
        before = sorted(files.iterdir())
        assert main(["export", "beam.toml", "--format", "fmu", "--out", "new/beam.fmu"]) == 130
        assert capsys.readouterr().err.endswith("ancf-casadi: stopped; nothing was written\n")
        assert (sorted(files.iterdir()), Path.cwd()) == (before, files)

    @pytest.mark.parametrize("error", [FitError("NonIpopt_Exception_Thrown"), NotImplementedError("Wrong number")])
    def test_taken_for_a_failure_by_casadi(self, files, capsys, monkeypatch, error):
        """IPOPT and IDAS report an exception in a callback as their own failure, CasADi calls as wrong arguments."""

        def swallowed(*_, **__):
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt:
                raise error from None

        monkeypatch.setattr(beam_kinds, "match_frequencies", swallowed)
        assert main(["run", "beam.toml", "match"]) == 130
        assert one_line(capsys) == f"ancf-casadi: stopped; {KEPT}"

    @pytest.mark.parametrize("ending", ENDING)
    def test_handler_is_put_back(self, files, capsys, ending):
        before = signal.getsignal(ending)
        assert main(["run", "beam.toml", "modes"]) == 0
        assert signal.getsignal(ending) is before

    @pytest.mark.parametrize("ending", ENDING)
    def test_while_writing(self, files, capsys, monkeypatch, ending):
        monkeypatch.setattr(os, "replace", lambda *_: signal.raise_signal(ending))
        before = sorted(files.iterdir())
        assert main(["fit-decay", "decay.csv", "--curve", "curve.csv"]) == 128 + ending
        assert one_line(capsys) == "ancf-casadi: stopped; not all files were written"
        assert sorted(files.iterdir()) == before

    @pytest.mark.slow
    @pytest.mark.parametrize(("delay", "ending"), [(0.3, signal.SIGINT), (0.1, signal.SIGTERM)])
    def test_in_the_midst_of_a_simulation(self, files, delay, ending):
        """A real signal once the integrator is at work, which notices it in one of several ways."""
        (files / "study.toml").write_text(edited(STUDY, ("duration = 8.0 ", "duration = 200.0 ")))
        code = (
            "import sys\n"
            "from problems.cli import main\n"
            "from problems.spec import motion\n"
            "simulate = motion.simulate\n"
            "def told(**arguments):\n"
            "    print('at work', file=sys.stderr, flush=True)\n"
            "    return simulate(**arguments)\n"
            "motion.simulate = told\n"
            "sys.exit(main(['run', 'study.toml', 'simulation', '--out', 'new']))"
        )
        command = [sys.executable, "-c", code]
        with subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        ) as process:
            assert process.stderr is not None
            while b"at work" not in process.stderr.read1():
                assert process.poll() is None
            try:
                process.wait(timeout=0.5 + delay)
            except subprocess.TimeoutExpired:
                process.send_signal(ending)
            output, errors = process.communicate(timeout=60)
        assert process.returncode == 128 + ending
        assert output == b""
        assert errors.decode().splitlines()[-1] == f"ancf-casadi: stopped; {KEPT}"
        assert b"Traceback" not in errors
        assert not (files / "new" / "motion.csv").exists()


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [["run", "beam.toml", "modes"], ["--help"]])
def test_a_reader_that_has_left_is_no_error(files, arguments):
    """As in ``ancf-casadi run beam.toml modes | true``."""
    reader, writer = os.pipe()
    os.close(reader)
    try:
        done = subprocess.run(
            [sys.executable, "-m", "problems.cli", *arguments],
            stdout=writer,
            stderr=subprocess.PIPE,
            text=True,
            timeout=60,
            check=False,
        )
    finally:
        os.close(writer)
    assert done.stderr == ""
    assert done.returncode == 0


@pytest.mark.slow
@pytest.mark.parametrize(("ending", "send"), [(signal.SIGINT, os.killpg), (signal.SIGTERM, os.kill)])
def test_a_study_that_is_interrupted_leaves_no_processes(files, ending, send):
    """Ctrl-C in a terminal reaches the whole group, SIGTERM the command alone; it answers, and no process is left."""
    command = [sys.executable, "-m", "problems.cli", "reproduce", "--quick", "--jobs", "2", "--out", "study"]
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        assert process.stderr is not None
        while not list((files / "study").rglob("*.msgpack")):
            assert process.poll() is None
            time.sleep(0.05)
        try:
            process.wait(timeout=1.0)  # the other processes are at work by then
        except subprocess.TimeoutExpired:
            send(process.pid, ending)
        try:
            output, errors = process.communicate(timeout=30)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            raise
    assert process.returncode == 128 + ending
    assert output == b""
    assert errors.decode() == f"ancf-casadi: stopped; {KEPT}\n"
    assert [path.name for path in (files / "study").iterdir()] == ["steps"]  # finished steps are kept
    left, deadline = True, time.monotonic() + 10.0
    while left and time.monotonic() < deadline:
        try:
            os.killpg(process.pid, 0)
        except ProcessLookupError:
            left = False
        time.sleep(0.05)
    assert not left


HOSTILE = "time_s,\x1b[2J\x1b]0;pwned\x07\n0,1\n1,2\n2,1\n3,2\n"


@pytest.mark.parametrize(
    ("name", "arguments"),
    [("a.csv", []), ("\x1b[31m.csv", []), ("a.csv", ["--column", "\x1b[2J"]), ("a.csv", ["--sample-rate", "\x1b[2J"])],
    ids=["a column", "a file", "an option", "a number"],
)
def test_control_characters_of_others_do_not_reach_the_terminal(tmp_path, capsys, name, arguments):
    (tmp_path / name).write_text(HOSTILE)
    with contextlib.suppress(SystemExit):
        main(["inspect", str(tmp_path / name), *arguments])
    printed = "".join(capsys.readouterr())
    assert "\x1b" not in printed and "\x07" not in printed and "\\x1b" in printed


CLOSED = {
    "output": (">&-", 2, ""),
    "errors": ("2>&-", 0, "tip"),
    "both": (">&- 2>&-", 2, ""),
    "input": ("<&-", 0, "tip"),
}


@pytest.mark.parametrize("stream", CLOSED)
def test_closed_streams_end_without_a_traceback(tmp_path, stream):
    redirection, code, printed = CLOSED[stream]
    (tmp_path / "a.csv").write_text("time_s,tip\n0,1\n1,2\n2,1\n")
    line = f"exec {shlex.quote(sys.executable)} -m problems.cli inspect a.csv {redirection}"
    run = subprocess.run(["sh", "-c", line], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert run.returncode == code
    assert printed in run.stdout and "Traceback" not in run.stderr
    assert run.stderr == (
        "ancf-casadi: the result cannot be printed (standard output is closed)\n" * (stream == "output")
    )


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp1252"])
def test_characters_that_a_terminal_lacks_are_escaped(tmp_path, encoding):
    (tmp_path / "ünï³→.csv").write_text("time_s,ä→\n0,1\n1,2\n2,1\n", encoding="utf-8")
    command = [sys.executable, "-m", "problems.cli", "inspect", "ünï³→.csv"]
    environment = os.environ | {"PYTHONIOENCODING": encoding}
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, check=False, env=environment)
    assert run.returncode == 0 and not run.stderr
    assert "\\u2192" in run.stdout.decode(encoding)
