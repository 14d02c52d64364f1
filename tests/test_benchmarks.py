"""Every benchmark runs at its smallest size, and prints what is true of it."""

import math
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = {path.stem: path.read_text(encoding="utf-8") for path in sorted((ROOT / "benchmarks").glob("*.py"))}
SCRIPTS = {name for name, source in SOURCES.items() if "\nif __name__ == " in source}
BENCHMARKS = SCRIPTS | {name for name, source in SOURCES.items() if "\ndef test_" in source}  # the others are shared


@dataclass(frozen=True)
class Smallest:
    """Arguments of a benchmark for its smallest size, and the rows that it prints.

    Parameters
    ----------
    benchmark, arguments : str
        File and command line; for a benchmark of pytest, which of its tests are selected.
    row : str
        Pattern of a row, with a group for each number.
    rows : int
        Number of rows.
    holds : callable
        What is true of the numbers of a row, which must be finite.
    needs : str, optional
        A library or program without which the benchmark cannot run.
    """

    benchmark: str
    arguments: str
    row: str
    rows: int
    holds: Callable[..., bool]
    needs: str | None = None


def selection(benchmark: str, tests: str, passed: int, needs: str | None = None) -> Smallest:
    """Return the smallest size of a benchmark of pytest, whose tests assert what is true."""
    return Smallest(benchmark, tests, r"=* *(\d+) passed, \d+ deselected in", 1, lambda count: count == passed, needs)


def positive(*numbers: float) -> bool:
    return min(numbers) > 0.0


def percentages(*numbers: float) -> bool:
    return min(numbers) >= 0.0 and max(numbers) <= 100.0


