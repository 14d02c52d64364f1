"""Compare the first call with the second: the cost of compilation from an empty cache, and the calls that reuse it.

    .venv/bin/python -m benchmarks.first_call                          three laws, both integrators, a transient fit
    .venv/bin/python -m benchmarks.first_call --before ../old          the same, in turn with another checkout
    .venv/bin/python -m benchmarks.first_call --cases radau-modal fit --seconds 1

Each case runs in its own process with an empty cache.  It makes the same call twice, then one call with another beam
and one with another number of elements.  Times are wall times and, in brackets, processor times including the
compilers; on a shared machine, read the latter.  The first call may take 2 s more than the second, and 5 s in a fit.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ancf_casadi import (
    DampingLaw,
    HarmonicBase,
    ModalDamping,
    Model,
    QuadraticDamping,
    RayleighDamping,
    natural_modes,
    simulate,
)
from ancf_casadi.dynamics.simulation import Method
from benchmarks.beams import DAMPING_RATIOS, silicone, steel
from benchmarks.clock import processor_time
from problems import MarkerRecord, fit_beam

CALLS: dict[str, dict[str, Any]] = {
    "first": {},
    "second": {},
    "other beam": {"density": 1000.0, "gravity": (0, -9.7)},
    "other mesh": {"elements": 12},
}
LAWS: dict[str, Callable[[Model], DampingLaw]] = {
    "modal": lambda model: ModalDamping(natural_modes(model), DAMPING_RATIOS),
    "strain-rate": lambda model: RayleighDamping(alpha=0.228, beta=3.18e-5),
    "quadratic": lambda model: QuadraticDamping(eta1=0.15, eta2=0.11),
}
ROOT = Path(__file__).parents[1]
METHODS: tuple[Method, ...] = ("idas", "radau")
CASES = {f"{method}-{law}": (method, law) for method in METHODS for law in LAWS}


def call(case: str, seconds: float, **changes: Any) -> Callable[[], object]:
    """Return the call of a case, ready to be timed."""
    if case == "fit":
        return fit_call(seconds, **changes)
    model = Model(steel(**changes))
    method, law = CASES[case]
    base = HarmonicBase(amplitude=5e-3, frequency=1.85)
    return lambda: simulate(model, damping=LAWS[law](model), base=base, duration=seconds, method=method)


def fit_call(seconds: float, **changes: Any) -> Callable[[], object]:
    """Return the fit of air drag to a noisy record of a silicone strip, simulated without a compiler."""
    model, base = Model(silicone(**{"elements": 8} | changes)), HarmonicBase(0.02, 2.0, stop=0.5)
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


def measure(case: str, seconds: float) -> list[tuple[float, float]]:
    """Return wall time and processor time (s) of each of ``CALLS``."""
    found = []
    for changes in CALLS.values():
        made = call(case, seconds, **changes)
        clock, used = time.perf_counter(), processor_time()
        made()
        found.append((time.perf_counter() - clock, processor_time() - used))
    return found


def measured_apart(case: str, seconds: float, root: Path) -> list[tuple[float, float]]:
    """Run ``measure`` in a separate process, with the packages of a checkout and an empty cache."""
    with tempfile.TemporaryDirectory() as cache:
        additions = {"ANCF_CASADI_CACHE": cache, "ANCF_CASADI_COMPILE": "1", "PYTHONPATH": f"{root}{os.pathsep}{ROOT}"}
        command = [sys.executable, __file__, "--measure", case, "--seconds", str(seconds)]
        done = subprocess.run(command, env=os.environ | additions, stdout=subprocess.PIPE, check=True, text=True)
    return [(clock, used) for clock, used in json.loads(done.stdout.splitlines()[-1])]


def show(label: str, found: Sequence[tuple[float, float]]) -> None:
    """Print a row of the table."""
    extra = [round(found[0][k] - found[1][k], 2) for k in (0, 1)]
    times = "".join(f"{clock:8.2f} ({used:5.2f})" for clock, used in found)
    print(f"{label:26s}{times}{extra[0]:9.2f} ({extra[1]:5.2f})", flush=True)


def main() -> None:
    """Measure the cases, each checkout in turn, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", nargs="+", choices=[*CASES, "fit"], default=[*CASES, "fit"])
    parser.add_argument("--seconds", type=float, default=2.0, help="simulated time")
    parser.add_argument("--before", type=Path, help="another checkout to compare with")
    parser.add_argument("--measure", choices=[*CASES, "fit"], help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.measure:
        print(json.dumps(measure(options.measure, options.seconds)))
        return
    print(f"{'seconds (of processors)':26s}" + "".join(f"{name:>16s}" for name in (*CALLS, "first - second")))
    for case in options.cases:
        now = measured_apart(case, options.seconds, ROOT)
        if options.before:
            before = measured_apart(case, options.seconds, options.before.resolve())
            show(f"{case}, before", before)
            show(f"{case}, now", now)
            print(f"{'  ratio':26s}" + "".join(f"{b[1] / n[1]:16.2f}" for b, n in zip(before, now, strict=True)))
        else:
            show(case, now)


if __name__ == "__main__":
    main()
