"""Sections other than rectangles: closed forms of rods, tubes and beams of given stiffness, and refusals."""

import math
import pickle

import casadi as cs
import numpy as np
import pytest
import scipy.linalg

from ancf_casadi import (
    Beam,
    InputError,
    Model,
    PointLoad,
    PointMass,
    QuadraticDamping,
    Section,
    Sensor,
    natural_modes,
    static_equilibrium,
)
from ancf_casadi.dynamics.derivatives.reading import SampledMotion
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.mechanics.beam import SplitBeam

MATERIAL = {"density": 1200.0, "elastic_modulus": 2e9}
LYING = {"axis": (1.0, 0.0), "gravity": (0.0, 0.0)}
CABLE = Section.stiffness(bending=0.02, axial=4e4, mass_per_length=0.05)
LOADS_OF_ROOTS = np.array([1.8751040687, 4.6940911330, 7.8547574382]) ** 2


def beam_of(section, elements=16, **changes):
    """Return a beam of 0.4 m whose section, if not of given stiffness, is of MATERIAL."""
    material = {} if section.elastic_modulus else MATERIAL
    return Beam.uniform(length=0.4, section=section, elements=elements, **{**LYING, **material, **changes})


# E I, E A and mass per length from the textbook, without the classes of the program
D, BORE = 6e-3, 0.7
TEXTBOOK = {
    "rod": (Section.circle(D), 2e9 * math.pi * D**4 / 64, 2e9 * math.pi * D**2 / 4, 1200 * math.pi * D**2 / 4),
    "tube": (
        Section.tube(outer=D, inner=BORE * D),
        2e9 * math.pi * (D**4 - (BORE * D) ** 4) / 64,
        2e9 * math.pi * (D**2 - (BORE * D) ** 2) / 4,
        1200 * math.pi * (D**2 - (BORE * D) ** 2) / 4,
    ),
    "cable": (CABLE, 0.02, 4e4, 0.05),
}
cases = pytest.mark.parametrize(("section", "bending", "axial", "line_mass"), TEXTBOOK.values(), ids=TEXTBOOK)


@cases
def test_stiffnesses_and_mass_are_those_of_the_textbook(section, bending, axial, line_mass):
    beam = beam_of(section, elements=2)
    np.testing.assert_allclose(beam.bending_stiffness, bending, rtol=1e-14)
    np.testing.assert_allclose(beam.axial_stiffness, axial, rtol=1e-14)
    np.testing.assert_allclose(beam.mass_per_length, line_mass, rtol=1e-14)
    assert beam.mass == pytest.approx(0.4 * line_mass, rel=1e-14)


@cases
def test_a_cantilever_has_the_frequencies_of_the_closed_form(section, bending, axial, line_mass):
    frequencies = natural_modes(Model(beam_of(section)), count=3).frequencies
    exact = LOADS_OF_ROOTS * math.sqrt(bending / line_mass) / 0.4**2 / (2 * math.pi)
    assert frequencies == pytest.approx(exact, rel=5e-5)  # (lambda l)^4/1440 of 16 cubics in mode 3: 4e-5


@cases
def test_a_small_sag_is_that_of_the_closed_form(section, bending, axial, line_mass):
    gravity = 1e-3 * bending / line_mass / 0.4**3
    rest = static_equilibrium(Model(beam_of(section, gravity=(0.0, -gravity))))
    assert -rest.tip[1] == pytest.approx(line_mass * gravity * 0.4**4 / (8 * bending), rel=1e-5)


@cases
@pytest.mark.parametrize(("load", "down", "back"), [(1.0, 0.30172, 0.05643), (10.0, 0.81061, 0.55500)])
def test_a_dead_tip_load_bends_it_to_the_elastica(section, bending, axial, line_mass, load, down, back):
    """Bisshopp and Drucker 1945, Large deflection of cantilever beams, Quarterly of Applied Mathematics 3, p. 272."""
    model = Model(beam_of(section, elements=24))
    rest = static_equilibrium(model, tip_force=(0.0, -load * bending / 0.4**2))
    stretch = 2 * load * bending / 0.4**2 / axial  # these sections stretch a little
    assert -rest.tip[1] / 0.4 == pytest.approx(down, abs=2e-5 + stretch)
    assert 1 - rest.tip[0] / 0.4 == pytest.approx(back, abs=2e-5 + stretch)


def test_a_rod_is_the_rectangle_of_the_page_on_sections():
    rod = beam_of(Section.circle(D), elements=4)
    width, thickness = math.pi / (2 * math.sqrt(3)) * D, math.sqrt(3) / 2 * D
    assert width / D == pytest.approx(0.907, abs=5e-4) and thickness / D == pytest.approx(0.866, abs=5e-4)
    strip = Beam.uniform(length=0.4, width=width, thickness=thickness, elements=4, **MATERIAL, **LYING)
    np.testing.assert_allclose(Model(rod).properties, Model(strip).properties, rtol=1e-15)
    assert Model(rod).element is Model(strip).element  # the same Functions


