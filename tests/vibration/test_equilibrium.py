import math
import re

import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    Clamp,
    EquilibriumError,
    InputError,
    ModalDamping,
    Model,
    PointLoad,
    StrainMeasures,
    motion,
    natural_modes,
    static_equilibrium,
)
from ancf_casadi.export.model_document import Document
from ancf_casadi.vibration.statics import primary_equilibrium
from tests.boundary.cases import REFERENCES

# P L^2/EI: x/L, y/L, theta of the inextensible elastica with a transverse tip load
ELASTICA = {
    load: (1 - shortening, deflection, angle)
    for load, (shortening, deflection, angle) in zip(
        (1.0, 2.0, 5.0, 10.0), REFERENCES["dead_tip_force"]["rows"].values(), strict=True
    )
}
LOCKING = StrainMeasures(axial_points=5, bending_points=3)


@pytest.fixture(scope="module")
def tip_loaded(paper_beam, bending_stiffness):
    """Equilibrium of a weightless beam along x with a tip load P L^2/EI normal to it."""

    def solve(load, elements=20, measures=None, **changes):
        beam = paper_beam(elements, axis=(1.0, 0.0), gravity=(0.0, 0.0), **changes)
        force = load * bending_stiffness(beam) / beam.length**2
        return static_equilibrium(Model(beam, measures or StrainMeasures()), tip_force=(0.0, force))

    return solve


def tip_error(equilibrium, reference):
    """Distance of the tip from a reference (x/L, y/L), divided by the length."""
    return float(np.linalg.norm(equilibrium.tip / equilibrium.model.beam.length - reference[:2]))


def clamp_reaction(equilibrium):
    """Force the clamp exerts on the beam."""
    model = equilibrium.model
    loads = model.gravity_force(model.properties, model.beam.gravity).full().ravel()
    return (model.elastic_force(equilibrium.coordinates, model.properties).full().ravel() - loads)[:2]


def test_with_more_gauss_points_the_element_locks(tip_loaded):
    """The error is 4e-4 of the length with 5 and 3 points, and 3e-6 with the default of 2 and 2."""
    assert tip_error(tip_loaded(10.0, measures=LOCKING), ELASTICA[10.0]) > 1e-4
    assert tip_error(tip_loaded(10.0), ELASTICA[10.0]) < 4e-6


@pytest.mark.parametrize("axial", ["engineering", "green"])
@pytest.mark.parametrize("curvature", ["material", "geometric", "small"])
def test_a_small_tip_load_deflects_the_tip_by_fl3_3ei_under_every_strain_measure(tip_loaded, axial, curvature):
    equilibrium = tip_loaded(1e-3, measures=StrainMeasures(axial, curvature))
    assert equilibrium.tip[1] / 0.5 == pytest.approx(1e-3 / 3, rel=1e-6)


@pytest.mark.parametrize(("curvature", "error"), [("material", 1e-5), ("geometric", 1e-5), ("small", 1e-4)])
@pytest.mark.parametrize("axial", ["engineering", "green"])
def test_the_measures_agree_on_a_slender_beam_that_hardly_stretches(tip_loaded, axial, curvature, error):
    assert tip_error(tip_loaded(2.0, measures=StrainMeasures(axial, curvature)), ELASTICA[2.0]) < error


@pytest.mark.parametrize(
    ("curvature", "displacement"),
    [("material", (-0.508537304326, -1.207239854550)), ("geometric", (-0.508923036548, -1.208400217308))],
)
def test_a_stubby_beam_distinguishes_the_curvature_measures(curvature, displacement):
    """Gerstmayr and Irschik 2008: L = 2, b = h = 0.1, F = 3 EI/L^2; their results converge to the material value.

    The references are the extensible elastica with each curvature, by collocation.
    """
    errors = []
    for elements in (5, 10, 40):
        beam = Beam.uniform(
            length=2.0,
            width=0.1,
            thickness=0.1,
            density=7850.0,
            elastic_modulus=2.07e11,
            elements=elements,
            axis=(1.0, 0.0),
            gravity=(0.0, 0.0),
        )
        force = 3 * 2.07e11 * beam.sections[0].second_moment / 4
        equilibrium = primary_equilibrium(
            Model(beam, StrainMeasures(curvature=curvature)), [PointLoad((0.0, -force))]
        )  # unstable with 40 elements, which are shorter than the beam is thick
        errors.append(np.linalg.norm(equilibrium.tip - (2.0, 0.0) - displacement))
    assert errors[0] < 3e-4
    assert errors[1] < errors[0] / 8
    assert errors[2] < 3e-6


