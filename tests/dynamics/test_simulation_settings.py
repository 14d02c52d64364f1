"""Starts, samples, restarts, options, progress and failures of simulations."""

import pickle
import re

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import (
    BaseMotion,
    HarmonicBase,
    InputError,
    Model,
    SampledBase,
    SimulationError,
    State,
    natural_modes,
    simulate,
    static_equilibrium,
)
from ancf_casadi.dynamics.base_motion import Piece

AMPLITUDE, FREQUENCY = 20e-3, 1.85
OMEGA = 2 * np.pi * FREQUENCY


def rigid(model, speed):
    """Velocities of a beam that moves along x as a rigid body."""
    return np.tile([speed, 0.0, 0.0, 0.0], model.beam.elements + 1)


# --------------------------------------------------------------------------------- what the numbers do not depend on


@pytest.mark.slow
@pytest.mark.parametrize("rate", [10.0, 97.0, 250.0, 1000 / 7])
def test_the_motion_does_not_depend_on_the_sampling_nor_on_where_the_stop_falls_between_samples(rubber, rate):
    base = HarmonicBase(AMPLITUDE, FREQUENCY, stop=0.1)
    settings = {"base": base, "tolerance": 1e-9}
    sampled = simulate(rubber, duration=0.3, sample_rate=rate, **settings)
    fine = simulate(rubber, duration=0.3, sample_rate=7 * rate, **settings)
    np.testing.assert_allclose(sampled.time, np.arange(int(0.3 * rate + 1e-9) + 1) / rate, rtol=1e-14)
    np.testing.assert_allclose(fine.time[::7][: len(sampled.time)], sampled.time, atol=1e-14)
    assert abs(fine.coordinates[::7][: len(sampled.time)] - sampled.coordinates).max() < 1e-6


@pytest.mark.parametrize("stop", [0.02, 0.25, 15.0, np.inf])
def test_the_clamp_follows_the_base_to_the_last_sample_wherever_the_stop_is(small, stop):
    base = HarmonicBase(5e-3, FREQUENCY, stop=stop, direction=(0.6, 0.8))
    run = simulate(small, base=base, duration=0.3, sample_rate=100.0, tolerance=1e-7)
    u = 5e-3 * np.sin(OMEGA * np.minimum(run.time, base.stop_time))
    v = 5e-3 * OMEGA * np.cos(OMEGA * run.time) * (run.time < base.stop_time)
    np.testing.assert_allclose(run.base, np.outer(u, [0.6, 0.8]), atol=1e-16)
    np.testing.assert_allclose(run.velocities[:, :2], np.outer(v, [0.6, 0.8]), atol=1e-15)
    np.testing.assert_array_equal(run.coordinates[:, 2:4], np.tile([0.0, -1.0], (31, 1)))


# ------------------------------------------------------------------------------------------------- starts and samples


def test_a_run_starts_as_told(small):
    base = HarmonicBase(5e-3, FREQUENCY)
    held = static_equilibrium(small, tip_force=(1e-3, 0.0))
    rest, none = static_equilibrium(small).coordinates, np.zeros(small.size)
    with_base = rigid(small, 5e-3 * OMEGA)
    swinging = with_base + np.where(np.arange(small.size) < 4, 0.0, 0.1)
    for start, coordinates, velocities in (
        ("equilibrium", rest, with_base),
        ("impact", rest, none),
        ("straight", small.straight, with_base),
        (held, held.coordinates, with_base),
        (State(rest, swinging), rest, swinging),
    ):
        run = simulate(small, base=base, start=start, duration=1e-4, sample_rate=1e4, method="radau")
        np.testing.assert_allclose(run.coordinates[0], coordinates, atol=1e-14)
        np.testing.assert_allclose(run.velocities[0, 4:], velocities[4:], atol=1e-12)
        np.testing.assert_allclose(run.velocities[0, :4], with_base[:4], atol=1e-14)


