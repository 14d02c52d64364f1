"""Paths through limit points and bifurcations, against solutions of the differential equations of thin beams."""

import json
import math

import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    Clamp,
    EquilibriumError,
    Guide,
    InputError,
    Model,
    Pin,
    PointLoad,
    Roller,
    equilibrium_path,
    natural_modes,
)
from ancf_casadi.figures.files import figure_bytes
from tests.boundary.cases import REFERENCES
from tests.boundary.statics import FEET, RISE, section_of

# Numbers of ``boundary/references.json``, whose sources are named there.
COLUMN = dict(zip((20, 60, 100, 140, 176), REFERENCES["elastica_cantilever_axial"]["rows"].values(), strict=True))
*FORCES, FIRST_LIMIT, SECOND_LIMIT = REFERENCES["williams_toggle"]["rows"].values()
TOGGLE = {(k + 1) / 10: force for k, (force,) in enumerate(FORCES)}
TOGGLE_LIMITS = [FIRST_LIMIT, SECOND_LIMIT]
(ARCH,) = REFERENCES["deep_arch_clamped_hinged"]["rows"].values()
BUCKLED_PINNED = dict(zip((1, 2, 4, 10), REFERENCES["postbuckled_pp"]["rows"].values(), strict=True))
BUCKLED_CLAMPED = dict(zip((1, 4, 10), REFERENCES["postbuckled_cc"]["rows"].values(), strict=True))


def model_of(bending, axial, *, length=1.0, elements=20, **fields):
    """Return a beam along x with given stiffnesses EI and EA and a mass of 1 per length, without gravity."""
    section = section_of(bending, axial)
    settings = {"axis": (1.0, 0.0), "gravity": (0.0, 0.0), "density": 1 / section["thickness"], **section, **fields}
    return Model(Beam.uniform(length=length, elements=elements, **settings))


def column(elements=20, **fields):
    """Return a beam of unit length and bending stiffness that hardly stretches."""
    return model_of(1.0, 1e8, elements=elements, **fields)


def toggle(elements=20):
    """Return one half of Williams' toggle frame; half the force acts on it."""
    length = math.hypot(FEET, RISE)
    supports = (Clamp(), Guide(length, direction=(0.0, 1.0)))
    return model_of(9270.0, 1885e3, length=length, elements=elements, axis=(FEET, RISE), supports=supports)


def strip(support, elements=40, radius=2e-4):
    """Return a strip of unit length whose end is displaced until it has buckled by ten radii of gyration."""
    euler = 4 if support is Clamp else 1  # times pi^2 EI/L^2
    way = math.pi**2 * radius**2 * (euler + 10**2 / 4)
    supports = (support(0.0), support(1.0, displacement=(-way, 0.0)))
    return model_of(1.0, radius**-2, elements=elements, supports=supports), lambda b: (euler + b**2 / 4) / (euler + 25)


APEX = [PointLoad((0.0, -0.5))]
PUSH = [PointLoad((-1.0, 0.0))]


def unbalance(rest):
    """Return the largest force that is not balanced, relative to the largest elastic force at a node."""
    elastic = rest.model.elastic_force(rest.coordinates, rest.model.properties).full()
    return np.abs(rest.structure.linearisation(rest.exact)[0]).max() / np.abs(elastic).max()


@pytest.fixture(scope="module")
def snap():
    return equilibrium_path(toggle(), loads=APEX, largest_factor=100.0)


def deflection(rest):
    return RISE - rest.tip[1]


@pytest.mark.parametrize("w", TOGGLE)
def test_a_toggle_frame_snaps_through_as_williams_found(snap, w):
    nearest = min(snap.equilibria_at(TOGGLE[w]), key=lambda rest: abs(deflection(rest) - w))
    force = np.interp(w, [deflection(rest) for rest in snap.equilibria], snap.factors)
    assert force == pytest.approx(TOGGLE[w], rel=0.03)
    assert deflection(nearest) == pytest.approx(w, rel=1e-4)


def test_the_limit_points_of_the_toggle_frame_are_found(snap):
    assert [point.kind for point in snap.critical_points] == ["limit", "limit"]
    for point, (w, force) in zip(snap.critical_points, TOGGLE_LIMITS, strict=True):
        assert point.factor == pytest.approx(force, rel=1e-5)
        assert deflection(point.equilibrium) == pytest.approx(w, rel=1e-4)
    assert snap.complete
    assert snap.factors[-1] == 100.0


