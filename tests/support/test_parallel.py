"""Parallel runs give the same numbers as serial runs, and their processes end with their parent."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from multiprocessing import get_context

import pytest

from ancf_casadi import (
    Beam,
    InputError,
    Model,
    NumericsError,
    RayleighDamping,
    SimulationError,
    run_all,
    simulate,
)

SCRIPT = """
import time
from functools import partial
from ancf_casadi import run_all
{guard}:
    run_all([partial(time.sleep, {seconds})] * 2, jobs=2, progress=True)
"""


@pytest.fixture(scope="module")
def tasks():
    beam = Beam.uniform(length=0.2, width=0.01, thickness=2e-3, density=1070.0, elastic_modulus=264e3, elements=2)
    laws = [RayleighDamping(alpha=0.5), RayleighDamping(beta=1e-3)]
    return [
        partial(simulate, Model(beam), damping=law, start="straight", duration=0.05, method=method)
        for law in laws
        for method in ("idas", "radau")
    ]


@pytest.mark.slow
def test_executors_give_the_numbers_of_the_serial_run(tasks):
    serial = run_all(tasks)
    with ThreadPoolExecutor(2) as threads, ProcessPoolExecutor(1, get_context("spawn")) as processes:
        others = [run_all(tasks, executor=executor) for executor in (threads, processes)]
    others.append(run_all(tasks, jobs=2, sizes=[1.0, 4.0, 2.0, 3.0]))
    assert abs(serial[0].tip - serial[2].tip).max() > 1e-9
    for other in others:
        for run, same in zip(serial, other, strict=True):
            assert run.coordinates.tobytes() == same.coordinates.tobytes()
            assert run.dissipated_energy.tobytes() == same.dissipated_energy.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_an_error_of_a_task_is_that_of_all(tasks, jobs):
    with pytest.raises(InputError, match="tolerance: must be positive"):
        run_all([partial(tasks[0], tolerance=-1.0), *tasks], jobs=jobs)
    with pytest.raises(SimulationError) as caught:
        run_all([partial(tasks[0], options={"max_num_steps": 1})] * 2, jobs=jobs)
    assert len(caught.value.partial.time) == 0


@pytest.mark.slow
def test_progress_is_shown_on_the_error_stream(tasks, capsys):
    run_all(tasks[:2], progress=True)
    assert "runs: 100%" in capsys.readouterr().err


def script(tmp_path, guard, seconds):
    path = tmp_path / "script.py"
    path.write_text(SCRIPT.format(guard=guard, seconds=seconds))
    return path


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("name", ["SIGTERM", "SIGKILL", "SIGHUP"])
def test_processes_end_with_their_parent(tmp_path, name):
    """The pipe to which all processes write closes when the last one has ended, however the parent ends."""
    path = script(tmp_path, 'if __name__ == "__main__"', 600)
    with subprocess.Popen([sys.executable, path], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stderr is not None
        while b"runs:" not in process.stderr.read1():
            assert process.poll() is None
        started = time.monotonic()
        while len(children(process.pid)) < 3 and time.monotonic() < started + 20.0:  # resource tracker, two workers
            time.sleep(0.1)
        left = children(process.pid)
        process.send_signal(getattr(signal, name))
        try:
            process.communicate(timeout=20)
        finally:
            for number in left:
                if os.path.exists(f"/proc/{number}"):
                    os.kill(number, signal.SIGKILL)
    assert len(left) == 3
    assert process.returncode == -getattr(signal, name)


def children(number):
    listed = subprocess.run(["ps", "-o", "pid=", "--ppid", str(number)], capture_output=True, text=True, check=False)
    return [int(line) for line in listed.stdout.split()]


@pytest.mark.slow
@pytest.mark.parametrize("guard", ["if True", "try: pass\nfinally"])
def test_a_script_without_a_guard_is_refused_once(tmp_path, guard):
    done = subprocess.run(
        [sys.executable, script(tmp_path, guard, 0.0)], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 1
    assert done.stderr.count("Traceback") == 1
    assert done.stderr.splitlines()[-1].startswith("ancf_casadi.exceptions.InputError: jobs: ")
    assert 'under if __name__ == "__main__":' in done.stderr.splitlines()[-1]


@pytest.mark.slow
def test_a_script_without_a_file_is_refused(tmp_path):
    text = script(tmp_path, "if True", 0.0).read_text()
    done = subprocess.run(
        [sys.executable, "-"], input=text, capture_output=True, text=True, timeout=60, check=False, cwd=tmp_path
    )
    assert done.stderr.count("Traceback") == 1
    assert "InputError: jobs: processes import the script, and <stdin> is not a file" in done.stderr.splitlines()[-1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"tasks": [lambda: 1, int]}, "tasks: number 1 cannot be sent to another process"),
        ({"tasks": [int, 3]}, "tasks: must be a sequence of functions"),
        ({"tasks": int}, "tasks: must be a sequence of functions"),
        ({"tasks": [int], "jobs": 1.5}, "jobs: must be a whole number, 1 or more, got 1.5"),
        ({"tasks": [int], "jobs": 0}, "jobs: must be a whole number, 1 or more, got 0"),
        ({"tasks": [int, int], "sizes": [1.0]}, "sizes: has 1 values for 2 tasks"),
    ],
)
def test_unusable_tasks_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        run_all(**{"jobs": 2, **arguments})


def test_a_process_that_dies_is_a_numerical_failure_and_keeps_the_results_of_others():
    with pytest.raises(NumericsError, match="a process ended before its task was done") as caught:
        run_all([partial(int, "7"), partial(die_later, 0.3)], jobs=2)
    assert caught.value.results == {0: 7}
    assert len(caught.value.__notes__) == 1


def die_later(seconds):
    time.sleep(seconds)
    os._exit(3)


@pytest.mark.parametrize("workers", [None, 1, 3])
def test_a_task_that_raises_keeps_the_results_of_others(workers):
    tasks = [partial(int, "7"), partial(int, "no number"), partial(int, "8")]
    with contextlib.ExitStack() as stack:
        executor = workers and stack.enter_context(ThreadPoolExecutor(workers))
        with pytest.raises(ValueError, match="invalid literal") as caught:
            run_all(tasks, executor=executor)
    assert caught.value.results.items() >= {0: 7}.items()
    assert caught.value.results.keys() <= {0, 2}
