"""The motion between the ends of the steps."""

import pickle
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    HarmonicBase,
    InputError,
    Model,
    Pin,
    PointLoad,
    RayleighDamping,
    Roller,
    SampledLoad,
    periodic_motion,
    simulate,
    static_equilibrium,
)

STEEL = {"length": 0.5, "width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elastic_modulus": 210e9}
SWING = HarmonicBase(amplitude=5e-3, frequency=1.85)


def strip(elements=8, **changes):
    return Model(Beam.uniform(**{**STEEL, **changes}, elements=elements))


@pytest.fixture(scope="module")
def swing():
    return simulate(strip(), damping=RayleighDamping(alpha=0.2), base=SWING, duration=2.0, tolerance=1e-6)


def test_velocities_are_the_rates_of_the_coordinates(swing):
    times, d = np.array([0.3217, 0.8111, 1.4444]), 1e-5
    differences = (swing.at(times + d).coordinates - swing.at(times - d).coordinates) / (2 * d)
    np.testing.assert_allclose(swing.at(times).velocities, differences, atol=1e-6)
    assert abs(swing.velocity(0.2) - swing.velocities @ swing.model.interpolation(0.2).T).max() < 1e-12
    assert abs(swing.position(0.2) - swing.coordinates @ swing.model.interpolation(0.2).T).max() < 1e-12


def test_a_run_can_be_read_at_any_instants_in_any_order(swing):
    chosen = swing.at(swing.time[[700, 3, 1500]])
    for name in ("tip", "coordinates", "velocities", "clamp_force", "dissipated_energy", "base_work", "tip_load"):
        np.testing.assert_allclose(getattr(chosen, name), getattr(swing, name)[[700, 3, 1500]], atol=1e-12, rtol=1e-7)
    assert swing.at(0.5).tip.shape == (1, 2)
    finer = simulate(swing.model, damping=RayleighDamping(alpha=0.2), base=SWING, duration=2.0, tolerance=1e-8)
    times = np.sort(np.random.default_rng(0).uniform(0.0, 2.0, 200))
    assert abs(finer.at(times).tip - swing.at(times).tip).max() < 5e-6
    force = finer.at(times).axial_force(0.2)
    assert np.sqrt(np.mean((swing.at(times).axial_force(0.2) - force) ** 2)) < 2e-3 * abs(force).max()


def test_a_reading_does_not_depend_on_the_other_instants(swing):
    assert abs(swing.at([0.7, 1.3, 0.2]).balance_error).max() < 1e-3 * swing.kinetic_energy.max()
    assert swing.at([]).balance_error.shape == (0,)
    jump = SampledLoad([0.0, 0.1], [[0.1, 0.0], [0.1, 0.0]])
    pulled = simulate(strip(), load=jump, duration=0.2)
    np.testing.assert_array_equal(pulled.at([0.1]).tip_load, pulled.tip_load[[100]])


@pytest.mark.parametrize("times", [[-0.1], [2.1], [np.nan], "now", [[0.1, 0.2]]])
def test_instants_outside_the_motion_are_refused(swing, times):
    with pytest.raises(InputError, match=r"^times: (the motion lasts from 0 to 2|must be)"):
        swing.at(times)


def test_a_run_that_failed_at_once_has_no_instants(swing):
    failed = replace(swing, time=swing.time[:0], source=replace(swing.source, steps=()))
    assert failed.at([]).tip.shape == failed.base.shape == (0, 2)
    assert failed.to_dict()["tip_m"] == [] and failed.clamp_force.shape == (0, 4)
    with pytest.raises(InputError, match=r"^times: the motion has no steps$"):
        failed.at([0.0])


def test_a_periodic_motion_is_known_at_its_samples_alone():
    model = strip(4)
    run = periodic_motion(model, base=HarmonicBase(1e-4, 1.5), damping=RayleighDamping(alpha=0.5)).trajectory(40)
    assert (run.at(run.time[3:5]).tip == run.tip[3:5]).all()
    with pytest.raises(InputError, match=r"^times: the motion is known at its own samples alone$"):
        run.at(run.time[:2] + 1e-3)


def test_a_run_travels_between_processes_after_everything_was_read(swing):
    assert swing.clamp_force.shape == (2001, 4)
    again = pickle.loads(pickle.dumps(swing))
    np.testing.assert_array_equal(again.at([0.7]).clamp_force, swing.at([0.7]).clamp_force)


@pytest.mark.parametrize(
    "supports",
    [
        (Pin(0.0), Pin(0.5)),
        (Pin(0.0), Roller(0.5)),
        (Pin(0.1), Pin(0.5, displacement=(-0.01, 0.0))),
    ],
)
def test_the_nodes_at_supports_stay_in_their_places(supports):
    model = strip(10, axis=(1.0, 0.0), gravity=(0.0, 0.0), supports=supports)
    held = static_equilibrium(model, loads=[PointLoad(point=0.3, force=(0.0, -0.02))])
    run = simulate(model, damping=RayleighDamping(alpha=1.0), start=held, duration=0.1, tolerance=1e-6)
    finer = simulate(model, damping=RayleighDamping(alpha=1.0), start=held, duration=0.1, tolerance=1e-8)
    for support in supports:
        place = np.array([support.point, 0.0]) + support.displacement
        across = 1 if isinstance(support, Roller) else slice(None)
        assert abs(run.position(support.point)[:, across] - place[across]).max() < 1e-15
        assert abs(run.velocity(support.point)[:, across]).max() < 1e-12
    if Roller not in map(type, supports):  # its small axial force is that of unresolved vibrations
        force = finer.axial_force(0.3)
        assert np.sqrt(np.mean((run.axial_force(0.3) - force) ** 2)) < 0.06 * np.sqrt(np.mean(force**2))


@pytest.mark.slow
def test_a_minute_of_motion_fits_into_60_megabytes():
    model = strip(20)
    simulate(model, base=SWING, duration=0.1)
    tracemalloc.start()
    run = simulate(model, damping=RayleighDamping(alpha=0.2), base=SWING, duration=60.0, tolerance=1e-5)
    assert run.tip.shape == (60_001, 2)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 60e6
