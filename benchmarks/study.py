"""Time of a study, by default of the paper: a quick look and the whole, from an empty cache and with compiled ones.

Usage: python -m benchmarks.study [STUDY.toml] [--quick]

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


def timed(cache: Path, *arguments: str) -> tuple[float, float]:
    """Return the time (s) and the processor time (s) of a run and its processes."""
    environment = os.environ | {"ANCF_CASADI_CACHE": str(cache)}
    used, began = processor_time(), time.perf_counter()
    command = [sys.executable, "-m", "problems.cli", *arguments]
    subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.perf_counter() - began, processor_time() - used


def main() -> None:
    """Print the times."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="time the quick look only")
    parser.add_argument("study", nargs="?", help="file of the study; the paper if not given")
    options = parser.parse_args()
    command = ("run", options.study) if options.study else ("reproduce",)
    with tempfile.TemporaryDirectory() as folder:
        cache, quick, full = Path(folder) / "cache", Path(folder) / "quick", Path(folder) / "full"
        rows = [("quick, empty cache", Path(folder) / "first"), ("quick", quick), ("quick, again", quick)]
        rows += [("whole", full), ("whole, again", full)] if not options.quick else []
        for name, out in rows:
            seconds, used = timed(cache, *command, "--out", str(out), *([] if out == full else ["--quick"]))
            print(f"{name:22s} {seconds:6.1f} s  {used:6.1f} CPU s", flush=True)


if __name__ == "__main__":
    main()
