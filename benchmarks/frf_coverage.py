"""Coverage of modes from force and response over time, under a hammer and a shaker, with noise on both channels.

python -m benchmarks.frf_coverage --runs 400

Prints the share of 95 % intervals that hold the truth, and the mean and standard deviation of the standardised errors,
for frequency and damping ratio of two modes; ``docs/how_to/frequency_response_functions.md`` states the result.
"""

import argparse
import time

import numpy as np

from tests.problems.frf.time_records import CASES, fit_records, intervals_hold


def main() -> None:
    """Print a table with one row per case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--case", choices=tuple(CASES), action="append", help="all if not given")
    options = parser.parse_args()
    print("| case | covered, f1, zeta1, f2, zeta2, % | mean error | its deviation | time of a fit |")
    print("|---|---|---|---|---|")
    for name in options.case or CASES:
        begin = time.perf_counter()
        results = np.array([intervals_hold(fit_records(*CASES[name], seed)) for seed in range(options.runs)])
        each, (holds, scores) = (time.perf_counter() - begin) / options.runs, np.moveaxis(results, 2, 0)
        rows = 100 * holds.mean(axis=0), scores.mean(axis=0), scores.std(axis=0)
        shares = [
            ", ".join(f"{value:.{digits}f}" for value in row) for row, digits in zip(rows, (1, 2, 2), strict=True)
        ]
        print(f"| {name} | {shares[0]} | {shares[1]} | {shares[2]} | {each:.2f} s |", flush=True)


if __name__ == "__main__":
    main()
