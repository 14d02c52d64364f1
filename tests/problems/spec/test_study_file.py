"""TOML files give the same beams, laws, base motions and settings as Python, or an error with the name of the key."""

from pathlib import Path

import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    Clamp,
    Dashpot,
    FrictionDamping,
    Guide,
    HarmonicBase,
    InputError,
    ModalDamping,
    Model,
    Pin,
    PointMass,
    QuadraticDamping,
    RayleighDamping,
    Roller,
    RotationalSpring,
    Spring,
    natural_modes,
)
from ancf_casadi.export import Document, write_document
from ancf_casadi.support.inputs import numbers
from problems import Global, MeasuredModes, PerElement, Smooth
from problems.spec.beam import read_beam, read_damped_beam
from problems.spec.motion import SimulationTables
from problems.study.reading import read_study
from tests.problems.conftest import STRIP

BEAM = f"{STRIP}elements = 4\n"
SIMULATION = "[simulation]\nduration = 2.0\n"


def arguments(path):
    """Return the arguments of ``simulate`` in a file."""
    return SimulationTables.of(path).read().arguments


def read_match(path):
    """Return the beam of a file and the arguments of ``match_frequencies`` after it."""
    study = read_study(path, ["match"])
    (step,) = study.steps
    return study.beam, step.table.request()


def beam(**changes) -> Beam:
    given = {"length": 0.5, "width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elastic_modulus": 210e9}
    return Beam.uniform(**{**given, "elements": 4, **changes})


class TestBeam:
    def test_uniform(self, file):
        assert read_beam(file(BEAM)).model.beam == beam()

    def test_values_of_each_element_axis_and_gravity(self, file):
        text = BEAM.replace("width = 5e-3", "width = [5e-3, 4e-3, 3e-3, 2e-3]")
        text += "axis = [2.0, 0.0]\ngravity = [0, -1.62]\n"
        assert read_beam(file(text)).model.beam == beam(width=(5e-3, 4e-3, 3e-3, 2e-3), axis=(1, 0), gravity=(0, -1.62))

    def test_tables_of_other_commands_do_not_disturb(self, file):
        assert read_beam(file(BEAM, "[match]\ntargets = 1\n[base]\n", SIMULATION)).model.beam == beam()

    def test_supports_attachments_and_natural_curvature(self, file, tmp_path):
        """The same file, read for a command and by ``Beam.from_toml``, gives the beam that Python makes."""
        text = """
        natural_curvature = 0.4
        prestress = -1e5
        tip_mass = 1e-3
        supports = [
            {kind = "clamp", stiffness = inf},
            {kind = "roller", point = 0.2, direction = [3.0, 4.0], displacement = [0.0, 1e-3]},
            {kind = "pin", point = 0.4},
            {kind = "guide", point = 0.5, rotation = 0.1},
        ]
        [[beam.attachments]]
        kind = "mass"
        point = 0.3
        mass = 5e-3
        rotary_inertia = 1e-7
        [[beam.attachments]]
        kind = "spring"
        point = 0.3
        stiffness = [0.0, 80.0]
        [[beam.attachments]]
        kind = "rotational_spring"
        point = 0.0
        stiffness = 2.0
        [[beam.attachments]]
        kind = "dashpot"
        point = 0.5
        coefficient = [0.0, 0.1]
        """
        expected = beam(
            natural_curvature=0.4,
            prestress=-1e5,
            tip_mass=1e-3,
            supports=(
                Clamp(0.0),
                Roller(0.2, (0.6, 0.8), displacement=(0.0, 1e-3)),
                Pin(0.4),
                Guide(0.5, rotation=0.1),
            ),
            attachments=(
                PointMass(0.3, 5e-3, rotary_inertia=1e-7),
                Spring(0.3, (0.0, 80.0)),
                RotationalSpring(0.0, 2.0),
                Dashpot(0.5, (0.0, 0.1)),
            ),
        )
        path = file(BEAM, text)
        assert read_beam(path).model.beam == Beam.from_toml(path) == expected
        write_document(tmp_path / "beam.json", Document(Model(expected)))
        assert read_beam(file('[beam]\ndocument = "beam.json"\n')).model.beam == expected

    def test_a_beam_without_supports_is_free(self, file):
        assert read_beam(file(BEAM, "supports = []\n")).model.beam == beam(supports=())

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("supports = [{}]", "supports: 1: the key 'kind' is missing; it is one of clamp, pin, roller, guide"),
            ('supports = [{kind = "glue"}]', "supports: 1: kind: must be one of clamp, pin, roller, guide, got 'glue'"),
            ('supports = [{kind = "clamp"}, {kind = "pin", point = 0.5, rotation = 1}]', "supports: 2: unknown key"),
            ('supports = [{kind = "pin", point = 0.7}]', "supports: the point 0.7 m is not on the beam"),
            ('attachments = [{kind = "clamp"}]', "attachments: 1: kind: must be one of mass, spring,"),
            ("natural_curvature = [1.0]", "natural_curvature: has 1 values for 4 elements"),
        ],
    )
    def test_wrong_supports_and_attachments_are_refused_in_one_line(self, file, text, message):
        path = file(BEAM, f"{text}\n")
        for read in (read_beam, Beam.from_toml):
            with pytest.raises(InputError) as caught:
                read(path)
            assert str(caught.value).startswith(f"{path}: [beam]: {message}")

    @pytest.mark.parametrize("text", ["# a beam", "[base]\n", "beam = 1\n"])
    def test_missing(self, file, text):
        with pytest.raises(InputError, match=r"study\.toml: (the key 'beam' is missing|\[beam\]: must be a table)"):
            read_beam(file(text))

    def test_file_that_is_not_there(self, tmp_path):
        with pytest.raises(InputError, match=r"absent\.toml: cannot be read"):
            read_beam(str(tmp_path / "absent.toml"))


