"""Compiled functions: same digits, one program for all beams, a safe cache, and runs without a compiler."""

import os
import pwd
import shutil
import signal
import subprocess
import sys
import time
import warnings
from importlib.machinery import ModuleSpec
from pathlib import Path

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    ModalDamping,
    Model,
    QuadraticDamping,
    RayleighDamping,
    motion,
    natural_modes,
    simulate,
    static_equilibrium,
)
from ancf_casadi.support import compilation
from ancf_casadi.support.compilation import (
    c_compiler,
    cache_folder,
    compile_function,
    compile_together,
    expand_function,
)

needs_compiler = pytest.mark.skipif(not (shutil.which("cc") or shutil.which("gcc")), reason="no C compiler")
X = np.array([0.3, -1.2, 2.0])
LAWS = {
    "rayleigh": lambda model: RayleighDamping(alpha=0.5, beta=1e-4),
    "quadratic": lambda model: QuadraticDamping(eta1=0.5, eta2=1.0),
    "modal": lambda model: ModalDamping(natural_modes(model, count=2), (0.01, 0.02)),
}


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("ANCF_CASADI_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("ANCF_CASADI_COMPILE", raising=False)
    monkeypatch.setattr(compilation, "_failed", set())
    return tmp_path / "cache"


def a_function(factor=2.0):
    x, p = cs.MX.sym("x", 3), cs.MX.sym("p")
    return cs.Function("product", [x, p], [factor * p * cs.sin(x) * x[0]], {"is_diff_in": [True, False]})


def is_right(function, factor=2.0):
    return function(X, 1.5).full().ravel() == pytest.approx(factor * 1.5 * np.sin(X) * X[0], rel=1e-15)


def a_beam(elements=4, **changes):
    steel = {"length": 0.5, "width": 5e-3, "thickness": 0.5e-3, "density": 8e3, "elastic_modulus": 2.1e11}
    return Beam.uniform(**steel | changes, elements=elements)


def fake_compiler(folder, script):
    path = folder / "compiler"
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    return str(path)


@needs_compiler
class TestWithACompiler:
    def test_a_function_and_its_derivatives_are_those_of_the_virtual_machine(self):
        function, seed = a_function(), np.array([1.0, -2.0, 0.5])
        slope = 3.0 * (np.diag(np.cos(X)) * X[0] + np.outer(np.sin(X), [1.0, 0.0, 0.0]))
        for value in (*compile_together([function], derivatives=True), expand_function(function)):
            assert is_right(value)
            assert value.forward(1)(X, 1.5, 0.0, seed, 0.0).full().ravel() == pytest.approx(slope @ seed, rel=1e-14)
            assert value.reverse(1)(X, 1.5, 0.0, seed)[0].full().ravel() == pytest.approx(slope.T @ seed, rel=1e-14)

    def test_a_compiled_function_tells_which_outputs_depend_on_which_inputs(self):
        x = cs.MX.sym("x", 3)
        function = compile_function(cs.Function("squares", [x], [x**2, x[0]]))
        assert function.jac_sparsity(0, 0) == cs.Sparsity.diag(3)
        assert function.jac_sparsity(1, 0).nnz() == 1

    def test_a_compiled_function_is_found_again_and_another_compiled_anew(self, cache):
        compile_function(a_function())
        files = {path: path.stat().st_mtime_ns for path in cache.iterdir()}
        compile_function(a_function())
        assert {path: path.stat().st_mtime_ns for path in cache.iterdir()} == files
        compile_function(a_function(3.0))
        assert len(list(cache.iterdir())) == len(files) + 1

    def test_derivatives_need_no_further_library_of_a_function_that_has_none(self, cache):
        """A fit takes the passes that a simulation has compiled."""
        x = cs.MX.sym("x")
        for derivatives in (False, True):
            compile_together([cs.Function("square", [x], [x**2], {"is_diff_in": [False]})], derivatives=derivatives)
        assert len(list(cache.glob("square-*.so"))) == 1

    def test_the_compiler_may_be_named_with_options(self, cache, monkeypatch):
        """``CC`` may hold options, as in ``CC="gcc -O1"``."""
        monkeypatch.setenv("CC", f"{shutil.which('gcc') or shutil.which('cc')} -O1 -DSOME='a b'")
        assert is_right(compile_function(a_function()))
        assert len(list(cache.glob("product-*.so"))) == 1

    @pytest.mark.slow
    @pytest.mark.parametrize("method", ["idas", "radau"])
    def test_all_meshes_and_all_beams_share_their_programs(self, cache, method):
        """Mesh, properties, gravity, axis, coefficients and lumped parts are inputs; only the kind of law is not."""
        compiled_files = []
        for changes in (
            {"elements": 10},
            {"elements": 30},
            {"elements": 3, "length": 0.3, "thickness": 0.6e-3, "elastic_modulus": 7e10},
            {"elements": 10, "gravity": (0.0, 0.0), "axis": (0.6, 0.8)},
            {"elements": 10, "tip_mass": 1e-3, "clamp_stiffness": 2.0},
        ):
            law = RayleighDamping(alpha=1.0 + len(compiled_files), beta=1e-4)
            simulate(Model(a_beam(**changes)), damping=law, duration=0.01, sample_rate=200.0, method=method)
            compiled_files.append(sorted(path.name for path in cache.iterdir()))
        assert compiled_files[0] and compiled_files == [compiled_files[0]] * 5

    @pytest.mark.slow
    @pytest.mark.parametrize(("method", "law"), [("idas", "modal"), *(("radau", law) for law in LAWS)])
    def test_a_compiled_motion_is_the_interpreted_one_to_the_last_digit(self, monkeypatch, method, law):
        model = Model(a_beam(3))
        start = static_equilibrium(model, tip_force=(0.05, 0.0))
        settings = {"damping": LAWS[law](model), "start": start, "duration": 0.1, "method": method, "tolerance": 1e-6}
        with_compiler = simulate(model, **settings)
        monkeypatch.setenv("ANCF_CASADI_COMPILE", "0")
        without = simulate(model, **settings)
        np.testing.assert_array_equal(with_compiler.coordinates, without.coordinates)
        np.testing.assert_array_equal(with_compiler.dissipated_energy, without.dissipated_energy)
        assert np.ptp(without.tip[:, 0]) > 1e-2

    @pytest.mark.slow
    def test_compiled_derivatives_of_a_motion_are_the_interpreted_ones(self, monkeypatch):
        model = Model(a_beam(2))
        law, start = RayleighDamping(alpha=0.5, beta=1e-4), static_equilibrium(model, tip_force=(0.02, 0.0))

        def slopes():
            function = motion(model, damping=law, start=start, duration=0.1, sample_rate=40.0)
            theta, properties = cs.MX.sym("theta", 2), cs.MX.sym("P", 4, 2)
            tip = cs.vec(function(theta, [], properties)[-4:-2, :])
            weights = cs.DM(np.arange(1.0, tip.numel() + 1))
            forward, reverse = cs.jacobian(tip, theta), cs.gradient(cs.dot(weights, tip), properties)
            values = cs.Function("slopes", [theta, properties], [forward, reverse])([0.5, 1e-4], model.properties)
            return [value.full() for value in values]

        with_compiler = slopes()
        monkeypatch.setenv("ANCF_CASADI_COMPILE", "0")
        for got, expected in zip(with_compiler, slopes(), strict=True):
            np.testing.assert_allclose(got, expected, rtol=1e-11, atol=1e-11 * abs(expected).max())
            assert abs(got).max() > 1e-4


@needs_compiler
class TestCache:
    @pytest.mark.parametrize(
        "damage",
        [lambda data: b"", lambda data: data[: len(data) // 3], lambda data: data[:-1] + b"x", lambda data: b"x" * 99],
        ids=["empty", "truncated", "changed", "nonsense"],
    )
    def test_a_damaged_library_is_built_anew(self, cache, damage):
        compile_function(a_function())
        (library,) = cache.glob("*.so")
        whole = library.read_bytes()
        library.unlink()
        library.write_bytes(damage(whole))
        library.chmod(0o700)
        assert is_right(compile_function(a_function()))
        assert [path.read_bytes() for path in cache.glob("*.so")] == [whole]

    @pytest.mark.parametrize("mode", [0o770, 0o707])
    def test_a_library_in_a_folder_that_others_can_write_does_not_run(self, cache, mode):
        """A library whose contents differ from the digest in its name is not loaded."""
        for factor in (2.0, 3.0):
            compile_function(a_function(factor))
        two, three = (next(p for p in cache.iterdir() if _factor(p) == factor) for factor in (2.0, 3.0))
        stem, digest = two.name.rsplit("-", 1)[0], three.name.rsplit("-", 1)[1]
        os.replace(three, cache / f"{stem}-{digest}")
        two.unlink()
        assert is_right(compile_function(a_function()), factor=3.0)  # what an intruder could do
        cache.chmod(mode)
        with pytest.warns(UserWarning, match=r"cache can be written by others \(chmod go-w\)"):
            assert is_right(compile_function(a_function()))
        assert len(list(cache.iterdir())) == 1
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert is_right(compile_function(a_function(4.0)), factor=4.0)  # said once

    def test_nor_one_below_a_folder_that_others_can_write(self, tmp_path, monkeypatch):
        (tmp_path / "open").mkdir()
        (tmp_path / "open").chmod(0o777)
        monkeypatch.setenv("ANCF_CASADI_CACHE", str(tmp_path / "open" / "cache"))
        with pytest.warns(UserWarning, match="open can be written by others"):
            assert is_right(compile_function(a_function()))
        assert not list((tmp_path / "open" / "cache").iterdir())

    def test_nor_one_in_the_folder_of_another_user(self, cache, monkeypatch):
        compile_function(a_function())
        monkeypatch.setattr(os, "geteuid", lambda: 12345)
        with pytest.warns(UserWarning, match="cache belongs to another user"):
            assert is_right(compile_function(a_function()))

    def test_nor_one_that_others_can_write_itself(self, cache):
        compile_function(a_function())
        (library,) = cache.iterdir()
        library.chmod(0o777)
        assert is_right(compile_function(a_function()))
        assert [path.stat().st_mode & 0o777 for path in cache.iterdir()] == [0o700]

    def test_a_user_without_a_home(self, monkeypatch, tmp_path):
        """Without a home, ``Path.home()`` raises RuntimeError."""

        def nobody(_):
            raise KeyError

        for name in ("ANCF_CASADI_CACHE", "XDG_CACHE_HOME", "HOME"):
            monkeypatch.delenv(name, raising=False)
        monkeypatch.setattr(pwd, "getpwuid", nobody)
        compilation._private_folder.cache_clear()
        with pytest.warns(UserWarning, match="there is no home folder; set ANCF_CASADI_CACHE"):
            assert is_right(compile_function(a_function()))
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
        assert cache_folder() == tmp_path / "ancf-casadi"

    def test_a_cache_that_is_a_file(self, cache):
        cache.write_text("")
        with pytest.warns(UserWarning, match="cache: File exists"):
            assert is_right(compile_function(a_function()))

    def test_drafts_of_killed_compilers_are_removed(self, cache):
        """The next compilation removes what a killed one left."""
        cache.mkdir(mode=0o700)
        for name, age in (("tmpold", 3600.0), ("tmpnew", 1.0)):
            (cache / name).mkdir()
            (cache / name / "source.c").write_text("")
            os.utime(cache / name, (time.time() - age,) * 2)
        compile_function(a_function())
        assert [path.name for path in cache.iterdir() if path.is_dir()] == ["tmpnew"]


def _factor(library):
    return float(cs.external("product", str(library))(np.pi / 2, 1.0)[0] / (np.pi / 2))


class TestUnusableLibraries:
    """A library that cannot be loaded is not kept, and the virtual machine runs the Function, with one warning."""

    @pytest.mark.parametrize(
        ("script", "reason"),
        [
            ("exit 0", "cannot be loaded"),
            ("for last; do :; done; echo text > {library}", "cannot be loaded"),
            ("gcc -c {arguments}", "cannot be loaded"),
            ("gcc {arguments}; truncate -s 4200 {library}", "cannot be loaded|ends the process"),
        ],
        ids=["writes nothing", "writes text", "only compiles", "truncated"],
    )
    def test_a_library_that_cannot_be_loaded_is_not_kept(self, cache, monkeypatch, tmp_path, script, reason):
        library = '"$(echo "$*" | sed "s/.* -o //; s/ -lm//")"'
        script = script.format(library=library, arguments='"$@"')
        if "gcc" in script and not shutil.which("gcc"):
            pytest.skip("no gcc")
        monkeypatch.setenv("CC", fake_compiler(tmp_path, script))
        with pytest.warns(UserWarning, match=f"fails: .*({reason}).*uncompiled"):
            assert is_right(compile_function(a_function()))
        assert not list(cache.iterdir())

    @needs_compiler
    def test_a_folder_in_place_of_a_library_is_replaced(self, cache):
        compile_function(a_function())
        (library,) = cache.iterdir()
        library.unlink()
        (library / "more").mkdir(parents=True)
        assert is_right(compile_function(a_function()))
        assert library.is_file()

    @needs_compiler
    def test_a_library_that_vanishes_after_its_check_is_done_without(self, cache, monkeypatch):
        monkeypatch.setattr(compilation, "_kept", lambda folder, stem: folder / "gone.so")
        with pytest.warns(UserWarning, match=r"gone\.so cannot be loaded; .*uncompiled"):
            assert is_right(compile_function(a_function()))

    @pytest.mark.parametrize("command", ["no-such-compiler -O1", '"x', "\\"], ids=["missing", "quotation", "backslash"])
    def test_a_command_that_cannot_be_run_is_told_of(self, cache, monkeypatch, command):
        monkeypatch.setenv("CC", command)
        with pytest.warns(UserWarning, match="No such file"):
            assert is_right(compile_function(a_function()))


class TestEnding:
    """A compiler and its own processes end at once with the work that asked for it."""

    CODE = (
        "import casadi as cs; from ancf_casadi.support.compilation import compile_function; {context}; "
        "x = cs.MX.sym('x'); print('begin', flush=True); compile_function(cs.Function('f', [x], [x**2]))"
    )
    NOTED = "from ancf_casadi.support.interrupts import delayed_interrupts as d; c = d(); c.__enter__()"

    @pytest.mark.parametrize(
        ("number", "context"),
        [(signal.SIGINT, "pass"), (signal.SIGINT, NOTED), (signal.SIGTERM, "pass"), (signal.SIGKILL, "pass")],
        ids=["interrupt", "noted interrupt", "end", "kill"],
    )
    def test_a_signal_ends_a_compiler_that_hangs(self, cache, monkeypatch, tmp_path, number, context):
        script = f'echo $$ >> {tmp_path}/pids; sh -c "echo \\$\\$ >> {tmp_path}/pids; sleep 60"; exit 1'
        monkeypatch.setenv("CC", fake_compiler(tmp_path, script))
        code = self.CODE.format(context=context)
        with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            deadline = time.monotonic() + 30
            while len(pids := _numbers(tmp_path / "pids")) < 2 and time.monotonic() < deadline:
                time.sleep(0.02)
            process.send_signal(number)
            sent = time.monotonic()
            process.wait(10)
        assert time.monotonic() - sent < 2.0
        assert len(pids) == 2
        while any(map(_is_alive, pids)) and time.monotonic() < sent + 2:
            time.sleep(0.02)
        assert not any(map(_is_alive, pids))


def _numbers(path):
    return [int(line) for line in path.read_text().split()] if path.exists() else []


def _is_alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return "State:\tZ" not in Path(f"/proc/{pid}/status").read_text()


class TestWithoutACompiler:
    def test_compilation_can_be_turned_off(self, cache, monkeypatch):
        monkeypatch.setenv("ANCF_CASADI_COMPILE", "0")
        monkeypatch.setenv("CC", "no-such-compiler")
        assert is_right(compile_function(a_function()))
        assert not cache.exists()

    @pytest.mark.parametrize(
        ("script", "said"),
        [("echo 'source.c:1: error: no' >&2; exit 1", "source.c:1: error: no"), ("exit 3", "exit code 3")],
    )
    def test_a_compiler_that_fails_is_told_of_once_and_not_tried_again(
        self, cache, monkeypatch, tmp_path, script, said
    ):
        command = fake_compiler(tmp_path, f"echo x >> {tmp_path}/calls; {script}")
        monkeypatch.setenv("CC", command)
        with pytest.warns(UserWarning, match=f"{command} fails: {said}; .*pip install ziglang") as caught:
            for factor in (2.0, 3.0, 4.0):
                assert is_right(compile_function(a_function(factor)), factor)
        assert len(caught) == 1
        assert (tmp_path / "calls").read_text().split() == ["x"]
        assert not list(cache.iterdir())

    @pytest.mark.slow
    def test_that_there_is_none_is_told_once_in_a_process(self, cache):
        code = (
            "import casadi as cs; from ancf_casadi import *; "
            "model = Model(Beam.uniform(length=0.5, width=5e-3, thickness=5e-4, density=8e3, elastic_modulus=2.1e11, "
            "elements=3)); [simulate(model, duration=0.01, sample_rate=200.0, method=m) for m in ('idas', 'radau')]"
        )
        environment = {**os.environ, "PATH": "/nonexistent"}
        environment.pop("CC", None)
        blocked = f"import sys; sys.modules['ziglang'] = None; {code}"
        done = subprocess.run(
            [sys.executable, "-c", blocked], env=environment, capture_output=True, text=True, timeout=60
        )
        assert done.returncode == 0, done.stderr
        assert done.stderr.count("UserWarning") == 1
        assert "no C compiler was found" in done.stderr and "pip install ziglang" in done.stderr

    def test_ziglang_serves_if_there_is_no_other(self, monkeypatch):
        monkeypatch.delenv("CC", raising=False)
        monkeypatch.setenv("PATH", "/nonexistent")
        monkeypatch.setattr(compilation.importlib.util, "find_spec", lambda name: ModuleSpec(name, None))
        assert c_compiler() == (sys.executable, "-m", "ziglang", "cc")
        monkeypatch.setattr(compilation.importlib.util, "find_spec", lambda name: None)
        assert c_compiler() == ()

    def test_ziglang_compiles(self, cache, monkeypatch):
        pytest.importorskip("ziglang")
        monkeypatch.delenv("CC", raising=False)
        monkeypatch.setenv("PATH", "/nonexistent")
        assert is_right(compile_function(a_function()))
        assert len(list(cache.glob("product-*.so"))) == 1

    def test_drafts_of_a_compiler_that_is_stopped_go_with_its_folder(self, tmp_path, monkeypatch, cache):
        """Drafts go with the compiler that wrote them."""
        monkeypatch.setenv("CC", fake_compiler(tmp_path, 'touch "$TMPDIR/draft.s"; exit 1'))
        (tmp_path / "temporary").mkdir()
        monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
        with pytest.warns(UserWarning, match="exit code 1"):
            assert is_right(compile_function(a_function()))
        assert not [*cache.iterdir(), *(tmp_path / "temporary").iterdir()]
