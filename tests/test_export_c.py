"""The C program against Python, and what has no C."""

import ctypes
import shutil
import subprocess

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import (
    InputError,
    Model,
    QuadraticDamping,
    RayleighDamping,
    State,
    motion,
    simulate,
    static_equilibrium,
)
from ancf_casadi.export import beam_functions, values, write_c
from ancf_casadi.export.c import DECAY_EVERY, DECAY_STEP, DECAY_STEPS

LAW = RayleighDamping(alpha=0.5, beta=3e-5) + QuadraticDamping(eta2=0.2)
STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O2", "-fPIC")

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc")


@pytest.fixture(scope="module")
def model(paper_beam):
    return Model(paper_beam(2))


@pytest.fixture(scope="module")
def functions(model):
    return beam_functions(model, LAW, markers=(0.2,), modes=2)


@pytest.fixture(scope="module")
def folder(functions, tmp_path_factory):
    """The C compiled to a library and a program."""
    folder = tmp_path_factory.mktemp("c")
    write_c(functions, folder, name="strip")
    for command in (
        ("gcc", *STRICT, "-c", "strip.c"),
        ("gcc", "-shared", "strip.o", "-o", "strip.so", "-lm"),
        ("gcc", *STRICT, "main.c", "strip.o", "-o", "decay", "-lm"),
    ):
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    return folder


@needs_gcc
def test_every_function_gives_the_numbers_of_python(functions, folder):
    library = ctypes.CDLL(str(folder / "strip.so"))
    random = np.random.default_rng(3)
    n, p = functions.free, values(functions.parameters) * 1.01
    given = {
        "q": values(functions.states)[:n] + 1e-5 * random.normal(size=n),
        "v": 0.1 * random.normal(size=n),
        "a": random.normal(size=n),
        "base": 0.01 * random.normal(size=9),
        "p": p,
        "h": np.array([1e-3]),
    }
    for function in functions.functions:
        inputs = [given[name].ravel() for name in function.name_in()]
        if function.name() == "step":
            inputs[2] = 1e-3 * random.normal(size=18)
        shaped = [cs.reshape(cs.DM(x), *function.size_in(k)) for k, x in enumerate(inputs)]
        expected = function(*shaped)
        outputs = [np.full(function.nnz_out(k), np.nan) for k in range(function.n_out())]
        pointers = [x.ctypes.data_as(ctypes.c_void_p) for x in (*inputs, *outputs)]
        assert getattr(library, f"strip_{function.name()}")(*pointers) == 0
        for found, value in zip(outputs, expected if isinstance(expected, tuple) else (expected,), strict=True):
            entries = np.array(value.nonzeros())
            assert np.isfinite(entries).all()
            scale = np.abs(entries).max(initial=0.0)
            np.testing.assert_allclose(found, entries, rtol=1e-12, atol=1e-12 * scale, err_msg=function.name())


@needs_gcc
def test_the_program_integrates_the_decay_that_simulate_finds(model, functions, folder):
    done = subprocess.run([folder / "decay"], capture_output=True, text=True, check=True)
    lines = done.stdout.splitlines()
    rows = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    assert lines[0].startswith("time_s,tip_x_m,tip_y_m")
    assert len(rows) == DECAY_STEPS // DECAY_EVERY + 1
    pull = [float(x) for x in (folder / "main.c").read_text().split("pull[2] = {")[1].split("}")[0].split(",")]
    aside = Model(model.beam.with_(gravity=tuple(np.add(model.beam.gravity, pull))))
    start = static_equilibrium(aside).coordinates
    rate = 1 / (DECAY_STEP * DECAY_EVERY)
    run = simulate(
        model, damping=LAW, start=State(start, 0 * start), duration=rows[-1, 0], sample_rate=rate, method="radau"
    )
    swing = np.ptp(run.tip[:, 0])
    assert swing > 0.05
    assert np.ptp(run.tip[-100:, 0]) < 0.9 * swing
    np.testing.assert_allclose(rows[:, 1:3], run.tip, atol=1e-3 * swing)


@needs_gcc
def test_the_tables_of_the_header_are_those_of_the_model(functions, folder):
    library = ctypes.CDLL(str(folder / "strip.so"))
    for name, signals in (("strip_parameters", functions.parameters), ("strip_rest", functions.states)):
        table = np.array((ctypes.c_double * len(signals)).in_dll(library, name))
        np.testing.assert_array_equal(table, values(signals))
    header = (folder / "strip.h").read_text()
    for signal in (*functions.parameters, *functions.states, *functions.base, *functions.outputs):
        assert f"{signal.name} " in header and signal.description in header
    source = (folder / "strip.c").read_text()
    assert not any(word in source for word in ("malloc(", "calloc(", "casadi_checkout("))


def test_what_contains_an_integrator_is_refused(model, functions, tmp_path, capfd):
    x, theta = cs.MX.sym("x"), cs.MX.sym("theta", 3)
    integrator = cs.integrator("through_time", "cvodes", {"x": x, "ode": -x}, 0.0, 1.0)
    moved = motion(model, duration=0.01, damping=LAW)(theta, cs.MX(0, 1), model.properties)
    for name, function in (
        ("decays", cs.Function("decays", [x], [integrator(x0=x)["xf"]])),
        ("moves", cs.Function("moves", [theta], [moved[-1]])),
    ):
        with pytest.raises(InputError, match="there is no C") as caught:
            write_c(functions, tmp_path / "c", also=[function])
        assert caught.value.where == name
        assert "\n" not in str(caught.value)
    assert not (tmp_path / "c").exists()
    assert capfd.readouterr() == ("", "")


def test_files_of_others_are_not_touched(functions, tmp_path):
    (tmp_path / "main.c").write_text("int main(void) { return 0; }\n")
    with pytest.raises(InputError, match="is there already"):
        write_c(functions, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["main.c"]
    (tmp_path / "main.c").unlink()
    (tmp_path / "main.c").mkdir()
    with pytest.raises(InputError, match="is there already"):
        write_c(functions, tmp_path)
    (tmp_path / "main.c").rmdir()
    first = [path.read_bytes() for path in write_c(functions, tmp_path)]
    assert first == [path.read_bytes() for path in write_c(functions, tmp_path)]


@pytest.mark.parametrize("name", ["main", "2beam", "Beam", "a__b", "../beam", ""])
def test_names_that_are_none_in_c_are_refused(functions, tmp_path, name):
    with pytest.raises(InputError, match="name: must be"):
        write_c(functions, tmp_path, name=name)
    assert not list(tmp_path.iterdir())
