"""Large motions of free, hinged and clamped beams, computed for the reference cases.

Each function returns the numbers of the case of its name in ``references.json``, in the same order.
"""

import numpy as np

from ancf_casadi import (
    Beam,
    Clamp,
    Guide,
    Model,
    MovingForce,
    Pin,
    Roller,
    SampledLoad,
    StrainMeasures,
    simulate,
    static_equilibrium,
)
from tests.boundary.statics import MONDKAR_POWELL, section_of
from tests.boundary.unit_beam import HERE, unit_beam

LENGTH = 10.0  # of the flying beam and the arm


def light_beam(bending, **settings):
    """Return a beam with E A = 1e4 and a mass of 1 per length, without gravity."""
    section = section_of(bending, 1e4)
    density = 1 / section["thickness"]
    return Beam.uniform(length=LENGTH, density=density, gravity=(0.0, 0.0), **section, **settings)


def smooth_blow(force, moment):
    """Return the load (force, moment) sin^2(pi t/2.5) until 2.5."""
    time = np.linspace(0.0, 2.5, 5001)
    factor = np.sin(np.pi * time / 2.5) ** 2
    return SampledLoad(time, np.outer(factor, force), moment * factor)


def samples(run, times):
    """Return the numbers of the samples at some times."""
    return np.round(np.array(times) * (len(run.time) - 1) / run.time[-1]).astype(int)


def flying_beam_500(n):
    """The tip is A, and the beam begins at B."""
    model = Model(light_beam(500.0, elements=n, supports=(), axis=(0.6, -0.8)))
    run = simulate(model, load=smooth_blow((8.0, 0.0), -80.0), duration=7.5, sample_rate=20.0, tolerance=1e-7)
    at = samples(run, (1.25, 2.5, 5.0, 7.5))
    begin = run.position(0.0)[at] + np.array([0.0, 8.0])
    return np.hstack([run.tip[at] + np.array([0.0, 8.0]), begin])


def robot_arm_moment(n):
    """The tip of the beam is the pin.  Three Gauss points of the axial strain hold elements shorter than thick."""
    beam = light_beam(1000.0, elements=n, supports=(Pin(LENGTH),), axis=(-1.0, 0.0))
    model = Model(beam, StrainMeasures(axial_points=3))
    run = simulate(model, load=smooth_blow((0.0, 0.0), 160.0), duration=10.0, sample_rate=20.0, tolerance=1e-7)
    return run.position(0.0)[samples(run, (1.25, 2.5, 5.0, 10.0))] + np.array([LENGTH, 0.0])


def rubber_pendulum(n):
    """Three Gauss points of the axial strain converge faster, because the weight stretches the pendulum by 9 %."""
    thickness = np.sqrt(12 * 1.215e-8 / 0.0018)
    beam = Beam.uniform(
        length=1.2,
        width=0.0018 / thickness,
        thickness=thickness,
        density=5540.0,
        elastic_modulus=0.7e6,
        elements=n,
        axis=(1.0, 0.0),
        supports=(Pin(0.0),),
    )
    run = simulate(Model(beam, StrainMeasures(axial_points=3)), start="straight", duration=0.6, sample_rate=200.0)
    return run.tip[samples(run, (0.2, 0.4, 0.6))]


def clamped_clamped_step_force(n):
    """One half of the beam, with n elements; its end at the centre is guided and carries half of the force."""
    half = {**MONDKAR_POWELL, "length": 10.0}
    model = Model(Beam.uniform(**half, elements=n, supports=(Clamp(0.0), Guide(10.0, (0.0, 1.0))), **HERE))
    force = SampledLoad([0.0, 1.0], [[0.0, 320.0]] * 2)
    settings = {"duration": 2e-3, "sample_rate": 5e5, "tolerance": 3e-7}
    run = simulate(model, load=force, start=static_equilibrium(model), **settings)
    deflection = run.tip[:, 1]
    largest = deflection.argmax()
    return [deflection[largest], round(run.time[largest], 5), *deflection[samples(run, (0.5e-3, 1e-3, 1.5e-3, 2e-3))]]


def moving_force(n):
    """The other end rolls, so that the motion is linear."""
    model, force, found = Model(unit_beam(n, supports=(Pin(0.0), Roller(1.0)))), 1e-3, []
    for speed in (np.pi / 4, np.pi / 2):
        load = MovingForce((0.0, force), speed)
        run = simulate(model, load=load, duration=1 / speed, sample_rate=1600 * speed)
        found.append(48 * run.position(0.5)[:, 1].max() / force)
    return found
