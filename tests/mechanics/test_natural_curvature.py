"""Beams that are bent without stress."""

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import Model, RayleighDamping, SampledLoad, Sensor, StrainMeasures, simulate, static_equilibrium
from ancf_casadi.dynamics.derivatives.reading import SampledMotion
from ancf_casadi.dynamics.equations import Equations

WEIGHTLESS = {"axis": (0.6, -0.8), "gravity": (0.0, 0.0)}
COILED = (4.0, 0.0, -6.0, 5.0)  # 1/m


def turning(coordinates):
    """Velocities of a rigid rotation about the origin at 1 rad/s."""
    nodes = coordinates.reshape(-1, 2)
    return np.column_stack([-nodes[:, 1], nodes[:, 0]]).ravel()


@pytest.mark.parametrize("curvature", ["material", "geometric", "small"])
@pytest.mark.parametrize("axial", ["engineering", "green"])
def test_a_bent_beam_as_manufactured_is_free_of_stress_on_any_mesh(paper_beam, axial, curvature):
    model = Model(paper_beam(4, natural_curvature=COILED, **WEIGHTLESS), StrainMeasures(axial, curvature))
    e, p = model.straight, model.properties
    straight = Model(paper_beam(4, **WEIGHTLESS), model.measures)
    assert float(straight.strain_energy(e, p)) > 1e-3
    assert float(model.strain_energy(e, p)) < 1e-20
    assert abs(model.elastic_force(e, p).full()).max() < 1e-8  # E A = 5e5 N
    assert abs(model.tangent_force(e, turning(e), p).full()).max() < 1e-8
    assert abs(model.reference_force(turning(e), p).full()).max() < 1e-8


def test_a_moment_straightens_a_coarse_bent_beam(paper_beam, bending_stiffness):
    """The cubics of 10 elements miss this arc by a strain whose tension is 80 times the buckling load."""
    beam = paper_beam(10, natural_curvature=6.0, **WEIGHTLESS)
    rest = static_equilibrium(Model(beam), tip_moment=-6.0 * bending_stiffness(beam))
    np.testing.assert_allclose(rest.tip, 0.5 * np.array(beam.axis), rtol=0.0, atol=1e-4 * beam.length)
    assert rest.stable


@pytest.mark.slow
def test_the_straightened_beam_converges_at_order_four(paper_beam, bending_stiffness):
    errors = []
    for elements in (8, 16, 32):
        beam = paper_beam(elements, natural_curvature=6.0, **WEIGHTLESS)
        rest = static_equilibrium(Model(beam), tip_moment=-6.0 * bending_stiffness(beam))
        errors.append(np.linalg.norm(rest.tip - 0.5 * np.array(beam.axis)))
    np.testing.assert_allclose(-np.diff(np.log2(errors)), 4.0, atol=0.1)


@pytest.mark.slow
def test_a_bent_beam_without_load_reads_no_force_and_no_moment(paper_beam):
    run = simulate(Model(paper_beam(8, natural_curvature=6.0, **WEIGHTLESS)), start="straight", duration=0.01)
    for point in (0.0, 0.11, 0.5):
        assert run.curvature(point) == pytest.approx(6.0, rel=1e-3)
        assert abs(run.bending_moment(point)).max() < 1e-9
        assert abs(run.axial_force(point)).max() < 1e-6


@pytest.mark.slow
def test_a_bent_beam_under_a_moment_reads_this_moment(paper_beam, bending_stiffness):
    beam = paper_beam(16, natural_curvature=6.0, **WEIGHTLESS)
    moment = -3.0 * bending_stiffness(beam)
    run = simulate(Model(beam), load=SampledLoad([0.0, 1.0], np.zeros((2, 2)), [moment, moment]), duration=0.01)
    for point in (0.0, 0.11, 0.5):
        assert run.bending_moment(point)[-1] == pytest.approx(moment, rel=2e-3)


def test_a_strain_gauge_on_a_bent_beam_reads_the_strain_beyond_its_shape_without_load(paper_beam):
    """For the same shape, the reading changes by z per unit of natural curvature."""
    model = Model(paper_beam(32, natural_curvature=[6.0, 3.0] * 16, **WEIGHTLESS))
    equations, still = Equations(model, RayleighDamping()), cs.MX.zeros(model.size)
    parameters = cs.MX.sym("parameters", len(equations.parameters))
    motion = SampledMotion.of(equations, cs.MX(cs.DM(model.straight)), still, still, cs.MX.zeros(3), parameters)
    reading = motion.read(Sensor("strain", 0.115))
    found = cs.Function("found", [parameters], [reading, cs.gradient(reading, parameters)])
    value, slope = (part.full().ravel() for part in found(equations.parameters))
    assert abs(value[0]) < 1e-3 * 0.25e-3 * 3.0
    assert slope[-1] == pytest.approx(0.25e-3 / 2, rel=1e-12)
