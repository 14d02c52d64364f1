"""Compare the time that this project and Exudyn take to reach the same accuracy.

    python -m benchmarks.compare_exudyn [--case a|b|all] [--law mass|modal|drag|all] [--method idas|radau]

requires ``pip install exudyn`` and a C compiler.  ``exudyn_cases.py`` defines the cases and Exudyn's
model.

Times.  Each program runs in its own process, one after the other, on one thread, over a ladder of accuracies:
tolerances of the chosen integrator for this project, step sizes for Exudyn.  A time is processor time, and covers
building the model and integrating it.  The compilation of this project, done once and cached, is listed separately;
the matrices given to Exudyn cost it nothing.  Both programs take 1000 samples per second.

Errors.  Each solution is compared with the converged one of the same program: ``radau`` with a small tolerance here,
and for Exudyn an extrapolation from its two smallest steps, with order 2.  In a window at the end,

    error       is the largest distance of the two, relative to the largest excursion,
    amplitude   is the relative difference of their root mean squares.

The last lines compare the times of the cheapest setting of each program within the limit.  The difference of the two
converged solutions is printed as well: the meshes are the same, but the elements integrate the axial strain
differently.  In case (b) it is about 3 % at the end with 20 elements, and 40 times as much with 10.
"""

from __future__ import annotations

import argparse
import importlib.util
import multiprocessing
import os
import platform
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version

import numpy as np

from ancf_casadi import Model, natural_modes, simulate, static_equilibrium
from ancf_casadi.dynamics.simulation import Method
from ancf_casadi.mechanics.nodes import NODE
from benchmarks.clock import processor_time
from benchmarks.exudyn_cases import (
    BEAM,
    LAWS,
    SAMPLE_RATE,
    Array,
    Bar,
    Case,
    Solution,
    blow,
    damping,
    large,
    solve_exudyn,
)

ORDER = 2  # of generalized alpha
FINER = 1.5  # least steps of a converged solution, relative to the finest rung
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
ROW = "{:8}  {:16}  {:>8}  {:>8}  {:>9}  {:>9}"


@dataclass(frozen=True)
class Rung:
    """Run of one program at one accuracy: motion in the window, (k, c), number of steps, and processor time (s)."""

    setting: float
    signal: Array
    steps: int
    seconds: float


@dataclass(frozen=True)
class Ladder:
    """Runs of one program, coarse to fine, and its converged motion."""

    program: str
    rungs: list[Rung]
    converged: Array

    def error(self, rung: Rung, kind: str) -> float:
        """Return the relative error of a run."""
        if kind == "amplitude":
            return abs(float(_size(rung.signal) / _size(self.converged)) - 1.0)
        return distance(rung.signal, self.converged)

    def cheapest(self, bar: Bar) -> Rung | None:
        """Return the fastest run within a limit."""
        within = [rung for rung in self.rungs if self.error(rung, bar.kind) <= bar.limit]
        return min(within, key=lambda rung: rung.seconds, default=None)

    def label(self, rung: Rung) -> str:
        """Return the setting of a run in words."""
        return f"tolerance {rung.setting:.0e}" if self.program == "ours" else f"h {1e3 * rung.setting:g} ms"


def main() -> None:
    """Run the requested comparison."""
    parser = _parser()
    arguments = parser.parse_args()
    if arguments.repeat < 1:
        parser.error("--repeat must be at least 1")
    if importlib.util.find_spec("exudyn") is None:
        sys.exit("Exudyn is not installed, so there is nothing to compare with: pip install exudyn")
    os.environ.update(dict.fromkeys(THREADS, "1"))
    laws = LAWS if arguments.law == "all" else (arguments.law,)
    cases = [large(law, arguments.quick, arguments.shorten) for law in laws] if arguments.case in ("a", "all") else []
    cases += [blow(arguments.quick, arguments.shorten)] if arguments.case in ("b", "all") else []
    print(_machine())
    for case in cases:
        compare(case, arguments.method, not arguments.interpreted, arguments.repeat)


def compare(case: Case, method: Method, compiled: bool, repeat: int) -> None:
    """Run both programs and print the results."""
    print(f"\ncase {case.name}, {case.law}, {method}: {case.title}")
    ours, compilation = climb_ours(case, method, compiled, repeat)
    theirs = climb_exudyn(case, repeat)
    print(ROW.format("program", "setting", "steps", "CPU s", "error", "amplitude"))
    for ladder in (ours, theirs):
        for rung in ladder.rungs:
            cost = rung.steps, f"{rung.seconds:.2f}"
            errors = (f"{ladder.error(rung, kind):.1e}" for kind in ("error", "amplitude"))
            print(ROW.format(ladder.program, ladder.label(rung), *cost, *errors))
    print(f"ours compiled in {compilation:.1f} s, once")
    print(f"the converged solutions are {distance(ours.converged, theirs.converged):.1e} apart")
    for bar in case.bars:
        print(verdict(bar, ours, theirs))


def verdict(bar: Bar, ours: Ladder, theirs: Ladder) -> str:
    """Return a line that compares the two programs at a limit."""
    found = [(ladder, ladder.cheapest(bar)) for ladder in (ours, theirs)]
    words = [
        f"{ladder.program} {rung.seconds:.2f} s ({ladder.label(rung)})" if rung else f"{ladder.program} not reached"
        for ladder, rung in found
    ]
    own, other = (rung for _, rung in found)
    if own is None or other is None:
        return f"{bar.kind} of {bar.limit:g}: {', '.join(words)}"
    ratio = f"Exudyn takes {other.seconds / own.seconds:.2f} times ours"
    return f"{bar.kind} of {bar.limit:g}: {', '.join(words)}; {ratio}"


