"""Compiled functions: the same numbers, found again, and done without where there is no compiler."""

import shutil

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import Beam, Model, RayleighDamping, simulate, static_equilibrium
from ancf_casadi.compilation import cache_folder, compiled, interpreted

needs_compiler = pytest.mark.skipif(not (shutil.which("cc") or shutil.which("gcc")), reason="no C compiler")


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("ANCF_CASADI_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("ANCF_CASADI_COMPILE", raising=False)
    return tmp_path / "cache"


def a_function(factor=2.0):
    x, p = cs.MX.sym("x", 3), cs.MX.sym("p")
    return cs.Function("product", [x, p], [factor * p * cs.sin(x) * x[0]], {"is_diff_in": [True, False]})


@needs_compiler
class TestWithACompiler:
    def test_function_and_jacobian_are_those_of_the_virtual_machine(self):
        function, x = a_function(), np.array([0.3, -1.2, 2.0])
        for value in (compiled(function), interpreted(function)):
            assert value(x, 1.5).full().ravel() == pytest.approx(3.0 * np.sin(x) * x[0], rel=1e-15)
            slope = value.jacobian()(x, 1.5, 0.0)[0].full()
            expected = 3.0 * (np.diag(np.cos(x)) * x[0] + np.outer(np.sin(x), [1.0, 0.0, 0.0]))
            assert slope == pytest.approx(expected, rel=1e-14)

    def test_a_compiled_function_is_found_again_and_another_compiled_anew(self, cache):
        compiled(a_function())
        files = {path: path.stat().st_mtime_ns for path in cache.iterdir()}
        compiled(a_function())
        assert {path: path.stat().st_mtime_ns for path in cache.iterdir()} == files
        compiled(a_function(3.0))
        assert len(list(cache.iterdir())) == len(files) + 1

    def test_beams_of_one_mesh_share_a_program(self, cache):
        """Properties, gravity and coefficients are inputs: only the mesh and the kind of law are compiled in."""
        for changes in ({}, {"thickness": 0.6e-3, "elastic_modulus": 70e9, "gravity": (0.0, 0.0)}):
            beam = Beam.uniform(
                **{"length": 0.5, "width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elastic_modulus": 210e9}
                | changes,
                elements=2,
            )
            law = RayleighDamping(alpha=1.0 + len(changes))
            simulate(Model(beam), damping=law, duration=1.0, sample_rate=10.0)
            assert len(list(cache.iterdir())) == 2

    def test_a_compiled_motion_is_the_interpreted_one(self, monkeypatch):
        model = Model(
            Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8e3, elastic_modulus=2.1e11, elements=4)
        )
        start = static_equilibrium(model, tip_force=(0.05, 0.0))
        law = RayleighDamping(alpha=0.5, beta=1e-4)
        with_compiler = simulate(model, damping=law, start=start, duration=1.0)
        monkeypatch.setenv("ANCF_CASADI_COMPILE", "0")
        without = simulate(model, damping=law, start=start, duration=1.0)
        assert with_compiler.tip == pytest.approx(without.tip, abs=1e-5)
        assert np.ptp(without.tip[:, 0]) > 0.05


def test_without_a_compiler_the_virtual_machine_serves(monkeypatch, cache):
    for name, value in (("CC", "no-such-compiler"), ("ANCF_CASADI_COMPILE", "0")):
        monkeypatch.setenv(name, value)
        assert compiled(a_function())(1.0, 1.0).full()[0, 0] == pytest.approx(2 * np.sin(1.0))
        assert not list(cache.glob("*.so"))


def test_the_cache_is_a_folder_of_the_user(monkeypatch, tmp_path):
    monkeypatch.delenv("ANCF_CASADI_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "ancf-casadi"


def test_drafts_of_a_compiler_that_is_stopped_go_with_its_folder(tmp_path, monkeypatch, cache):
    """They stayed in the folder of temporary files."""
    (tmp_path / "cc").write_text('#!/bin/sh\ntouch "$TMPDIR/draft.s"\nexit 1\n')
    (tmp_path / "cc").chmod(0o755)
    (tmp_path / "temporary").mkdir()
    monkeypatch.setenv("CC", str(tmp_path / "cc"))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    assert compiled(a_function())([1.0, 2.0, 3.0], 1.0).numel() == 3
    assert not [*cache.iterdir(), *(tmp_path / "temporary").iterdir()]
