import numpy as np
import pytest
from scipy.optimize import brentq

from ancf_casadi import (
    EquilibriumError,
    InputError,
    Model,
    Pin,
    PointLoad,
    StrainMeasures,
    mac,
    natural_modes,
    static_equilibrium,
)
from ancf_casadi.vibration.assembly import Position, Structure
from ancf_casadi.vibration.eigensolver import lowest_modes
from ancf_casadi.vibration.statics import primary_equilibrium

# Hz.  Beam of Table 1 (0.5 m, 5 mm, 0.5 mm, 210 GPa).  "exact": roots in 40 digits, or power series with gravity, which
# agree with Chebyshev collocation.  "cubic": 20 cubic elements, assembled independently.
CUBIC_8000 = (1.6552932, 10.3735667, 29.0467016, 56.9225661, 94.1071423)
EXACT_8000 = (1.655293122, 10.373544922, 29.046226159, 56.919010528, 94.091202772)
EXACT_7850 = (1.671033189, 10.472186237, 29.322424698, 57.460249429, 94.985909456)
EXACT_HANGING = (1.87613156, 10.57854292, 29.25877251, 57.14312999, 94.32271386)
EXACT_STANDING = (1.39944159, 10.16418416, 28.83182775, 56.69381756, 93.85900178)
TABLE_10_STANDARD = (1.6710, 10.4722, 29.3224, 57.4602, 94.9859)  # the fifth as it should be; the paper prints 94.97

WEIGHTLESS = {"axis": (1.0, 0.0), "gravity": (0.0, 0.0)}


def cantilever_roots(count):
    """Values beta L of the clamped-free beam: cos x cosh x = -1."""
    return np.array(
        [
            brentq(lambda x: np.cos(x) + 1 / np.cosh(x), (k + 0.4) * np.pi, (k + 0.7) * np.pi, xtol=1e-14)
            for k in range(count)
        ]
    )


@pytest.fixture(scope="module")
def modes(weightless):
    return natural_modes(weightless, count=6)


def test_twenty_elements_give_the_frequencies_of_twenty_cubic_elements(modes):
    np.testing.assert_allclose(modes.frequencies[:5], CUBIC_8000, rtol=1e-6)


def test_frequencies_are_those_of_the_cantilever_formula(modes):
    """Frequency f = (beta L)^2/(2 pi L^2) (EI/mu)^1/2, which 20 elements overestimate by (beta l)^4/1440."""
    roots = cantilever_roots(5)
    exact = roots**2 / (2 * np.pi * 0.5**2) * np.sqrt(210e9 / 8000.0) * 0.5e-3 / np.sqrt(12)
    np.testing.assert_allclose(exact, EXACT_8000, rtol=1e-9)
    np.testing.assert_allclose(modes.frequencies[:5] / (1 + (roots / 20) ** 4 / 1440), exact, rtol=1e-5)


@pytest.mark.parametrize("elements", [5, 10, 20, 40])
def test_the_error_of_a_frequency_is_beta_l_to_the_fourth_over_1440(paper_beam, elements):
    frequencies = natural_modes(Model(paper_beam(elements, **WEIGHTLESS)), count=3).frequencies
    waves = cantilever_roots(3) / elements
    errors, expected = frequencies / EXACT_8000[:3] - 1, waves**4 / 1440
    assert (abs(errors - expected) < (0.02 + 0.07 * waves**2) * expected + 2e-9).all()


@pytest.mark.slow
@pytest.mark.parametrize(("elements", "axis"), [(100, (0.6, 0.8)), (400, (1.0, 0.0)), (2000, (0.6, 0.8))])
def test_fine_meshes_keep_the_digits_of_the_low_frequencies(paper_beam, elements, axis):
    """Rounding the assembled stiffness changed the first frequency by 3e-7 with 400 elements, and by 1e-4 with 2000."""
    frequencies = natural_modes(Model(paper_beam(elements, **{**WEIGHTLESS, "axis": axis}))).frequencies
    roots = cantilever_roots(5)
    exact = roots**2 / (2 * np.pi * 0.5**2) * np.sqrt(210e9 / 8000.0) * 0.5e-3 / np.sqrt(12)
    waves = roots / elements
    errors, expected = frequencies / exact - 1, waves**4 / 1440
    assert (abs(errors - expected) < 0.07 * waves**2 * expected + 1e-7 * waves**2 + 2e-10).all()


@pytest.mark.slow
@pytest.mark.parametrize(("axis", "exact"), [((0.0, -1.0), EXACT_HANGING), ((0.0, 1.0), EXACT_STANDING)])
def test_a_fine_mesh_under_gravity(paper_beam, axis, exact):
    """Stretching, which the references neglect, changes the frequencies by 1e-7."""
    frequencies = natural_modes(Model(paper_beam(1500, axis=axis))).frequencies
    np.testing.assert_allclose(frequencies, exact, rtol=1.2e-7)