def climb_ours(case: Case, method: Method, compiled: bool, repeat: int) -> tuple[Ladder, float]:
    """Return our ladder and the compilation time (s), from an empty cache."""
    settings, solve = case.tolerances[method], partial(solve_ours, method=method)
    with tempfile.TemporaryDirectory() as cache:
        with _process({"ANCF_CASADI_CACHE": cache, "ANCF_CASADI_COMPILE": str(int(compiled))}) as process:
            cold, warm = (process.submit(solve, case, settings[0], duration=0.1).result() for _ in range(2))
            rungs = _climb(process, solve, case, settings, repeat)
            fine = process.submit(solve_ours, case, case.converged, method="radau").result()
    if fine.steps < FINER * rungs[-1].steps:
        print(f"our converged solution has only {fine.steps} steps: its own error matters", file=sys.stderr)
    return Ladder("ours", rungs, signal(case, fine.coordinates)), max(0.0, cold.seconds - warm.seconds)


def climb_exudyn(case: Case, repeat: int) -> Ladder:
    """Return Exudyn's ladder."""
    with _process({}) as process:
        rungs = _climb(process, solve_exudyn, case, case.steps, repeat)
    coarse, fine = rungs[-2:]
    gain = (coarse.setting / fine.setting) ** ORDER - 1
    return Ladder("exudyn", rungs, fine.signal + (fine.signal - coarse.signal) / gain)


def solve_ours(case: Case, tolerance: float, *, method: Method, duration: float | None = None) -> Solution:
    """Run a case in this project, including the construction of the model and its law."""
    began = processor_time()
    model = Model(BEAM)
    run = simulate(
        model,
        damping=damping(case.law, model),
        base=case.base,
        start=case.start,
        duration=duration or case.duration,
        sample_rate=SAMPLE_RATE,
        method=method,
        tolerance=tolerance,
    )
    coordinates = run.tip if case.mode is None else run.coordinates
    return Solution(coordinates, run.steps, processor_time() - began)


def signal(case: Case, coordinates: Array) -> Array:
    """Return the compared signal in the window at the end: tip excursion or modal coordinate."""
    coordinates = coordinates[-round(case.window * SAMPLE_RATE) - 1 :]
    model = Model(BEAM)
    held: Array = np.array([case.base.amplitude * np.sin(2 * np.pi * case.base.frequency * case.base.stop_time), 0.0])
    if case.mode is None:
        return coordinates - static_equilibrium(model).coordinates[-NODE:-2] - held
    relative = coordinates - np.tile([*held, 0.0, 0.0], BEAM.elements + 1)
    return natural_modes(model, count=case.mode + 1).modal_coordinate(relative, case.mode)[:, None]


def distance(first: Array, second: Array) -> float:
    """Return the largest distance of two motions, relative to the largest excursion of the second."""
    return float(np.linalg.norm(first - second, axis=1).max() / np.linalg.norm(second, axis=1).max())


def _size(motion: Array) -> float:
    return float(np.sqrt((motion**2).sum(axis=1).mean()))


def _climb(
    process: ProcessPoolExecutor,
    solve: Callable[[Case, float], Solution],
    case: Case,
    settings: Sequence[float],
    repeat: int,
) -> list[Rung]:
    """Run a program at each setting; keep the fastest of the repeated runs."""
    rungs = []
    for setting in settings:
        runs = [process.submit(solve, case, setting).result() for _ in range(repeat)]
        best = min(runs, key=lambda run: run.seconds)
        print(f"  {setting:g}: {best.seconds:.2f} s", file=sys.stderr, flush=True)
        rungs.append(Rung(setting, signal(case, best.coordinates), best.steps, best.seconds))
    return rungs


def _environment(additions: dict[str, str]) -> None:
    os.environ.update(additions)


def _process(additions: dict[str, str]) -> ProcessPoolExecutor:
    """Return a new process with additional environment variables."""
    return ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _environment, (additions,))


def _machine() -> str:
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    programs = ", ".join(f"{name} {version(name)}" for name in ("ancf-casadi", "casadi", "exudyn"))
    return f"{programs}; {platform.machine()}, {os.cpu_count()} cores{load}; one thread"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Compare the speed of this project with Exudyn's.")
    parser.add_argument("--case", choices=("a", "b", "all"), default="all", help="a: mode 1, large; b: mode 5, impact")
    parser.add_argument("--law", choices=(*LAWS, "all"), default="all", help="damping law of case a")
    parser.add_argument("--method", choices=("idas", "radau"), default="radau", help="our integrator")
    parser.add_argument("--interpreted", action="store_true", help="run ours without a C compiler")
    parser.add_argument("--quick", action="store_true", help="short ladders, less accurate converged solutions")
    parser.add_argument("--shorten", type=float, default=1.0, metavar="FACTOR", help="divide the simulated times")
    parser.add_argument("--repeat", type=int, default=1, metavar="N", help="keep the fastest of N runs")
    return parser


if __name__ == "__main__":
    main()
