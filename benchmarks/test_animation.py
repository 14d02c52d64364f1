"""Time and size of moving pictures; run with ``pytest benchmarks -n 0 --benchmark-enable``."""

import time

import pytest

from ancf_casadi import HarmonicBase, Model, RayleighDamping, simulate
from benchmarks.beams import steel


@pytest.fixture(scope="module")
def run():
    base = HarmonicBase(amplitude=8e-3, frequency=1.88, stop=5.0)
    return simulate(Model(steel()), damping=RayleighDamping(alpha=0.2), base=base, duration=10.0, sample_rate=250.0)


@pytest.mark.parametrize("suffix", ["gif", "html"])
def test_ten_seconds(benchmark, run, tmp_path, suffix):
    """10 s of motion at 25 pictures per second: 15 s of processor time, 3 MB."""
    path = tmp_path / f"swing.{suffix}"
    began = time.process_time()
    benchmark.pedantic(run.animate, args=(path,), rounds=1)
    benchmark.extra_info["cpu_seconds"] = time.process_time() - began
    benchmark.extra_info["megabytes"] = path.stat().st_size / 1e6
    assert benchmark.extra_info["cpu_seconds"] < 15.0 and path.stat().st_size < 3e6