def test_the_whole_spectrum_has_the_same_low_frequencies_as_a_few_modes(paper_beam):
    """All modes come from a dense solver, a few from Lanczos' method."""
    model = Model(paper_beam(60))
    few, every = natural_modes(model, count=4), natural_modes(model, count=240)
    np.testing.assert_allclose(every.frequencies[:4], few.frequencies, rtol=1e-11)
    np.testing.assert_allclose(every.shapes[:, :4], few.shapes, atol=1e-6 * abs(few.shapes).max())


@pytest.mark.slow
def test_elements_as_short_as_the_beam_is_thick_are_unstable_in_bending(paper_beam, bending_stiffness):
    """With two Gauss points the length of the slopes may alternate along a bent beam with hardly any strain energy."""
    beam = paper_beam(120, thickness=5e-3, **WEIGHTLESS)
    moment = 3.0 * bending_stiffness(beam) / beam.length
    two, three = (Model(beam, StrainMeasures(axial_points=points)) for points in (2, 3))
    assert static_equilibrium(three, tip_moment=moment).stable
    with pytest.raises(EquilibriumError, match="as short as the beam is thick are unstable in bending: use fewer"):
        natural_modes(two, equilibrium=primary_equilibrium(two, [PointLoad(moment=moment)]))
    assert not static_equilibrium(two, tip_moment=moment).stable  # the mesh is, not the beam


@pytest.mark.parametrize(("axis", "exact"), [((0.0, -1.0), EXACT_HANGING), ((0.0, 1.0), EXACT_STANDING)])
def test_gravity_raises_the_frequencies_of_a_hanging_beam_and_lowers_those_of_a_standing_one(paper_beam, axis, exact):
    frequencies = natural_modes(Model(paper_beam(axis=axis))).frequencies
    np.testing.assert_allclose(frequencies, exact, rtol=3e-4)
    np.testing.assert_allclose(frequencies[0], exact[0], rtol=1e-6)


def test_table_10_standard_is_the_weightless_beam_of_density_7850_not_8000(paper_beam, modes):
    """Tables 1 and 9 print 8000 kg/m^3."""
    frequencies = natural_modes(Model(paper_beam(density=7850.0, **WEIGHTLESS))).frequencies
    np.testing.assert_allclose(frequencies, TABLE_10_STANDARD, rtol=2e-4)
    np.testing.assert_allclose(frequencies, EXACT_7850, rtol=2e-4)
    assert (np.array(TABLE_10_STANDARD) / modes.frequencies[:5] > 1.009).all()


@pytest.mark.parametrize("measures", [StrainMeasures("green", "geometric"), StrainMeasures("engineering", "small")])
def test_small_motion_does_not_depend_on_the_strain_measure(paper_beam, modes, measures):
    other = natural_modes(Model(paper_beam(**WEIGHTLESS), measures))
    np.testing.assert_allclose(other.frequencies, modes.frequencies[:5], rtol=1e-8)


def test_weightless_frequencies_depend_on_thickness_modulus_and_density_but_not_on_width_or_direction(
    paper_beam, modes
):
    def frequencies(**changes):
        return natural_modes(Model(paper_beam(**{**WEIGHTLESS, **changes}))).frequencies

    reference = modes.frequencies[:5]
    np.testing.assert_allclose(frequencies(width=8e-3), reference, rtol=1e-8)
    np.testing.assert_allclose(frequencies(axis=(0.6, -0.8)), reference, rtol=1e-8)
    np.testing.assert_allclose(frequencies(thickness=1e-3), 2 * reference, rtol=1e-7)
    np.testing.assert_allclose(frequencies(elastic_modulus=4 * 210e9), 2 * reference, rtol=1e-8)
    np.testing.assert_allclose(frequencies(density=4 * 8000.0), reference / 2, rtol=1e-8)


def test_a_stubby_beam_has_an_axial_mode_at_a_quarter_of_the_wave_speed_over_the_length(paper_beam):
    beam = paper_beam(thickness=0.1, **WEIGHTLESS)
    modes = natural_modes(Model(beam), count=6)
    axial = np.abs(modes.shapes[-4]) > np.abs(modes.shapes[-3])
    expected = np.sqrt(210e9 / 8000.0) / (4 * 0.5)
    assert modes.frequencies[axial][0] == pytest.approx(expected, rel=3e-4)  # second order in the element length


def test_modes_are_mass_normalised_and_diagonalise_mass_and_stiffness(hanging):
    modes = natural_modes(hanging, count=6)
    shapes, free = modes.shapes, slice(4, hanging.size)
    mass = hanging.mass(hanging.properties).full()
    modal_mass = shapes.T @ mass @ shapes
    modal_stiffness = shapes[free].T @ modes.equilibrium.stiffness @ shapes[free]
    omega = modes.angular_frequencies
    np.testing.assert_allclose(modal_mass, np.eye(6), atol=1e-9)
    np.testing.assert_allclose(modal_stiffness, np.diag(omega**2), atol=1e-8 * omega[-1] ** 2)
    np.testing.assert_allclose(omega, 2 * np.pi * modes.frequencies)


def test_shapes_vanish_at_the_clamp_and_move_the_tip_to_the_positive_side(modes):
    assert modes.count == 6 and not modes.shapes[:4].any()
    assert (modes.shapes[-3] > 0).all()


