"""Many runs at once give the numbers of one after the other."""

from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from multiprocessing import get_context

import pytest

from ancf_casadi import Beam, InputError, Model, RayleighDamping, SimulationError, run_all, simulate


@pytest.fixture(scope="module")
def tasks():
    beam = Beam.uniform(length=0.2, width=0.01, thickness=2e-3, density=1070.0, elastic_modulus=264e3, elements=2)
    laws = [RayleighDamping(alpha=0.5), RayleighDamping(beta=1e-3)]
    return [
        partial(simulate, Model(beam), damping=law, start="straight", duration=0.05, method=method)
        for law in laws
        for method in ("idas", "radau")
    ]


def test_executors_give_the_numbers_of_the_serial_run(tasks):
    serial = run_all(tasks)
    with ThreadPoolExecutor(2) as threads, ProcessPoolExecutor(1, get_context("spawn")) as processes:
        others = [run_all(tasks, executor=executor) for executor in (threads, processes)]
    others.append(run_all(tasks, jobs=2, sizes=[1.0, 4.0, 2.0, 3.0]))
    assert abs(serial[0].tip - serial[2].tip).max() > 1e-9
    for other in others:
        for one, same in zip(serial, other, strict=True):
            assert one.coordinates.tobytes() == same.coordinates.tobytes()
            assert one.dissipated_energy.tobytes() == same.dissipated_energy.tobytes()


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_error_of_a_task_is_that_of_all(tasks, jobs):
    with pytest.raises(InputError, match="tolerance: must be positive"):
        run_all([partial(tasks[0], tolerance=-1.0), *tasks], jobs=jobs)
    with pytest.raises(SimulationError) as caught:
        run_all([partial(tasks[0], options={"max_num_steps": 1})], jobs=jobs)
    assert len(caught.value.partial.time) == 0


def test_progress_is_shown_on_the_error_stream(tasks, capsys):
    run_all(tasks[:2], progress=True)
    assert "runs: 100%" in capsys.readouterr().err
