"""Time of ``ancf-casadi reproduce``: a quick look and the whole paper, from an empty cache and with compiled equations.

Usage: python benchmarks/study.py [--quick]

Each row is a new process with its own folder of results; ``again`` runs in the folder of the row above and takes up all
its finished computations.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.clock import processor_time


def timed(out: Path, cache: Path, *options: str) -> tuple[float, float]:
    """Return the time (s) and the processor time (s) of a run and its processes."""
    environment = os.environ | {"ANCF_CASADI_CACHE": str(cache)}
    used, began = processor_time(), time.perf_counter()
    command = [sys.executable, "-m", "problems.cli", "reproduce", "--out", str(out), *options]
    subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.perf_counter() - began, processor_time() - used


def main() -> None:
    """Print the times."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="time the quick look only")
    whole = not parser.parse_args().quick
    with tempfile.TemporaryDirectory() as folder:
        cache, quick, full = Path(folder) / "cache", Path(folder) / "quick", Path(folder) / "full"
        rows = [("quick, empty cache", Path(folder) / "first", "--quick"), ("quick", quick, "--quick"),
                ("quick, again", quick, "--quick")]  # fmt: skip
        rows += [("whole paper", full, ""), ("whole paper, again", full, "")] if whole else []
        for name, out, option in rows:
            seconds, used = timed(out, cache, *([option] if option else []))
            print(f"{name:22s} {seconds:6.1f} s  {used:6.1f} CPU s", flush=True)


if __name__ == "__main__":
    main()