def test_a_mass_normalised_cantilever_mode_moves_the_tip_by_two_over_the_root_of_the_mass(modes):
    """Phi(L)^2 = 4 for the mode with unit mean square (Bishop and Johnson 1960)."""
    np.testing.assert_allclose(modes.tip_amplitudes()[:4], 2 / np.sqrt(modes.model.beam.mass), rtol=2e-4)


def test_the_modal_coordinate_is_the_displacement_of_the_tip_in_that_mode(modes):
    amplitudes = np.array([0.3, -0.2, 0.1, 0.0, 0.5, 0.0]) * 1e-3
    motion = modes.equilibrium.coordinates + modes.shapes @ (amplitudes / modes.tip_amplitudes())
    for mode, amplitude in enumerate(amplitudes):
        assert modes.modal_coordinate(motion, mode) == pytest.approx(amplitude, abs=1e-12)
    many = modes.modal_coordinate(np.array([modes.equilibrium.coordinates, motion]), 1)
    np.testing.assert_allclose(many, [0.0, -0.2e-3], atol=1e-12)


def test_modes_about_a_loaded_equilibrium_include_its_tension(weightless, bending_stiffness):
    """A dominant tension T makes the beam a string: omega L (mu/T)^1/2 = pi/2 (1 + (EI/T)^1/2/L)."""
    tension = 2000 * bending_stiffness(weightless.beam) / 0.5**2
    pulled = static_equilibrium(weightless, tip_force=(tension, 0.0))
    omega = natural_modes(weightless, count=1, equilibrium=pulled).angular_frequencies[0]
    mu = weightless.beam.mass / 0.5
    pendulum = omega * 0.5 * np.sqrt(mu / tension)
    assert pendulum == pytest.approx(np.pi / 2 * (1 + 1 / np.sqrt(2000)), rel=2e-3)


def test_the_mac_is_one_for_the_same_shape_and_zero_for_orthogonal_shapes():
    rng = np.random.default_rng(0)
    basis = np.linalg.qr(rng.normal(size=(8, 3)))[0]
    np.testing.assert_allclose(mac(basis, -3 * basis), np.eye(3), atol=1e-14)
    assert mac(basis[:, :1], basis[:, 1:]).shape == (1, 2)
    np.testing.assert_allclose(mac(1e200 * basis, 1e-200 * basis), np.eye(3), atol=1e-14)
    with pytest.raises(InputError, match="second: has a shape that is zero everywhere"):
        mac(basis, 0 * basis)
    mixed = basis[:, [0]] + basis[:, [1]]
    np.testing.assert_allclose(mac(basis, mixed), [[0.5], [0.5], [0.0]], atol=1e-14)


@pytest.mark.parametrize("count", [0, -1, 17, 2.0, True, None])
def test_a_count_of_modes_that_the_mesh_does_not_have_is_rejected(paper_beam, count):
    with pytest.raises(InputError, match=r"^count: must be a whole number, 1 to 16"):
        natural_modes(Model(paper_beam(4)), count=count)


def test_an_equilibrium_of_another_model_is_rejected(weightless, hanging):
    with pytest.raises(InputError, match=r"^equilibrium: belongs to another model$"):
        natural_modes(weightless, equilibrium=static_equilibrium(hanging))


def test_an_unstable_equilibrium_has_no_modes(paper_beam):
    slender = Model(paper_beam(axis=(0.0, 1.0), length=0.8))
    with pytest.raises(EquilibriumError, match=r"^the equilibrium is unstable, so it has no modes"):
        natural_modes(slender, equilibrium=primary_equilibrium(slender, ()))


@pytest.mark.parametrize("thickness", [1e-8, 3e-9, 1e-9])
def test_frequencies_that_rounding_limits_are_named(paper_beam, thickness):
    """Slenderness 5e7 and more."""
    with pytest.warns(UserWarning, match=r"^rounding limits the frequencies up to mode \d: the beam is so slender"):
        natural_modes(Model(paper_beam(thickness=thickness, gravity=(0.0, 0.0))))


@pytest.mark.parametrize(
    "points", [(0.0, 0.25, 0.5), (0.0, 0.125, 0.25, 0.375, 0.5), (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)], ids=["3", "5", "6"]
)
def test_supports_at_every_node_are_one_line(paper_beam, points):
    with pytest.raises(InputError, match="supports: hold every node, so no mode moves one; use more elements"):
        natural_modes(Model(paper_beam(len(points) - 1, supports=tuple(Pin(point) for point in points))))


def test_a_position_in_which_rounding_alone_decides_the_stiffness_gives_no_warning(paper_beam):
    """With slopes of no length nothing resists deflections, and their stiffness is rounding of either sign."""
    model = Model(paper_beam(4, **WEIGHTLESS))
    nodes = model.straight.reshape(-1, 4) * [1.0, 1.0, 0.0, 0.0]
    nodes[1:, 1] -= 1e-13
    nodes[1:, 2:] = 1e-15 * np.random.default_rng(0).normal(size=(4, 2))
    assert lowest_modes(Structure.of(model), Position.of(nodes.ravel()), 1) is None
