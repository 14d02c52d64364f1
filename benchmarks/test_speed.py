"""Times that users wait for; run with ``pytest benchmarks -n 0 --benchmark-enable``.

The limits in ``benchmarks/README.md`` hold for a quiet machine.  On a shared one, compare ratios within one run.
"""

import subprocess
import sys

import numpy as np
import pytest

from ancf_casadi import (
    HarmonicBase,
    ModalDamping,
    Model,
    QuadraticDamping,
    RayleighDamping,
    natural_modes,
    simulate,
)
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.idas import SemiExplicit
from ancf_casadi.support.compilation import compile_function, expand_function
from benchmarks.beams import DAMPING_RATIOS, steel
from problems import match_frequencies
from tests.problems.paper import numbers as paper

SWING = HarmonicBase(amplitude=5e-3, frequency=1.85)


def model(elements=20):
    return Model(steel(elements))


def law_of(name, beam):
    return {
        "undamped": lambda: None,
        "mass-proportional": lambda: RayleighDamping(alpha=0.2325),
        "strain-rate": lambda: RayleighDamping(alpha=0.228, beta=3.18e-5),
        "tangent": lambda: RayleighDamping(alpha=0.228, beta=3.18e-5, stiffness="tangent"),
        "quadratic": lambda: QuadraticDamping(eta1=0.15, eta2=0.11),
        "modal": lambda: ModalDamping(natural_modes(beam), DAMPING_RATIOS),
    }[name]()


def test_import(benchmark):
    """``import ancf_casadi`` beyond casadi and numpy: limit 0.3 s."""
    code = "import time, casadi, numpy; t = time.perf_counter(); import ancf_casadi; print(time.perf_counter() - t)"

    def run():
        return float(subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout)

    benchmark.extra_info["import_seconds"] = benchmark.pedantic(run, rounds=3)
    assert benchmark.extra_info["import_seconds"] < 3.0


def test_model_with_all_that_simulate_needs(benchmark):
    """Model of 20 elements with its equilibrium and equations: limit 0.5 s."""

    def build():
        beam = model()
        natural_modes(beam)
        equations = SemiExplicit(Equations(beam, RayleighDamping(alpha=0.228, beta=3.18e-5)))
        return expand_function(equations.residual), expand_function(equations.powers)

    residual, _ = benchmark(build)
    assert residual.size1_in(0) == 160


def test_frequency_matching(benchmark):
    """42 properties, 5 frequencies: limit 1 s to build and solve, 0.2 s to solve; ``test_meshes`` has finer meshes."""
    beam = steel()
    match = benchmark(lambda: match_frequencies(beam, targets=paper.TARGET_FREQUENCIES))
    benchmark.extra_info.update(build=match.build_seconds, solve=match.solve_seconds, iterations=match.iterations)
    assert match.max_relative_error < 1e-6


@pytest.mark.parametrize("name", ["undamped", "mass-proportional", "strain-rate", "tangent", "quadratic", "modal"])
def test_two_seconds_of_a_large_swing(benchmark, name):
    """Mode 1 driven with 5 mm at resonance, 20 elements, default tolerance."""
    beam = model()
    law = law_of(name, beam)
    run = benchmark.pedantic(lambda: simulate(beam, damping=law, base=SWING, duration=2.0), rounds=3, warmup_rounds=1)
    benchmark.extra_info["microseconds_per_step"] = 1e6 * run.wall_seconds / run.steps
    assert np.ptp(run.tip[:, 0]) > 0.1


@pytest.mark.parametrize("name", ["mass-proportional", "quadratic", "modal"])
@pytest.mark.parametrize("elements", [20, 200])
def test_fine_meshes(benchmark, name, elements):
    """200 elements relative to 20: limit a factor of 12."""
    beam = model(elements)
    law = law_of(name, beam)
    run = benchmark.pedantic(
        lambda: simulate(beam, damping=law, base=SWING, duration=1.0, sample_rate=200.0),
        rounds=1,
        warmup_rounds=1,
    )
    assert run.steps > 0


@pytest.mark.parametrize("make", [expand_function, compile_function])
def test_equations_of_motion(benchmark, make):
    """One evaluation of the residual, 20 elements."""
    equations = SemiExplicit(Equations(model(), RayleighDamping(alpha=0.228, beta=3.18e-5)))
    residual = make(equations.residual)
    buffer, call = residual.buffer()
    inputs = [np.zeros(residual.size_in(k), order="F") for k in range(3)]
    outputs = [np.zeros(residual.size_out(k), order="F") for k in range(2)]
    inputs[2][2:4, 0] = (0.0, -1.0)
    for k, values in enumerate(inputs):
        buffer.set_arg(k, values.data)
    for k, values in enumerate(outputs):
        buffer.set_res(k, values.data)
    benchmark(call)
    assert np.isfinite(outputs[1]).all()
