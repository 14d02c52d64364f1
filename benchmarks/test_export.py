"""Computing times of the exported model; run with ``pytest benchmarks/test_export.py -n 0 --benchmark-enable``."""

import shutil
import subprocess
import time

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import ModalDamping, Model, RayleighDamping, natural_modes
from ancf_casadi.export import beam_functions, values, write_c
from ancf_casadi.support.compilation import Buffered
from benchmarks.beams import steel


def exported(elements, name):
    model = Model(steel(elements))
    laws = {
        "strain-rate": lambda: RayleighDamping(alpha=0.2, beta=3e-5),
        "modal": lambda: ModalDamping(natural_modes(model), (0.01,) * 5),
    }
    return beam_functions(model, laws[name]())


@pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc")
@pytest.mark.parametrize("name", ["strain-rate", "modal"])
@pytest.mark.parametrize("elements", [20, 200])
def test_right_hand_side(benchmark, tmp_path, elements, name):
    """At most 15 us for 20 elements, and ten times as long for 200."""
    functions = exported(elements, name)
    source, library = tmp_path / "rhs.c", tmp_path / "rhs.so"
    generator = cs.CodeGenerator(source.name)
    generator.add(functions.rhs)
    source.write_text(generator.dump())
    subprocess.run(["gcc", "-O2", "-fPIC", "-shared", source, "-o", library, "-lm"], check=True)
    n = functions.free
    start = values(functions.states)
    inputs = (start[:n].copy(), start[n:].copy(), np.zeros(9), values(functions.parameters))
    call = Buffered(cs.external("rhs", str(library)), *inputs)
    benchmark(call)
    assert np.isfinite(call.outputs[0]).all()


@pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc")
@pytest.mark.parametrize("name", ["strain-rate", "modal"])
def test_writing_and_compiling_all_functions(benchmark, tmp_path, name):
    """At most 5 s to write 20 elements, and 60 s to compile them at -O2."""
    functions = exported(20, name)
    source, *_ = benchmark.pedantic(lambda: write_c(functions, tmp_path), rounds=1)
    began = time.perf_counter()
    subprocess.run(["gcc", "-std=c99", "-O2", "-c", source, "-o", tmp_path / "beam.o"], check=True)
    benchmark.extra_info["compile_seconds"] = time.perf_counter() - began
    assert benchmark.extra_info["compile_seconds"] < 600