def test_places_and_speeds_are_those_of_the_points_asked_for(driven):
    np.testing.assert_array_equal(driven.position(0.5), driven.tip)
    np.testing.assert_array_equal(driven.position(0.0), driven.base)
    step = 1 / 970.0
    differences = (driven.position(0.3)[2:] - driven.position(0.3)[:-2]) / (2 * step)
    np.testing.assert_allclose(driven.velocity(0.3)[1:-1], differences, atol=2e-3)
    relative = driven.relative_coordinates
    np.testing.assert_allclose(relative[:, -4:-2], driven.tip - driven.base, atol=1e-16)
    np.testing.assert_array_equal(relative[:, 2::4], driven.coordinates[:, 2::4])
    assert driven.steps > 100 and driven.wall_seconds > 0.0


def test_the_slope_is_unwrapped_where_a_beam_turns_over(rubber_beam):
    stiff = Model(rubber_beam(elastic_modulus=210e9 / 16))
    t = np.linspace(0.0, 0.5, 201)
    turn = 2 * np.pi * (10 * (2 * t) ** 3 - 15 * (2 * t) ** 4 + 6 * (2 * t) ** 5)
    turning = SampledBase(t, np.zeros((201, 2)), turn)
    run = simulate(stiff, base=turning, duration=0.5, sample_rate=400.0, tolerance=1e-7)
    np.testing.assert_allclose(run.slope(0.0), turn - np.pi / 2, atol=1e-9)
    assert abs(run.slope(0.5) - run.slope(0.0)).max() < 1.5


# ---------------------------------------------------------------------------------------------- progress and failure


def test_progress_is_shown_on_the_error_stream_only_when_asked_for(small, capfd):
    simulate(small, duration=0.1)
    assert capfd.readouterr() == ("", "")
    simulate(small, duration=0.1, progress=True)
    shown = capfd.readouterr()
    assert shown.out == ""
    assert "100%" in shown.err and "0.10/0.10 s [" in shown.err


def test_a_failing_integration_is_one_line_of_advice_and_nothing_else_is_printed(small, capfd):
    with pytest.raises(SimulationError, match=r"^IDAS took too many steps between two samples") as caught:
        simulate(small, start="straight", duration=0.1, method="idas", options={"max_num_steps": 1})
    assert "\n" not in str(caught.value)
    assert 0.0 < caught.value.time < 1e-6
    assert caught.value.__cause__ is None and caught.value.__suppress_context__
    assert len(caught.value.partial.time) == 0
    assert capfd.readouterr() == ("", "")


def test_a_run_that_fails_on_the_way_keeps_what_it_has(small):
    """The impact of a sudden stop takes more steps than allowed."""
    base = HarmonicBase(AMPLITUDE, FREQUENCY, stop=0.2, stop_at="once")
    settings = {"base": base, "duration": 0.3, "sample_rate": 100.0, "tolerance": 1e-7, "method": "idas"}
    with pytest.raises(SimulationError) as caught:
        simulate(small, options={"max_num_steps": 1000}, **settings)
    partial = caught.value.partial
    assert 0.2 < caught.value.time < 0.21
    assert partial.time[-1] == pytest.approx(0.2)
    undisturbed = simulate(small, **settings | {"base": HarmonicBase(AMPLITUDE, FREQUENCY), "duration": 0.2})
    assert abs(partial.tip - undisturbed.tip).max() < 1e-4


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"nonsense": 1}, "nonsense"),
        ({"reltol": "small"}, "reltol"),
        ({"linear_solver": "ma99"}, "linsol_ma99"),
        ({"max_multistep_order": 7}, "MaxOrd"),
        ({"abstol": -1.0}, "tolerances"),
    ],
)
def test_an_option_that_idas_refuses_is_named_in_one_line(small, capfd, options, message):
    with pytest.raises(InputError, match=f"^options: .*IDAS interface refuses them: .*{message}") as caught:
        simulate(small, duration=0.1, options=options)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
def test_options_override_the_defaults(small):
    settings = {"start": "straight", "duration": 0.05, "method": "idas"}
    loose = simulate(small, options={"abstol": 1e-5}, **settings)
    assert loose.steps < simulate(small, **settings).steps / 2