class TestMatch:
    def test_beam_and_request(self, file):
        read, request = read_match(file(BEAM, "[match]\ntargets = [1.85, 10.19]\nbounds = 0.2\n"))
        assert read == beam()
        assert request == {"targets": [1.85, 10.19], "bounds": 0.2}

    def test_unknowns_and_shapes(self, file):
        text = """
        [match]
        targets = [10.19, 1.85]
        frequency_std = [0.01, 0.002]
        points = [0.2, 0.5]
        shapes = [[-1.0, 2.0], [1.0, 4.0]]
        objective = "worst-error"
        starts = 2
        unknowns = {width = "element", density = "global", thickness = {smooth = 2, relative_bounds = 0.05}}
        """
        _, request = read_match(file(BEAM, text))
        assert request == {
            "targets": MeasuredModes((10.19, 1.85), (0.01, 0.002), (0.2, 0.5), ((-1.0, 2.0), (1.0, 4.0))),
            "objective": "worst-error",
            "starts": 2,
            "unknowns": (PerElement("width"), Global("density"), Smooth("thickness", terms=2, relative_bounds=0.05)),
        }

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("", "the table is missing"),
            ("[match]\ntargets = [1]\nstart = [1]\n", "unknown key 'start'; known are bounds, freq"),
            ("[match]\ntargets = [1]\nbounds = 1.5\n", "bounds: must be above 0 and at most 1"),
            ("[match]\ntargets = [2, 1]\nfrequency_std = 0.1\n", "targets: must be ascending"),
            ("[match]\ntargets = [1]\nunknowns.width = 'all'\n", "unknowns: width: must be one of element, global,"),
            ("[match]\ntargets = [1]\nunknowns.width = {smooth = 2, order = 1}\n", "unknowns: width: unknown key"),
            ("[match]\ntargets = [1]\nunknowns.width = {element = false}\n", "unknowns: width: must be"),
            ("[match]\ntargets = [1]\nunknowns.width = 'smooth'\n", "unknowns: width: must be one of element,"),
            ("[match]\ntargets = [1]\nunknowns.length = 'global'\n", "unknowns: must be one of width"),
            ("[match]\ntargets = [1]\nunknowns.width = {smooth = 'x'}\n", "unknowns: width: smooth: must be a whole"),
        ],
    )
    def test_unusable(self, file, text, message):
        with pytest.raises(InputError, match=rf"study\.toml: \[match\]: {message}"):
            read_match(file(BEAM, text))

    def test_a_mesh_that_would_take_minutes_is_refused(self, file):
        text = BEAM.replace("elements = 4", "elements = 1001") + "[match]\ntargets = [1.85]\n"
        with pytest.raises(InputError, match=r"\[beam\]: elements: a match takes 1000 at most, got 1001"):
            read_match(file(text))

    def test_table_that_is_none(self, file):
        with pytest.raises(InputError, match=r"\[match\]: must be a table, got 3"):
            read_match(file("match = 3\n", BEAM))