SMALLEST = [
    Smallest("co_simulation", "--laws rayleigh --kinds reduced --seconds 1",
             r"reduced +rayleigh +(\S+) +(\S+) .* (\S+) times real time", 2,
             lambda travel, error, factor: travel > 1.0 and error < 1e-4 and factor > 0.0, "fmpy"),
    Smallest("compare_exudyn", "--quick --shorten 100 --interpreted --law modal",
             r"the converged solutions are (\S+) apart", 2, lambda distance: distance < 5e-3, "exudyn"),
    Smallest("coverage", "--case curvature --seeds 2", r"curvature +\w+ +[0-2] +2 .* (\S+) +\S+ \+- \S+", 2,
             lambda coverage: 93.0 < coverage < 98.0),
    Smallest("decay_coverage", "--case white --runs 2",
             r"white +(\S+), (\S+), (\S+) +(\S+) +(\S+), (\S+), (\S+) +(\S+)", 1, positive),
    Smallest("decay_robustness", "--runs 3", r"(\d+) of 3 fits failed; processor time (\S+) s", 1,
             lambda failed, seconds: failed == 0 < seconds),
    Smallest("decay_robustness", "--long --runs 2", r"(\d+) of 2 fits failed; processor time (\S+) s", 1,
             lambda failed, seconds: failed == 0 < seconds),
    Smallest("first_call", "--cases fit --seconds 0.5", r"fit" + 4 * r" +(\S+) \( *(\S+)\)", 1,
             lambda first, first_used, second, second_used, *others: first_used > second_used > 0.0, "gcc"),
    selection("fit_coverage", "20-0 or 0-20 or constant-5 or 5-constant", 2),
    Smallest("fit_speed", "--scale 0.1 --case release",
             r"release, .* fit_beam (\S+) s, SciPy (\S+) s, ratio (\S+)", 1, positive),
    Smallest("frf_coverage", "--runs 1 --case hammer", r"\| hammer \| (\S+), (\S+), (\S+), (\S+) \|", 1, percentages),
    Smallest("imports", "--runs 1", r"(?:import|from|ancf-casadi) .* (\S+) s +(\S+)", 12,
             lambda seconds, ratio: 0.0 <= seconds and ratio >= 0.0),
    Smallest("integrators", "--cases drag --methods idas --seconds 0.1", r"drag +\w+ +(\S+) +(\S+) +(\S+) +(\d+)",
             1, lambda first, second, error, steps: min(first, second) > 0.0 and error < 1e-4 and steps > 10),
    Smallest("law_selection", "decays --runs 1 --jobs 1", r"\w+ +right +(\S+)%, settled +(\S+)%, .* law +(\S+)%", 3,
             lambda right, settled, wrong: right == 100.0 and wrong == 0.0),
    Smallest("law_selection", "calibration --weak --runs 1 --jobs 1",
             r"\w+ +right +(\S+)%, settled +(\S+)%, .* law +(\S+)%", 8, percentages),
    Smallest("mode_coverage", "--runs 1", r"\| .* \| (\S+), (\S+), (\S+) \| (\S+), (\S+), (\S+) \| \S+ s \|", 6,
             percentages),
    Smallest("modes_apart", "--runs 1 --jobs 1", r"\w+ +told apart +(\S+)%", 3, lambda share: share == 100.0),
    Smallest("noise_coverage", "--runs 2", r" *\d+ +[-0-9., ]+  (\S+), (\S+), (\S+), (\S+)", 23, percentages),
    Smallest("plan_errors", "--case statics --seeds 3",
             r"statics, \w+: expected (\S+), scatter .* linear estimates (\S+)", 2,
             lambda expected, ratio: expected > 0.0 and abs(ratio - 1.0) < 0.1),
    Smallest("posterior", "--seeds 1", r"\w[a-z ]+" + 8 * r" +(\d+)" + r"   p = (\S+)", 3,
             lambda *numbers: sum(numbers[:8]) == 1 and 0.0 < numbers[8] < 1.0, "nutpie"),
    Smallest("radau_step", "--seconds 0.2", r"  (\S+) ms per step, (\S+) ms without samples", 4, positive),
    Smallest("response", "--seconds 0.1", r".* (\d+) points  per 100: +(\S+) s +(\S+) CPU s +(\S+)", 4, positive),
    Smallest("robustness", "--inputs 20 --calls 20", r"[a-z ]+ (?:refused|returned) +(\d+)", 7, positive),
    Smallest("simulators", "--case rayleigh --programs mujoco",
             r"\| rayleigh \| mujoco \| .* \| (\S+) % \| (\S+) % \| (\S+) % \| (\S+) % \| (\S+) \|", 1,
             lambda *errors: max(map(abs, errors[:4])) < 1.0, "mujoco"),
    Smallest("study", "examples/beam.toml --quick", r"quick.* (\S+) s +(\S+) CPU s", 3, positive),
    selection("test_animation", "html", 1),
    selection("test_decay_fit", "linear and 1.85", 1),
    selection("test_export", "right_hand_side and 20-strain-rate", 1, "gcc"),
    selection("test_meshes", "20 and not 200", 3),
    selection("test_modes", "low or 4-3 or leakage", 3),
    selection("test_reading", "plain-1000 or memory and not 10000000", 2),
    selection("test_reduction", "5-undamped--O2", 1, "gcc"),
    selection("test_speed", "expand_function or matching or tangent", 3),
    Smallest("video_tracks", "--patterns dots --frames 62", r"dots +\w+ +\w+ +ours +(\S+) +(\S+) +(\d+) +(\S+)", 4,
             lambda rms, largest, lost, ratio: rms < 0.05 and largest < 0.2 and lost == 0 and 0.5 < ratio < 2.0, "cv2"),
]  # fmt: skip


def test_every_benchmark_has_a_smallest_size():
    assert {size.benchmark for size in SMALLEST} == BENCHMARKS


@pytest.mark.slow
@pytest.mark.parametrize("size", SMALLEST, ids=lambda size: f"{size.benchmark} {size.arguments}")
def test_benchmark(size):
    if size.needs and not (find_spec(size.needs) or shutil.which(size.needs)):
        pytest.skip(f"there is no {size.needs}")
    if size.benchmark in SCRIPTS:
        command = [f"benchmarks.{size.benchmark}", *size.arguments.split()]
    else:
        selected = f"benchmarks/{size.benchmark}.py", "-k", size.arguments
        command = ["pytest", "-n", "0", "-p", "no:cacheprovider", "--benchmark-disable", *selected]
    run = subprocess.run([sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    rows = [re.match(size.row, line) for line in run.stdout.splitlines()]
    numbers = [tuple(map(float, row.groups())) for row in rows if row]
    assert len(numbers) == size.rows, run.stdout
    assert all(math.isfinite(number) for row in numbers for number in row)
    assert all(size.holds(*row) for row in numbers), numbers
