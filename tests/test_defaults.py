"""Calls with all defaults are accurate and fast, warn of nothing, and report the integrator used."""

from time import process_time

import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    HarmonicBase,
    InputError,
    ModalDamping,
    Model,
    QuadraticDamping,
    RayleighDamping,
    SampledBase,
    SweepBase,
    natural_modes,
    simulate,
    static_equilibrium,
)
from ancf_casadi.dynamics.tolerance import LARGEST_TOLERANCE, TOLERANCE_PER_TRAVEL, expected_travel
from ancf_casadi.mechanics.state import State

L = 0.5
RATIOS = (0.0100, 0.0028, 0.0028, 0.0023, 0.0030)  # Table 2 of the paper
BENDING_STIFFNESS = 210e9 * 5e-3 * 0.5e-3**3 / 12


def steel(elements=20, **changes):
    """The paper's beam, Table 1."""
    table = {"length": L, "width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elastic_modulus": 210e9}
    return Model(Beam.uniform(**table, elements=elements, **changes))


@pytest.fixture(scope="module")
def modes():
    return natural_modes(steel())


# ----------------------------------------------------------------------------------------- accurate and fast


def call(name, modes):
    """Return the arguments of a call with all defaults: law, base motion and start."""
    modal, f = ModalDamping(modes, RATIOS), modes.frequencies
    swing, time = HarmonicBase(5e-3, f[0], stop=0.6), np.linspace(0.0, 1.0, 201)
    shaken = 2e-3 * np.minimum(time, 0.5) * np.sin(20 * time)
    pull = 0.03 * BENDING_STIFFNESS / L**2
    return {
        "modal, mode 1": lambda: {"damping": modal, "base": swing},
        "modal, mode 1, small": lambda: {"damping": modal, "base": HarmonicBase(1e-5, f[0], stop=0.6)},
        "modal, mode 2": lambda: {"damping": modal, "base": HarmonicBase(1e-3, f[1], stop=0.6)},
        "strain-rate": lambda: {"damping": RayleighDamping(alpha=0.2, beta=1e-3), "base": swing},
        "drag": lambda: {"damping": QuadraticDamping(eta1=0.15, eta2=0.11), "base": swing},
        "sampled": lambda: {"damping": modal, "base": SampledBase(time, np.outer(shaken, (1.0, 0.0)))},
        "release": lambda: {"start": static_equilibrium(modes.model, tip_force=(pull, 0.0))},
    }[name]()


@pytest.mark.parametrize(
    "name",
    [
        "strain-rate",
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in ("modal, mode 1", "modal, mode 1, small", "modal, mode 2", "drag", "sampled", "release")
        ),
    ],
)
def test_a_call_with_all_defaults_warns_of_nothing_and_keeps_a_margin_below_a_ten_thousandth_of_its_travel(modes, name):
    """Half of the limit in the first second, because the error grows with time; a warning would be an error.

    The limit is five times as large after a release, which sets the whole mesh in motion.
    """
    settings = call(name, modes) | {"duration": 1.0, "sample_rate": 200.0}
    run = simulate(modes.model, **settings)
    (used,) = run.integrators
    exact = simulate(modes.model, method="radau", tolerance=used.tolerance / 5, **settings)
    travel = abs(exact.tip - exact.tip[0]).max()
    assert travel > 1e-5
    larger = 5.0 if name == "release" else 1.0
    assert abs(run.tip - exact.tip).max() < larger * 5e-5 * travel
    assert abs(run.balance_error).max() < larger * 1e-4 * run.kinetic_energy.max()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["strain-rate", "drag"])
def test_the_default_is_the_cheaper_integrator(modes, name):
    """In processor time of a second call: it takes less than half of that of IDAS."""
    cost = {}
    for method in ("auto", "idas"):
        simulate(modes.model, method=method, duration=0.01, **call(name, modes))  # compiles
        began = process_time()
        simulate(modes.model, method=method, duration=1.0, **call(name, modes))
        cost[method] = process_time() - began
    assert cost["auto"] < cost["idas"]


