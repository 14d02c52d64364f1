"""Modal damping from the modes of another beam, or with frequencies far from those of the model."""

import numpy as np
import pytest

from ancf_casadi import Clamp, ModalDamping, Model, Pin, Spring, natural_modes


@pytest.mark.parametrize("tip_mass", [2e-3, 5e-3, 20e-3])
def test_modes_of_a_bare_strip_are_named_where_a_mass_is_at_its_tip(paper_beam, tip_mass):
    """With 5 g, the ratio of 1 % becomes half as large."""
    bare, heavy = paper_beam(8), paper_beam(8, tip_mass=tip_mass)
    law, modes = ModalDamping(natural_modes(Model(bare), count=1), [0.01]), natural_modes(Model(heavy), count=1)
    with pytest.warns(UserWarning, match=r"those of another beam: mode 1 has [1-9]"):
        ratio = law.damping_ratios(modes, [1e-3])[0]
    assert ratio < 0.8 * 0.01


OTHER_BEAMS = {
    "a pin": {"supports": [Clamp(), Pin(0.25)]},
    "a spring": {"attachments": [Spring(0.5, stiffness=(20.0, 0.0))]},
    "another modulus": {"elastic_modulus": 840e9},
}


@pytest.mark.parametrize("changed", OTHER_BEAMS)
def test_modes_of_a_strip_that_is_held_otherwise_are_named(paper_beam, changed):
    other = natural_modes(Model(paper_beam(8, **OTHER_BEAMS[changed])), count=3)
    law = ModalDamping(natural_modes(Model(paper_beam(8)), count=3), [0.01, 0.02, 0.03])
    with pytest.warns(UserWarning, match="those of another beam"):
        ratios = law.damping_ratios(other, [1e-3] * 3)
    assert np.abs(ratios / law.ratios - 1).max() > 0.2


@pytest.mark.parametrize("factor", [0.5, 1.48, 3.0])
def test_frequencies_far_from_those_of_the_modes_are_named(paper_beam, factor):
    modes = natural_modes(Model(paper_beam(8)), count=2)
    with pytest.warns(UserWarning, match=r"the frequency of mode 2, \S+ Hz, is far from the \S+ Hz of the modes"):
        law = ModalDamping(modes, [0.01, 0.01], frequencies=modes.frequencies * [1.0, factor])
    assert law.damping_ratios(modes, [1e-3, 1e-3]) == pytest.approx([0.01, 0.01 * factor])


def test_another_axis_and_measured_frequencies_nearby_are_silent(paper_beam):
    modes = natural_modes(Model(paper_beam(8)), count=2)
    law = ModalDamping(modes, [0.01, 0.01], frequencies=modes.frequencies * [0.9, 1.1])
    level = natural_modes(Model(paper_beam(8, axis=(0.0, 1.0))), count=2)
    assert law.damping_ratios(level, [1e-3, 1e-3]).max() > 0.005