def test_three_equilibria_at_one_force_are_reported(snap):
    low, middle, high = snap.equilibria_at(33.0)
    assert [rest.stable for rest in (low, middle, high)] == [True, False, True]
    assert deflection(low) < TOGGLE_LIMITS[0][0] < deflection(middle) < TOGGLE_LIMITS[1][0] < deflection(high)
    assert max(unbalance(rest) for rest in (low, middle, high)) < 1e-9
    assert all(rest.loads[0].force[1] == -16.5 for rest in (low, middle, high))
    assert [len(snap.equilibria_at(force)) for force in (0.0, 20.0, 50.0, 100.0)] == [1, 1, 1, 1]
    assert snap.equilibria_at(101.0) == snap.equilibria_at(-1.0) == ()


def test_equilibria_between_limit_points_are_unstable_and_all_others_stable(snap):
    deflections = np.array([deflection(rest) for rest in snap.equilibria])
    between = (deflections > TOGGLE_LIMITS[0][0] - 1e-4) & (deflections < TOGGLE_LIMITS[1][0] + 1e-4)
    assert between.sum() >= 4
    assert np.array_equal(snap.stable, ~between)
    regular = [k for k in range(len(deflections)) if k not in snap.critical_indices]
    assert [snap.equilibria[k].stable for k in regular] == snap.stable[regular].tolist()


@pytest.mark.slow
@pytest.mark.parametrize("largest", [35.0, 1e3, 1e5])
def test_no_limit_point_is_jumped_over_whatever_the_largest_factor(snap, largest):
    """The limit points and the drop between them are 7 % to 0.003 % of the largest factor."""
    path = equilibrium_path(toggle(10), loads=APEX, largest_factor=largest)
    assert [point.factor for point in path.critical_points] == pytest.approx([33.86123305, 31.26258318], rel=1e-4)
    assert path.complete


def test_natural_modes_about_both_stable_shapes_of_the_toggle_frame(snap):
    low, _, high = snap.equilibria_at(33.0)
    lowest = [natural_modes(rest.model, count=1, equilibrium=rest).frequencies[0] for rest in (low, high)]
    for rest, frequency in zip((low, high), lowest, strict=True):
        stiffness = np.linalg.eigvalsh(rest.stiffness.toarray())[0]
        assert frequency > 0.0 < stiffness
    with pytest.raises(EquilibriumError, match="unstable"):
        natural_modes(snap.model, equilibrium=snap.equilibria_at(33.0)[1])


EULER = {  # P L^2/EI
    "cantilever": ((Clamp(),), math.pi**2 / 4),
    "pinned": ((Pin(0.0), Roller(1.0)), math.pi**2),
    "clamped": ((Clamp(), Guide(1.0)), 4 * math.pi**2),
    "pinned, clamped": ((Pin(0.0), Guide(1.0)), 20.1907286),
}


@pytest.mark.parametrize("name", EULER)
def test_columns_buckle_at_euler_loads(name):
    supports, load = EULER[name]
    path = equilibrium_path(column(supports=supports), loads=PUSH, largest_factor=1.5 * load)
    (buckling,) = path.critical_points
    assert buckling.kind == "bifurcation"
    assert buckling.factor == pytest.approx(load, rel=1e-4)
    assert path.stable.tolist() == (path.factors < buckling.factor).tolist()
    points = np.linspace(0.0, 1.0, 21)
    shape = np.array([path.model.interpolation(s) @ buckling.shape for s in points])
    assert np.abs(shape[:, 0]).max() < 1e-6
    assert np.abs(shape).max() == shape[:, 1].max() == 1.0
    if name == "clamped":
        assert shape[:, 1] == pytest.approx((1 - np.cos(2 * math.pi * points)) / 2, abs=1e-4)


@pytest.mark.slow
def test_a_column_that_may_sway_buckles_at_the_displacement_of_its_end_by_euler():
    """The guided end is displaced, so the factor is a strain; Timoshenko & Gere 1961: P L^2/EI = pi^2."""
    guide = Guide(1.0, direction=(0.0, 1.0), displacement=(-2e-7, 0.0))
    path = equilibrium_path(column(supports=(Clamp(), guide)))
    (buckling,) = path.critical_points
    assert 1e8 * 2e-7 * buckling.factor == pytest.approx(math.pi**2, rel=1e-4)


@pytest.mark.slow
def test_the_factor_of_a_bifurcation_does_not_depend_on_the_steps():
    loads = [PointLoad((-(math.pi**2), 0.0))]
    model = column(supports=(Pin(0.0), Roller(1.0)))
    paths = [equilibrium_path(model, loads=loads, largest_factor=largest) for largest in (1.01, 1.3, 2.7)]
    factors = [path.critical_points[0].factor for path in paths]
    assert factors == pytest.approx([factors[0]] * 3, rel=1e-9)