@pytest.mark.slow
def test_an_undamped_release_from_four_fifths_of_the_length_keeps_its_energy():
    model = steel(axis=(1.0, 0.0), gravity=(0.0, 0.0))
    start = static_equilibrium(model, tip_force=(0.0, 9.1 * BENDING_STIFFNESS / L**2))
    assert start.tip[1] > 0.78 * L
    run = simulate(model, start=start, duration=0.5)
    assert abs(run.energy - run.energy[0]).max() < 1e-5 * run.energy[0]
    assert run.steps < 50_000
    assert abs(run.tip[:, 1]).max() > 0.7 * L


@pytest.mark.slow
@pytest.mark.parametrize(("mode", "amplitude"), [(4, 1e-4), (1, 1e-3), (0, 1e-2)])
def test_defaults_neither_damp_nor_detune_a_mode(mode, amplitude):
    """Numerical damping below 1e-5 and the frequency within 3e-5, against a motion integrated to 1e-10."""
    modes = natural_modes(steel(axis=(1.0, 0.0), gravity=(0.0, 0.0)))
    frequency, start = modes.frequencies[mode], modes.state(mode + 1, amplitude * L)
    settings = {"start": start, "duration": 3 / frequency, "sample_rate": 50 * frequency}
    ratios, angular_frequencies = [], []
    for run in (simulate(modes.model, **settings), simulate(modes.model, method="radau", tolerance=1e-10, **settings)):
        velocity = modes.modal_coordinate(run.velocities + modes.equilibrium.coordinates, mode)
        phasor = modes.modal_coordinate(run.coordinates, mode) - 1j * velocity / modes.angular_frequencies[mode]
        angular_frequencies.append(np.polyfit(run.time, np.unwrap(np.angle(phasor)), 1)[0])
        ratios.append(-np.polyfit(run.time, np.log(abs(phasor)), 1)[0] / angular_frequencies[-1])
    assert abs(ratios[0] - ratios[1]) < 1e-5
    assert angular_frequencies[0] == pytest.approx(angular_frequencies[1], rel=3e-5)
    assert angular_frequencies[1] == pytest.approx(modes.angular_frequencies[mode], rel=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(0, 20, 4))
