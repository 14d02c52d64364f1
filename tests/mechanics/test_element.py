import numpy as np
import pytest

from ancf_casadi import InputError, StrainMeasures
from ancf_casadi.mechanics.element import element

LENGTH = 0.1
WIDTH, THICKNESS, DENSITY, MODULUS = 5e-3, 2e-3, 8000.0, 2e9
PROPERTIES = np.array([WIDTH, THICKNESS, DENSITY, MODULUS, LENGTH, 1.0, 0.0])
AREA, LINE_DENSITY = WIDTH * THICKNESS, DENSITY * WIDTH * THICKNESS

MEASURES = [
    StrainMeasures(axial, curvature)
    for axial in ("engineering", "green")
    for curvature in ("material", "geometric", "small")
]
STEP = 1e-6


def name(measures):
    return f"{measures.axial}-{measures.curvature}"


@pytest.fixture(params=MEASURES, ids=name, scope="module")
def functions(request):
    return element(request.param)


def straight(stretch=1.0):
    return np.array([0.0, 0.0, stretch, 0.0, stretch * LENGTH, 0.0, stretch, 0.0])


def deformed(seed):
    """Coordinates of a moderately stretched, bent and rotated element."""
    rng = np.random.default_rng(seed)
    return turn(straight() + rng.normal(size=8) * np.tile([0.02 * LENGTH] * 2 + [0.1] * 2, 2), rng.uniform(-3, 3))


def turn(e, angle):
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return (e.reshape(-1, 2) @ rotation.T).ravel()


def spin(e):
    """Velocities of a rigid rotation at 1 rad/s."""
    return (e.reshape(-1, 2) @ np.array([[0.0, 1.0], [-1.0, 0.0]])).ravel()


def dense(function, *arguments):
    return function(*arguments).full().squeeze()


def energy(functions, e):
    return float(functions.strain_energy(e, PROPERTIES))


def difference(function, x):
    """Central differences of a function of a vector, one column per component of x."""
    columns = [(function(x + h) - function(x - h)) / (2 * STEP) for h in STEP * np.eye(len(x))]
    return np.array(columns).T


@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 2, -2.5])
def test_a_rigid_rotation_and_translation_store_no_energy_and_exert_no_force(functions, angle):
    moved = turn(straight(), angle) + np.tile([1.0, -2.0, 0.0, 0.0], 2)
    assert energy(functions, moved) < 1e-25 * MODULUS
    assert np.abs(dense(functions.elastic_force, moved, PROPERTIES)).max() < 1e-14 * MODULUS * AREA / LENGTH


@pytest.mark.parametrize("seed", range(3))
def test_a_rigid_motion_does_not_change_the_energy_of_a_deformed_element(functions, seed):
    e = deformed(seed)
    moved = turn(e, 1.234) + np.tile([0.3, -0.2, 0.0, 0.0], 2)
    assert energy(functions, e) > 1e-3
    assert energy(functions, moved) == pytest.approx(energy(functions, e), rel=1e-11)


@pytest.mark.parametrize(("axial", "strain"), [("engineering", 0.1), ("green", (1.1**2 - 1) / 2)])
def test_a_uniform_stretch_stores_half_ea_eps_squared_l(axial, strain):
    stretched = element(StrainMeasures(axial=axial))
    expected = MODULUS * AREA * strain**2 * LENGTH / 2
    assert energy(stretched, straight(1.1)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("curvature", "power"), [("material", 2), ("geometric", 3), ("small", 0)])
def test_a_bent_and_stretched_element_stores_the_energy_of_its_curvature_measure(curvature, power):
    """A parabola y = c p^2/2, x = lambda p, with exact integrals of (x' y'')^2/|r'|^(2 power), or of |r''|^2."""
    lam, c, thick = 1.2, 1.0, 0.05
    stretching, bending = MODULUS * WIDTH * thick, MODULUS * WIDTH * thick**3 / 12
    e = np.array([0.0, 0.0, lam, 0.0, lam * LENGTH, c * LENGTH**2 / 2, lam, c * LENGTH])
    nodes, weights = np.polynomial.legendre.leggauss(20)
    slope = np.hypot(lam, c * LENGTH * (nodes + 1) / 2)
    kappa = lam * c / slope**power if power else c * np.ones_like(slope)
    axial, transverse = LENGTH / 4 * weights @ np.array([stretching * (slope - 1) ** 2, bending * kappa**2]).T
    exact = element(StrainMeasures(curvature=curvature, axial_points=5, bending_points=5))
    got = float(exact.strain_energy(e, [WIDTH, thick, DENSITY, MODULUS, LENGTH, 1.0, 0.0]))
    assert transverse > 1e-3 * axial
    assert got - axial == pytest.approx(transverse, rel=1e-7)


@pytest.mark.parametrize("seed", range(4))
def test_the_elastic_force_is_the_gradient_of_the_energy(functions, seed):
    e = deformed(seed)
    force = dense(functions.elastic_force, e, PROPERTIES)
    np.testing.assert_allclose(
        force, difference(lambda x: energy(functions, x), e), rtol=1e-6, atol=1e-6 * abs(force).max()
    )


@pytest.mark.parametrize("seed", range(4))
def test_the_tangent_stiffness_is_the_symmetric_jacobian_of_the_force(functions, seed):
    e = deformed(seed)
    stiffness = dense(functions.tangent_stiffness, e, PROPERTIES)
    differences = difference(lambda x: dense(functions.elastic_force, x, PROPERTIES), e)
    np.testing.assert_allclose(stiffness, differences, atol=1e-7 * abs(stiffness).max())
    np.testing.assert_allclose(stiffness, stiffness.T, atol=1e-13 * abs(stiffness).max())


