"""The exported C against Python, and refusals of Functions without C code."""

import ctypes
import os
import re
import shutil
import subprocess

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import (
    Clamp,
    InputError,
    Model,
    Pin,
    QuadraticDamping,
    RayleighDamping,
    State,
    motion,
    reduce_model,
    simulate,
    simulate_reduced,
    static_equilibrium,
)
from ancf_casadi.export import beam_functions, values, write_c
from ancf_casadi.export.c import PROGRAM_SAMPLES, PROGRAM_STEP

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
def reduced(paper_beam):
    return reduce_model(Model(paper_beam(8)), modes=3, damping=LAW, markers=(0.2,))


def compile_c(functions, folder, also=()):
    """Write the C code, and compile it to a library and a program."""
    write_c(functions, folder, name="strip", also=also)
    for command in (
        ("gcc", *STRICT, "-c", "strip.c"),
        ("gcc", "-shared", "strip.o", "-o", "strip.so", "-lm"),
        ("gcc", *STRICT, "main.c", "strip.o", "-o", "decay", "-lm"),
    ):
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def folder(functions, reduced, tmp_path_factory):
    """The full model in C, and the reduced one with it."""
    return compile_c(functions, tmp_path_factory.mktemp("c"), also=reduced.functions)


@pytest.fixture(scope="module")
def small_folder(reduced, tmp_path_factory):
    """The reduced model in C."""
    return compile_c(reduced, tmp_path_factory.mktemp("c"))


def check_numbers(folder, functions, called, size):
    """Compare each Function of a model with its C code, in a state whose distance from rest is ``size``."""
    library = ctypes.CDLL(str(folder / "strip.so"))
    random = np.random.default_rng(3)
    n, p = functions.free, values(functions.parameters) * 1.01
    given = {
        "q": values(functions.states)[:n] + size * random.normal(size=n),
        "v": 0.1 * random.normal(size=n),
        "a": random.normal(size=n),
        "p": p,
        "h": np.array([1e-3]),
    }
    for name, function in functions.named.items():
        if "base" in function.name_in():
            given["base"] = 0.01 * random.normal(size=function.numel_in("base"))
        inputs = [np.ascontiguousarray(given[name]) for name in function.name_in()]
        shaped = [cs.reshape(cs.DM(x), *function.size_in(k)) for k, x in enumerate(inputs)]
        outputs = [np.full(function.nnz_out(k), np.nan) for k in range(function.n_out())]
        pointers = [x.ctypes.data_as(ctypes.c_void_p) for x in (*inputs, *outputs)]
        assert getattr(library, f"strip_{called}{name}")(*pointers) == 0
        for found, value in zip(outputs, function.call(shaped), strict=True):
            entries = np.array(value.nonzeros())
            assert np.isfinite(entries).all()
            scale = np.abs(entries).max(initial=0.0)
            np.testing.assert_allclose(found, entries, rtol=1e-12, atol=1e-12 * scale, err_msg=name)


@pytest.mark.slow
@needs_gcc
def test_every_function_agrees_with_python(functions, folder):
    check_numbers(folder, functions, "", 1e-5)


@pytest.mark.slow
@needs_gcc
def test_every_function_of_the_reduced_model_agrees_alone_and_beside_the_full_one(reduced, folder, small_folder):
    check_numbers(small_folder, reduced, "", 1e-3)
    check_numbers(folder, reduced, "reduced_", 1e-3)


def decay(folder):
    """Run the program and return its rows."""
    done = subprocess.run([folder / "decay"], capture_output=True, text=True, check=True)
    lines = done.stdout.splitlines()
    assert lines[0].startswith("time_s,tip_x_m,tip_y_m")
    rows = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    np.testing.assert_allclose(rows[:, 0], np.arange(PROGRAM_SAMPLES + 1) * PROGRAM_STEP, rtol=1e-12)
    assert np.ptp(rows[-100:, 1]) < 0.9 * np.ptp(rows[:, 1])
    return rows


@pytest.mark.slow
@needs_gcc
def test_the_program_agrees_with_simulate(model, functions, folder):
    rows = decay(folder)
    pull = [float(x) for x in (folder / "main.c").read_text().split("pull[2] = {")[1].split("}")[0].split(",")]
    aside = Model(model.beam.with_(gravity=tuple(np.add(model.beam.gravity, pull))))
    start = static_equilibrium(aside).coordinates
    run = simulate(
        model, damping=LAW, start=State(start, 0 * start), duration=2.0, sample_rate=1 / PROGRAM_STEP, method="radau"
    )
    swing = np.ptp(run.tip[:, 0])
    assert swing > 0.05
    np.testing.assert_allclose(rows[:, 1:3], run.tip, atol=1e-3 * swing)


@pytest.mark.slow
@needs_gcc
def test_the_program_of_the_reduced_model_agrees_with_both_models(reduced, small_folder):
    """The rows agree with ``simulate_reduced`` to rounding, and with the full beam to the error of the reduction."""
    rows = decay(small_folder)
    bend = float((small_folder / "main.c").read_text().split("q[0] = ")[1].split(";")[0])
    q, still = np.array([bend, 0.0, 0.0]), np.zeros(9)
    start = State(*(part.full().ravel() for part in reduced.coordinates(q, np.zeros(3), still)))
    settings = {"start": start, "duration": 2.0, "sample_rate": 1 / PROGRAM_STEP}
    run = simulate_reduced(reduced, **settings)
    swing = np.ptp(run.tip[:, 0])
    assert swing == pytest.approx(0.2 * 0.5, rel=0.05)
    np.testing.assert_allclose(rows[:, 1:3], run.tip, atol=1e-10 * swing)
    np.testing.assert_allclose(rows[:, 3:], run.energy, atol=1e-10 * np.ptp(run.energy[:, 0]))
    full = simulate(reduced.model, damping=LAW, method="radau", **settings)
    np.testing.assert_allclose(rows[:, 1:3], full.tip, atol=2e-4 * swing)


