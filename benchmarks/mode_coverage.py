"""Coverage of frequency and damping against amplitude of one mode, from simulated stepped sines.

python -m benchmarks.mode_coverage --runs 200

Prints the share of 95 % bands that hold the truth at three amplitudes; ``docs/how_to/one_mode.md`` states the result.
The records of response control have phases with the wrong sign and reference.
"""

import argparse
import time

import numpy as np

from tests.problems.mode.oscillators import CASES, held, records, truth_of


def main() -> None:
    """Print a table with one row per oscillator and kind of control."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=200)
    runs = parser.parse_args().runs
    print("| oscillator | held | frequency, three amplitudes, % | damping ratio, % | time of a fit |")
    print("|---|---|---|---|---|")
    for name, (one, laws) in CASES.items():
        truth = truth_of(one)
        for control in ("force", "response"):
            curves, begin = records(one, control), time.perf_counter()
            turn = (lambda phases: np.pi - phases) if control == "response" else None
            hits = 100 * np.mean([held(curves, laws, truth, seed, turn) for seed in range(runs)], axis=0)
            each = (time.perf_counter() - begin) / runs
            shares = [", ".join(f"{share:.1f}" for share in row) for row in hits]
            print(f"| {name} | {control} | {shares[0]} | {shares[1]} | {each:.2f} s |", flush=True)


if __name__ == "__main__":
    main()