@pytest.mark.parametrize("moment", [0.5, 1.0, 2.0, np.pi])
def test_an_end_moment_bends_the_beam_to_an_arc_of_a_circle(weightless, bending_stiffness, moment):
    """Tip at (sin m/m, (1 - cos m)/m) L, angle m, for m = M L/EI."""
    m = moment
    equilibrium = static_equilibrium(weightless, tip_moment=m * bending_stiffness(weightless.beam) / 0.5)
    assert tip_error(equilibrium, (np.sin(m) / m, (1 - np.cos(m)) / m)) < 1e-5
    assert abs(np.exp(1j * equilibrium.tip_angle) - np.exp(1j * m)) < 2e-5


def test_an_end_moment_of_two_pi_ei_over_l_closes_the_circle(weightless, bending_stiffness):
    equilibrium = static_equilibrium(weightless, tip_moment=2 * np.pi * bending_stiffness(weightless.beam) / 0.5)
    assert np.linalg.norm(equilibrium.tip) / 0.5 < 2e-4
    assert np.linalg.norm(equilibrium.coordinates[-2:] - (1.0, 0.0)) < 1e-3
    np.testing.assert_allclose(equilibrium.position(0.25), (0.0, 0.5 / np.pi), atol=1e-4)


@pytest.mark.parametrize(
    ("elements", "error"), [(20, 2e-7), *(pytest.param(n, 1.5e-8, marks=pytest.mark.slow) for n in (1000, 3000))]
)
def test_a_horizontal_beam_sags_under_its_own_weight(paper_beam, elements, error):
    """Tip (0.4795670775, -0.1322053449) m, angle 0.3574651341: inextensible, power series and collocation."""
    equilibrium = static_equilibrium(Model(paper_beam(elements, axis=(1.0, 0.0))))
    np.testing.assert_allclose(equilibrium.tip, (0.4795670775, -0.1322053449), atol=error)
    assert equilibrium.tip_angle == pytest.approx(-0.3574651341, abs=max(error, 1e-7))
    assert equilibrium.stable


def test_a_hanging_beam_stretches_by_its_weight_alone(hanging):
    """rho g L^2/2E."""
    equilibrium = static_equilibrium(hanging)
    np.testing.assert_allclose(equilibrium.tip, (0.0, -0.5 - 8000 * 9.81 * 0.5**2 / 2 / 210e9), atol=1e-11)
    assert equilibrium.tip_angle == pytest.approx(-np.pi / 2, abs=1e-12)


def test_a_pull_along_the_axis_stretches_the_beam_by_fl_ea(weightless):
    area = weightless.beam.sections[0].area
    equilibrium = static_equilibrium(weightless, tip_force=(1e-4 * 210e9 * area, 0.0))
    np.testing.assert_allclose(equilibrium.tip, (0.5 * (1 + 1e-4), 0.0), atol=1e-12)


def test_the_clamp_carries_the_weight_and_the_tip_force(paper_beam):
    model = Model(paper_beam(axis=(1.0, 0.0)))
    equilibrium = static_equilibrium(model, tip_force=(0.01, -0.02), tip_moment=1e-3)
    expected = -(model.beam.mass * np.array([0.0, -9.81]) + (0.01, -0.02))
    np.testing.assert_allclose(clamp_reaction(equilibrium), expected, atol=1e-8)
    np.testing.assert_array_equal(equilibrium.coordinates[:4], model.straight[:4])


def test_rotating_beam_gravity_and_loads_rotates_the_equilibrium(paper_beam):
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    first = static_equilibrium(
        Model(paper_beam(axis=(1.0, 0.0), gravity=(0.0, -9.81))), tip_force=(0.0, 0.03), tip_moment=2e-3
    )
    second = static_equilibrium(
        Model(paper_beam(axis=turn @ (1.0, 0.0), gravity=turn @ (0.0, -9.81))),
        tip_force=turn @ (0.0, 0.03),
        tip_moment=2e-3,
    )
    np.testing.assert_allclose(second.tip, turn @ first.tip, atol=1e-9)


@pytest.mark.parametrize("rotation", [0.5, 2.0, -3.14159, math.pi, 6.0])
@pytest.mark.parametrize("stiffness", [math.inf, 5.0])
def test_a_weightless_beam_turns_with_its_clamp(weightless, rotation, stiffness):
    straight, turned = (
        Model(weightless.beam.with_(supports=[Clamp(stiffness=stiffness, rotation=angle)])) for angle in (0.0, rotation)
    )
    tip = 0.5 * np.array([math.cos(rotation), math.sin(rotation)])
    np.testing.assert_allclose(static_equilibrium(turned).tip, tip, atol=1e-9)
    frequencies = [natural_modes(model, count=2).frequencies for model in (straight, turned)]
    np.testing.assert_allclose(*frequencies, rtol=1e-6)


