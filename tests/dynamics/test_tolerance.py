"""An excitation beyond all reason is refused before the first step, and a large one is not."""

import time

import numpy as np
import pytest

from ancf_casadi import (
    HarmonicBase,
    HarmonicLoad,
    InputError,
    SampledBase,
    SampledLoad,
    State,
    SweepBase,
    motion,
    reduce_model,
    simulate,
    simulate_reduced,
)

SETTINGS = {"duration": 0.5, "sample_rate": 100.0}
TIME = np.linspace(0.0, 0.5, 11)


def ramp(most):
    """A travel that begins and ends at rest."""
    return np.outer(most * (10 * (TIME / 0.5) ** 3 - 15 * (TIME / 0.5) ** 4 + 6 * (TIME / 0.5) ** 5), [1.0, 0.0])


UNREASONABLE = {
    "amplitude": (HarmonicBase(1e9, 2.0), "base: moves the clamp by .* at most 1000 lengths"),
    "frequency": (HarmonicBase(5e-3, 1.1e9), "base: moves at .* m/s at .* s, more than 10 times as fast"),
    "sweep": (SweepBase(1.0, (1.0, 1e6), stop=0.4), "base: moves at .* m/s at .* s, more than 10 times as fast"),
    "travel": (SampledBase(TIME, ramp(1e9)), "base: moves the clamp by 1e.09 m until 0.5 s"),
}
LOADS = {
    "harmonic": HarmonicLoad(force=(1e9, 0.0), frequency=2.0),
    "sampled": SampledLoad(TIME, np.outer(1e9 * np.sin(TIME), [1.0, 0.0])),
    "from the start": SampledLoad(TIME, np.full((11, 2), 1e9)),
}


@pytest.mark.parametrize(("base", "message"), UNREASONABLE.values(), ids=UNREASONABLE)
def test_a_base_motion_beyond_reason_is_refused_at_once(small, base, message):
    begin = time.process_time()
    for run in (simulate, motion):
        with pytest.raises(InputError, match=message):
            run(small, base=base, **SETTINGS)
    assert time.process_time() - begin < 5.0


@pytest.mark.parametrize("load", LOADS.values(), ids=LOADS)
def test_a_load_beyond_reason_is_refused_at_once(small, load):
    with pytest.raises(InputError, match=r"load: would bend the beam by .* of its lengths"):
        simulate(small, load=load, **SETTINGS)


def test_a_state_beyond_reason_is_refused_at_once(small):
    velocities = np.zeros(small.size)
    velocities[-4] = 1e9
    with pytest.raises(InputError, match=r"start: moves at 1e.09 m/s in the state"):
        simulate(small, start=State(small.straight, velocities), **SETTINGS)


def test_the_reduced_model_has_the_same_limits(small):
    reduced = reduce_model(small, modes=1)
    for base, message in UNREASONABLE.values():
        with pytest.raises(InputError, match=message):
            simulate_reduced(reduced, base=base, **SETTINGS)


def test_a_gantry_that_travels_eighty_lengths_is_simulated(small):
    run = simulate_reduced(reduce_model(small, modes=1), base=SampledBase(TIME, ramp(40.0)), **SETTINGS)
    assert run.base[-1, 0] == pytest.approx(40.0)


def test_a_sharp_blow_is_simulated(small):
    """A force of 50 N, 380 times the length by small deflections, that lasts a tenth of a millisecond."""
    blow = SampledLoad(np.array([0.0, 0.05e-3, 0.1e-3]), [[0.0, 0.0], [50.0, 0.0], [0.0, 0.0]])
    run = simulate(small, load=blow, duration=2e-3, sample_rate=1000.0, method="radau")
    assert np.isfinite(run.tip).all()