def test_a_tube_without_bore_is_a_rod_and_a_thin_one_has_the_radius_of_gyration_of_a_ring():
    assert Section.tube(D, 0.0) == Section.circle(D)
    ring = Section.tube(D, D * (1 - 1e-9))
    assert math.sqrt(ring.second_moment / ring.area) == pytest.approx(D / math.sqrt(8), rel=1e-8)
    assert ring.area == pytest.approx(math.pi * D**2 * 1e-9 / 2, rel=1e-6)


def test_rectangles_stay_as_they_were():
    assert Section.rectangle(5e-3, 1e-3) == Section(width=5e-3, thickness=1e-3) == Section(5e-3, 1e-3)
    stated = Beam.uniform(length=0.4, width=5e-3, thickness=1e-3, elements=4, **MATERIAL)
    of_section = Beam.uniform(length=0.4, section=Section(5e-3, 1e-3), elements=4, **MATERIAL)
    assert stated == of_section and of_section.section_shape == ()
    assert repr(of_section) == "Beam(0.4 m, 4 elements, 5 x 1 mm)"
    assert repr(beam_of(Section.tube(D, 3e-3))) == "Beam(0.4 m, 16 elements, Section(outer=0.006, inner=0.003))"
    assert repr(CABLE) == "Section(bending=0.02, axial=40000, mass_per_length=0.05)"


def test_a_beam_keeps_the_sections_of_its_elements():
    sections = [Section.circle(D), Section.tube(D, 2e-3), Section.rectangle(4e-3, 3e-3), Section.circle(5e-3)]
    beam = Beam.uniform(length=0.4, section=sections, elements=4, **MATERIAL)
    assert pickle.loads(pickle.dumps(beam)) == beam
    assert [section.depth for section in beam.sections] == pytest.approx([D, D, 3e-3, 5e-3], rel=1e-15)
    assert [section.breadth for section in beam.sections] == pytest.approx([D, D, 4e-3, 5e-3], rel=1e-15)
    fine = SplitBeam.of(beam)
    assert fine.sections[::2] == fine.sections[1::2] == beam.sections
    with pytest.raises(InputError, match=r"^diameter: only circles and tubes have one"):
        _ = beam.diameter


def test_a_diameter_changes_width_and_thickness_and_keeps_the_bore():
    tube = beam_of(Section.tube(D, 3e-3), elements=3)
    wider = tube.with_(diameter=(D, 2 * D, 3 * D))
    assert wider.diameter == pytest.approx((D, 2 * D, 3 * D), rel=1e-15)
    np.testing.assert_allclose(wider.bending_stiffness, tube.bending_stiffness * [1, 16, 81], rtol=1e-13)
    cable = tube.with_(section=CABLE)
    np.testing.assert_allclose(cable.mass_per_length, 0.05, rtol=1e-14)
    assert cable.with_(section=Section.circle(D), **MATERIAL) == beam_of(Section.circle(D), elements=3)


@cases
def test_the_air_sees_the_breadth(section, bending, axial, line_mass):
    """Force per length of a cross flow on a beam at rest: rho Cd b u^2/2."""
    breadth = D
    if section is CABLE:
        section = Section.stiffness(0.02, 4e4, 0.05, depth=2e-3, breadth=D)
    beam = beam_of(section, elements=4)
    (load,) = QuadraticDamping.from_drag(1.2, 1.3, beam, flow=(0.0, 3.0)).loads(beam)
    assert load.force == pytest.approx((0.0, 1.3 * 1.2 * breadth * 3.0**2 / 2), rel=1e-12)


@cases
def test_a_gauge_on_the_surface_reads_the_moment_times_half_the_depth(section, bending, axial, line_mass):
    if section is CABLE:
        section = Section.stiffness(0.02, 4e4, 0.05, depth=D)
    model, force = Model(beam_of(section)), 1e-3 * bending / 0.4**2
    strain = gauge_reading(model, Sensor("strain", 0.05), static_equilibrium(model, tip_force=(0.0, -force)))
    assert strain == pytest.approx(force * (0.4 - 0.05) * D / 2 / bending, rel=1e-3)


def gauge_reading(model, sensor, equilibrium):
    """Return the reading of a sensor on a beam at rest."""
    equations, still = Equations(model, QuadraticDamping()), cs.MX.zeros(model.size)
    coordinates, parameters = (cs.MX(cs.DM(values)) for values in (equilibrium.coordinates, equations.parameters))
    motion = SampledMotion.of(equations, coordinates, still, still, cs.MX.zeros(3), parameters)
    return float(cs.evalf(motion.read(sensor)))