@pytest.mark.parametrize("seed", range(3))
def test_the_tangent_force_is_the_tangent_stiffness_times_the_velocity(functions, seed):
    e, velocity = deformed(seed), np.random.default_rng(seed + 100).normal(size=8)
    expected = dense(functions.tangent_stiffness, e, PROPERTIES) @ velocity
    np.testing.assert_allclose(dense(functions.tangent_force, e, velocity, PROPERTIES), expected, rtol=1e-10)


@pytest.mark.parametrize("seed", range(3))
def test_a_rigid_motion_of_a_deformed_element_causes_no_strain_rate_force(functions, seed):
    e = deformed(seed)
    rigid = spin(e) + np.tile([0.7, -0.4, 0.0, 0.0], 2)
    scale = abs(dense(functions.tangent_stiffness, e, PROPERTIES)).max()
    assert abs(dense(functions.strain_rate_force, e, rigid, PROPERTIES)).max() < 1e-14 * scale
    assert abs(dense(functions.tangent_force, e, rigid, PROPERTIES)).max() > 1e-6 * scale  # not objective


@pytest.mark.parametrize("seed", range(3))
def test_the_strain_rate_force_dissipates_energy_in_any_deformation(functions, seed):
    velocity = np.random.default_rng(seed).normal(size=8)
    assert velocity @ dense(functions.strain_rate_force, deformed(seed), velocity, PROPERTIES) > 0.0


@pytest.mark.parametrize("angle", [0.0, 0.8])
def test_in_an_unstrained_element_the_strain_rate_force_is_the_elastic_stiffness_times_the_velocity(functions, angle):
    velocity = np.random.default_rng(5).normal(size=8)
    e = turn(straight(), angle)
    expected = dense(functions.tangent_stiffness, e, PROPERTIES) @ velocity
    got = dense(functions.strain_rate_force, e, velocity, PROPERTIES)
    np.testing.assert_allclose(got, expected, atol=1e-10 * abs(expected).max())


def test_the_mass_matrix_is_that_of_the_hermite_cubic():
    """The consistent matrix of any textbook, for example Przemieniecki 1968, Eq. (11.26)."""
    l = LENGTH
    textbook = [
        [156, 22 * l, 54, -13 * l],
        [22 * l, 4 * l**2, 13 * l, -3 * l**2],
        [54, 13 * l, 156, -22 * l],
        [-13 * l, -3 * l**2, -22 * l, 4 * l**2],
    ]
    expected = np.kron(LINE_DENSITY * l / 420 * np.array(textbook), np.eye(2))
    got = dense(element(StrainMeasures()).mass, PROPERTIES)
    np.testing.assert_allclose(got, expected, atol=1e-14 * expected.max())


def test_gravity_does_the_work_of_the_weight_in_any_translation(functions):
    force = dense(functions.gravity_force, PROPERTIES, [1.5, -9.81])
    assert force @ np.tile([1.0, 0.0, 0.0, 0.0], 2) == pytest.approx(1.5 * LINE_DENSITY * LENGTH, rel=1e-12)
    assert force @ np.tile([0.0, 1.0, 0.0, 0.0], 2) == pytest.approx(-9.81 * LINE_DENSITY * LENGTH, rel=1e-12)


def test_drag_on_a_translating_element_is_its_mass_times_speed_times_velocity(functions):
    force = dense(functions.drag_force, np.tile([3.0, -4.0, 0.0, 0.0], 2), PROPERTIES)
    expected = LINE_DENSITY * LENGTH * 5.0 * np.array([3.0, -4.0])
    np.testing.assert_allclose(force[[0, 1]] + force[[4, 5]], expected, rtol=1e-12)


def test_drag_on_an_element_turning_about_its_end_is_the_integral_of_the_squared_speed(functions):
    """int mu p^2 dp = mu l^3/3, across the element."""
    force = dense(functions.drag_force, spin(straight()), PROPERTIES)
    assert force[1] + force[5] == pytest.approx(LINE_DENSITY * LENGTH**3 / 3, rel=1e-7)


@pytest.mark.parametrize("seed", range(3))
def test_drag_opposes_any_motion_and_is_even_in_its_sign(functions, seed):
    velocity = np.random.default_rng(seed).normal(size=8)
    force = dense(functions.drag_force, velocity, PROPERTIES)
    assert velocity @ force > 0.0
    np.testing.assert_allclose(dense(functions.drag_force, -2 * velocity, PROPERTIES), -4 * force, rtol=1e-12)


def test_drag_vanishes_smoothly_at_rest(functions):
    assert not dense(functions.drag_force, np.zeros(8), PROPERTIES).any()
    jacobian, _ = functions.drag_force.jacobian()(np.zeros(8), PROPERTIES, np.zeros(8))
    assert np.abs(jacobian.full()).max() < 1e-8 * LINE_DENSITY * LENGTH


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"axial": "natural"}, "^axial: must be one of engineering, green, got 'natural'$"),
        ({"curvature": "large"}, "^curvature: must be one of material, geometric, small, got 'large'$"),
        ({"axial_points": 0}, "^axial_points: must be a whole number, 1 to 9, got 0$"),
        ({"bending_points": 10}, "^bending_points: must be a whole number, 1 to 9, got 10$"),
        ({"bending_points": 2.5}, "^bending_points: must be a whole number, 1 to 9, got 2.5$"),
    ],
)
def test_unknown_strain_measures_are_rejected_with_the_known_ones(arguments, message):
    with pytest.raises(InputError, match=message):
        StrainMeasures(**arguments)
