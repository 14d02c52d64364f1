import signal
import time
import tracemalloc

import pytest

from ancf_casadi import Beam, Model, reduce_model, simulate_reduced


@pytest.fixture(scope="module")
def one_mode():
    beam = Beam.uniform(length=0.5, width=5e-3, thickness=5e-4, density=8000.0, elastic_modulus=210e9, elements=2)
    return reduce_model(Model(beam), modes=1)


@pytest.mark.slow
def test_the_memory_of_a_run_grows_with_its_samples_not_with_its_steps(one_mode):
    def steps_and_memory(steps_per_period):
        tracemalloc.start()
        try:
            return simulate_reduced(one_mode, duration=0.01, steps_per_period=steps_per_period).steps, (
                tracemalloc.get_traced_memory()[1]
            )
        finally:
            tracemalloc.stop()

    few, least = steps_and_memory(1e5)
    many, most = steps_and_memory(1e6)
    assert many > 9 * few > 10_000
    assert most < 1.5 * least


@pytest.mark.slow
def test_ctrl_c_ends_a_run_of_very_many_steps_within_a_second(one_mode):
    """The run itself would take more than ten seconds."""
    handler = signal.signal(signal.SIGPROF, lambda *_: signal.raise_signal(signal.SIGINT))
    began = time.process_time()
    signal.setitimer(signal.ITIMER_PROF, 0.5)
    try:
        with pytest.raises(KeyboardInterrupt):
            simulate_reduced(one_mode, duration=0.01, steps_per_period=1e8)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, handler)
    assert time.process_time() - began < 1.5