@pytest.mark.slow
@needs_gcc
@pytest.mark.parametrize("which", [("functions", "folder"), ("reduced", "small_folder")], ids=["full", "reduced"])
def test_the_tables_of_the_header_agree_with_the_model(request, which):
    functions, folder = map(request.getfixturevalue, which)
    library = ctypes.CDLL(str(folder / "strip.so"))
    for name, signals in (("strip_parameters", functions.parameters), ("strip_rest", functions.states)):
        table = np.array((ctypes.c_double * len(signals)).in_dll(library, name))
        np.testing.assert_array_equal(table, values(signals))
    header = (folder / "strip.h").read_text()
    for signal in (*functions.parameters, *functions.states, *functions.base, *functions.outputs):
        assert f"{signal.name} " in header and f" {signal.unit} " in header and signal.description in header
    source = (folder / "strip.c").read_text()
    assert not any(word in source for word in ("malloc(", "calloc(", "casadi_checkout("))


def test_two_functions_with_the_same_name_are_refused(functions, reduced, tmp_path):
    with pytest.raises(InputError, match="rhs: is the name of another Function"):
        write_c(functions, tmp_path, also=[*reduced.functions, cs.Function("rhs", [], [1.0])])
    assert not list(tmp_path.iterdir())


X = cs.SX.sym("x")


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (cs.Function("rest", [X], [X]), "rest: is the name of another Function or table"),
        (cs.Function("rhs_raw", [X], [X]), "rhs_raw: is the name of another Function or table"),
        (cs.Function("own", [X], [X], ["w"], ["y"]), "own: w is a reserved name in C"),
        (cs.Function("own", [X], [X], ["x"], ["double"]), "own: double is a reserved name in C"),
        (cs.Function("own", [X], [X * cs.SX.sym("k")], {"allow_free": True}), "own: depends on k, which"),
    ],
)
def test_functions_that_would_not_compile_are_refused(functions, tmp_path, function, message):
    with pytest.raises(InputError, match=f"^{message}"):
        write_c(functions, tmp_path, also=[function])
    assert not list(tmp_path.iterdir())


def test_an_interrupted_export_leaves_no_files(functions, tmp_path, monkeypatch):
    def interrupted(draft, mode):
        if ".main.c-" in draft:
            raise KeyboardInterrupt

    monkeypatch.setattr(os, "chmod", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_c(functions, tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_function_with_an_integrator_is_refused(model, functions, tmp_path, capfd):
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


@pytest.mark.parametrize("supports", [(), (Pin(0.0),)])
def test_a_beam_that_can_move_rigidly_has_no_rest_no_frequencies_and_no_program(paper_beam, tmp_path, capfd, supports):
    free = beam_functions(Model(paper_beam(2, supports=supports, gravity=(0.0, 0.0))), modes=5)
    for function in (free.equilibrium, free.frequencies):
        assert np.isnan(function(values(free.parameters)).full()).all()
    with pytest.raises(InputError, match=r"^functions: can move rigidly"):
        write_c(free, tmp_path)
    assert not list(tmp_path.iterdir())
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    "make", [lambda model: beam_functions(model, modes=1), lambda model: reduce_model(model, modes=1)]
)
def test_a_beam_away_from_the_origin_is_released_from_the_same_deflection(paper_beam, tmp_path, make):
    programs = []
    for displacement in ((0.0, 0.0), (3.0, -4.0)):
        write_c(make(Model(paper_beam(2, supports=(Clamp(displacement=displacement),)))), tmp_path)
        numbers = re.search(r"(?:pull.2. = .|q.0. = )([^;}]*)", (tmp_path / "main.c").read_text())
        programs.append([float(number) for number in numbers[1].split(",")])
    np.testing.assert_allclose(*programs, rtol=1e-6, atol=1e-9)


@pytest.mark.slow
def test_foreign_files_are_not_overwritten(functions, tmp_path):
    (tmp_path / "main.c").write_text("int main(void) { return 0; }\n")
    with pytest.raises(InputError, match="already exists"):
        write_c(functions, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["main.c"]
    (tmp_path / "main.c").unlink()
    (tmp_path / "main.c").mkdir()
    with pytest.raises(InputError, match="already exists"):
        write_c(functions, tmp_path)
    (tmp_path / "main.c").rmdir()
    first = [path.read_bytes() for path in write_c(functions, tmp_path)]
    assert first == [path.read_bytes() for path in write_c(functions, tmp_path)]


@pytest.mark.parametrize("name", ["main", "2beam", "a__b", "../beam", "a" * 300, None])
def test_names_that_c_does_not_allow_are_refused(functions, tmp_path, name):
    with pytest.raises(InputError, match="name: must be"):
        write_c(functions, tmp_path, name=name)
    assert not list(tmp_path.iterdir())
