"""Modes and matching on fine meshes; run with ``pytest benchmarks/test_meshes.py -n 0 --benchmark-enable``.

On a shared machine, compare processor times and the ratios within one run.
"""

import time

import numpy as np
import pytest

from ancf_casadi import Model, natural_modes, static_equilibrium
from benchmarks.beams import steel
from problems import match_frequencies
from tests.problems.paper import numbers as paper

EXACT = (1.655293122, 10.373544922, 29.046226159, 56.919010528, 94.091202772)  # Hz, without gravity


def measured(benchmark, work):
    """Run once; record the processor time as well as the wall time."""

    def timed():
        began = time.process_time()
        result = work()
        benchmark.extra_info["processor_seconds"] = round(time.process_time() - began, 3)
        return result

    return benchmark.pedantic(timed, rounds=1)


@pytest.mark.parametrize("elements", [20, 40, 80, 200, 400])
def test_matching_all_widths_and_thicknesses(benchmark, elements):
    """2 n + 2 properties, 5 frequencies: limit 5 s with 200 elements, 15 s with 400."""
    beam = steel(elements)
    match = measured(benchmark, lambda: match_frequencies(beam, targets=paper.TARGET_FREQUENCIES))
    benchmark.extra_info.update(build=match.build_seconds, solve=match.solve_seconds, iterations=match.iterations)
    assert match.max_relative_error < 1e-6


@pytest.mark.parametrize("elements", [20, 200, 1000, 10_000])
def test_natural_modes(benchmark, elements):
    """Five modes and their equilibrium without gravity; error after subtraction of the cubic element's error."""
    model = Model(steel(elements, gravity=(0.0, 0.0)))
    modes = measured(benchmark, lambda: natural_modes(model))
    waves = np.sqrt(modes.angular_frequencies * np.sqrt(modes.model.beam.mass / 0.5 / (210e9 * 5e-3 * 0.5e-3**3 / 12)))
    error = np.abs(modes.frequencies / EXACT - 1 - (waves * 0.5 / elements) ** 4 / 1440).max()
    benchmark.extra_info["error"] = float(error)
    assert error < 1e-5


@pytest.mark.parametrize("elements", [20, 1000, 3000, 10_000])
def test_static_equilibrium(benchmark, elements):
    """Horizontal beam under its own weight."""
    model = Model(steel(elements, axis=(1.0, 0.0)))
    rest = measured(benchmark, lambda: static_equilibrium(model))
    assert rest.tip[1] == pytest.approx(-0.1322053449, abs=1e-6)
