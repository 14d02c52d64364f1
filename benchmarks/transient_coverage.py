"""How often the 95 % intervals of a fit to large motion hold the truth: seeded records of one beam, refitted.

    .venv/bin/python benchmarks/transient_coverage.py --runs 100 --jobs 2

The share that holds should be within 90 and 99 % at 100 runs.
"""

from __future__ import annotations

import argparse
from functools import partial

import numpy as np

from ancf_casadi import Beam, HarmonicBase, Model, QuadraticDamping, run_all, simulate
from problems import MarkerRecord, fit_transient

TRUTH = QuadraticDamping(eta1=0.6, eta2=4.0)
NOISE = 0.5e-3  # m
BASE = HarmonicBase(0.02, 2.0, stop=0.5)


def held_by(seed: int) -> list[float]:
    """Return 1 for each of eta1 and eta2 that its interval holds, 0 for the others."""
    strip = {"length": 0.2, "width": 0.01, "thickness": 2e-3, "density": 1070.0, "elastic_modulus": 264e3}
    model = Model(Beam.uniform(**strip, elements=3))
    run = simulate(model, damping=TRUTH, base=BASE, duration=1.5, sample_rate=40.0, method="radau", tolerance=1e-7)
    noise = NOISE * np.random.default_rng(seed).normal(size=run.tip.shape)
    record = MarkerRecord(run.time, run.tip + noise, base=BASE)
    found = fit_transient(model, record, QuadraticDamping(0.3, 8.0), tolerance=1e-5)
    low, high = found.fit.intervals().T
    return [float(inside) for inside in (low <= [0.6, 4.0]) & ([0.6, 4.0] <= high)]


def main() -> None:
    """Run the study, and print a line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    held = np.array(run_all([partial(held_by, seed) for seed in range(options.runs)], jobs=options.jobs))
    print(
        f"held by the intervals of eta1 and eta2 in {options.runs} runs: " + ", ".join(f"{x:.0%}" for x in held.mean(0))
    )


if __name__ == "__main__":
    main()