def test_what_needs_an_unknown_extent_is_refused():
    beam = beam_of(CABLE, elements=4)
    with pytest.raises(InputError, match=r"^breadth: .* given stiffness; give Section.stiffness a depth or a breadth$"):
        QuadraticDamping.from_drag(1.2, 1.3, beam)
    model = Model(beam)
    with pytest.raises(InputError, match=r"^depth: .* given stiffness; give Section.stiffness a depth$"):
        gauge_reading(model, Sensor("strain", 0.05), static_equilibrium(model))
    sensor = Sensor("strain", 0.05, distance=1e-3)
    assert abs(gauge_reading(model, sensor, static_equilibrium(model))) < 1e-12


ROD = {"length": 0.4, "elements": 4, "section": Section.circle(D), **MATERIAL}


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Section.circle(-1e-3), "diameter: must be positive, got -0.001"),
        (lambda: Section.circle(1e200), "width: .* beyond the range of numbers; check the unit"),
        (lambda: Section.tube(1e-3, 1e-3), "inner: the diameter must be below the outer one, 0.001 m, got 0.001 m"),
        (lambda: Section.tube(1e-3, 2e-3), "inner: the diameter must be below the outer one"),
        (lambda: Section.tube(1e-3, -1e-3), "inner: must not be negative"),
        (lambda: Section.stiffness(0.0, 1.0, 1.0), "bending: must be positive"),
        (lambda: Section.stiffness(1.0, -1.0, 1.0), "axial: must be positive"),
        (lambda: Section.stiffness(1.0, 1.0, None), "mass_per_length: must be a finite number"),
        (lambda: Section.stiffness(1.0, 1.0, 1.0, depth=0.0), "depth: must be positive"),
        (lambda: Section.rectangle(1e-3, 0.0), "thickness: must be positive"),
        (lambda: Section(1e-3, 1e-3, "circle"), "shape: must be a Shape"),
        (lambda: Beam.uniform(**ROD, width=1e-3), "width: follows from the section; give one or the other"),
        (lambda: Beam.uniform(**{**ROD, "section": CABLE}), "density: follows from the section; give one or the other"),
        (lambda: Beam.uniform(**{**ROD, "density": None}), "density: must be a finite number, got None; state it"),
        (lambda: Beam.uniform(**{**ROD, "section": None}), "width: must be a finite number, got None; state it"),
        (lambda: Beam.uniform(**{**ROD, "section": [CABLE] * 3}), "section: has 3 values for 4 elements"),
        (lambda: Beam.uniform(**{**ROD, "section": "circle"}), "section: must be a Section, got 'circle'"),
        (
            lambda: Beam.uniform(**{**ROD, "section": [CABLE, CABLE, Section.circle(D), CABLE]}),
            "section: some are of given stiffness and some are not",
        ),
        (lambda: Beam.uniform(**ROD).with_(thickness=1e-3), "width, thickness: the section of element 1 is round"),
        (lambda: Beam.uniform(**ROD).with_(diameter=1e-3, width=1e-3), "width: follows from the section"),
        (lambda: Beam.uniform(**ROD).with_(diameter=[1e-3]), "diameter: has 1 values for 4 elements"),
        (lambda: Beam.uniform(**ROD).with_(diameter=0.0), "diameter: must be positive"),
        (lambda: beam_of(CABLE).with_(diameter=1e-3), "diameter: only circles and tubes have one"),
        (lambda: beam_of(CABLE).with_(section=Section.circle(D)), "density: is that of a section of given stiffness"),
        (lambda: beam_of(CABLE).with_(section_shape=[1]), "section_shape: must be a Shape"),
        (lambda: beam_of(CABLE).with_(section_shape=[CABLE.shape]), "section_shape: has 1 values for 16 elements"),
        (lambda: CABLE.diameter, "diameter: only circles and tubes have one"),
    ],
)
def test_unusable_sections_are_refused_in_one_line(make, message):
    with pytest.raises(InputError, match=f"^{message}") as caught:
        make()
    assert "\n" not in str(caught.value)


TOML = "[beam]\nlength = 0.4\naxis = [1.0, 0.0]\ngravity = [0.0, 0.0]\n"
OF_MATERIAL = "density = 1200.0\nelastic_modulus = 2e9\n"


def read(tmp_path, lines):
    path = tmp_path / "beam.toml"
    path.write_text(TOML + lines)
    return Beam.from_toml(path)


@pytest.mark.parametrize(
    ("lines", "section"),
    [
        ('section = {kind = "circle", diameter = 6e-3}\n' + OF_MATERIAL, Section.circle(D)),
        ('section = {kind = "tube", outer = 6e-3, inner = 3e-3}\n' + OF_MATERIAL, Section.tube(D, 3e-3)),
        ('section = {kind = "rectangle", width = 6e-3, thickness = 3e-3}\n' + OF_MATERIAL, Section(D, 3e-3)),
        ('section = {kind = "stiffness", bending = 0.02, axial = 4e4, mass_per_length = 0.05}\n', CABLE),
    ],
)
def test_a_section_is_read_from_toml(tmp_path, lines, section):
    assert read(tmp_path, lines + "elements = 16\n") == beam_of(section)


