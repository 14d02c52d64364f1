"""Observables, energies, starts and interruptions of simulated motions."""

import os
import pickle
import signal
from functools import partial

import numpy as np
import pytest

from ancf_casadi import (
    FixedBase,
    HarmonicBase,
    InputError,
    Model,
    RayleighDamping,
    SampledBase,
    SimulationError,
    motion,
    reduce_model,
    run_all,
    simulate,
    simulate_reduced,
    static_equilibrium,
)
from ancf_casadi.dynamics import motion_setup, simulation

BENDING_STIFFNESS = 210e9 * 5e-3 * 0.5e-3**3 / 12
WEIGHTLESS = {"gravity": (0.0, 0.0), "axis": (1.0, 0.0)}


@pytest.fixture(scope="module")
def hanging(paper_beam):
    return Model(paper_beam(8))


@pytest.fixture(scope="module")
def reduced(hanging):
    return reduce_model(hanging, modes=2)


class TestForces:
    def test_a_hanging_beam_at_rest_pulls_at_its_clamp_and_at_each_section_with_the_weight_below(self, hanging):
        run = simulate(hanging, duration=0.01)
        weight = hanging.beam.mass * 9.81
        assert run.clamp_force[:, :2] == pytest.approx(np.tile([0.0, weight], (11, 1)), abs=1e-6 * weight)
        for s in (0.0, 0.1, 0.31, 0.5):
            assert run.axial_force(s) == pytest.approx(weight * (1 - s / 0.5), abs=1e-5 * weight)

    def test_an_end_moment_bends_to_a_constant_moment_and_curvature(self, paper_beam):
        model = Model(paper_beam(20, **WEIGHTLESS))
        moment = 0.5 * BENDING_STIFFNESS / 0.5
        run = simulate(model, start=static_equilibrium(model, tip_moment=moment), duration=0.001)
        for s in (0.0, 0.2, 0.5):
            assert run.bending_moment(s)[0] == pytest.approx(moment, rel=1e-4)
            assert run.curvature(s)[0] == pytest.approx(1.0, rel=1e-4)
            assert run.slope(s)[0] == pytest.approx(s, abs=1e-5)

    def test_a_small_tip_force_bends_like_a_cantilever(self, paper_beam):
        model = Model(paper_beam(8, **WEIGHTLESS))
        force = 1e-3 * 3 * BENDING_STIFFNESS / 0.5**2
        run = simulate(model, start=static_equilibrium(model, tip_force=(0.0, force)), duration=0.001, method="radau")
        for s in (0.0, 0.17, 0.4):
            assert run.bending_moment(s)[0] == pytest.approx(force * (0.5 - s), rel=1e-4)


class TestStarts:
    @pytest.mark.parametrize("start", ["equilibrium", "straight", "impact"])
    @pytest.mark.parametrize("base", [FixedBase((0.1, 0.0)), FixedBase(rotation=0.2)])
    def test_a_base_that_begins_away_from_the_beam_at_rest_is_refused(self, hanging, reduced, base, start):
        """The first element would have to reach from its clamp to the second one."""
        message = r"base: begins with the clamp at .* start from a State"
        for run in (partial(simulate, hanging), partial(motion, hanging), partial(simulate_reduced, reduced)):
            with pytest.raises(InputError, match=message):
                run(duration=0.1, base=base, start=start)


class TestBaseMotions:
    @pytest.mark.slow
    def test_a_sampled_motion_is_that_of_its_samples(self, hanging):
        """A sine of the base, sampled 200 times per second, moves the beam like the exact sine."""
        exact = HarmonicBase(amplitude=5e-3, frequency=3.0, direction=(1.0, 0.5))
        time = np.arange(0.0, 0.5, 0.005)
        sampled = SampledBase(time, 5e-3 * np.outer(np.sin(6 * np.pi * time), exact.direction))
        runs = [simulate(hanging, base=base, duration=0.45) for base in (exact, sampled)]
        assert runs[1].tip == pytest.approx(runs[0].tip, abs=1e-5)
        assert np.ptp(runs[0].tip[:, 0]) > 5e-3

    def test_a_slow_turn_of_the_base_turns_the_beam(self, paper_beam):
        """Without gravity, and slowly compared with the first mode, the tip follows the direction of the clamp."""
        model = Model(paper_beam(8, **WEIGHTLESS))
        time = np.linspace(0.0, 20.0, 401)
        angle = 0.6 * (time / 20.0 - np.sin(2 * np.pi * time / 20.0) / (2 * np.pi))
        base = SampledBase(time, np.zeros((401, 2)), angle)
        run = simulate(model, base=base, duration=20.0, sample_rate=20.0, damping=RayleighDamping(alpha=0.5))
        assert run.tip == pytest.approx(0.5 * np.column_stack([np.cos(angle), np.sin(angle)]), abs=2e-3)
        assert run.slope(0.0) == pytest.approx(angle, abs=1e-9)


class TestInterruptions:
    def at_segment(self, monkeypatch, number, action):
        """Do something when the given segment is finished."""
        original = simulation.integrate_by_radau

        def eventful(*arguments):
            for count, path in enumerate(original(*arguments), start=1):
                if count == number:
                    action()
                yield path

        monkeypatch.setattr(simulation, "integrate_by_radau", eventful)

    @pytest.mark.slow
    def test_ctrl_c_ends_a_run_with_what_is_done(self, hanging, monkeypatch):
        """The signal arrives during the sixth segment; afterwards the previous handler is restored."""
        start = static_equilibrium(hanging, tip_force=(0.01, 0.0))
        whole = simulate(hanging, start=start, duration=0.1)
        self.at_segment(monkeypatch, 6, lambda: os.kill(os.getpid(), signal.SIGINT))
        part = simulate(hanging, start=start, duration=0.1)
        assert part.interrupted
        assert not whole.interrupted
        assert len(part.time) == 25
        assert np.array_equal(part.tip, whole.tip[: len(part.time)])
        assert np.array_equal(part.base_work, whole.base_work[: len(part.time)])
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler

    def test_ctrl_c_before_the_first_segment_waits_for_it(self, hanging, monkeypatch):
        """Raised within a call of CasADi, it would appear as an error of that call."""
        original = motion_setup.check_excitation

        def check(*arguments):
            os.kill(os.getpid(), signal.SIGINT)
            return original(*arguments)

        monkeypatch.setattr(motion_setup, "check_excitation", check)
        part = simulate(hanging, duration=0.1)
        assert part.interrupted
        assert len(part.time) == 5
        with pytest.raises(KeyboardInterrupt):  # not the other runs after part of the first
            run_all([partial(simulate, hanging, duration=0.1)])

    def test_a_failed_run_keeps_the_good_part_and_travels_between_processes(self, hanging, monkeypatch):
        def fail():
            raise SimulationError("the integrator gave up", 0.02)

        self.at_segment(monkeypatch, 6, fail)
        with pytest.raises(SimulationError) as caught:
            simulate(hanging, duration=0.1)
        assert len(caught.value.partial.time) == 21
        again = pickle.loads(pickle.dumps(caught.value))
        assert (str(again), again.time) == ("the integrator gave up", 0.02)
        assert np.array_equal(again.partial.tip, caught.value.partial.tip)
