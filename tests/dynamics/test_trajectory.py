"""Observables, energies, starts and interruptions of simulated motions."""

import os
import pickle
import signal
from functools import partial

import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    FixedBase,
    HarmonicBase,
    InputError,
    ModalDamping,
    Model,
    QuadraticDamping,
    RayleighDamping,
    SampledBase,
    SimulationError,
    State,
    SweepBase,
    motion,
    natural_modes,
    reduce_model,
    run_all,
    simulate,
    simulate_reduced,
    static_equilibrium,
)
from ancf_casadi.dynamics import simulation, start

STEEL = {"length": 0.5, "width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elastic_modulus": 210e9}
BENDING_STIFFNESS = 210e9 * 5e-3 * 0.5e-3**3 / 12


def steel(elements=8, **changes):
    return Model(Beam.uniform(**{**STEEL, **changes}, elements=elements))


@pytest.fixture(scope="module")
def hanging():
    return steel()


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

    def test_an_end_moment_bends_to_a_constant_moment_and_curvature(self):
        model = steel(20, gravity=(0.0, 0.0), axis=(1.0, 0.0))
        moment = 0.5 * BENDING_STIFFNESS / 0.5
        run = simulate(model, start=static_equilibrium(model, tip_moment=moment), duration=0.001)
        for s in (0.0, 0.2, 0.5):
            assert run.bending_moment(s)[0] == pytest.approx(moment, rel=1e-4)
            assert run.curvature(s)[0] == pytest.approx(1.0, rel=1e-4)
            assert run.slope(s)[0] == pytest.approx(s, abs=1e-5)

    def test_a_small_tip_force_bends_like_a_cantilever(self):
        model = steel(gravity=(0.0, 0.0), axis=(1.0, 0.0))
        force = 1e-3 * 3 * BENDING_STIFFNESS / 0.5**2
        run = simulate(model, start=static_equilibrium(model, tip_force=(0.0, force)), duration=0.001, method="radau")
        for s in (0.0, 0.17, 0.4):
            assert run.bending_moment(s)[0] == pytest.approx(force * (0.5 - s), rel=1e-4)

    @pytest.mark.parametrize("observable", ["slope", "curvature", "axial_force", "bending_moment"])
    def test_a_point_off_the_beam_is_refused(self, hanging, observable):
        run = simulate(hanging, duration=0.002)
        with pytest.raises(InputError, match="must be on the beam"):
            getattr(run, observable)(0.51)


class TestEnergy:
    def laws(self, model):
        return {
            "undamped": None,
            "proportional": RayleighDamping(alpha=0.5, beta=1e-4),
            "tangent": RayleighDamping(beta=1e-3, stiffness="tangent"),
            "quadratic": QuadraticDamping(eta1=0.5, eta2=2.0),
            "generic": ModalDamping(natural_modes(model, count=3), (0.02, 0.01, 0.01)),
            "sum": ModalDamping(natural_modes(model, count=1), (0.02,)) + QuadraticDamping(eta2=2.0),
        }

    @pytest.mark.slow
    @pytest.mark.parametrize("name", ["undamped", "proportional", "tangent", "quadratic", "generic", "sum"])
    def test_work_of_the_base_is_stored_or_lost(self, hanging, name):
        """The change of T + U + V is the work of the base minus the energy lost, within 1/1000 of the work."""
        base = HarmonicBase(amplitude=5e-3, frequency=1.9, stop=0.5)
        run = simulate(hanging, damping=self.laws(hanging)[name], base=base, duration=0.9)
        scale = np.abs(run.base_work).max()
        assert np.abs(run.balance_error).max() < 1e-3 * scale
        if name == "undamped":
            assert run.dissipated_energy == pytest.approx(np.zeros(901), abs=1e-15)
        else:
            assert run.dissipated_energy[-1] > 0.01 * scale
            assert np.diff(run.dissipated_energy).min() >= -1e-9 * scale

    @pytest.mark.slow
    def test_the_balance_closes_with_the_tolerance(self, hanging):
        """The error does not come from the sampling: it falls at least threefold for a hundredth of the tolerance."""
        start = static_equilibrium(hanging, tip_force=(0.05, 0.0))
        errors = [
            np.abs(simulate(hanging, start=start, duration=0.5, tolerance=tolerance, method="idas").balance_error).max()
            for tolerance in (1e-6, 1e-8)
        ]
        assert errors[1] < errors[0] / 3

    def test_after_the_stop_the_base_does_no_work(self, hanging):
        base = HarmonicBase(amplitude=5e-3, frequency=1.9, stop=0.2)
        run = simulate(hanging, base=base, duration=0.6)
        held = run.base_work[run.time > base.stop_time]
        assert held == pytest.approx(held[0], abs=1e-12 * abs(held[0]))
        assert abs(held[0]) > 0.0