def test_a_list_of_sections_is_read_from_toml(tmp_path):
    lines = 'section = [{kind = "circle", diameter = 6e-3}, {kind = "rectangle", width = 5e-3, thickness = 1e-3}]\n'
    assert read(tmp_path, lines + OF_MATERIAL).sections == (Section.circle(D), Section(5e-3, 1e-3))


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ('section = {kind = "hexagon", side = 6e-3}\n' + OF_MATERIAL, "section: kind: must be one of"),
        ("section = {diameter = 6e-3}\n" + OF_MATERIAL, "section: the key 'kind' is missing"),
        ('section = {kind = "circle", radius = 6e-3}\n' + OF_MATERIAL, "section: .*'?(diameter|radius)"),
        ('section = {kind = "circle", diameter = -6e-3}\n' + OF_MATERIAL, "section: diameter: must be positive"),
        ('section = {kind = "tube", outer = 6e-3, inner = 6e-3}\n' + OF_MATERIAL, "section: inner: the diameter must"),
        (
            'section = {kind = "circle", diameter = 6e-3}\nwidth = 1.0\n' + OF_MATERIAL,
            "width: follows from the section",
        ),
        ('section = {kind = "circle", diameter = 6e-3}\n', "density: must be a finite number, got None; state it"),
        (OF_MATERIAL + "thickness = 1e-3\n", "the key 'width' is missing"),
    ],
)
def test_an_unusable_section_in_toml_is_refused_in_one_line(tmp_path, lines, message):
    with pytest.raises(InputError, match=rf"beam\.toml: \[beam\]: {message}") as caught:
        read(tmp_path, lines + "elements = 4\n")
    assert "\n" not in str(caught.value)


def test_a_wing_of_given_stiffnesses_and_lumped_masses_vibrates_like_cubic_elements_of_linear_theory():
    """15 different elements and 16 masses, against matrices that are assembled here from the textbook."""
    root, l = np.linspace(1.0, 0.2, 15), 1.2 / 15
    bending, axial, line_mass = 30.0 * root**3, 4e6 * root, 0.6 * root
    masses = [0.05, *np.linspace(0.04, 0.01, 15)]
    sections = [Section.stiffness(*row) for row in zip(bending, axial, line_mass, strict=True)]
    points = [PointMass(place, mass) for place, mass in zip(np.linspace(0.0, 1.2, 16), masses, strict=True)]
    wing = Beam.uniform(length=1.2, section=sections, elements=15, attachments=points, **LYING)
    K, M = np.zeros((32, 32)), np.diag(np.column_stack([masses, np.zeros(16)]).ravel())
    for k in range(15):
        rows = np.ix_(*[range(2 * k, 2 * k + 4)] * 2)
        K[rows] += (
            bending[k]
            / l**3
            * np.array(
                [
                    [12, 6 * l, -12, 6 * l],
                    [6 * l, 4 * l**2, -6 * l, 2 * l**2],
                    [-12, -6 * l, 12, -6 * l],
                    [6 * l, 2 * l**2, -6 * l, 4 * l**2],
                ]
            )
        )
        M[rows] += line_mass[k] * l / 420 * np.array(
            [[156, 22 * l, 54, -13 * l], [22 * l, 4 * l**2, 13 * l, -3 * l**2],
             [54, 13 * l, 156, -22 * l], [-13 * l, -3 * l**2, -22 * l, 4 * l**2]])  # fmt: skip
    exact = np.sqrt(scipy.linalg.eigh(K[2:, 2:], M[2:, 2:], eigvals_only=True)[:4]) / (2 * math.pi)
    assert natural_modes(Model(wing), count=4).frequencies == pytest.approx(exact, rel=1e-6)


def test_a_static_load_on_a_stepped_shaft_adds_up_the_parts():
    """Tip deflection of a cantilever with two diameters, by integration of M/(E I)."""
    shaft = Beam.uniform(length=0.4, section=[Section.circle(D)] * 4 + [Section.circle(D / 2)] * 4, elements=8,
                         **MATERIAL, **LYING)  # fmt: skip
    thick, thin = (2e9 * math.pi * d**4 / 64 for d in (D, D / 2))
    force = 1e-4 * thin / 0.4**2
    exact = force * (0.4**3 - 0.2**3) / 3 / thick + force * 0.2**3 / 3 / thin
    rest = static_equilibrium(Model(shaft), loads=[PointLoad((0.0, -force), point=0.4)])
    assert -rest.tip[1] == pytest.approx(exact, rel=1e-5)
