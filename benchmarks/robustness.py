"""Mutated inputs of the readers and commands, and hostile calls of public functions, seeded.

Each input is read or refused with one line, and each call returns or is refused with an error of the package.  What
asks for more than 10 s of processor time is interrupted as by Ctrl-C, and ends within 2 s: a command with one line and
exit code 130, a call with ``KeyboardInterrupt`` or what it has by then.  No process is left.  Anything else is a fault
and is printed.  The mutations and the calls are those of the tests.

    python -m benchmarks.robustness --seed 1 --inputs 20000 --calls 5000
"""

import argparse
import contextlib
import io
import multiprocessing
import random
import re
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from ancf_casadi import InputError
from problems.cli import main
from problems.command.init import STUDY
from tests.hostile_calls import SECONDS, every_call, hostile_call, outcome
from tests.problems.command.test_mutations import COMMANDS, OPTIONS
from tests.problems.command.test_mutations import mutated as mutated_study
from tests.records.reading.test_mutations import library_files, text_files
from tests.records.reading.test_mutations import mutated as mutated_file

SHARES = {"text file": 0.55, "binary file": 0.25, "study": 0.1, "options": 0.1}  # of the inputs
QUICK = ("returned", "refused")
KNOWN = (*QUICK, "stopped")
MOST_CHARACTERS = 1000  # of a refusal
SHORT = {"elements = 8": "elements = 2", "duration = 2.0": "duration = 0.01", "stop = 1.0": "stop = 0.01"}


def command(*arguments: str) -> None:
    """Run the command in this process; raise an error of the package if it refuses in one line."""
    errors = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(errors):
        try:
            code: object = main(arguments)
        except SystemExit as stopped:  # an option that argparse refuses
            code = stopped.code
    found = re.findall(r"^ancf-casadi[\w -]*: (?!warning: ).*", errors.getvalue(), flags=re.MULTILINE)
    if code not in (0, 1, 2, 130) or len(found) != (code != 0) or any(len(line) > MOST_CHARACTERS for line in found):
        raise AssertionError(f"exit code {code} with {len(found)} lines: {errors.getvalue()[:200]}")
    if code == 130:
        raise KeyboardInterrupt
    if code:
        raise InputError("in one line")


def inputs(rng: random.Random, files: dict[str, dict[str, bytes]]) -> tuple[str, list[str]]:
    """Draw an input, write it to the current folder, and return its kind and the arguments of a command."""
    (kind,) = rng.choices(list(SHARES), list(SHARES.values()))
    if kind == "study":
        text = STUDY
        for long, quick in SHORT.items():
            text = text.replace(long, quick)
        Path("study.toml").write_text(mutated_study(text, rng))
        return kind, rng.choice(COMMANDS)
    if kind == "options":
        options = [part for name in rng.sample(sorted(OPTIONS), 2) for part in (name, rng.choice(OPTIONS[name]))]
        return kind, ["fit-decay", "decay.csv", *options]
    name = rng.choice(sorted(files[kind]))
    Path(name).write_bytes(mutated_file(rng, files[kind][name]))
    return kind, ["inspect", name]


def try_inputs(seed: int, count: int) -> Counter[tuple[str, str]]:
    """Count the outcomes of mutated inputs by kind."""
    rng = random.Random(seed)
    counts: Counter[tuple[str, str]] = Counter()
    Path("seeds").mkdir()
    binary = library_files(Path("seeds"))
    files = {
        "text file": text_files(None),
        "binary file": {name: data for name, data in binary.items() if not name.endswith((".mat", ".h5"))},
    }  # without those that need a process each
    instants = np.arange(0.0, 5.0, 0.01)
    motion = 5.0 * np.exp(-0.3 * instants) * np.cos(19.0 * instants)
    np.savetxt("decay.csv", np.column_stack([instants, motion]), delimiter=",", header="time_s,tip_mm", comments="")
    for number in range(count):
        kind, arguments = inputs(rng, files)
        result = outcome(command, {}, arguments)
        fault = result not in KNOWN
        counts[kind, "fault" if fault else result] += 1
        if result not in QUICK:
            print(f"input {number}, {' '.join(arguments)[:300]}: {result}", flush=True)
        if fault:
            Path("faults").mkdir(exist_ok=True)
            if Path(arguments[1]).is_file():
                Path("faults", f"{number}-{Path(arguments[1]).name}").write_bytes(Path(arguments[1]).read_bytes())
    return counts


def try_calls(calls: Iterable[tuple[str, dict[str, Any], Callable[..., object]]]) -> Counter[tuple[str, str]]:
    """Count the outcomes of hostile calls."""
    counts: Counter[tuple[str, str]] = Counter()
    for number, (name, arguments, function) in enumerate(calls):
        result = outcome(function, arguments)
        counts["call", result if result in KNOWN else "fault"] += 1
        if result not in QUICK:
            print(f"call {number}, {name}: {result}", flush=True)
    return counts


def run() -> None:
    """Try the inputs and the calls, and print how many ended how."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--inputs", type=int, default=20_000)
    parser.add_argument("--calls", type=int, default=5_000)
    parser.add_argument("--every", action="store_true", help="also each argument with each hostile value")
    parser.add_argument("--folder", type=Path, help="folder for the files, which are then kept")
    options = parser.parse_args()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a process in the background ignores Ctrl-C
    began = time.process_time()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        with contextlib.chdir(folder):
            rng = random.Random(options.seed)
            drawn = (hostile_call(rng, Path.cwd()) for _ in range(options.calls))
            counts = try_inputs(options.seed, options.inputs) + try_calls(drawn)
            if options.every:
                counts += try_calls(every_call(Path.cwd()))
    for (kind, result), times in sorted(counts.items()):
        print(f"{kind:12} {result:10} {times:7d}")
    print(f"{time.process_time() - began:.0f} s of processor time; work is stopped after {SECONDS:g} s")
    left = multiprocessing.active_children()
    if left:
        print(f"processes left: {left}")
    sys.exit(bool(left) or any(result == "fault" for _, result in counts))


if __name__ == "__main__":
    run()