def test_a_clamp_that_turns_once_around_does_not_leave_a_strip_between_two_clamps_straight(weightless):
    """It snaps on the way, although both slopes then have the directions of the straight strip."""
    beam = weightless.beam.with_(supports=[Clamp(0.0, rotation=2 * math.pi), Clamp(0.5)])
    with pytest.raises(EquilibriumError, match="no static equilibrium"):
        primary_equilibrium(Model(beam), ())


def test_a_beam_held_by_the_spring_of_its_clamp_is_not_said_to_move_freely(paper_beam):
    beam = paper_beam(2, axis=(1.0, 0.0), gravity=(0.0, 0.0), clamp_stiffness=5.0)
    with pytest.raises(EquilibriumError, match="more elements"):
        static_equilibrium(Model(beam), tip_moment=1.0)


@pytest.mark.parametrize(("factor", "stable"), [(0.99, True), (1.01, False)])
def test_a_standing_beam_buckles_under_its_own_weight_at_greenhills_length(paper_beam, factor, stable):
    """q L^3/EI = 7.8373 (Greenhill 1881; Timoshenko and Gere 1961, Section 2.12)."""
    second_moment_over_area = (0.5e-3) ** 2 / 12
    critical = (7.8373 * 210e9 * second_moment_over_area / (8000.0 * 9.81)) ** (1 / 3)
    beam = paper_beam(axis=(0.0, 1.0), length=factor * critical)
    assert primary_equilibrium(Model(beam), ()).stable is stable


@pytest.mark.parametrize(("elements", "margin"), [(20, 1e-2), pytest.param(1500, 1e-5, marks=pytest.mark.slow)])
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_compressed_cantilever_buckles_at_eulers_load(paper_beam, bending_stiffness, elements, margin, sign):
    """pi^2 EI/4L^2 (Euler 1744); rounding the stiffness of 1500 elements changes its lowest eigenvalue by 1e-4."""
    beam = paper_beam(elements, axis=(1.0, 0.0), gravity=(0.0, 0.0))
    load = (1 + sign * margin) * np.pi**2 * bending_stiffness(beam) / (4 * 0.5**2)
    assert primary_equilibrium(Model(beam), [PointLoad((-load, 0.0))]).stable is (sign < 0)


def test_the_stiffness_is_the_jacobian_of_the_imbalance_loads_included(paper_beam, bending_stiffness):
    """A slightly larger tip moment, which follows the tip, moves the beam as the stiffness predicts."""
    model = Model(paper_beam(8, axis=(1.0, 0.0)))
    unit = bending_stiffness(model.beam) / 0.5
    states = [static_equilibrium(model, tip_moment=(1.0 + h) * unit, tip_force=(0.0, 0.01)) for h in (-1e-5, 0.0, 1e-5)]
    slope = states[1].coordinates[-2:]
    change_of_load = np.zeros(model.size - 4)
    change_of_load[-2:] = unit * np.array([-slope[1], slope[0]]) / (slope @ slope)
    change = np.linalg.solve(states[1].stiffness.toarray(), change_of_load)
    differences = (states[2].coordinates - states[0].coordinates)[slice(4, model.size)] / 2e-5
    np.testing.assert_allclose(change, differences, atol=1e-6 * abs(differences).max())


@pytest.mark.slow
def test_an_element_bent_beyond_what_a_cubic_can_follow_is_an_error_with_advice(paper_beam, bending_stiffness):
    beam = paper_beam(5, axis=(1.0, 0.0), gravity=(0.0, 0.0))
    with pytest.raises(EquilibriumError, match=r"^no static equilibrium was found beyond 0\.\d+ of the load .*\)"):
        static_equilibrium(Model(beam), tip_moment=2 * np.pi * bending_stiffness(beam) / 0.5)


@pytest.mark.parametrize(
    ("loads", "message"),
    [
        ({"tip_force": (0.0, np.nan)}, "tip_force: must be a finite number, got nan"),
        ({"tip_force": 1.0}, "tip_force: must be a pair of numbers (x, y), got 1.0"),
        ({"tip_moment": np.inf}, "tip_moment: must be a finite number, got inf"),
        ({"tip_moment": "1"}, "tip_moment: must be a finite number, got '1'"),
    ],
)
def test_loads_that_are_not_numbers_are_rejected_by_name(weightless, loads, message):
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        static_equilibrium(weightless, **loads)


def test_a_point_off_the_beam_has_no_position(weightless):
    with pytest.raises(InputError, match=r"^point: the point must be on the beam"):
        static_equilibrium(weightless).position(0.51)


def test_a_beam_too_slender_for_arithmetic_is_an_error_with_advice(paper_beam):
    with pytest.raises(EquilibriumError, match="a value is in the wrong unit"):
        static_equilibrium(Model(paper_beam(4, length=1e20)))