class TestSimulation:
    def test_least(self, file):
        """With a beam and a duration alone: undamped, on a fixed base, with the defaults of ``simulate``."""
        given = arguments(file(BEAM, SIMULATION))
        assert given == {"model": Model(beam()), "damping": None, "duration": 2.0}

    def test_settings(self, file):
        text = 'sample_rate = 250.0\nstart = "straight"\nmethod = "radau"\ntolerance = 1e-9\n'
        settings = {"duration": 2.0, "sample_rate": 250.0, "start": "straight", "method": "radau", "tolerance": 1e-9}
        given = arguments(file(BEAM, SIMULATION, text))
        assert given == {"model": Model(beam()), "damping": None, **settings}

    def test_base(self, file):
        text = '[base]\namplitude = 1e-3\nfrequency = 2.0\nstop = 3\ndirection = [0.0, 2.0]\nstop_at = "once"\n'
        base = HarmonicBase(1e-3, 2.0, stop=3.0, direction=(0.0, 1.0), stop_at="once")
        assert arguments(file(BEAM, SIMULATION, text))["base"] == base

    @pytest.mark.parametrize("head", ["[damping]", "[[damping]]"])
    @pytest.mark.parametrize(
        ("text", "law"),
        [
            ('law = "rayleigh"\nalpha = 0.2\nbeta = 1e-5\n', RayleighDamping(0.2, 1e-5)),
            ('law = "rayleigh"\nbeta = 1e-5\nstiffness = "tangent"\n', RayleighDamping(0.0, 1e-5, stiffness="tangent")),
            ('law = "quadratic"\neta1 = 0.15\neta2 = 0.11\n', QuadraticDamping(0.15, 0.11)),
            ('law = "friction"\neta0 = 0.05\n', FrictionDamping(0.05)),
            ('law = "friction"\neta0 = 0.05\nsmoothing_speed = 1e-4\n', FrictionDamping(0.05, 1e-4)),
        ],
    )
    def test_one_law(self, file, head, text, law):
        assert arguments(file(BEAM, SIMULATION, head, "\n", text))["damping"] == law

    def test_modal_law(self, file):
        text = '[damping]\nlaw = "modal"\nratios = [0.01, 0.02]\nfrequencies = [1.8, 10]\n'
        law = arguments(file(BEAM, SIMULATION, text))["damping"]
        assert isinstance(law, ModalDamping)
        assert (law.ratios, law.frequencies) == ((0.01, 0.02), (1.8, 10.0))
        assert law.modes.frequencies == pytest.approx(natural_modes(Model(beam()), count=2).frequencies)

    def test_several_laws_add_up(self, file):
        modal = '[[damping]]\nlaw = "modal"\nratios = [0.01]\n'
        quadratic = '[[damping]]\nlaw = "quadratic"\neta2 = 0.11\n'
        modes = natural_modes(Model(beam()), count=1)
        both, first, second = (
            arguments(file(BEAM, SIMULATION, text))["damping"].damping_ratios(modes, np.array([0.05]))
            for text in (modal + quadratic, modal, quadratic)
        )
        assert first == pytest.approx([0.01])
        assert second > 1e-3
        assert both == pytest.approx(first + second)

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("[damping]\neta2 = 0.1\n", r"\[damping\]: the key 'law' is missing; it is one of rayleigh, quadratic,"),
            ("[damping]\nlaw = 'air'\n", r"\[damping\]: law: must be one of rayleigh, quadratic,"),
            ("[damping]\nlaw = 'modal'\nratios = []\n", r"\[damping\]: ratios: must be a list of 1 or more, got \[\]"),
            ("[damping]\nlaw = 'modal'\nratios = [1.0]\n", r"\[damping\]: ratios: 1: must be at least 0 and below 1"),
            (f"[damping]\nlaw = 'modal'\nratios = {[0.01] * 17}\n", r"\[damping\]: ratios: has 17 values for 16 modes"),
            ("[damping]\nlaw = 'modal'\nratios = [0.01]\nfrequencies = [1, 2]\n", r"frequencies: has 2 values for 1"),
            ("sample_rate = -1\n", r"\[simulation\]: sample_rate: must be positive"),
            ("length = 0.4\n", r"\[simulation\]: unknown key 'length'; known are duration"),
            ('start = "running"\n', r"\[simulation\]: start: must be one of"),
            ("[base]\namplitude = 1e-3\n", r"\[base\]: the key 'frequency' is missing"),
        ],
    )
    def test_unusable(self, file, text, message):
        with pytest.raises(InputError, match=message):
            arguments(file(BEAM, SIMULATION, text))

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("damping = 3\n", "must be a table .damping., or several"),
            ("damping = [3]\n", r"\[damping\]: must be a table, got 3"),
            ("base = 3\n", r"\[base\]: must be a table, got 3"),
        ],
    )
    def test_tables_that_are_none(self, file, text, message):
        with pytest.raises(InputError, match=message):
            arguments(file(text, BEAM, SIMULATION))

    def test_without_settings(self, file):
        with pytest.raises(InputError, match=r"\[simulation\]: the table is missing"):
            arguments(file(BEAM))


