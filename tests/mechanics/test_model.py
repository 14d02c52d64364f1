import pickle
import re

import numpy as np
import pytest

from ancf_casadi import InputError, Model, StrainMeasures


@pytest.fixture(scope="module")
def model(paper_beam):
    """Four elements that differ in every property, tilted."""
    return Model(
        paper_beam(
            elements=4,
            width=[5e-3, 4e-3, 6e-3, 5e-3],
            thickness=[4e-3, 5e-3, 3e-3, 6e-3],
            density=[8000.0, 7000.0, 9000.0, 8500.0],
            elastic_modulus=[2.1e9, 1.9e9, 2.3e9, 2.0e9],
            axis=(0.6, -0.8),
        )
    )


def deformed(model, seed):
    """Coordinates of a moderately stretched and bent beam, off its clamp."""
    noise = np.random.default_rng(seed).normal(size=model.size)
    return model.straight + noise * np.tile([2e-3, 2e-3, 0.1, 0.1], model.beam.elements + 1)


def dense(function, *arguments):
    return function(*arguments).full().squeeze()


def elements_of(e):
    """Coordinates of each element."""
    return [e[4 * k : 4 * k + 8] for k in range(len(e) // 4 - 1)]


def properties_of_elements(model):
    """Properties of each element as columns: those in P, the length and the axis."""
    length_and_axis = [model.beam.element_lengths[0], *model.beam.axis]
    return np.vstack([model.properties, np.outer(length_and_axis, np.ones(model.beam.elements))])


def test_the_straight_beam_has_its_nodes_along_the_axis_and_unit_slopes(model):
    nodes = model.straight.reshape(-1, 4)
    np.testing.assert_allclose(nodes[:, :2], np.outer([0, 0.125, 0.25, 0.375, 0.5], [0.6, -0.8]), atol=1e-15)
    np.testing.assert_allclose(nodes[:, 2:], np.tile([0.6, -0.8], (5, 1)), atol=1e-15)


def test_the_clamp_fixes_the_four_coordinates_of_the_first_node(model):
    assert model.size == 20 and model.freedoms == 16
    np.testing.assert_array_equal(model.whole_of_free.full(), np.eye(20)[:, 4:])
    np.testing.assert_array_equal(model.whole_of_base, np.eye(20)[:, :4])


def test_energies_and_forces_are_the_sums_over_the_elements_with_their_own_properties(model):
    e, velocity, g = deformed(model, 0), np.random.default_rng(1).normal(size=model.size), [1.0, -9.81]
    energy = 0.0
    sums = {name: np.zeros(model.size) for name in ("elastic", "tangent", "strain_rate", "drag", "friction", "gravity")}
    element, properties = model.element, properties_of_elements(model)
    for k, (nodes, rates) in enumerate(zip(elements_of(e), elements_of(velocity), strict=True)):
        p, rows = properties[:, k], slice(4 * k, 4 * k + 8)
        energy += float(element.strain_energy(nodes, p))
        sums["elastic"][rows] += dense(element.elastic_force, nodes, p)
        sums["tangent"][rows] += dense(element.tangent_force, nodes, rates, p)
        sums["strain_rate"][rows] += dense(element.strain_rate_force, nodes, rates, p)
        sums["drag"][rows] += dense(element.drag_force, rates, p)
        sums["friction"][rows] += dense(element.friction_force, rates, p, 0.5)
        sums["gravity"][rows] += dense(element.gravity_force, p, g)
    P = model.properties
    assert float(model.strain_energy(e, P)) == pytest.approx(energy, rel=1e-13)
    got = {
        "elastic": dense(model.elastic_force, e, P),
        "tangent": dense(model.tangent_force, e, velocity, P),
        "strain_rate": dense(model.strain_rate_force, e, velocity, P),
        "drag": dense(model.drag_force, velocity, P),
        "friction": dense(model.friction_force, velocity, P, 0.5),
        "gravity": dense(model.gravity_force, P, g),
    }
    for name, expected in sums.items():
        np.testing.assert_allclose(got[name], expected, atol=1e-12 * abs(expected).max(), err_msg=name)


def test_matrices_are_the_sums_over_the_elements_and_couple_neighbouring_nodes_only(model):
    e, P, properties = deformed(model, 0), model.properties, properties_of_elements(model)
    mass, stiffness = np.zeros((2, model.size, model.size))
    for k, part in enumerate(elements_of(e)):
        rows = slice(4 * k, 4 * k + 8)
        mass[rows, rows] += dense(model.element.mass, properties[:, k])
        stiffness[rows, rows] += dense(model.element.tangent_stiffness, part, properties[:, k])
    np.testing.assert_allclose(dense(model.mass, P), mass, atol=1e-15 * mass.max())
    np.testing.assert_allclose(dense(model.tangent_stiffness, e, P), stiffness, atol=1e-12 * stiffness.max())
    assert model.mass(P).nnz() == model.tangent_stiffness(e, P).nnz() == 16 * (5 + 2 * 4)


def test_the_clamp_holds_the_three_rigid_motions_and_the_axial_pattern_that_two_gauss_points_do_not_see(model):
    """Equal changes of all slopes strain no Gauss point; the clamp fixes the first slope and thereby all."""
    stiffness = dense(model.tangent_stiffness, model.straight, model.properties)
    values = np.linalg.eigvalsh(stiffness)
    assert (values < 1e-9 * values.max()).sum() == 4
    assert np.linalg.eigvalsh(stiffness[slice(4, model.size), slice(4, model.size)]).min() > 1e-9 * values.max()


def test_the_functions_are_symbolic_in_the_properties(model):
    """Mass is linear in the density, stiffness in the modulus."""
    e = deformed(model, 0)
    heavier, stiffer = model.properties.copy(), model.properties.copy()
    heavier[2] *= 3
    stiffer[3] *= 2
    np.testing.assert_allclose(dense(model.mass, heavier), 3 * dense(model.mass, model.properties), rtol=1e-13)
    expected = 2 * dense(model.elastic_force, e, model.properties)
    np.testing.assert_allclose(dense(model.elastic_force, e, stiffer), expected, rtol=1e-12)


def test_a_point_of_the_straight_beam_lies_at_its_arc_length_along_the_axis(model):
    for s in (0.0, 0.01, 0.125, 0.3, 0.499, 0.5):
        np.testing.assert_allclose(model.interpolation(s) @ model.straight, s * np.array([0.6, -0.8]), atol=1e-16)
        np.testing.assert_allclose(model.slope_interpolation(s) @ model.straight, [0.6, -0.8], atol=1e-14)


def test_points_at_nodes_are_the_nodal_coordinates(model):
    e = deformed(model, 0)
    for k, s in enumerate((0.0, 0.125, 0.25, 0.375, 0.5)):
        np.testing.assert_allclose(model.interpolation(s) @ e, e[4 * k : 4 * k + 2], atol=1e-15)
        np.testing.assert_allclose(model.slope_interpolation(s) @ e, e[4 * k + 2 : 4 * k + 4], atol=1e-14)


def test_the_slope_is_the_derivative_of_the_position_and_continuous_across_nodes(model):
    e, h = deformed(model, 0), 1e-7
    for s in (0.01, 0.125, 0.3, 0.499):
        slope = (model.interpolation(s + h) - model.interpolation(s - h)) @ e / (2 * h)
        np.testing.assert_allclose(model.slope_interpolation(s) @ e, slope, atol=1e-5)


@pytest.mark.parametrize(
    ("s", "message"),
    [
        (-1e-9, "point: the point must be on the beam, 0 to 0.5 m, got -1e-09"),
        (0.6, "point: the point must be on the beam, 0 to 0.5 m, got 0.6"),
        (float("nan"), "point: must be a finite number, got nan"),
        ("tip", "point: must be a finite number, got 'tip'"),
    ],
)
def test_a_point_that_is_not_on_the_beam_is_rejected(model, s, message):
    for interpolation in (model.interpolation, model.slope_interpolation):
        with pytest.raises(InputError, match=f"^{re.escape(message)}"):
            interpolation(s)


def test_models_are_equal_when_beam_and_strain_measures_are(paper_beam):
    assert Model(paper_beam()) == Model(paper_beam())
    assert Model(paper_beam()) != Model(paper_beam(density=7850.0))
    assert Model(paper_beam()) != Model(paper_beam(), StrainMeasures(axial="green"))


def test_a_used_model_can_be_pickled(model):
    again = pickle.loads(pickle.dumps(model))
    assert again == model
    np.testing.assert_array_equal(dense(again.mass, again.properties), dense(model.mass, model.properties))