class TestStarts:
    @pytest.mark.slow
    def test_a_run_from_a_state_continues_the_run_it_came_from(self, hanging):
        start = static_equilibrium(hanging, tip_force=(0.05, 0.0))
        law = RayleighDamping(alpha=0.3, beta=1e-4)
        whole = simulate(hanging, damping=law, start=start, duration=0.4)
        first = simulate(hanging, damping=law, start=start, duration=0.2)
        second = simulate(hanging, damping=law, start=first.state(-1), duration=0.2)
        assert second.tip == pytest.approx(whole.tip[200:], abs=2e-5)
        assert np.ptp(whole.tip[200:, 0]) > 0.02

    def test_a_state_of_the_wrong_size_is_refused(self, hanging):
        with pytest.raises(InputError, match="start: the coordinates must be 36 finite numbers"):
            simulate(hanging, start=State(np.zeros(3), np.zeros(36)), duration=0.1)

    def test_a_start_that_stretches_the_beam_is_refused_and_told_the_right_one(self, hanging):
        with pytest.raises(InputError, match=r"stretches the beam by 2.0 %.*static_equilibrium"):
            simulate(hanging, start=State(1.02 * hanging.straight, np.zeros(36)), duration=0.1)

    @pytest.mark.parametrize("start", ["equilibrium", "straight", "impact"])
    @pytest.mark.parametrize("base", [FixedBase((0.1, 0.0)), FixedBase(rotation=0.2)])
    def test_a_base_that_begins_away_from_the_beam_at_rest_is_refused(self, hanging, reduced, base, start):
        """The first element would have to reach from its clamp to the second one."""
        message = r"base: begins with the clamp at .* start from a State"
        for run in (partial(simulate, hanging), partial(motion, hanging), partial(simulate_reduced, reduced)):
            with pytest.raises(InputError, match=message):
                run(duration=0.1, base=base, start=start)

    def test_no_sample_no_state(self, hanging):
        with pytest.raises(InputError, match="must be a whole number, -3 to 2, got 3"):
            simulate(hanging, duration=0.002).state(3)


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

    def test_a_slow_turn_of_the_base_turns_the_beam(self):
        """Without gravity, and slowly compared with the first mode, the tip follows the direction of the clamp."""
        model = steel(gravity=(0.0, 0.0), axis=(1.0, 0.0))
        time = np.linspace(0.0, 20.0, 401)
        angle = 0.6 * (time / 20.0 - np.sin(2 * np.pi * time / 20.0) / (2 * np.pi))
        base = SampledBase(time, np.zeros((401, 2)), angle)
        run = simulate(model, base=base, duration=20.0, sample_rate=20.0, damping=RayleighDamping(alpha=0.5))
        assert run.tip == pytest.approx(0.5 * np.column_stack([np.cos(angle), np.sin(angle)]), abs=2e-3)
        assert run.slope(0.0) == pytest.approx(angle, abs=1e-9)

    def test_a_sampled_motion_counts_from_its_first_sample_and_is_held_after_its_last(self, hanging):
        time = 5.0 + np.linspace(0.0, 0.1, 21)
        base = SampledBase(time, np.column_stack([1.0 + 1e-3 * (time - 5.0) ** 2, np.full(21, -3.0)]))
        run = simulate(hanging, base=base, duration=0.2, method="radau")
        assert run.base[0] == pytest.approx([0.0, 0.0], abs=1e-12)
        assert run.base[-1] == pytest.approx([1e-5, 0.0], abs=1e-9)

    def test_a_sweep_runs_through_its_frequencies(self):
        """u = A sin(2 pi (f0 t + (f1 - f0) t^2/(2 T))): the derivative of its phase gives f(t)."""
        model = steel(2)
        base = SweepBase(amplitude=1e-4, frequencies=(2.0, 6.0), stop=1.0)
        run = simulate(model, base=base, duration=1.0, damping=RayleighDamping(beta=1e-3), method="radau")
        expected = 1e-4 * np.sin(2 * np.pi * (2.0 * run.time + 2.0 * run.time**2))
        assert run.base[:, 0] == pytest.approx(expected, abs=1e-12)

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (([0, 1, 2], np.zeros((3, 2))), "time: needs at least 6 instants"),
            (([0, 1, 2, 3, 5, 4], np.zeros((6, 2))), "time: must increase"),
            ((range(6), np.zeros((5, 2))), "displacement: must have the shape"),
            ((range(6), np.full((6, 2), np.nan)), "displacement: must be finite"),
            ((range(6), [["a", 1]] * 6), "displacement: must be numbers"),
            ((range(6), np.zeros((6, 2)), np.zeros(5)), "rotation: must have the shape"),
        ],
    )
    def test_unusable_samples_are_refused(self, arguments, message):
        with pytest.raises(InputError, match=message):
            SampledBase(*arguments)

    def test_a_sweep_needs_positive_frequencies(self):
        with pytest.raises(InputError, match="frequencies: must be positive"):
            SweepBase(amplitude=1e-3, frequencies=(0.0, 3.0), stop=1.0)


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
        original = start.checked_excitation

        def check(*arguments):
            os.kill(os.getpid(), signal.SIGINT)
            return original(*arguments)

        monkeypatch.setattr(start, "checked_excitation", check)
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
