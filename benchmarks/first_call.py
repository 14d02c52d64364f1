"""Compare the first call with the second: the cost of compilation from an empty cache, and the calls that reuse it.

    .venv/bin/python benchmarks/first_call.py                          three laws, both integrators, a transient fit
    .venv/bin/python benchmarks/first_call.py --before ../old          the same, in turn with another checkout
    .venv/bin/python benchmarks/first_call.py --cases radau-modal fit --seconds 2

Each case runs in its own process with an empty cache.  It makes the same call twice, then one call with another beam
and one with another number of elements.  Times are wall times and, in brackets, processor times including the
compilers; on a shared machine, read the latter.  The first call may take 2 s more than the second, and 5 s in a fit.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ancf_casadi import (
    Beam,
    HarmonicBase,
    ModalDamping,
    Model,
    QuadraticDamping,
    RayleighDamping,
    natural_modes,
    simulate,
)
from problems import MarkerRecord, fit_beam
from tests.problems.paper import numbers as paper

STEEL = {"length": 0.5, "width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elastic_modulus": 210e9, "elements": 20}
SILICONE = {"length": 0.2, "width": 0.01, "thickness": 2e-3, "density": 1070.0, "elastic_modulus": 264e3, "elements": 8}
CALLS = {
    "first": {},
    "second": {},
    "other beam": {"density": 1000.0, "gravity": (0, -9.7)},
    "other mesh": {"elements": 12},
}
LAWS = {
    "modal": lambda model: ModalDamping(natural_modes(model), paper.DAMPING_RATIOS),
    "strain-rate": lambda model: RayleighDamping(alpha=0.228, beta=3.18e-5),
    "quadratic": lambda model: QuadraticDamping(eta1=0.15, eta2=0.11),
}
CASES = (*(f"{method}-{law}" for method in ("idas", "radau") for law in LAWS), "fit")


def call(case: str, seconds: float, **changes: Any) -> Callable[[], object]:
    """Return the call of a case, ready to be timed."""
    if case == "fit":
        return fit_call(seconds / 5, **changes)
    model = Model(Beam.uniform(**STEEL | changes))
    method, law = case.split("-", 1)
    base = HarmonicBase(amplitude=5e-3, frequency=1.85)
    return lambda: simulate(model, damping=LAWS[law](model), base=base, duration=seconds, method=method)


def fit_call(seconds: float, **changes: Any) -> Callable[[], object]:
    """Return the fit of air drag to a noisy record of a silicone strip, simulated without a compiler."""
    model, base = Model(Beam.uniform(**SILICONE | changes)), HarmonicBase(0.02, 2.0, stop=0.5)
    compilation, os.environ["ANCF_CASADI_COMPILE"] = os.environ["ANCF_CASADI_COMPILE"], "0"
    run = simulate(
        model,
        damping=QuadraticDamping(eta1=0.6, eta2=4.0),
        base=base,
        duration=seconds,
        sample_rate=40.0,
        method="radau",
    )
    os.environ["ANCF_CASADI_COMPILE"] = compilation
    noise = np.random.default_rng(0).normal(0.0, 0.5e-3, run.tip.shape)
    record = MarkerRecord(run.time, run.tip + noise, base=base)
    return lambda: fit_beam(model, record, QuadraticDamping(0.3, 8.0), tolerance=1e-5)


def processors() -> float:
    """Return the processor time (s) of this process and its children."""
    usages = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def measure(case: str, seconds: float) -> list[tuple[float, float]]:
    """Return wall time and processor time (s) of each of ``CALLS``."""
    found = []
    for changes in CALLS.values():
        made = call(case, seconds, **changes)
        clock, used = time.perf_counter(), processors()
        made()
        found.append((time.perf_counter() - clock, processors() - used))
    return found


def measured_apart(case: str, seconds: float, root: Path) -> list[tuple[float, float]]:
    """Run ``measure`` in a separate process, with the packages of a checkout and an empty cache."""
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "ANCF_CASADI_CACHE": cache, "PYTHONPATH": str(root), "ANCF_CASADI_COMPILE": "1"}
        command = [sys.executable, __file__, "--measure", case, "--seconds", str(seconds)]
        done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True, text=True)
    return [(clock, used) for clock, used in json.loads(done.stdout.splitlines()[-1])]


def show(label: str, found: Sequence[tuple[float, float]]) -> None:
    """Print a row of the table."""
    extra = [round(found[0][k] - found[1][k], 2) for k in (0, 1)]
    times = "".join(f"{clock:8.2f} ({used:5.2f})" for clock, used in found)
    print(f"{label:26s}{times}{extra[0]:9.2f} ({extra[1]:5.2f})", flush=True)


def main() -> None:
    """Measure the cases, each checkout in turn, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", nargs="+", choices=CASES, default=CASES)
    parser.add_argument("--seconds", type=float, default=10.0, help="simulated time; a fit uses a fifth of it")
    parser.add_argument("--before", type=Path, help="another checkout to compare with")
    parser.add_argument("--measure", choices=CASES, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.measure:
        print(json.dumps(measure(options.measure, options.seconds)))
        return
    here = Path(importlib.util.find_spec("ancf_casadi").origin).parents[1]
    print(f"{'seconds (of processors)':26s}" + "".join(f"{name:>16s}" for name in (*CALLS, "first - second")))
    for case in options.cases:
        now = measured_apart(case, options.seconds, here)
        if options.before:
            before = measured_apart(case, options.seconds, options.before.resolve())
            show(f"{case}, before", before)
            show(f"{case}, now", now)
            print(f"{'  ratio':26s}" + "".join(f"{b[1] / n[1]:16.2f}" for b, n in zip(before, now, strict=True)))
        else:
            show(case, now)


if __name__ == "__main__":
    main()