@pytest.mark.slow
def test_bifurcations_closer_than_a_step_are_all_found():
    loads = [PointLoad((-(math.pi**2), 0.0))]
    path = equilibrium_path(column(30, supports=(Pin(0.0), Roller(1.0))), loads=loads, largest_factor=120.0)
    assert [point.kind for point in path.critical_points] == ["bifurcation"] * 10
    assert [point.factor for point in path.critical_points] == pytest.approx([k**2 for k in range(1, 11)], rel=1e-2)


@pytest.mark.parametrize("axis", [(0.6, 0.8), (0.7, -0.3)])
def test_the_factor_of_a_bifurcation_does_not_depend_on_the_axis(axis):
    """Along x the forces across are exactly zero; in other directions they are rounded, and K is next to singular."""
    factors = []
    for direction in ((1.0, 0.0), axis):
        force = -(math.pi**2) / 4 * np.array(direction) / np.linalg.norm(direction)
        model = model_of(1.0, 1e6, axis=direction)
        path = equilibrium_path(model, loads=[PointLoad(tuple(force))], largest_factor=2.0)
        factors += [point.factor for point in path.critical_points]
    assert factors == pytest.approx([factors[0]] * 2, rel=1e-8)


@pytest.fixture(scope="module")
def buckled():
    loads = [PointLoad((-(math.pi**2) / 4, 0.0))]
    straight = equilibrium_path(column(40), loads=loads, largest_factor=1.2)
    (start,) = straight.critical_points
    sides = [equilibrium_path(column(40), loads=loads, largest_factor=9.2, start=start, side=side) for side in (1, -1)]
    return straight, sides


@pytest.mark.parametrize("angle", COLUMN)
def test_a_column_bends_as_the_elastica_to_both_sides(buckled, angle):
    factor, x, y = COLUMN[angle]
    for path, sign in zip(buckled[1], (1.0, -1.0), strict=True):
        (rest,) = path.equilibria_at(factor)
        assert rest.tip == pytest.approx([x, sign * y], abs=1e-4)
        assert rest.tip_angle == pytest.approx(sign * math.radians(angle), abs=1e-3)
        assert rest.stable


def test_a_branch_begins_at_its_bifurcation_and_is_stable(buckled):
    straight, (left, right) = buckled
    assert left.factors[0] == right.factors[0] == straight.critical_points[0].factor
    assert not left.stable[0]
    assert left.stable[1:].all()
    assert np.diff(left.factors).min() > 0.0
    assert left.reference_point == 1.0


