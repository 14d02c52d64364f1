import dataclasses
import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ancf_casadi import Beam, InputError, Section

GOOD = {"length": 0.5, "width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elastic_modulus": 210e9, "elements": 4}
PROPERTIES = ("width", "thickness", "density", "elastic_modulus")

TOML = """
[beam]
length = 0.5
elements = 4
width = 5e-3
thickness = [0.5e-3, 0.5e-3, 0.4e-3, 0.4e-3]
density = 8000
elastic_modulus = 210e9
axis = [0, 1]
"""

magnitudes = st.floats(min_value=1e-6, max_value=1e12)


def test_a_rectangular_section_has_area_bh_and_second_moment_bh3_12():
    section = Section(width=6.0, thickness=2.0)
    assert section.area == 12.0
    assert section.second_moment == 4.0


def test_a_number_applies_to_all_elements_and_a_sequence_is_kept():
    beam = Beam.uniform(**{**GOOD, "thickness": [1e-3, 2e-3, 3e-3, 4e-3]})
    assert beam.elements == 4
    assert beam.element_lengths.tolist() == [0.125] * 4
    assert beam.width == (5e-3,) * 4
    assert beam.thickness == (1e-3, 2e-3, 3e-3, 4e-3)
    assert [section.thickness for section in beam.sections] == [1e-3, 2e-3, 3e-3, 4e-3]


def test_arrays_and_numpy_integers_are_accepted_like_lists_and_ints():
    from_arrays = Beam.uniform(**{**GOOD, "width": np.full(4, 5e-3), "elements": np.int64(4)})
    assert from_arrays == Beam.uniform(**GOOD)


def test_the_mass_adds_up_over_unequal_elements():
    beam = Beam.uniform(**{**GOOD, "width": [1e-3, 2e-3, 3e-3, 4e-3], "density": [1e3, 2e3, 3e3, 4e3]})
    assert beam.mass == pytest.approx(0.125 * 0.5e-3 * (1 + 4 + 9 + 16))


def test_by_default_the_beam_hangs_under_standard_gravity():
    beam = Beam.uniform(**GOOD)
    assert (beam.axis, beam.gravity) == ((0.0, -1.0), (0.0, -9.81))


def test_the_axis_is_kept_as_a_unit_vector():
    assert Beam.uniform(**GOOD, axis=(3.0, -4.0)).axis == (0.6, -0.8)


def test_a_beam_cannot_be_changed_in_place():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Beam.uniform(**GOOD).length = 1.0


def test_with_returns_a_changed_copy_and_applies_numbers_to_all_elements():
    beam = Beam.uniform(**GOOD)
    changed = beam.with_(density=7850.0, thickness=[1e-3, 1e-3, 2e-3, 2e-3], axis=(0.0, 2.0))
    assert changed.density == (7850.0,) * 4
    assert changed.thickness == (1e-3, 1e-3, 2e-3, 2e-3)
    assert changed.axis == (0.0, 1.0)
    assert changed.width == beam.width
    assert beam == Beam.uniform(**GOOD)


def test_a_toml_file_gives_the_beam_of_its_table(tmp_path):
    path = tmp_path / "beam.toml"
    path.write_text(TOML)
    changes = {"thickness": [0.5e-3, 0.5e-3, 0.4e-3, 0.4e-3], "axis": (0.0, 1.0)}
    assert Beam.from_toml(path) == Beam.uniform(**{**GOOD, **changes})


@pytest.mark.parametrize("name", PROPERTIES)
@pytest.mark.parametrize(
    "value", [0.0, -1.0, math.nan, math.inf, "wide", None, True, 10**400, [5e-3, -5e-3, 5e-3, 5e-3]]
)
def test_a_property_that_is_not_a_positive_number_is_rejected_by_name(name, value):
    with pytest.raises(InputError, match=f"^{name}: must be (positive|a finite number), got") as caught:
        Beam.uniform(**{**GOOD, name: value})
    assert caught.value.where == name


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"length": 0.0}, "length: must be positive, got 0"),
        ({"length": math.nan}, "length: must be a finite number, got nan"),
        ({"elements": 1}, "elements: must be a whole number, 2 to 10000, got 1"),
        ({"elements": -3}, "elements: must be a whole number, 2 to 10000, got -3"),
        ({"elements": 10**30}, f"elements: must be a whole number, 2 to 10000, got {10**30}"),
        ({"elements": 4.0}, "elements: must be a whole number, 2 to 10000, got 4.0"),
        ({"elements": True}, "elements: must be a whole number, 2 to 10000, got True"),
        ({"width": [5e-3] * 3}, "width: has 3 values for 4 elements"),
        ({"axis": (0.0, 0.0)}, "axis: must not be the zero vector"),
        ({"axis": (0.0, 0.0, 1.0)}, "axis: must be a pair of numbers (x, y), got (0.0, 0.0, 1.0)"),
        ({"axis": {"x": 0.0, "y": 1.0}}, "axis: must be a pair of numbers (x, y), got {'x': 0.0, 'y': 1.0}"),
        ({"axis": "up"}, "axis: must be a pair of numbers (x, y), got 'up'"),
        ({"gravity": 9.81}, "gravity: must be a pair of numbers (x, y), got 9.81"),
        ({"tip_mass": -0.1}, "tip_mass: must not be negative, got -0.1"),
        ({"tip_mass": math.inf}, "tip_mass: must be a finite number, got inf"),
        ({"clamp_stiffness": 0.0}, "clamp_stiffness: must be positive, got 0"),
        ({"clamp_stiffness": math.nan}, "clamp_stiffness: must be a finite number, got nan"),
        ({"clamp_stiffness": [1.0]}, "clamp_stiffness: must be a finite number, got [1.0]"),
        ({"gravity": (0.0, -math.inf)}, "gravity: must be a finite number, got -inf"),
    ],
)
def test_unusable_input_is_rejected_with_its_name_and_the_requirement(changes, message):
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        Beam.uniform(**{**GOOD, **changes})


