"""Response curves as a block: the reduced model that the unknown properties change."""

import pytest

from ancf_casadi import Beam, HarmonicBase, Model, QuadraticDamping
from problems import ResponseRecord
from problems.beam.curves.block import curve_block

STEEL = {"length": 0.5, "width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elements": 3}


@pytest.mark.parametrize("clamp", [{}, {"clamp_stiffness": 0.4}])
def test_a_changed_modulus_leaves_the_clamp_as_it_is(clamp):
    record = ResponseRecord([1.70, 1.75], [0.01, 0.02], base=HarmonicBase(amplitude=1e-3, frequency=1.0))
    law, size = QuadraticDamping(eta1=1.0), {"modes": 2, "harmonics": 3}

    def residuals(modulus, first, values):
        model = Model(Beam.uniform(**STEEL, **clamp, elastic_modulus=modulus))
        return curve_block(model, [(1, record)], law, tuple(first), first, **size).at(values)[0]

    factor = residuals(200e9, {"elastic_modulus": 200e9}, {"elastic_modulus": 202e9})
    rebuilt = residuals(202e9, {"tip_mass": 1e-3}, {"tip_mass": 1e-3})  # of which this beam has none
    assert factor == pytest.approx(rebuilt, rel=1e-4)
