"""Reduced models of a beam whose properties change a little."""

import numpy as np

from ancf_casadi import Beam, Model, reduce_model
from ancf_casadi.reduction.reduced import rebuild_reduction
from ancf_casadi.response.harmonic_balance.beams import reduced_system

STEEL = {"length": 0.5, "width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elements": 4}


def test_a_rebuilt_model_keeps_the_points_that_would_jump_with_the_properties():
    first = reduce_model(Model(Beam.uniform(**STEEL, elastic_modulus=200e9, clamp_stiffness=0.5)), modes=3)
    changed = Model(Beam.uniform(**STEEL, elastic_modulus=212e9, clamp_stiffness=0.384))
    rows = first.projection.slopes.rows
    assert (reduce_model(changed, modes=3).projection.slopes.rows != rows).any()
    found = rebuild_reduction(first, changed)
    assert (found.projection.slopes.rows == rows).all()
    np.testing.assert_allclose(found.modes.frequencies, reduce_model(changed, modes=3).modes.frequencies, rtol=1e-12)


def test_a_model_rebuilt_with_the_same_properties_is_the_same():
    first = reduce_model(Model(Beam.uniform(**STEEL, elastic_modulus=200e9)), modes=3)
    motion = *np.random.default_rng(0).standard_normal((3, 3)), np.zeros(12), first.values
    forces = [
        reduced_system(own).functions(1).balance(*motion) for own in (first, rebuild_reduction(first, first.model))
    ]
    np.testing.assert_allclose(forces[1], forces[0], rtol=1e-12)
