"""The order of parts, tasks that run once, and results that are kept whatever ends a study."""

import json
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, final

import pytest

from ancf_casadi.exceptions import FitError, InputError
from problems.study.part import Finding, Found, Part, Study, Task
from problems.study.runner import STEPS_FOLDER, run_parts
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
class Doubles(Part):
    """Twice the sum of numbers, each after the results of other parts were added."""

    kind = "doubles"

    terms: tuple[float, ...]
    after: tuple[str, ...]
    log: str

    @property
    def needs(self) -> tuple[str, ...]:
        return self.after

    def tasks(self, found: Found) -> tuple[Task, ...]:
        before = sum(found[name].data["sum"] for name in self.after)
        return tuple(Task(doubled, (term + before, self.log), cost=term) for term in self.terms)

    def finding(self, results: Sequence[Any], found: Found) -> Finding:
        return Finding({"sum": sum(results)})


@final
@dataclass(frozen=True, kw_only=True)
class Largest(Part):
    """Another kind with the same fields and the same tasks."""

    kind = "largest"

    terms: tuple[float, ...]
    after: tuple[str, ...]
    log: str

    def tasks(self, found: Found) -> tuple[Task, ...]:
        return tuple(Task(doubled, (term, self.log)) for term in self.terms)

    def finding(self, results: Sequence[Any], found: Found) -> Finding:
        return Finding({"sum": max(results)})


class Bench:
    """A folder in which studies run, and the calls of their tasks."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.log = folder, folder / "calls"

    def part(self, name: str, *terms: float, after: tuple[str, ...] = ()) -> Doubles:
        return Doubles(name=name, title=name, terms=terms, after=after, log=str(self.log))

    def run(self, *parts: Part, jobs: int = 1, executor: Any = None) -> dict[str, float]:
        """Return the sum of each part."""
        self.log.unlink(missing_ok=True)
        study = Study("test", parts)
        self.ran = run_parts(study, self.folder, formats=(), jobs=jobs, executor=executor, progress=False)
        return {one.name: one.data["sum"] for one in self.ran}

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
    def test_a_part_runs_after_those_it_needs(self, bench):
        """3 after 1 and 2 in any order of the document: first all that need nothing, the longest task first."""
        parts = (bench.part("c", 0.5, after=("a", "b")), bench.part("d", 0.25, after=("c",)), bench.part("a", 1.0, 4.0),
                 bench.part("b", 3.0))  # fmt: skip
        assert bench.run(*parts) == {"a": 10.0, "b": 6.0, "c": 33.0, "d": 66.5}
        assert bench.calls == [4.0, 1.0, 3.0, 16.5, 33.25]
        assert [part.name for part in bench.ran] == ["c", "d", "a", "b"]
        assert [part.tasks for part in bench.ran] == [1, 1, 2, 1]

    def test_equal_tasks_run_once(self, bench):
        assert bench.run(bench.part("a", 1.0, 2.0, 1.0), bench.part("b", 2.0)) == {"a": 8.0, "b": 4.0}
        assert bench.calls == [2.0, 1.0]
        first, second = bench.ran
        assert (first.tasks, second.tasks) == (2, 1)
        assert len(first.times.keys() & second.times.keys()) == 1
        assert first.seconds == sum(first.times.values()) > 0.0

    def test_no_tasks_are_no_tasks(self, bench):
        assert bench.run(bench.part("a")) == {"a": 0}
        assert bench.calls == []


class TestKept:
    def test_a_finished_task_does_not_run_again(self, bench):
        parts = (bench.part("a", 1.0, 2.0), bench.part("b", 3.0, after=("a",)))
        first = bench.run(*parts)
        assert bench.run(*parts) == first
        assert bench.calls == []
        assert bench.files == 5  # the tasks and the finding of each part

    def test_times_are_those_of_the_first_run(self, bench):
        bench.run(bench.part("a", 1.0))
        (first,) = bench.ran
        bench.run(bench.part("a", 1.0))
        (again,) = bench.ran
        assert again.times == first.times
        assert first.seconds > 0.0

    def test_a_change_runs_what_depends_on_it_alone(self, bench):
        parts = [bench.part("a", 1.0, 2.0), bench.part("b", 5.0), bench.part("c", 3.0, after=("a",))]
        bench.run(*parts)
        parts[0] = bench.part("a", 1.0, 2.5)
        assert bench.run(*parts) == {"a": 7.0, "b": 10.0, "c": 20.0}
        assert bench.calls == [2.5, 10.0]
        parts[1] = replace(parts[1], title="another title")
        bench.run(*parts)
        assert bench.calls == []

    def test_results_of_earlier_studies_are_removed(self, bench):
        bench.run(bench.part("a", 1.0, 2.0), bench.part("b", 3.0))
        assert bench.files == 5
        (bench.folder / STEPS_FOLDER / "notes.txt").write_text("of the user")
        bench.run(bench.part("a", 1.0, 2.0))
        assert bench.files == 3 + 1

    def test_another_kind_of_part_with_the_same_fields_is_another_part(self, bench):
        one = bench.part("a", 1.0, 2.0)
        assert bench.run(one) == {"a": 6.0}
        other = Largest(name=one.name, title=one.title, terms=one.terms, after=one.after, log=one.log)
        assert bench.run(other) == {"a": 4.0}
        assert bench.calls == []  # the tasks are the same

    @pytest.mark.parametrize("damage", [b"", b"\x80", b"not ours"])
    def test_a_damaged_result_is_computed_again(self, bench, damage):
        bench.run(bench.part("a", 1.0, 2.0))
        for path in (bench.folder / STEPS_FOLDER).iterdir():
            path.write_bytes(damage)
        assert bench.run(bench.part("a", 1.0, 2.0)) == {"a": 6.0}
        assert sorted(bench.calls) == [1.0, 2.0]


class TestFailure:
    @pytest.mark.slow
    @pytest.mark.parametrize("how", ["serial", "threads", "processes"])
    def test_is_our_error_and_keeps_the_finished_tasks(self, bench, how):
        """The failing task is the last of its part; the rest is not computed again."""
        (bench.folder / "fail").touch()
        parts = (bench.part("a", 1.0, 2.0), bench.part("b", 3.0, -11.0, after=("a",)))
        with ThreadPoolExecutor(1) as threads:
            options = {"serial": {}, "threads": {"executor": threads}, "processes": {"jobs": 2}}[how]
            with pytest.raises(FitError, match="no minimum was found"):
                bench.run(*parts, **options)
        (bench.folder / "fail").unlink()
        assert bench.run(*parts) == {"a": 6.0, "b": 8.0}
        assert set(bench.calls) <= {9.0, -5.0}
        assert -5.0 in bench.calls

    @pytest.mark.slow
    def test_an_interrupt_keeps_the_finished_tasks(self, bench):
        (bench.folder / "fail").touch()
        parts = (bench.part("a", 1.0, 2.0, -6.0),)
        with pytest.raises(KeyboardInterrupt):
            bench.run(*parts)
        (bench.folder / "fail").unlink()
        assert bench.run(*parts) == {"a": -6.0}
        assert bench.calls == [-6.0]

    @pytest.mark.slow
    def test_a_folder_that_cannot_be_written_is_an_input_error(self, bench):
        (bench.folder / STEPS_FOLDER).write_text("in the way")
        with pytest.raises(InputError, match="steps"):
            bench.run(bench.part("a", 1.0))


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