def test_any_call_with_all_defaults_ends_soon_and_balances_its_energy(number):
    """Each base motion with another law; a step takes about 0.4 ms."""
    rng = np.random.default_rng(number)
    hanging = bool(rng.integers(2))
    model = steel(int(rng.choice([8, 12, 20])), axis=(0.0, -1.0) if hanging else (1.0, 0.0))
    modes = natural_modes(model)
    f = modes.frequencies[rng.integers(3)]
    law = [
        None,
        ModalDamping(modes, RATIOS),
        RayleighDamping(alpha=0.2, beta=1e-5),
        QuadraticDamping(eta1=0.1, eta2=0.3),
        ModalDamping(modes, RATIOS[:1]) + QuadraticDamping(eta2=0.2),
    ][number % 5]
    size = L * 10 ** rng.uniform(-4, -1.7) * modes.frequencies[0] / f
    time = np.linspace(0.0, 1.0, 201)
    base = [
        HarmonicBase(size, f, stop=0.2),
        HarmonicBase(size, f, direction=(1.0, 1.0)),
        SweepBase(size, (0.5 * f, 2 * f), stop=0.3),
        SampledBase(time, np.outer(size * np.sin(2 * np.pi * f * time), (1.0, 0.5)), 0.3 * np.sin(3 * time) ** 2),
        None,
    ][number // 4]
    pull = static_equilibrium(model, tip_force=(rng.uniform(0.1, 1.0) * BENDING_STIFFNESS / L**2, 0.0))
    straight = "equilibrium" if hanging else "straight"  # its weight hardly stretches a hanging beam
    start = pull if base is None else ["equilibrium", straight, pull][rng.integers(3)]
    run = simulate(model, damping=law, base=base, start=start, duration=0.5)
    scale = max(np.ptp(run.kinetic_energy), np.ptp(run.strain_energy))
    assert scale > 0.0
    assert abs(run.balance_error).max() < (5e-4 if start is pull else 1e-4) * scale
    assert run.steps < 25_000


# ------------------------------------------------------------------------- which integrator, and how accurate


@pytest.mark.slow
def test_the_default_is_radau_and_options_of_idas_ask_for_idas(modes):
    base = HarmonicBase(5e-3, modes.frequencies[0])
    for settings, method, tolerance in (
        ({}, "radau", TOLERANCE_PER_TRAVEL["radau"] * 5e-3 / L),
        ({"tolerance": 3e-7}, "radau", 3e-7),
        ({"method": "idas"}, "idas", TOLERANCE_PER_TRAVEL["idas"] * 5e-3 / L),
        ({"options": {"max_num_steps": 100_000}}, "idas", TOLERANCE_PER_TRAVEL["idas"] * 5e-3 / L),
    ):
        (used,) = simulate(modes.model, base=base, duration=0.2, **settings).integrators
        assert (used.start, used.method) == (0.0, method)
        assert used.tolerance == pytest.approx(tolerance)
    (resting,) = simulate(modes.model, duration=0.02).integrators
    assert resting.tolerance == LARGEST_TOLERANCE["radau"]


def test_the_default_passes_over_a_mesh_that_an_impact_sets_ringing(modes):
    """IDAS resolves it, in 50 times as many steps."""
    run = simulate(modes.model, base=HarmonicBase(1e-2, modes.frequencies[0]), start="impact", duration=0.02)
    assert run.steps < 2000


def test_the_expected_travel_is_that_of_base_start_and_load():
    """Base travel, L times its rotation, distance from rest and v/w_1, static deflection by the load."""
    model = steel(4, gravity=(0.0, 0.0))
    times, still = np.array([0.0, 10.0]), np.zeros((2, 15))
    still[:, 2:4] = model.beam.axis
    rest = State(model.straight, np.zeros(model.size))
    assert expected_travel(model, times, still, rest) < 1e-15
    moved, turned = still.copy(), still.copy()
    moved[1, :2] = 1.2e-3, 1.6e-3
    assert expected_travel(model, times, moved, rest) == pytest.approx(2e-3 / L)
    turned[1, 2:4] = np.sin(0.2), -np.cos(0.2)
    assert expected_travel(model, times, turned, rest) == pytest.approx(0.2)
    pulled = static_equilibrium(model, tip_force=(0.02, 0.0))
    assert expected_travel(model, times, still, State(pulled.coordinates, rest.velocities)) == pytest.approx(
        np.hypot(*(pulled.tip - [0.0, -L])) / L
    )
    kick = np.zeros(model.size)
    kick[-4] = 0.1
    assert expected_travel(model, times, still, State(model.straight, kick)) == pytest.approx(
        0.1 / natural_modes(model, count=1).angular_frequencies[0] / L, rel=1e-2
    )
    shaken = State(pulled.coordinates, rest.velocities)
    moved[1, :2] = 12e-3, 16e-3
    assert expected_travel(model, times, moved, shaken) == pytest.approx(20e-3 / L)
    moved[1, :2] = 3e-6, 4e-6
    assert expected_travel(model, times, moved, shaken) == pytest.approx(
        0.1 * expected_travel(model, times, still, shaken)
    )
    for place, tip_load in ((12, {"tip_force": (1e-4, 0.0)}), (14, {"tip_moment": 1e-5})):
        loaded = still.copy()
        loaded[1, place] = 1e-4 if place == 12 else 1e-5
        deflection = np.hypot(*(static_equilibrium(model, **tip_load).tip - [0.0, -L])) / L
        assert expected_travel(model, times, loaded, rest) == pytest.approx(deflection, rel=1e-2)
        brief = 1e-4 * times  # a triangle of 1 ms
        impulse = deflection * natural_modes(model, count=1).angular_frequencies[0] * 1e-3 / 2
        assert expected_travel(model, brief, loaded, rest) == pytest.approx(impulse, rel=2e-2)
        loaded[0] = loaded[1]  # the beam starts under it
        held = State(static_equilibrium(model, **tip_load).coordinates, rest.velocities)
        assert expected_travel(model, times, loaded, held) < 1e-9


# ------------------------------------------------------------------------------------ continuing from a state


BASE = HarmonicBase(5e-3, 1.9, stop=0.4)
DAMPED = RayleighDamping(alpha=0.3, beta=1e-4)


@pytest.fixture(scope="module")
def whole():
    return simulate(steel(8), damping=DAMPED, base=BASE, duration=0.8, sample_rate=200.0, tolerance=1e-9)


@pytest.mark.parametrize(("method", "sample"), [("radau", 1), ("radau", 106), ("radau", -20), ("idas", 50)])
def test_continuing_from_any_sample_of_a_driven_run_gives_the_uninterrupted_run(whole, sample, method):
    """While the base moves, after its stop, and between the samples of the first run."""
    state = whole.state(sample)
    assert state.time == whole.time[sample]
    duration = whole.time[-1] - state.time
    settings = {"duration": duration, "sample_rate": 200.0, "method": method, "tolerance": 1e-9}
    rest = simulate(whole.model, damping=DAMPED, base=BASE, start=state, **settings)
    first = sample % len(whole.time)
    np.testing.assert_allclose(rest.time, whole.time[first:], atol=1e-12)
    assert abs(rest.tip - whole.tip[first:]).max() < 1e-4 * np.ptp(whole.tip[:, 0])
    np.testing.assert_allclose(rest.coordinates[0], state.coordinates, atol=1e-15)
    assert np.ptp(whole.tip[first:, 0]) > 5e-3


def test_without_a_base_motion_the_clamp_stays_where_the_state_has_it(whole):
    """A clamp that jumps back to 0 gives 100 times the strain energy."""
    assert abs(whole.base[-1, 0]) > 1e-3
    run = simulate(whole.model, damping=DAMPED, start=whole.state(-1), duration=0.1, sample_rate=200.0, tolerance=1e-9)
    np.testing.assert_allclose(run.base, np.tile(whole.base[-1], (len(run.time), 1)), atol=1e-15)
    assert run.strain_energy.max() < 1.5 * whole.strain_energy[whole.time > 0.5].max()
    assert run.time[0] == whole.time[-1]


def test_a_turned_clamp_stays_turned(whole):
    time = np.linspace(0.0, 0.2, 41)
    base = SampledBase(time, np.zeros((41, 2)), 0.5 * np.sin(np.pi * time / 0.4) ** 2)
    turned = simulate(whole.model, damping=DAMPED, base=base, duration=0.3, sample_rate=200.0, tolerance=1e-8)
    run = simulate(whole.model, damping=DAMPED, start=turned.state(-1), duration=0.1, sample_rate=200.0, tolerance=1e-8)
    np.testing.assert_allclose(run.slope(0.0), -np.pi / 2 + 0.5, atol=1e-12)
    assert abs(run.balance_error).max() < 1e-4 * run.kinetic_energy.max()


@pytest.mark.parametrize(
    ("sample", "base", "message"),
    [(-1, HarmonicBase(5e-3, 1.9), "is at"), (20, None, "has the velocity"), (20, HarmonicBase(5e-3, 3.8), "is at")],
)
def test_a_state_that_does_not_agree_with_the_base_motion_is_refused_in_one_line(whole, sample, base, message):
    with pytest.raises(InputError, match=f"^start: the clamp of the state {message}") as caught:
        simulate(whole.model, base=base, start=whole.state(sample), duration=0.1)
    assert "\n" not in str(caught.value)
