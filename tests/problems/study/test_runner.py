"""The order of steps, computations that run once, and results that are kept whatever ends a study."""

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import pytest

from ancf_casadi.exceptions import FitError, InputError
from problems.study.compute import Compute
from problems.study.runner import STEPS_FOLDER, run_steps
from problems.study.step import Finding, Findings, Step, Study
from problems.study.study import run_study
from tests.problems.conftest import BEAM, DECAYS, RAYLEIGH, without_times


def doubled(term: float, log: str) -> float:
    """Return twice a number, and note that this was asked; fail while there is a file ``fail``."""
    with open(log, "a", encoding="utf-8") as calls:
        calls.write(f"{term:g} ")
    if term < 0.0 and Path(log).with_name("fail").exists():
        raise KeyboardInterrupt if term < -5.0 else FitError("no minimum was found")
    return 2 * term


@final
@dataclass(frozen=True, kw_only=True)
class Doubles(Step):
    """Twice the sum of numbers, each after the results of other steps were added."""

    kind = "doubles"

    terms: tuple[float, ...]
    after: tuple[str, ...]
    log: str

    @property
    def needs(self) -> tuple[str, ...]:
        return self.after

    def finding(self, compute: Compute, findings: Findings) -> Finding:
        before = sum(findings[name].data["sum"] for name in self.after)
        results = compute.all(doubled, [(term + before, self.log) for term in self.terms])
        return Finding({"sum": sum(results)})


class Bench:
    """A folder in which studies run, and the calls of their computations."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.log = folder, folder / "calls"

    def step(self, name: str, *terms: float, after: tuple[str, ...] = ()) -> Doubles:
        return Doubles(name=name, title=name, terms=terms, after=after, log=str(self.log))

    def run(self, *steps: Step, jobs: int = 1, executor: Any = None) -> dict[str, float]:
        """Return the sum of each step."""
        self.log.unlink(missing_ok=True)
        self.ran = run_steps(Study(steps=steps), self.folder, formats=(), jobs=jobs, executor=executor, progress=False)
        return {finding.name: finding.data["sum"] for finding in self.ran}

    @property
    def calls(self) -> list[float]:
        return [float(term) for term in self.log.read_text().split()] if self.log.exists() else []

    @property
    def files(self) -> int:
        return len(list((self.folder / STEPS_FOLDER).glob("*")))


@pytest.fixture
def bench(tmp_path) -> Bench:
    return Bench(tmp_path)


class TestOrder:
    def test_a_step_runs_after_those_it_needs(self, bench):
        """3 after 1 and 2 in any order of the document: first all that need nothing."""
        steps = (bench.step("c", 0.5, after=("a", "b")), bench.step("d", 0.25, after=("c",)), bench.step("a", 1.0, 4.0),
                 bench.step("b", 3.0))  # fmt: skip
        assert bench.run(*steps) == {"a": 10.0, "b": 6.0, "c": 33.0, "d": 66.5}
        assert bench.calls == [1.0, 4.0, 3.0, 16.5, 33.25]
        assert [finding.name for finding in bench.ran] == ["c", "d", "a", "b"]
        assert [len(finding.times) for finding in bench.ran] == [1, 1, 2, 1]

    def test_equal_computations_run_once(self, bench):
        assert bench.run(bench.step("a", 1.0, 2.0, 1.0), bench.step("b", 2.0)) == {"a": 8.0, "b": 4.0}
        assert bench.calls == [1.0, 2.0]
        first, second = bench.ran
        assert (len(first.times), len(second.times)) == (2, 1)
        assert len(first.times.keys() & second.times.keys()) == 1
        assert first.seconds == sum(first.times.values()) > 0.0

    def test_no_computations_are_none(self, bench):
        assert bench.run(bench.step("a")) == {"a": 0}
        assert bench.calls == []


class TestKept:
    def test_a_finished_computation_does_not_run_again(self, bench):
        steps = (bench.step("a", 1.0, 2.0), bench.step("b", 3.0, after=("a",)))
        first = bench.run(*steps)
        assert bench.run(*steps) == first
        assert bench.calls == []
        assert bench.files == 3

    def test_times_are_those_of_the_first_run(self, bench):
        bench.run(bench.step("a", 1.0))
        (first,) = bench.ran
        bench.run(bench.step("a", 1.0))
        (again,) = bench.ran
        assert again.times == first.times
        assert first.seconds > 0.0

    def test_a_change_runs_what_depends_on_it_alone(self, bench):
        steps = [bench.step("a", 1.0, 2.0), bench.step("b", 5.0), bench.step("c", 3.0, after=("a",))]
        bench.run(*steps)
        steps[0] = bench.step("a", 1.0, 2.5)
        assert bench.run(*steps) == {"a": 7.0, "b": 10.0, "c": 20.0}
        assert bench.calls == [2.5, 10.0]

    def test_results_of_earlier_studies_are_removed(self, bench):
        bench.run(bench.step("a", 1.0, 2.0), bench.step("b", 3.0))
        assert bench.files == 3
        (bench.folder / STEPS_FOLDER / "notes.txt").write_text("of the user")
        bench.run(bench.step("a", 1.0, 2.0))
        assert bench.files == 2 + 1

    @pytest.mark.parametrize("damage", [b"", b"not ours"])
    def test_a_damaged_result_is_computed_again(self, bench, damage):
        bench.run(bench.step("a", 1.0, 2.0))
        for path in (bench.folder / STEPS_FOLDER).iterdir():
            path.write_bytes(damage)
        assert bench.run(bench.step("a", 1.0, 2.0)) == {"a": 6.0}
        assert sorted(bench.calls) == [1.0, 2.0]


class TestFailure:
    @pytest.mark.slow
    @pytest.mark.parametrize("how", ["serial", "threads", "processes"])
    def test_is_our_error_and_keeps_the_finished_computations(self, bench, how):
        """The failing computation is the last of its step; the others are not repeated."""
        (bench.folder / "fail").touch()
        steps = (bench.step("a", 1.0, 2.0), bench.step("b", 3.0, -11.0, after=("a",)))
        with ThreadPoolExecutor(1) as threads:
            options = {"serial": {}, "threads": {"executor": threads}, "processes": {"jobs": 2}}[how]
            with pytest.raises(FitError, match="no minimum was found"):
                bench.run(*steps, **options)
        (bench.folder / "fail").unlink()
        assert bench.run(*steps) == {"a": 6.0, "b": 8.0}
        assert set(bench.calls) <= {9.0, -5.0}
        assert -5.0 in bench.calls

    @pytest.mark.slow
    def test_an_interrupt_keeps_the_finished_computations(self, bench):
        (bench.folder / "fail").touch()
        steps = (bench.step("a", 1.0, 2.0, -6.0),)
        with pytest.raises(KeyboardInterrupt):
            bench.run(*steps)
        (bench.folder / "fail").unlink()
        assert bench.run(*steps) == {"a": -6.0}
        assert bench.calls == [-6.0]

    @pytest.mark.slow
    def test_a_folder_that_cannot_be_written_is_an_input_error(self, bench):
        (bench.folder / STEPS_FOLDER).write_text("in the way")
        with pytest.raises(InputError, match="steps"):
            bench.run(bench.step("a", 1.0))


@pytest.mark.slow
def test_any_executor_gives_the_same_files(study_file, tmp_path):
    """One after the other, in threads and in processes: the same numbers, tables and figures, to the last bit."""
    path = study_file(BEAM, DECAYS, RAYLEIGH)
    contents = []
    with ThreadPoolExecutor(2) as threads:
        for name, options in {"one": {}, "threads": {"executor": threads}, "processes": {"jobs": 2}}.items():
            run_study(path, tmp_path / name, **options)
            files = {
                str(file.relative_to(tmp_path / name)): file.read_bytes()
                for file in (tmp_path / name).rglob("*.*")
                if STEPS_FOLDER not in file.parts and file.suffix != ".html"
            }
            numbers = without_times(json.loads(files.pop("results.json")))
            contents.append((numbers, files))
    assert contents[0] == contents[1] == contents[2]
    assert {"tables/table_01.csv", "figures/figure_01.svg", "figures/figure_01.png"} <= contents[0][1].keys()


KILLED_RUNS = """
import os, signal, time
from pathlib import Path
from problems.study.runner import STEPS_FOLDER
from problems.study.study import run_study

