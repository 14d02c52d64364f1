"""Compare the integrators in calls with all defaults: processor time and error of IDAS, Radau and the default.

    .venv/bin/python -m benchmarks.integrators
    .venv/bin/python -m benchmarks.integrators --cases drag release --methods radau auto --seconds 1

Each call and integrator runs twice in its own process with an empty cache.  Columns: processor time of the first call,
compilers included, and of the second, s; largest error of the tip relative to its travel, against Radau at a twentieth
of its default tolerance; steps; integrator and tolerance.  A run of more than ``MOST_STEPS`` fails, and its time is a
lower bound.  Below each call: the time of the default relative to the cheaper integrator, second call.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from typing import Any

import numpy as np

from ancf_casadi import (
    FrictionDamping,
    HarmonicBase,
    ModalDamping,
    Model,
    QuadraticDamping,
    RayleighDamping,
    SampledBase,
    SimulationError,
    natural_modes,
    simulate,
    static_equilibrium,
)
from ancf_casadi.dynamics.motion_setup import set_up
from ancf_casadi.dynamics.simulation import Method
from ancf_casadi.dynamics.tolerance import default_tolerance
from benchmarks.beams import BENDING_STIFFNESS, DAMPING_RATIOS, steel
from benchmarks.clock import processor_time

METHODS: tuple[Method, ...] = ("idas", "radau", "auto")
MOST_STEPS = 600_000
SECONDS = 6.0
MODEL = Model(steel())
MODES = natural_modes(MODEL)
MODAL = ModalDamping(MODES, DAMPING_RATIOS)
DRAG = QuadraticDamping(eta1=0.15, eta2=0.11)


def driven(mode: int, amplitude: float) -> dict[str, Any]:
    """Return a base that moves for 2 s at a natural frequency."""
    return {"base": HarmonicBase(amplitude=amplitude, frequency=float(MODES.frequencies[mode - 1]), stop=2.0)}


def sampled() -> dict[str, Any]:
    """Return a base motion of two frequencies that grows for 1 s, as samples."""
    time = np.linspace(0.0, SECONDS, 1201)
    x = 2e-3 * np.sin(2 * math.pi * 1.7 * time) + 1e-3 * np.sin(2 * math.pi * 4.1 * time)
    return {"base": SampledBase(time, np.column_stack([np.minimum(time, 1.0) * x, 0 * x]))}


def released(force: float) -> dict[str, Any]:
    """Return a start under a tip force, in units of E I/L^2."""
    pull = force * BENDING_STIFFNESS / MODEL.beam.length**2
    return {"start": static_equilibrium(MODEL, tip_force=(pull, 0.0))}


CASES: dict[str, Callable[[], dict[str, Any]]] = {
    "modal, mode 1, 1 mm": lambda: {"damping": MODAL, **driven(1, 1e-3)},
    "modal, mode 1, 5 mm": lambda: {"damping": MODAL, **driven(1, 5e-3)},
    "modal, mode 2, 1 mm": lambda: {"damping": MODAL, **driven(2, 1e-3)},
    "modal, mode 2, 5 mm": lambda: {"damping": MODAL, **driven(2, 5e-3)},
    "modal, mode 1, 10 um": lambda: {"damping": MODAL, **driven(1, 1e-5)},
    "alpha": lambda: {"damping": RayleighDamping(alpha=0.2325), **driven(1, 5e-3)},
    "beta 1e-3": lambda: {"damping": RayleighDamping(alpha=0.2, beta=1e-3), **driven(1, 5e-3)},
    "drag": lambda: {"damping": DRAG, **driven(1, 5e-3)},
    "friction": lambda: {"damping": FrictionDamping(eta0=0.05), **driven(1, 5e-3)},
    "modal and drag": lambda: {"damping": MODAL + DRAG, **driven(1, 5e-3)},
    "undamped": lambda: driven(1, 5e-3),
    "release 0.03": lambda: released(0.03),
    "release 1": lambda: released(1.0),
    "sampled base": lambda: {"damping": MODAL, **sampled()},
}


def measure(case: str, method: Method, seconds: float) -> dict[str, Any]:
    """Return the times of two calls (s), and tip (m), steps and integrator of the second."""
    settings, times = CASES[case](), []
    for _ in range(2):
        began = processor_time()
        try:
            run = simulate(MODEL, duration=seconds, method=method, most_steps=MOST_STEPS, **settings)
        except SimulationError as failure:
            run = failure.partial
        times.append(processor_time() - began)
        if len(run.time) <= seconds * 1000:
            return {"times": times * 2, "tip": [], "steps": f">{run.steps}", "used": "fails"}
    (use,) = run.integrators
    return {"times": times, "tip": run.tip.tolist(), "steps": run.steps, "used": f"{use.method} {use.tolerance:.0e}"}


def apart(case: str, method: Method, seconds: float) -> dict[str, Any]:
    """Run ``measure`` in a separate process with an empty cache."""
    with tempfile.TemporaryDirectory() as cache:
        command = [sys.executable, __file__, "--measure", case, method, "--seconds", str(seconds)]
        environment = {**os.environ, "ANCF_CASADI_CACHE": cache}
        done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True, text=True)
    return dict(json.loads(done.stdout.splitlines()[-1]))


def exact(case: str, seconds: float) -> np.ndarray:
    """Return the position of the tip (m) at a twentieth of the default tolerance."""
    settings = {"damping": None, "base": None, "load": None, "start": "equilibrium", **CASES[case]()}
    travel = set_up(MODEL, duration=seconds, sample_rate=1000.0, **settings).travel
    tolerance = default_tolerance("radau", travel) / 20
    return simulate(MODEL, duration=seconds, method="radau", tolerance=tolerance, **settings).tip


def main() -> None:
    """Measure the calls and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    parser.add_argument("--seconds", type=float, default=SECONDS, help="simulated time")
    parser.add_argument("--measure", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.measure:
        case, method = options.measure
        print(json.dumps(measure(case, method, options.seconds)))
        return
    print(f"{'call':22s}{'method':7s}{'first':>8s}{'second':>8s}{'error':>9s}{'steps':>9s}  used")
    for case in options.cases:
        second, tip = {}, exact(case, options.seconds)
        for method in options.methods:
            found = apart(case, method, options.seconds)
            first, second[method] = found["times"][:2]
            error = abs(np.array(found["tip"]) - tip).max() / abs(tip - tip[0]).max() if found["tip"] else math.nan
            times = f"{first:8.2f}{second[method]:8.2f}"
            print(f"{case:22s}{method:7s}{times}{error:9.1e}{found['steps']:>9}  {found['used']}", flush=True)
        default = second.pop("auto", math.nan)
        print(f"{'':22s}auto relative to the cheaper: {default / min(second.values()):.2f}", flush=True)


if __name__ == "__main__":
    main()