@pytest.mark.slow
def test_a_deep_arch_reaches_its_limit_load():
    angle = math.radians(215.0)
    supports = (Clamp(), Pin(100.0 * angle))
    axis = (math.cos(angle / 2), math.sin(angle / 2))
    held = {"supports": supports, "axis": axis, "natural_curvature": -0.01}
    model = model_of(1e6, 1e8, length=100.0 * angle, elements=80, **held)
    crown = 50.0 * angle
    path = equilibrium_path(model, loads=[PointLoad((0.0, -100.0), point=crown)], largest_factor=10.0, most_steps=40)
    limit = path.critical_points[0]
    x, y = limit.equilibrium.position(crown) - model.interpolation(crown) @ model.straight
    assert limit.kind == "limit"
    assert (100 * limit.factor, x, -y) == pytest.approx(ARCH, rel=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(("support", "reference"), [(Pin, BUCKLED_PINNED), (Clamp, BUCKLED_CLAMPED)])
def test_a_strip_buckled_by_a_support_vibrates_about_its_buckled_state(support, reference):
    model, factor_of = strip(support)
    (start,) = equilibrium_path(model, largest_factor=1.05 * factor_of(0)).critical_points
    assert start.factor == pytest.approx(factor_of(0), rel=1e-5)
    bent = equilibrium_path(model, start=start)
    for rise, omega in reference.items():
        (rest,) = bent.equilibria_at(factor_of(rise))
        assert rest.position(0.5)[1] / 2e-4 == pytest.approx(rise, rel=1e-4)
        modes = natural_modes(rest.model, count=3, equilibrium=rest)
        assert modes.angular_frequencies == pytest.approx(omega, rel=1e-4)
    assert bent.equilibria[-1].model == model


@pytest.mark.slow
def test_each_equilibrium_has_the_supports_of_its_factor():
    """A clamp that turns and one in a spring, both displaced, under gravity and a force."""
    supports = (Clamp(displacement=(0.0, 0.1)), Clamp(1.0, 20.0, rotation=0.4, displacement=(-0.05, 0.0)))
    model = column(4, supports=supports, gravity=(0.0, -5.0))
    path = equilibrium_path(model, loads=[PointLoad((0.0, 3.0), point=0.3)])
    assert path.factors[-1] == 1.0
    assert path.equilibria[-1].model == model
    assert max(unbalance(rest) for rest in path.equilibria) < 1e-6
    (half,) = path.equilibria_at(0.5)
    assert half.model.beam.supports == (
        Clamp(displacement=(0.0, 0.05)),
        Clamp(1.0, 20.0, rotation=0.2, displacement=(-0.025, 0.0)),
    )
    assert half.position(0.0) == pytest.approx([0.0, 0.05], abs=1e-15)
    assert half.position(1.0) == pytest.approx([0.975, 0.0], abs=1e-15)


@pytest.mark.parametrize("share", [0.1, 0.3, 0.45])
def test_a_column_under_a_force_that_partly_follows_it_diverges(share):
    """Bolotin 1963: cos(P L^2/EI)^(1/2) = -share/(1 - share) for the share of the force that follows the tip."""
    loads = [PointLoad((share - 1.0, 0.0)), PointLoad((-share, 0.0), follower=True)]
    path = equilibrium_path(column(), loads=loads, largest_factor=8.0)
    (divergence,) = path.critical_points
    assert divergence.kind == "bifurcation"
    assert divergence.factor == pytest.approx(math.acos(-share / (1 - share)) ** 2, rel=1e-4)
    assert path.stable.tolist() == (path.factors < divergence.factor).tolist()


def test_a_path_shows_as_text_plain_data_and_a_figure(snap, buckled):
    assert repr(snap) == f"EquilibriumPath({len(snap.factors)} equilibria, factor 0 to 100, 2 critical points)"
    rows = snap.table().rows
    assert [row[0] for row in rows] == ["begin", "limit", "limit", "end"]
    assert rows[1][1:] == (snap.critical_points[0].factor, *snap.critical_points[0].equilibrium.tip)
    data = json.loads(json.dumps(snap.to_dict()))
    assert data["factors"] == snap.factors.tolist()
    assert [point["kind"] for point in data["critical_points"]] == ["limit", "limit"]
    straight, (left, right) = buckled
    figure = left.figure(right, straight, labels=["left", "right", "straight"])
    assert figure_bytes(figure)[:4] == b"\x89PNG"
    (axes,) = figure.axes
    assert axes.get_xlabel() == "y displacement of the point at 1 m, mm"


@pytest.mark.slow
@pytest.mark.parametrize("load", [PointLoad(moment=6.0), PointLoad((0.0, 20.0), follower=True)])
def test_a_slope_turns_by_at_most_a_quarter_radian_between_equilibria(load):
    path = equilibrium_path(column(), loads=[load])
    slopes = np.array([rest.coordinates.reshape(-1, 4)[:, 2:] for rest in path.equilibria])
    assert np.linalg.norm(np.diff(slopes, axis=0), axis=2).max() < 0.25 + 1e-9
    assert path.complete
    if load.moment:
        assert path.equilibria[-1].tip == pytest.approx([math.sin(6.0) / 6, (1 - math.cos(6.0)) / 6], abs=1e-4)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:an element bends")
def test_an_imperfect_column_bends_without_critical_points():
    path = equilibrium_path(column(10), loads=[PointLoad((-(math.pi**2) / 4, 1e-3))], largest_factor=3.0)
    assert path.critical_points == ()
    assert path.stable.all()
    assert path.equilibria[-1].tip[1] > 0.7


def test_a_path_ends_after_the_most_steps():
    path = equilibrium_path(toggle(4), loads=APEX, largest_factor=100.0, most_steps=3)
    assert len(path.factors) == 4
    assert not path.complete


def test_what_a_path_cannot_do_is_refused(snap, buckled):
    model, limit, fork = toggle(4), snap.critical_points[0], buckled[0].critical_points[0]
    loads = [PointLoad((-(math.pi**2) / 4, 0.0))]
    calls = {
        "loads: are zero": lambda: equilibrium_path(model),
        "side: must be 1 or -1": lambda: equilibrium_path(model, loads=APEX, side=0),
        "largest_factor": lambda: equilibrium_path(model, loads=APEX, largest_factor=-1.0),
        "start: is no bifurcation": lambda: equilibrium_path(snap.model, loads=APEX, largest_factor=100.0, start=limit),
        "start: is no bifurcation of": lambda: equilibrium_path(column(40), loads=PUSH, largest_factor=2.0, start=fork),
        "largest_factor: must be beyond the start": lambda: equilibrium_path(column(40), loads=loads, start=fork),
    }
    for message, call in calls.items():
        with pytest.raises(InputError, match=message):
            call()


def test_loads_that_meet_no_resistance_are_refused():
    swinging = column(4, supports=(Pin(0.0),))
    with pytest.raises(EquilibriumError, match="without resistance"):
        equilibrium_path(swinging, loads=[PointLoad((0.0, 1.0))])
    with pytest.raises(InputError, match="loads: act on supports alone"):
        equilibrium_path(swinging, loads=[PointLoad((0.0, 1.0), point=0.0)])
