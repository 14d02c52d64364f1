"""Supports and attachments: their description, and properties of the beam that they hold."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ancf_casadi import (
    Beam,
    Clamp,
    Dashpot,
    Guide,
    HarmonicLoad,
    InputError,
    Model,
    Pin,
    PointLoad,
    PointMass,
    RayleighDamping,
    Roller,
    RotationalSpring,
    SampledBase,
    Spring,
    State,
    natural_modes,
    simulate,
    static_equilibrium,
)

STRIP = {"length": 0.5, "width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elastic_modulus": 210e9}
WEIGHTLESS = {"axis": (1.0, 0.0), "gravity": (0.0, 0.0)}
FEATURES = [PointMass(0.3, 2e-3, 1e-7), Spring(0.2, (0.0, 20.0)), RotationalSpring(0.5, 0.01), Dashpot(0.1, (0.0, 0.1))]
SUPPORTS = [Pin(0.1), Roller(0.4, (1.0, 0.0)), Guide(0.5, (1.0, 0.2))]


def strip(elements=6, **changes):
    return Beam.uniform(**{**STRIP, "elements": elements, **changes})


def hertz(beam, count=4):
    return natural_modes(Model(beam), count=count).frequencies


# -------------------------------------------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"supports": (Clamp(0.0), Pin(0.0))}, "^supports: two supports hold the point at 0 m; give one that holds"),
        ({"supports": (Pin(0.25), Roller(0.25))}, "^supports: two supports hold the point at 0.25 m"),
        ({"supports": (Pin(0.6),)}, "^supports: the point 0.6 m is not on the beam, which is 0.5 m long$"),
        ({"attachments": (Spring(0.6, (1.0, 1.0)),)}, "^attachments: the point 0.6 m is not on the beam"),
        ({"supports": (PointMass(0.1, 1.0),)}, "^supports: must be a Support, got a PointMass$"),
        ({"attachments": (Pin(0.1),)}, "^attachments: must be an Attachment, got a Pin$"),
        ({"supports": (Pin(0.3),), "attachments": (PointMass(0.300002, 1e-3),)}, "^supports, attachments:"),
        ({"attachments": tuple(PointMass(0.01 * k, 1e-3) for k in range(1, 7))}, "^elements"),
    ],
)
def test_a_beam_refuses_what_cannot_be_at_its_points(changes, message):
    with pytest.raises(InputError, match=message):
        strip(**changes)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Pin(-0.1), "^point: must be 0 or more, got -0.1$"),
        (lambda: Clamp(math.nan), "^point: must be a finite number, got nan$"),
        (lambda: Clamp(0.0, -1.0), "^stiffness: must be positive, got -1$"),
        (lambda: Clamp(0.0, 0.0), "^stiffness: must be positive, got 0$"),
        (lambda: Clamp(0.0, rotation=math.inf), "^rotation: must be a finite number, got inf$"),
        (lambda: Roller(0.1, (0.0, 0.0)), "^direction: must not be the zero vector$"),
        (lambda: Guide(0.1, (0.0, 0.0)), "^direction: must not be the zero vector$"),
        (lambda: Pin(0.1, displacement=(0.0,)), "^displacement: must be a pair of numbers"),
        (lambda: PointMass(0.1, -1.0), "^mass: must not be negative, got -1$"),
        (lambda: PointMass(0.1, 1.0, -1.0), "^rotary_inertia: must not be negative, got -1$"),
        (lambda: Spring(0.1, (0.0, -1.0)), "^stiffness: must not be negative, got -1$"),
        (lambda: Spring(0.1, 5.0), "^stiffness: must be a pair of numbers"),
        (lambda: RotationalSpring(0.1, -1.0), "^stiffness: must not be negative, got -1$"),
        (lambda: Dashpot(0.1, (-1.0, 0.0)), "^coefficient: must not be negative, got -1$"),
    ],
)
def test_a_feature_refuses_what_has_no_meaning(make, message):
    with pytest.raises(InputError, match=message):
        make()


# ------------------------------------------------------------------------------------------------------------- nodes


@given(points=st.lists(st.integers(1, 499).map(lambda k: k / 1000), max_size=9, unique=True))
@settings(max_examples=50, deadline=None)
def test_each_feature_has_a_node_and_the_elements_make_up_the_beam(points):
    beam = strip(10, attachments=[PointMass(s, 1e-3) for s in points])
    assert {*points} <= {*beam.node_points.tolist()}
    assert (np.diff(beam.node_points) > 0.0).all()
    assert (beam.node_points[0], beam.node_points[-1], beam.node_points.size) == (0.0, 0.5, 11)
    np.testing.assert_allclose(np.diff(beam.node_points), beam.element_lengths, rtol=0.0, atol=1e-16)


def test_points_that_differ_by_rounding_are_the_same():
    assert 0.1 + 0.2 != 0.3 and 0.3 + 0.2 + 1e-12 > 0.5
    beam = strip(
        supports=(Clamp(1e-13), Pin(0.1 + 0.2)), attachments=(PointMass(0.3, 1e-3), PointMass(0.5 + 1e-12, 1e-3))
    )
    points = [feature.point for feature in (*beam.supports, *beam.attachments)]
    assert points == [0.0, points[1], points[1], 0.5]
    assert points[1] == pytest.approx(0.3, rel=1e-15)
    assert beam.tip_mass == 1e-3
    with pytest.raises(InputError, match="two supports hold the point"):
        strip(supports=(Pin(0.1 + 0.2), Roller(0.3)))


def test_unequal_elements_give_the_same_frequencies_as_equal_ones():
    """A mass of nothing moves a node."""
    equal = hertz(strip(40))
    for point in (0.003, 0.163, 0.3):
        np.testing.assert_allclose(hertz(strip(40, attachments=[PointMass(point, 0.0)])), equal, rtol=3e-5)


def test_the_order_of_features_does_not_matter():
    beam = strip(supports=SUPPORTS, attachments=FEATURES)
    reversed_order = strip(supports=SUPPORTS[::-1], attachments=FEATURES[::-1])
    assert beam == reversed_order
    assert beam.lumped == reversed_order.lumped


# ------------------------------------------------------------------------------------------- relations of the features


def test_a_pin_with_a_torsional_spring_is_an_elastic_clamp():
    hinged = strip(supports=(Pin(0.0),), attachments=(RotationalSpring(0.0, 0.05),))
    np.testing.assert_allclose(hertz(hinged), hertz(strip(supports=(Clamp(0.0, 0.05),))), rtol=1e-10)
    np.testing.assert_allclose(hertz(hinged), hertz(strip(clamp_stiffness=0.05)), rtol=1e-10)


def test_the_tip_mass_is_a_point_mass_at_the_tip():
    assert strip(tip_mass=2e-3) == strip(attachments=(PointMass(0.5, 2e-3),))
    assert strip(tip_mass=2e-3, attachments=(PointMass(0.5, 1e-3),)) == strip(tip_mass=2e-3)


def test_stiff_springs_hold_like_a_pin_and_a_roller():
    sprung = strip(attachments=(Spring(0.3, (0.0, 1e6)),), **WEIGHTLESS)
    np.testing.assert_allclose(hertz(sprung), hertz(strip(supports=(Clamp(0.0), Roller(0.3)), **WEIGHTLESS)), rtol=1e-4)


def test_two_masses_at_a_point_are_one():
    single, pair = [PointMass(0.2, 3e-3)], [PointMass(0.2, 1e-3), PointMass(0.2, 2e-3)]
    np.testing.assert_allclose(hertz(strip(attachments=pair)), hertz(strip(attachments=single)), rtol=1e-12)


def test_the_far_end_may_be_clamped_instead():
    np.testing.assert_allclose(
        hertz(strip(supports=(Clamp(0.5),), **WEIGHTLESS)), hertz(strip(**WEIGHTLESS)), rtol=1e-9
    )


def test_the_frequencies_of_a_hinged_beam_are_those_of_a_free_one_of_twice_the_length_that_are_antisymmetric():
    hinged = natural_modes(Model(strip(8, supports=(Pin(0.0),), **WEIGHTLESS)), count=3).frequencies
    free = natural_modes(Model(strip(16, length=1.0, supports=(), **WEIGHTLESS)), count=7).frequencies
    np.testing.assert_allclose(hinged, [0.0, free[4], free[6]], rtol=1e-7)


# --------------------------------------------------------------------------------------------- directions and places


@pytest.mark.parametrize("kind", [Roller, Guide])
@pytest.mark.parametrize("turn", [0.7, -2.0])
def test_a_support_in_an_oblique_direction_gives_the_turned_problem(kind, turn):
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])

    def solved(by):
        held = Clamp(0.0), kind(0.5, tuple(by @ [0.6, 0.8]))
        beam = strip(8, supports=held, axis=tuple(by @ [1.0, 0.0]), gravity=tuple(by @ [0.0, -9.81]))
        rest = static_equilibrium(Model(beam), loads=[PointLoad(tuple(by @ [0.2, 0.5]), point=0.25)])
        modes = natural_modes(rest.model, count=3, equilibrium=rest)
        return rest.coordinates.reshape(-1, 2), modes.frequencies

    (plain, frequencies), (turned, same) = solved(np.eye(2)), solved(rotation)
    np.testing.assert_allclose(turned, plain @ rotation.T, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(same, frequencies, rtol=1e-7)
    assert abs(plain[-2] - [0.5, 0.0]).max() > 1e-3


@pytest.mark.parametrize("kind", [Roller, Guide])
def test_a_sliding_end_moves_along_its_direction_and_is_pushed_across(kind):
    along, across = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    model = Model(strip(8, supports=(Clamp(0.0), kind(0.5, along)), **WEIGHTLESS))
    rest = static_equilibrium(model, loads=[PointLoad((0.0, 0.5), point=0.25)])
    moved = rest.tip - [0.5, 0.0]
    assert abs(moved @ along) > 1e-3
    assert abs(moved @ across) < 1e-12
    forces = model.elastic_force(rest.coordinates, model.properties).full().ravel()[model.nodes_of(0.5)[:2]]
    assert abs(forces @ along) < 1e-9
    assert abs(forces @ across) > 1e-2
    turned = rest.tip_angle
    assert abs(turned) < 1e-12 if kind is Guide else abs(turned) > 1e-2


def test_supports_hold_the_beam_at_their_displaced_places():
    held = Pin(0.0, displacement=(0.0, 0.01)), Clamp(0.5, displacement=(-0.01, 0.02), rotation=0.3)
    rest = static_equilibrium(Model(strip(8, supports=held, **WEIGHTLESS)))
    np.testing.assert_allclose(rest.position(0.0), [0.0, 0.01], atol=1e-13)
    np.testing.assert_allclose(rest.tip, [0.49, 0.02], atol=1e-13)
    assert rest.tip_angle == pytest.approx(0.3, rel=1e-12)


def test_a_displaced_clamp_stretches_the_beam_by_a_known_force():
    rest = static_equilibrium(Model(strip(supports=(Clamp(0.0), Clamp(0.5, displacement=(1e-4, 0.0))), **WEIGHTLESS)))
    forces = rest.model.elastic_force(rest.coordinates, rest.model.properties).full().ravel()
    assert forces[-4] == pytest.approx(210e9 * 5e-3 * 0.5e-3 * 1e-4 / 0.5, rel=1e-9)


@pytest.mark.parametrize("held", [(Clamp(0.0, 0.5),), (Pin(0.0), Clamp(0.5)), (Pin(0.1), Pin(0.4)), (Clamp(0.2),)])
def test_a_beam_that_moves_with_its_base_is_free_of_stress(held):
    """Supports and springs turn with the base."""
    beam = strip(supports=held, attachments=FEATURES, **WEIGHTLESS)
    model, angle = Model(beam), 1.1
    rotation = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    moved = model.straight.reshape(-1, 2) @ rotation.T
    moved[::2] += [0.3, -0.2]
    e = moved.ravel()
    np.testing.assert_allclose(model.whole(model.of_free(e - model.whole_of_base @ e[:4]), e[:4]), e, atol=1e-12)
    assert float(model.strain_energy(e, model.properties)) < 1e-20


# --------------------------------------------------------------------------------------------------------- motions


@pytest.mark.slow
def test_a_free_beam_falls():
    run = simulate(Model(strip(supports=())), start="straight", duration=0.2, sample_rate=100.0)
    np.testing.assert_allclose(run.tip[:, 1], -0.5 - 9.81 / 2 * run.time**2, rtol=0.0, atol=1e-9)


def test_a_straight_beam_starts_at_its_displaced_and_turned_clamp():
    """Its motion is that of a beam along the turned axis, shifted."""
    angle, shift, settings = 0.4, np.array([0.3, -2.0]), {"start": "straight", "duration": 0.1, "sample_rate": 50.0}
    turned = simulate(Model(strip(axis=(math.sin(angle), -math.cos(angle)))), **settings)
    run = simulate(Model(strip(supports=(Clamp(displacement=tuple(shift), rotation=angle),))), **settings)
    np.testing.assert_allclose(run.tip, turned.tip + shift, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(run.position(0.0), [shift] * len(run.time), rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("start", ["straight", "state"])
def test_a_start_that_does_not_fit_the_supports_is_refused(start):
    model = Model(strip(supports=(Pin(0.0), Pin(0.5, displacement=(0.0, 0.01)))))
    if start == "state":
        start = State(model.straight, np.zeros(model.size))
    with pytest.raises(InputError) as caught:
        simulate(model, start=start, duration=0.1)
    assert caught.value.where == "start"


def test_a_stiff_pendulum_swings_as_a_rigid_rod():
    """omega^2 = 3 g/(2 L), raised by the weight over the bending stiffness."""
    rod = strip(supports=(Pin(0.0),), thickness=0.02)
    omega = natural_modes(Model(rod), count=1).angular_frequencies[0]
    assert omega == pytest.approx(math.sqrt(1.5 * 9.81 / 0.5), rel=1e-5)


MOTIONS = {
    "roller": {"supports": (Clamp(0.0), Roller(0.5, (1.0, 0.3)))},
    "guide": {"supports": (Pin(0.0), Guide(0.5, (1.0, 0.0)))},
    "two pins": {"supports": (Pin(0.0), Pin(0.5))},
    "free": {"supports": ()},
    "attached": {
        "attachments": (
            Spring(0.3, (0.0, 5.0)),
            RotationalSpring(0.2, 0.01),
            PointMass(0.2, 2e-3, 1e-6),
            Dashpot(0.4, (0.0, 0.05)),
        )
    },
    "all": {"supports": (Pin(0.1), Roller(0.4, (1.0, 0.0))), "attachments": FEATURES},
}
THICK = {"thickness": 0.02, "elastic_modulus": 210e9 / 40**2}  # slow axial waves, which IDAS has to follow


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "method"), [(name, method) for name in ("free", "roller", "all") for method in ("radau", "idas")]
)
def test_the_energy_of_a_pushed_beam_is_balanced(name, method):
    """The push at a free tip lasts half a period of 5 Hz; where the tip is held, the beam is released instead.

    Each other feature is in the test of the moving base.
    """
    beam = strip(5, **MOTIONS[name], **THICK, **WEIGHTLESS)
    held = any(support.point == 0.5 for support in beam.supports)
    start = static_equilibrium(Model(beam), loads=[PointLoad((0.0, 0.5), point=0.25)]) if held else "equilibrium"
    load = None if held else HarmonicLoad((0.0, 0.2), 5.0, stop=0.1)
    law = RayleighDamping(alpha=0.1)
    run = simulate(
        Model(beam),
        damping=law,
        start=start,
        load=load,
        duration=0.15,
        sample_rate=200.0,
        method=method,
        tolerance=1e-9,
    )
    size = run.energy.max()
    assert size > 1e-5
    assert abs(run.balance_error).max() < 1e-4 * size
    assert (np.diff(run.dissipated_energy) > 0.0).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes",
    [
        *MOTIONS.values(),
        {"supports": (Clamp(0.0, 0.5), Clamp(0.5, displacement=(-2e-3, 1e-3), rotation=0.05))},
        {"supports": (Pin(0.0), Roller(0.5, (1.0, 0.2))), "natural_curvature": 3.0},
        {"supports": (Clamp(0.2),)},
    ],
    ids=[*MOTIONS, "displaced", "bent", "held in the middle"],
)
def test_the_energy_of_a_beam_on_a_base_that_moves_and_turns_is_balanced(changes):
    """The base does the work of all supports, springs and dashpots."""
    time = np.linspace(0.0, 0.2, 41)
    path = 0.01 * np.sin(np.outer(time, [20.0, 15.0])) ** 2
    base = SampledBase(time, path, 0.3 * np.sin(12.0 * time) ** 2)
    beam, law = strip(5, **THICK, **WEIGHTLESS, **changes), RayleighDamping(alpha=0.1, beta=1e-4)
    run = simulate(Model(beam), damping=law, base=base, duration=0.15, sample_rate=200.0, tolerance=1e-9)
    largest = max(abs(run.base_work).max(), run.energy.max())
    assert abs(run.balance_error).max() < 1e-6 * largest + 1e-15  # rounding, J
    assert abs(run.base_work).max() > 0.1 or not beam.supports


@pytest.mark.slow
def test_a_dashpot_dissipates_the_work_of_its_force():
    """Energy lost is the integral of c v^2 at the point, and none is lost without the dashpot."""
    c = 0.05
    beam = strip(4, attachments=(Dashpot(0.4, (0.0, c)),), **THICK, **WEIGHTLESS)
    load = HarmonicLoad((0.0, 0.2), 5.0, stop=0.1)
    settings = {"load": load, "duration": 0.15, "sample_rate": 2000.0, "tolerance": 1e-9}
    run = simulate(Model(beam), **settings)
    power = c * run.velocity(0.4)[:, 1] ** 2
    lost = np.trapezoid(power, run.time)
    assert run.dissipated_energy[-1] == pytest.approx(lost, rel=1e-4)
    assert lost > 0.02 * run.load_work[-1]
    free = simulate(Model(strip(4, **THICK, **WEIGHTLESS)), **settings)
    assert abs(free.dissipated_energy).max() == 0.0
