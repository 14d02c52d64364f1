"""Cost of a Radau step and of its parts.

    python -m benchmarks.radau_step

For several motions of 20 elements sampled 1000 times per second, it prints the numbers of steps, Newton iterations and
factorisations, and the processor time in ms per step, with and without samples.  Then follow the parts in microseconds
per step, the calls of the compiled Functions; the rest is Python.  The clocks around the parts take some time
themselves; the first two times are measured without them.
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

from ancf_casadi import (
    HarmonicBase,
    ModalDamping,
    Model,
    RayleighDamping,
    natural_modes,
    simulate,
    static_equilibrium,
)
from ancf_casadi.dynamics.radau import newton, stepper
from ancf_casadi.dynamics.radau.stepper import Stepper
from ancf_casadi.support.compilation import Buffered
from benchmarks.beams import BENDING_STIFFNESS, DAMPING_RATIOS, steel

SWING = HarmonicBase(amplitude=5e-3, frequency=1.85)


def motions(seconds: float) -> Iterator[tuple[str, Model, dict[str, Any]]]:
    """Yield description, model and settings of ``simulate`` of each motion; the last two take a tenth of the time."""
    hanging = Model(steel())
    swing = {"base": SWING, "start": "equilibrium", "duration": seconds}
    law = ModalDamping(natural_modes(hanging, count=len(DAMPING_RATIOS)), DAMPING_RATIOS)
    yield "mode 1, modal law", hanging, {**swing, "damping": law}
    yield "mode 1, mass-proportional", hanging, {**swing, "damping": RayleighDamping(alpha=0.2325)}
    weightless = Model(steel(axis=(1.0, 0.0), gravity=(0.0, 0.0)))
    start = static_equilibrium(weightless, tip_force=(0.0, 9.1 * BENDING_STIFFNESS / weightless.beam.length**2))
    yield (
        "undamped release from 0.8 L, tolerance 1e-6",
        weightless,
        {
            "start": start,
            "duration": seconds / 10,
            "tolerance": 1e-6,
        },
    )
    blow = HarmonicBase(amplitude=0.1e-3, frequency=94.3388)
    yield "mode 5 after a blow, tolerance 5e-5", hanging, {"base": blow, "duration": seconds / 10, "tolerance": 5e-5}


@contextmanager
def clocks(parts: dict[str, float]) -> Iterator[None]:
    """Add up the seconds spent in the Functions."""

    def clocked(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **options: Any) -> Any:
            began = time.process_time()
            result = function(*arguments, **options)
            parts[name] += time.process_time() - began
            return result

        return call

    class Clocked(Buffered):
        def __init__(self, function: Any, *inputs: Any, **options: Any) -> None:
            super().__init__(function, *inputs, **options)
            self._evaluate = clocked(function.name(), self._evaluate)

    with patch.object(stepper, "Buffered", Clocked), patch.object(newton, "Buffered", Clocked):
        yield


def noted(found: list[Stepper]) -> Any:
    """Note the steppers that a run makes."""
    init = Stepper.__init__

    def noting(one: Stepper, *arguments: Any, **options: Any) -> None:
        init(one, *arguments, **options)
        found.append(one)

    return patch.object(Stepper, "__init__", noting)


def seconds(model: Model, repeats: int = 3, **settings: Any) -> float:
    """Return the least processor time of several runs, s."""
    least = float("inf")
    for _ in range(repeats):
        began = time.process_time()
        simulate(model, method="radau", **settings)
        least = min(least, time.process_time() - began)
    return least


def main() -> None:
    """Print the cost of each motion."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="simulated time")
    for name, model, settings in motions(parser.parse_args().seconds):
        simulate(model, method="radau", **settings)  # compiles
        found: list[Stepper] = []
        with noted(found):
            simulate(model, method="radau", **settings)
        counts = {
            "steps": sum(one.steps for one in found),
            "iterations": sum(one.newton.iterations for one in found),
            "factorisations": sum(one.newton.factorisations for one in found),
        }
        everything = seconds(model, **settings)
        bare = seconds(model, **{**settings, "sample_rate": 2.0 / settings["duration"]})
        steps = counts["steps"]
        parts: dict[str, float] = defaultdict(float)
        with clocks(parts):
            seconds(model, 1, **settings)
        print(f"\n{name}: " + ", ".join(f"{count} {what}" for what, count in counts.items()))
        print(f"  {1e3 * everything / steps:.3f} ms per step, {1e3 * bare / steps:.3f} ms without samples")
        for part, spent in sorted(parts.items(), key=lambda item: -item[1]):
            print(f"  {part:>16} {1e6 * spent / steps:6.1f} us per step")


if __name__ == "__main__":
    main()
