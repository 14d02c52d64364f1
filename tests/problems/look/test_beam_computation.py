"""Where the first guesses of a fit stand in a study."""

import pytest

from problems.command.init import STUDY
from problems.look.beam_computation import guess_places
from problems.spec.editing import EditedStudy


@pytest.fixture
def edited(study_file):
    """A function that reads a study from its text."""
    return lambda text: EditedStudy.of(str(study_file(text)))


def test_places_of_guesses_are_those_of_the_parameters_and_properties(edited):
    names = ["ratio2", "eta2", "elastic_modulus", "bending_stiffness", "tip_mass", "base_amplitude"]
    study = edited(STUDY)
    places = guess_places(study.file, names)
    assert places == {
        "ratio2": ("damping", 0, "ratios", 1),
        "eta2": ("damping", 1, "eta2"),
        "elastic_modulus": ("beam", "elastic_modulus"),
        "bending_stiffness": ("beam", "elastic_modulus"),
    }
    scaled = study.scaled(places["ratio2"], 1.5).with_value(("beam", "elastic_modulus"), [2e11, 1e11])
    assert scaled.value(("damping", 0, "ratios")) == [0.005, 0.0045]
    assert scaled.scaled(places["elastic_modulus"], 1.1).value(("beam", "elastic_modulus")) == [2.2e11, 1.1e11]


def test_a_second_law_of_a_kind_has_its_own_place(edited):
    law = '[[damping]]\nlaw = "quadratic"\neta2 = 0.1\n'
    study = edited(STUDY[STUDY.index("[beam]") : STUDY.index("[match]")] + 2 * law)
    assert guess_places(study.file, ["eta2", "eta2_2"]) == {
        "eta2": ("damping", 0, "eta2"),
        "eta2_2": ("damping", 1, "eta2"),
    }