def started(folder):
    child = os.fork()
    if child == 0:
        run_study("study.toml", folder, quick=True)
        os._exit(0)
    return child

def wait_for(count, folder):
    while len([*(Path(folder) / STEPS_FOLDER).glob("*.msgpack")]) < count:
        time.sleep(1e-3)

run_study("study.toml", "imports", quick=True)
complete = len([*(Path("imports") / STEPS_FOLDER).glob("*.msgpack")])
child = started("whole")
moments = [time.perf_counter()]
for count in range(1, complete + 1):
    wait_for(count, "whole")
    moments.append(time.perf_counter())
os.waitpid(child, 0)
moments.append(time.perf_counter())
for k in range(40):
    turn, count = divmod(k, complete + 1)
    child = started(f"killed_{k}")
    wait_for(count, f"killed_{k}")
    time.sleep((moments[count + 1] - moments[count]) * turn * (complete + 1) / 40)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="kill -9 is a signal of POSIX")
def test_a_study_that_is_killed_at_any_of_40_instants_continues(study_file, tmp_path):
    """The same numbers as in one run; no finished computation is repeated, and no damaged one is used."""
    path = study_file(DECAYS, RAYLEIGH)
    subprocess.run([sys.executable, "-c", KILLED_RUNS], cwd=tmp_path, check=True, timeout=300)
    whole = without_times(json.loads((tmp_path / "whole" / "results.json").read_text()))
    counts = set()
    for k in range(40):
        folder = tmp_path / f"killed_{k}"
        kept = {file: file.stat().st_mtime_ns for file in (folder / STEPS_FOLDER).glob("*.msgpack")}
        assert without_times(run_study(path, folder, quick=True).to_dict()) == whole, k
        assert kept == {file: file.stat().st_mtime_ns for file in kept}, k
        counts.add(len(kept))
    complete = len([*(tmp_path / "whole" / STEPS_FOLDER).glob("*.msgpack")])
    assert counts >= {*range(complete)}  # runs are killed from before the first computation to the last one


@pytest.mark.parametrize("jobs", [1, 2])
def test_steps_that_share_a_computation_wait_for_it_and_for_its_error(bench, jobs):
    """Both steps ask for the same at once; neither waits for ever, and the study ends with the error."""
    (bench.folder / "fail").touch()
    with ThreadPoolExecutor(2) as threads:
        executor = threads if jobs > 1 else None
        with pytest.raises(FitError, match="no minimum was found"):
            bench.run(bench.step("a", -1.0), bench.step("b", -1.0), executor=executor)
        (bench.folder / "fail").unlink()
        assert bench.run(bench.step("a", -1.0), bench.step("b", -1.0), executor=executor) == {"a": -2.0, "b": -2.0}
    assert bench.calls == [-1.0]