@pytest.mark.parametrize("method", ["idas", "radau"])
def test_a_run_of_too_many_steps_is_given_up_and_keeps_its_finished_part(small, method):
    with pytest.raises(SimulationError, match=r"^the integrator took \d+ steps up to 0\.\d+ s") as caught:
        simulate(small, start="straight", duration=0.1, most_steps=10, method=method, tolerance=1e-10)
    assert caught.value.partial.time[-1] == pytest.approx(caught.value.time)
    again = pickle.loads(pickle.dumps(caught.value))
    assert (str(again), again.time) == (str(caught.value), caught.value.time)
    np.testing.assert_array_equal(again.partial.tip, caught.value.partial.tip)


@pytest.mark.parametrize("method", ["idas", "radau"])
def test_no_step_is_longer_than_allowed(small, method):
    """A beam at rest needs only a few steps otherwise."""
    free = simulate(small, duration=0.1, method=method)
    bounded = simulate(small, duration=0.1, method=method, largest_step=1e-4)
    assert free.steps < 500 and bounded.steps >= 999


@pytest.mark.slow
def test_radau_below_rounding_says_so_with_time_and_step(small):
    with pytest.raises(SimulationError, match=r"^the integrator could not continue at \S+ s with a step of \S+ s: "):
        simulate(small, start="straight", duration=0.1, tolerance=1e-29, method="radau")


class Endless(BaseMotion):
    """A motion that becomes infinite."""

    def pieces(self):
        return (Piece(np.inf, lambda t, parameters: cs.vertcat(cs.log(0.05 - t), 0.0, 0.0)),)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"duration": 0.0}, "duration: must be positive, got 0"),
        ({"duration": 1e-3, "sample_rate": 10.0}, "duration: must be at least one sampling interval, 0.1 s, got 0.001"),
        ({"sample_rate": 1e9}, "sample_rate: 1e+08 samples are more than 2e+06"),
        ({"tolerance": 0.0}, "tolerance: must be positive, got 0"),
        ({"tolerance": 1e-308}, "tolerance: 1e-308 is not within 1e-30 to 1e+30; check the unit"),
        ({"method": "bdf"}, "method: must be one of auto, idas, radau, got 'bdf'"),
        ({"method": "radau", "options": {"reltol": 1.0}}, "options: are those of IDAS; method='radau' has none"),
        ({"largest_step": 0.0}, "largest_step: must be positive, got 0"),
        ({"most_steps": 0}, "most_steps: must be a whole number, 1 or more, got 0"),
        ({"base": Endless()}, "base: its position, velocity or acceleration is not finite at 0.05 s"),
        ({"start": "rest"}, "start: must be one of equilibrium, straight, impact, an Equilibrium or a State"),
        ({"start": State(np.zeros(4), np.zeros(20))}, "start: the coordinates must be 20 finite numbers"),
    ],
)
def test_settings_that_make_no_sense_are_refused_by_name(small, settings, message):
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        simulate(small, **{"duration": 0.1} | settings)


def test_an_equilibrium_of_another_model_is_no_start(small, rubber):
    with pytest.raises(InputError, match=r"^start: the equilibrium belongs to another model$"):
        simulate(small, start=static_equilibrium(rubber), duration=0.1)


def test_a_linear_mode_shape_of_finite_amplitude_is_no_start_since_it_stretches_the_beam(small):
    modes = natural_modes(small, count=1)
    bent = modes.equilibrium.coordinates + 0.1 * modes.shapes[:, 0] / modes.tip_amplitudes()[0]
    with pytest.raises(InputError, match=r"^start: stretches the beam by \d\.\d %"):
        simulate(small, start=State(bent, np.zeros(small.size)), duration=0.1)


def test_a_sample_or_a_point_that_is_not_there_is_refused(driven):
    with pytest.raises(InputError, match=r"^index: must be a whole number, -583 to 582, got 583$"):
        driven.state(583)
    for quantity in ("position", "velocity", "slope", "curvature", "axial_force", "bending_moment"):
        with pytest.raises(InputError, match=r"^point: the point must be on the beam, 0 to 0\.5 m, got 0\.6$"):
            getattr(driven, quantity)(0.6)