@pytest.mark.parametrize(
    ("values", "kind"),
    [("1, 2", "sequence of numbers"), (None, "sequence of numbers"), ([1.0, float("nan")], "finite number"),
     ([1.0, True], "finite number")],
)  # fmt: skip
def test_numbers_are_finite_numbers_of_a_sequence(values, kind):
    with pytest.raises(InputError, match=f"here: must be a {kind}"):
        numbers(values, "here")


@pytest.mark.parametrize("name", ["beam.toml", "study.toml"])
def test_examples_can_be_read(name):
    path = str(Path(__file__).parents[3] / "examples" / name)
    assert read_beam(path).model.beam.elements == 20
    if name == "beam.toml":
        assert read_match(path)[1]["targets"] == [1.85, 10.19, 26.84, 53.20, 88.60]
    else:
        assert arguments(path)["sample_rate"] == 500.0


def test_a_quadratic_law_may_be_given_by_its_drag_coefficient(tmp_path):
    """Cd = 2 rho h eta2 (1183/876)/rho_air: 0.99 for the beam of the paper with eta2 = 0.11 1/m."""
    path = tmp_path / "air.toml"
    beam = "length = 0.5\nwidth = 5e-3\nthickness = 0.5e-3\ndensity = 8000.0\nelastic_modulus = 210e9\nelements = 4\n"
    law = '[[damping]]\nlaw = "quadratic"\ndrag_coefficient = 0.99\n'
    path.write_text(f"[beam]\n{beam}{law}air_density = 1.2\n")
    assert read_damped_beam(str(path)).damping.eta2 == pytest.approx(0.11, rel=1e-3)
    path.write_text(f"[beam]\n{beam}{law}air_density = 1.2\neta2 = 0.1\n")
    with pytest.raises(InputError, match="eta2"):
        read_damped_beam(str(path))
    path.write_text(f"[beam]\n{beam}{law}")
    with pytest.raises(InputError, match="air_density"):
        read_damped_beam(str(path))
