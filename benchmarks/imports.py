"""Processor time of imports and of the help texts of the command, relative to the import of numpy and casadi.

Usage: python -m benchmarks.imports [--runs 5]

Each row is the least of several new processes, which take turns with the others.
"""

from __future__ import annotations

import argparse
import subprocess
import sys

from benchmarks.clock import processor_time

COMMANDS = ("--version", "--help", "init --help", "inspect --help", "fit-decay --help", "run --help")
IMPORTS = (
    "import numpy, casadi",
    "import ancf_casadi",
    "from ancf_casadi import Beam",
    "from ancf_casadi import simulate",
    "from problems import fit_decay",
    "from problems import run_study",
)


def used(arguments: list[str]) -> float:
    """Return the processor time (s) of a Python process."""
    began = processor_time()
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
    return processor_time() - began


def main() -> None:
    """Print the times."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=5)
    runs = parser.parse_args().runs
    calls = {code: ["-c", code] for code in IMPORTS}
    calls |= {f"ancf-casadi {line}": ["-m", "problems.cli", *line.split()] for line in COMMANDS}
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(runs):
        for name, arguments in calls.items():
            times[name].append(used(arguments))
    bare = min(times[IMPORTS[0]])
    for name, found in times.items():
        print(f"{name:36s} {min(found):5.2f} s  {min(found) / bare:4.1f}")


if __name__ == "__main__":
    main()