@pytest.mark.parametrize(
    ("name", "value", "what"),
    [
        ("length", 1e308, "mass"),
        ("length", 1e-308, "mass"),
        ("thickness", [5e-4, 5e-4, 5e-4, 1e300], "mass"),
        ("elastic_modulus", 1e300, "axial stiffness"),
        ("elastic_modulus", 1e-95, "bending stiffness"),
    ],
)
def test_values_beyond_the_range_of_numbers_are_rejected_with_a_hint_at_the_units(name, value, what):
    with pytest.raises(InputError, match=f"^the {what} of element [14] is .*, beyond the range of numbers; check"):
        Beam.uniform(**{**GOOD, name: value})


def test_the_constructor_needs_one_value_per_element():
    for properties, message in (
        (((5e-3,) * 2, (0.5e-3,) * 3, (8000.0,) * 2, (210e9,) * 2), "thickness: has 3 values for 2 elements"),
        ((5e-3, 0.5e-3, 8000.0, 210e9), "width: must have one value per element"),
        (((5e-3,), (0.5e-3,), (8000.0,), (210e9,)), "elements: must be a whole number"),
    ):
        with pytest.raises(InputError, match=f"^{message}"):
            Beam(0.5, *properties)


def test_with_rejects_unknown_properties():
    with pytest.raises(InputError, match=r"^colour: is not a property of the beam; known are attachments, axis"):
        Beam.uniform(**GOOD).with_(colour="red")
    with pytest.raises(InputError, match=r"^width: has 2 values for 4 elements$"):
        Beam.uniform(**GOOD).with_(width=[1e-3, 1e-3])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("length = 0.5", "{path}: [beam]: the table is missing"),
        ("beam = 3", "{path}: [beam]: must be a table, got 3"),
        (TOML.replace("width = 5e-3", ""), "{path}: [beam]: the key 'width' is missing"),
        (TOML + "colour = 'red'", "{path}: [beam]: unknown key 'colour'; known are attachments, axis"),
        (TOML.replace("5e-3\nthickness", "-5e-3\nthickness"), "{path}: [beam]: width: must be positive, got -0.005"),
        (TOML.replace("[0, 1]", "{x = 0, y = 1}"), "{path}: [beam]: axis: must be a pair of numbers (x, y), got {"),
        ("[beam", "{path}: is not TOML ("),
    ],
)
def test_an_unusable_toml_file_is_rejected_with_file_and_key(tmp_path, text, message):
    path = tmp_path / "beam.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=f"^{re.escape(message.replace('{path}', str(path)))}"):
        Beam.from_toml(path)


def test_a_missing_toml_file_is_named_in_the_error(tmp_path):
    path = tmp_path / "missing.toml"
    with pytest.raises(InputError, match=f"^{re.escape(str(path))}: cannot be read \\(No such file or directory\\)$"):
        Beam.from_toml(path)


@settings(max_examples=40, deadline=None, database=None)
@given(
    length=magnitudes,
    width=magnitudes,
    thickness=magnitudes,
    density=magnitudes,
    elements=st.integers(min_value=2, max_value=30),
    angle=st.floats(min_value=-10.0, max_value=10.0),
)
def test_any_positive_numbers_make_a_beam_of_mass_rho_b_h_l(length, width, thickness, density, elements, angle):
    axis = (math.cos(angle), math.sin(angle))
    beam = Beam.uniform(
        length=length,
        width=width,
        thickness=thickness,
        density=density,
        elastic_modulus=1.0,
        elements=elements,
        axis=axis,
    )
    assert beam.mass == pytest.approx(density * width * thickness * length, rel=1e-12)
    assert beam.element_lengths.sum() == pytest.approx(length, rel=1e-12)
    assert math.hypot(*beam.axis) == pytest.approx(1.0, rel=1e-12)