class TestPointLoads:
    @pytest.mark.parametrize("load", [1.0, 2.0, 10.0])
    def test_the_beam_beyond_a_load_is_straight_and_the_rest_follows_the_elastica(
        self, paper_beam, bending_stiffness, load
    ):
        """A load at 0.8 L, on a node, bends the beam up to there like a tip load."""
        beam = paper_beam(25, axis=(1.0, 0.0), gravity=(0.0, 0.0))
        a = 0.8 * beam.length
        force = PointLoad((0.0, load * bending_stiffness(beam) / a**2), point=a)
        rest = static_equilibrium(Model(beam), loads=[force])
        x, y, theta = ELASTICA[load]
        np.testing.assert_allclose(rest.position(a) / a, (x, y), atol=1e-5)
        beyond = (rest.tip - rest.position(a)) / (0.2 * beam.length)
        np.testing.assert_allclose(beyond, (np.cos(theta), np.sin(theta)), atol=2e-5)
        assert rest.tip_angle == pytest.approx(theta, abs=2e-5)

    def test_a_load_within_an_element_bends_the_beam_like_one_at_a_node(self, paper_beam, bending_stiffness):
        a = 0.3771
        beams = [paper_beam(n, axis=(1.0, 0.0), gravity=(0.0, 0.0)) for n in (20, 80)]
        load = PointLoad((0.0, 2 * bending_stiffness(beams[0]) / a**2), 0.2 * bending_stiffness(beams[0]) / a, a)
        coarse, fine = (static_equilibrium(Model(beam), loads=[load]).tip for beam in beams)
        np.testing.assert_allclose(coarse, fine, atol=2e-5)

    @pytest.mark.parametrize("clamp", [np.inf, 0.05])
    def test_a_load_at_the_tip_is_the_tip_load_and_loads_add_up(self, paper_beam, clamp):
        model = Model(paper_beam(clamp_stiffness=clamp))
        expected = static_equilibrium(model, tip_force=(0.01, 0.02), tip_moment=1e-3).coordinates
        halves = [PointLoad((0.01, 0.0), point=0.5), PointLoad((0.0, 0.02), 1e-3)]
        np.testing.assert_allclose(static_equilibrium(model, loads=halves).coordinates, expected, atol=1e-12)
        both = static_equilibrium(model, tip_force=(0.01, 0.02), loads=[PointLoad(moment=1e-3)])
        np.testing.assert_allclose(both.coordinates, expected, atol=1e-12)

    def test_natural_modes_under_a_load_within_the_beam_are_those_of_its_stiffness(self, hanging):
        """A force along the beam stiffens it like a string."""
        free, pulled = (
            natural_modes(hanging, count=1, equilibrium=static_equilibrium(hanging, loads=loads)).frequencies[0]
            for loads in ((), [PointLoad((0.0, -0.5), point=0.4)])
        )
        assert pulled > 1.2 * free

    @pytest.mark.parametrize(
        ("loads", "message"),
        [
            ([PointLoad(moment=1.0, point=0.51)], "point: 0.51 m is beyond the tip"),
            ([(0.0, 1.0)], "loads: must be a PointLoad"),
            (PointLoad(), "put it in a list"),
            (None, "loads: must be a sequence"),
        ],
    )
    def test_loads_that_cannot_act_are_refused(self, hanging, loads, message):
        with pytest.raises(InputError, match=message):
            static_equilibrium(hanging, loads=loads)

    @pytest.mark.parametrize(
        ("changes", "message"),
        [({"point": -0.1}, "point: must be 0 or more"), ({"force": 1.0}, "force: must be a pair"),
         ({"moment": np.nan}, "moment: must be a finite number")],
    )  # fmt: skip
    def test_a_load_has_finite_values_at_a_point_of_the_beam(self, changes, message):
        with pytest.raises(InputError, match=message):
            PointLoad(**changes)

    def test_a_motion_is_differentiable_only_from_a_load_at_the_tip(self, hanging):
        start = static_equilibrium(hanging, loads=[PointLoad((0.01, 0.0), point=0.4)])
        with pytest.raises(InputError, match="start: only a load at the tip has derivatives here"):
            motion(hanging, start=start, duration=0.1)

    def test_a_document_holds_no_modes_about_an_equilibrium_under_such_loads(self, hanging):
        rest = static_equilibrium(hanging, loads=[PointLoad((0.01, 0.0), point=0.4)])
        law = ModalDamping(natural_modes(hanging, count=1, equilibrium=rest), (0.01,))
        with pytest.raises(InputError, match="equilibrium under loads away from the tip"):
            Document(hanging, law).to_dict()
