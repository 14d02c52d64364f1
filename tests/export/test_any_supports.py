"""Functions of a beam between two hinges with all kinds of attachments, and of a beam on slanted rollers."""

import math

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import (
    BaseMotion,
    Beam,
    Dashpot,
    Model,
    Pin,
    PointMass,
    QuadraticDamping,
    RayleighDamping,
    Roller,
    RotationalSpring,
    Spring,
    natural_modes,
    simulate,
    static_equilibrium,
)
from ancf_casadi.dynamics.base_motion import Piece
from ancf_casadi.export import beam_functions, values
from ancf_casadi.export.solved_functions import SDIRK_STAGES

LAW = RayleighDamping(alpha=0.5, beta=3e-5) + QuadraticDamping(eta2=0.2)
AMPLITUDE, OMEGA = np.array([1e-3, 2e-3, 0.02]), 40.0  # of the base: x, y (m) and rotation (rad); rad/s
SETTINGS = {"width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elastic_modulus": 210e9, "elements": 4}
HINGED = Beam.uniform(
    **SETTINGS,
    length=0.5,
    axis=(1.0, 0.0),
    natural_curvature=[0.1, 0.1, -0.2, 0.0],
    prestress=[1e6, 2e6, 1e6, 0.0],
    supports=(Pin(0.0), Pin(0.5, displacement=(-1e-4, 0.0))),
    attachments=(
        PointMass(0.2, 2e-3, rotary_inertia=1e-7),
        Spring(0.3, (1.0, 4.0)),
        RotationalSpring(0.0, 2e-3),
        Dashpot(0.2, (0.0, 0.01)),
    ),
)
ROLLING = HINGED.with_(supports=(Pin(0.1), Roller(0.5, direction=(1.0, 0.5))))


class Rocking(BaseMotion):
    """A base that swings and turns."""

    def pieces(self):
        return (Piece(math.inf, lambda t, _: cs.DM(AMPLITUDE) * cs.sin(OMEGA * t)),)


def rocking(t):
    """Return displacements and rotation, velocities and accelerations of the base."""
    sine, cosine = math.sin(OMEGA * t), math.cos(OMEGA * t)
    return np.concatenate([AMPLITUDE * sine, OMEGA * AMPLITUDE * cosine, -(OMEGA**2) * AMPLITUDE * sine])


@pytest.fixture(scope="module", params=[HINGED, ROLLING], ids=["hinged", "rolling"])
def functions(request):
    model = Model(request.param)
    return model, beam_functions(model, LAW, markers=(0.2,), modes=3)


@pytest.mark.slow
def test_steps_on_a_rocking_base_agree_with_simulate(functions):
    """The steps are of order 2: half the step has a quarter of the error."""
    model, exported = functions
    duration, p, errors = 0.05, values(exported.parameters), []
    run = simulate(model, damping=LAW, base=Rocking(), duration=duration, sample_rate=100.0, tolerance=1e-9)
    for count in (100, 200):
        h, q, v = duration / count, model.of_free(run.coordinates[0]), model.of_free(run.velocities[0])
        for k in range(count):
            stages = np.column_stack([rocking((k + part) * h) for part in SDIRK_STAGES])
            q, v = exported.step(q, v, stages, p, h)
        found = [exported.markers(q, rocking(duration)), exported.tip(q, rocking(duration))]
        truth = [run.position(0.2)[-1], run.tip[-1]]
        errors.append(float(np.abs(np.ravel(found) - np.ravel(truth)).max()))
    assert np.ptp(run.position(0.2)[:, 1]) > 2e-3
    assert errors[1] < 2e-6
    assert 3.0 < errors[0] / errors[1] < 5.0


@pytest.mark.slow
def test_rest_and_frequencies_agree_with_the_model(functions):
    model, exported = functions
    p, beam = values(exported.parameters), model.beam
    names = np.array([signal.name for signal in exported.parameters])
    thicker = Model(beam.with_(thickness=[1.1 * thickness for thickness in beam.thickness]))
    for other, parameters in ((model, p), (thicker, np.where(np.char.startswith(names, "thickness"), 1.1 * p, p))):
        rest = other.of_free(static_equilibrium(other).coordinates)
        np.testing.assert_allclose(exported.equilibrium(parameters).full().ravel(), rest, atol=1e-9)
        frequencies = natural_modes(other, count=3).frequencies
        np.testing.assert_allclose(exported.frequencies(parameters).full().ravel(), frequencies, rtol=1e-7)


@pytest.mark.slow
def test_a_node_on_a_slanted_roller_has_one_coordinate():
    model = Model(ROLLING)
    states = {signal.name: signal for signal in beam_functions(model, modes=1).states}
    assert {"x_4", "y_4"}.isdisjoint(states)
    place = static_equilibrium(model).coordinates[-4:-2]
    assert states["slide_4"].value == pytest.approx(place @ np.array([2.0, 1.0]) / math.sqrt(5.0))
