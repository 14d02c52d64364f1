"""Damped modes and critical loads of a beam whatever its direction, and however it comes to it."""

import math

import numpy as np
import pytest

from ancf_casadi import Clamp, Model, PointLoad, critical_load


def euler(beam):
    """The load pi^2 E I/(4 L^2) of a cantilever (Euler 1744)."""
    return math.pi**2 * beam.bending_stiffness[0] / (4 * beam.length**2)


@pytest.mark.parametrize("angle", [0.3, math.pi / 2, 3.0])
@pytest.mark.parametrize("by_clamp", [True, False])
def test_a_column_buckles_under_eulers_load_in_any_direction(paper_beam, angle, by_clamp):
    """The clamp turns first; next to the critical load, rounding of the position moves the beam aside."""
    direction = math.cos(angle), math.sin(angle)
    turned = {"supports": (Clamp(rotation=angle),), "axis": (1.0, 0.0)} if by_clamp else {"axis": direction}
    beam = paper_beam(8, gravity=(0.0, 0.0), **turned)
    load = PointLoad(tuple(-euler(beam) * np.array(direction)))
    critical = critical_load(Model(beam), [load], largest_factor=2.0, steps=5)
    assert (critical.factor, critical.kind) == (pytest.approx(1.0, rel=1e-5), "divergence")


@pytest.mark.slow
def test_an_undamped_column_of_many_elements_does_not_seem_to_flutter(paper_beam):
    """Next to its critical load K has nearly no inverse; modes that are sought next to s = 0 grow there by rounding."""
    direction = np.array([math.cos(1.0), math.sin(1.0)])
    beam = paper_beam(120, axis=direction, gravity=(0.0, 0.0))
    critical = critical_load(Model(beam), [PointLoad(tuple(-euler(beam) * direction))], largest_factor=1.5, steps=3)
    assert (critical.factor, critical.kind) == (pytest.approx(1.0, rel=1e-5), "divergence")
