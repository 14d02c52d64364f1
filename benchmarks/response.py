"""Time of response curves and backbones: the beam of the paper in eight modes, and the full beam with 20 elements.

    .venv/bin/python -m benchmarks.response            reduced model
    .venv/bin/python -m benchmarks.response --full     also the full beam, which takes minutes

The curve passes both folds of mode 2 under modal and quadratic damping.  Each time is also given relative to that of
10 s of ``simulate_reduced`` in the same process, because the machine is shared, and as processor time.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

from ancf_casadi import (
    HarmonicBase,
    ModalDamping,
    Model,
    QuadraticDamping,
    backbone,
    frequency_response,
    natural_modes,
    reduce_model,
    simulate_reduced,
)
from benchmarks.beams import steel

POINTS = 100


def timed(name: str, work: Callable[[], int], unit: float) -> float:
    """Print and return the time of some work, per 100 points."""
    began, used = time.perf_counter(), time.process_time()
    count = work()
    share = POINTS / count
    seconds, processor = (time.perf_counter() - began) * share, (time.process_time() - used) * share
    relative = f"{seconds / unit:6.1f}" if unit else "   1.0"
    print(f"{name:44s}{count:5d} points  per 100: {seconds:6.2f} s {processor:6.2f} CPU s {relative}", flush=True)
    return seconds


def main() -> None:
    """Print the times."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--full", action="store_true", help="also the full beam")
    parser.add_argument("--seconds", type=float, default=10.0, help="of simulate_reduced")
    options = parser.parse_args()
    model = Model(steel())
    modes = natural_modes(model, count=8)
    law = ModalDamping(modes, ratios=(0.01, 0.003, 0.003, 0.003, 0.003)) + QuadraticDamping(eta2=0.1)
    reduced = reduce_model(model, modes=modes, damping=law)
    base = HarmonicBase(amplitude=5e-4, frequency=10.0)

    def run() -> int:
        simulate_reduced(reduced, base=base, duration=options.seconds)
        return POINTS

    def curve() -> int:
        found = frequency_response(reduced, (10.0, 10.8), base=base)
        assert [own.kind for own in found.bifurcations] == ["fold", "fold"]
        return len(found.motions)

    run()  # compiles
    unit = timed(f"{options.seconds:g} s of simulate_reduced", run, 0.0)
    timed("mode 2 through both folds, 8 modes, first", curve, unit)
    timed("mode 2 through both folds, 8 modes, again", curve, unit)
    timed("backbone of mode 1, 8 modes", lambda: len(backbone(reduced, mode=1, amplitude=0.1).motions), unit)
    if options.full:
        timed(
            "mode 2 through both folds, full beam",
            lambda: len(frequency_response(model, (10.0, 10.8), damping=law, base=base).motions),
            unit,
        )


if __name__ == "__main__":
    main()
