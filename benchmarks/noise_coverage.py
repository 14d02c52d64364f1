"""Coverage of 95 % intervals from coloured residuals, in a linear model of six periods of a decay.

    .venv/bin/python -m benchmarks.noise_coverage --runs 1000

Each of one or four sensors sees the decay with a phase and an offset of its own, in autoregressive noise.  The unknowns
are the changes of the decay with its amplitude, phase, frequency and damping; the table lists the percentage of their
intervals that cover the truth.  A record takes 2 ms, so that the noise model alone is tested, with many seeds.
"""

from __future__ import annotations

import argparse
import math
from concurrent.futures import Executor
from functools import partial

import numpy as np
from scipy.signal import lfilter

from ancf_casadi.estimation.fit import quantile
from ancf_casadi.estimation.noise.spectrum import estimated_noise
from ancf_casadi.support.parallel import run_all
from ancf_casadi.support.tables import Table

ALONE = [(samples, (rho,)) for samples in (60, 100, 200, 1000) for rho in (0.0, 0.3, 0.5, 0.9)]
TOGETHER = [(60, (rho,) * 4) for rho in (0.0, 0.3, 0.5, 0.9)] + [
    (60, (0.0, 0.5, 0.0, 0.8)),
    (60, (0.0, 0.0, 0.8, 0.8)),
    (60, (-0.4, 0.0, 0.0, 0.8)),
]


def columns(samples: int, sensors: int) -> np.ndarray:
    """Return the derivatives by the four unknowns of the decay, and by the offset of each sensor."""
    t, found = np.arange(samples) / samples, []
    for k in range(sensors):
        angle = 12 * math.pi * t + 0.9 * k
        waves = np.column_stack([np.cos(angle), np.sin(angle)]) * np.exp(-3 * t)[:, None]
        found.append(np.column_stack([waves, t[:, None] * waves]))
    return np.column_stack([np.concatenate(found), np.kron(np.eye(sensors), np.ones((samples, 1)))])


def hits(samples: int, colours: tuple[float, ...], seed: int) -> list[bool]:
    """Return whether the interval of each unknown of the decay covers its true value, which is 0."""
    rng = np.random.default_rng(seed)
    basis, triangle = np.linalg.qr(columns(samples, len(colours)))
    noise = np.concatenate([
        lfilter([math.sqrt(1 - rho**2)], [1.0, -rho], rng.standard_normal(samples + 300))[300:] for rho in colours
    ])  # fmt: skip
    inverse, found = np.linalg.inv(triangle)[:4], basis.T @ noise
    scatter = estimated_noise(noise - basis @ found, basis, [samples] * len(colours), None)
    half = quantile(0.95, scatter.freedom) * np.sqrt(np.diag(inverse @ scatter.form(basis) @ inverse.T))
    return list(np.abs(inverse @ found) < half)


def coverage(runs: int, *, executor: Executor | None = None, jobs: int = 1) -> Table:
    """Return the coverage of each unknown, one row per number of samples and colours."""
    rows = []
    for samples, colours in ALONE + TOGETHER:
        tasks = [partial(hits, samples, colours, seed) for seed in range(runs)]
        shares = 100 * np.mean(run_all(tasks, executor=executor, jobs=jobs), axis=0)
        rows.append((samples, ", ".join(map(str, colours)), ", ".join(f"{share:.1f}" for share in shares)))
    return Table("coverage", f"Coverage of {runs} records", ("samples of each", "rho", "covered, %"), rows)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    print(coverage(options.runs, jobs=options.jobs).text())


if __name__ == "__main__":
    main()
