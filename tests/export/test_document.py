"""The JSON document: lossless round trips, and one-line refusals of damaged documents."""

import copy
import json
import math
import os
import re
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import casadi as cs
import jsonschema
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ancf_casadi import (
    Beam,
    Clamp,
    DampingLaw,
    Dashpot,
    FrictionDamping,
    Guide,
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
    StrainMeasures,
    natural_modes,
    static_equilibrium,
)
from ancf_casadi.damping import SumOfLaws
from ancf_casadi.export import DataFile, Document, Identification, Provenance, read_document, schema, write_document
from ancf_casadi.support.files import MAX_BYTES, MAX_LEVELS
from problems import fit_decay

WRITTEN = "2025-01-31T12:00:00Z"
FIT = {"kind": "decay", "estimates": []}
VERSION_1 = """
{"format": "ancf-casadi", "schema": 1, "beam": {"length": 0.5, "width": [0.005, 0.005], "thickness": [0.0005, 0.0005],
"density": [8000.0, 8000.0], "elastic_modulus": [210000000000.0, 210000000000.0], "axis": [0.0, -1.0], "gravity":
[0.0, -9.81], "natural_curvature": [0.2, -0.1], "supports": [{"kind": "clamp", "point": 0.0, "stiffness": null,
"displacement": [0.0, 0.0], "rotation": 0.0}, {"kind": "roller", "point": 0.25, "direction": [0.6, 0.8],
"displacement": [0.0, 0.001]}], "attachments": [{"kind": "mass", "point": 0.5, "mass": 0.001, "rotary_inertia":
0.0}]}, "strain_measures": {"axial": "engineering", "curvature": "material", "axial_points": 2, "bending_points": 2},
"damping": {"law": "sum", "laws": [{"law": "rayleigh", "alpha": 0.14285714285714285, "beta": 0.0, "stiffness":
"strain-rate"}, {"law": "modal", "ratios": [0.01], "frequencies": [1.9], "modes": {"frequencies":
[2.1734449664191433], "shapes": [[0.0, 0.0, 0.0, 0.0, 6.225569520977857, -6.218566224497187e-26, 42.369740121363485,
2.2650766694875953e-25, 18.252840131698463, -3.4813145095477417e-25, 50.13581385331348, 5.212222737412323e-24]],
"equilibrium": {"coordinates": [0.0, 0.0, 0.0, -1.0, 0.0, -0.25000003503571433, 0.0, -0.9999999065714292, 0.0,
-0.5000000467142858, 0.0, -0.9999998131428591], "tip_force": [0.0, 0.0], "tip_moment": 0.0}, "beam": {"length": 0.5,
"width": [0.005, 0.005], "thickness": [0.0006, 0.0006], "density": [8000.0, 8000.0], "elastic_modulus":
[210000000000.0, 210000000000.0], "axis": [0.0, -1.0], "gravity": [0.0, -9.81], "natural_curvature": [], "supports":
[{"kind": "clamp", "point": 0.0, "stiffness": null, "displacement": [0.0, 0.0], "rotation": 0.0}], "attachments": []},
"strain_measures": {"axial": "engineering", "curvature": "material", "axial_points": 2, "bending_points": 2}}}]},
"identifications": [{"result": {"kind": "decay", "estimates": [], "drift_stderr_m_per_s": null}, "data": [{"name":
"decay.csv", "sha256": "0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f"}]}], "provenance":
{"written": "2025-01-31T12:00:00Z", "versions": {"ancf-casadi": "0.1.0"}, "note": "by an earlier release"}}
"""

positive = st.floats(min_value=1e-300, max_value=1e300)
sizes = st.floats(min_value=1e-10, max_value=1e10)  # of what masses and stiffnesses are products of
small = sizes.map(lambda size: size - 1.0) | st.just(-0.0)
finite = st.floats(allow_nan=False, allow_infinity=False)
coefficients = st.floats(min_value=0.0, max_value=1e300)
ratios = st.floats(min_value=0.0, max_value=1.0, exclude_max=True)


@st.composite
def beams(draw, elements=None):
    n = draw(st.integers(4, 6)) if elements is None else elements
    angle, length = draw(st.floats(-4.0, 4.0)), draw(sizes)
    return Beam(
        length=length,
        **{
            name: tuple(draw(st.lists(sizes, min_size=n, max_size=n)))
            for name in ("width", "thickness", "density", "elastic_modulus")
        },
        axis=(draw(positive) * np.cos(angle), draw(positive) * np.sin(angle)),
        gravity=(draw(finite), draw(finite)),
        natural_curvature=draw(st.sampled_from([(), tuple(draw(st.lists(small, min_size=n, max_size=n)))])),
        prestress=draw(st.sampled_from([(), tuple(draw(st.lists(small, min_size=n, max_size=n)))])),
        supports=draw(supports(length)),
        attachments=draw(attachments(length)),
    )


@st.composite
def supports(draw, length):
    """Draw none to four supports, each of another kind and at another point."""
    pairs, points = st.tuples(small, small), draw(st.permutations([0.0, 0.3 * length, length / 3, length]))
    across, rest = st.tuples(positive, small), {"displacement": pairs}
    kinds = (
        st.builds(Clamp, st.just(points[0]), sizes | st.just(math.inf), **rest, rotation=small),
        st.builds(Pin, st.just(points[1]), **rest),
        st.builds(Roller, st.just(points[2]), across, **rest),
        st.builds(Guide, st.just(points[3]), across, **rest, rotation=small),
    )
    return [draw(support) for support in kinds if draw(st.booleans())]


def attachments(length):
    """Draw any number of attachments, at two points between the ends at most."""
    points, pairs = st.sampled_from([0.0, 0.3 * length, length / 3, length]), st.tuples(sizes, sizes)
    return st.lists(
        st.builds(PointMass, points, sizes, sizes)
        | st.builds(Spring, points, pairs)
        | st.builds(RotationalSpring, points, sizes)
        | st.builds(Dashpot, points, pairs),
        max_size=5,
    )


@pytest.fixture(scope="module")
def identified(paper_beam):
    """A beam with every law; one modal law has the modes of another beam, one those of the loaded beam."""
    model = Model(paper_beam(2, axis=(0.3, -0.9)), StrainMeasures("green", "geometric", 2, 3))
    other = Model(paper_beam(2, thickness=0.54e-3))
    loaded = natural_modes(model, count=2, equilibrium=static_equilibrium(model, tip_force=(1e-3, 0), tip_moment=1e-4))
    law = (
        ModalDamping(natural_modes(other, count=2), (0.01, 0.02))
        + ModalDamping(loaded, (0.003,), frequencies=(1.9,))
        + QuadraticDamping(eta1=0.1 / 3, eta2=0.11)
        + RayleighDamping(alpha=1 / 7, beta=1e-5 / 3, stiffness="tangent")
        + FrictionDamping(eta0=0.1 / 7)
    )
    time = np.arange(0.0, 4.0, 0.01)
    noise = np.random.default_rng(3).standard_normal(time.size)
    fit = fit_decay(time, np.exp(-0.3 * time) * np.cos(12 * time) + 1e-3 * noise)
    identification = Identification(fit.to_dict(), [DataFile("decay.csv", "0123456789abcdef" * 4)])
    return Document(model, law, [identification], Provenance.of_this(written=WRITTEN, note="a note"))


@pytest.fixture
def written(identified, tmp_path) -> Path:
    path = tmp_path / "beam.json"
    write_document(path, identified)
    return path


def damping_force(document: Document) -> list[str]:
    """Return the damping force in a bent and moving state, in hexadecimal."""
    model = document.model
    e, e_t = cs.MX.sym("e", model.size), cs.MX.sym("e_t", model.size)
    force = cs.Function("force", [e, e_t], [document.damping.force(model, e, e_t)])
    draw = np.random.default_rng(8)
    state = model.straight + 0.01 * draw.standard_normal(model.size), draw.standard_normal(model.size)
    return [value.hex() for value in force(*state).full().ravel().tolist()]


def refused(tmp_path, text: str | bytes) -> str:
    path = tmp_path / "bad.json"
    path.write_bytes(text.encode("utf-8", "surrogatepass") if isinstance(text, str) else text)
    with pytest.raises(InputError) as caught:
        read_document(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    assert len(message) < 400 + len(str(path))
    return message.removeprefix(f"{path}: ")


class TestRoundTrip:
    @pytest.mark.slow
    @settings(max_examples=40, deadline=None)
    @given(beam=beams(), alpha=coefficients, beta=coefficients, eta1=coefficients, eta2=coefficients, data=st.data())
    def test_any_beam_and_law_survive_a_round_trip_to_the_last_bit(
        self, tmp_path_factory, beam, alpha, beta, eta1, eta2, data
    ):
        law = data.draw(
            st.sampled_from(
                [
                    None,
                    RayleighDamping(alpha, beta),
                    QuadraticDamping(eta1, eta2),
                    RayleighDamping(alpha, beta, stiffness="tangent") + QuadraticDamping(eta1, eta2),
                    FrictionDamping(eta1) + FrictionDamping(eta2, smoothing_speed=1e-4),
                    SumOfLaws((RayleighDamping(alpha), SumOfLaws((QuadraticDamping(eta1),)))),
                ]
            )
        )
        path = tmp_path_factory.mktemp("beam") / "beam.json"
        document = Document(Model(beam), law)
        write_document(path, document)
        found = read_document(path)
        assert found.model == document.model  # compares floats; -0.0 and 0.0 are told apart by the text
        assert found.damping == law
        assert found.to_dict() == document.to_dict()
        write_document(path.with_name("again.json"), found)
        assert path.with_name("again.json").read_bytes() == path.read_bytes()

    @pytest.mark.slow
    def test_frequencies_and_damping_force_are_the_same_in_another_process(self, identified, written):
        code = (
            "import sys; sys.path.insert(0, sys.argv[2]); from test_document import *\n"
            "found = read_document(sys.argv[1])\n"
            "frequencies = natural_modes(found.model, count=4).frequencies\n"
            "print(json.dumps([[f.hex() for f in frequencies.tolist()], damping_force(found)]))"
        )
        call = [sys.executable, "-c", code, str(written), str(Path(__file__).parent)]
        run = subprocess.run(call, capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2])
        frequencies, force = json.loads(run.stdout)
        assert frequencies == [f.hex() for f in natural_modes(identified.model, count=4).frequencies.tolist()]
        assert force == damping_force(identified)
        assert max(abs(float.fromhex(value)) for value in force) > 1.0

    def test_identifications_and_provenance_survive_a_round_trip(self, identified, written):
        found = read_document(written)
        assert found.identifications == identified.identifications
        assert found.provenance == identified.provenance
        [decay] = found.identifications
        assert decay.result["frequency_hz"] == pytest.approx(12 / (2 * np.pi), rel=1e-3)
        assert decay.result["frequency_stderr_hz"] > 0.0
        assert np.shape(decay.result["fit"]["covariance"]) == (len(decay.result["fit"]["unknowns"]),) * 2

    def test_infinite_numbers_of_a_result_become_null(self):
        result = {"estimates": np.array([1.5, np.inf]), "wide": (float("-inf"), np.float64(2.0)), "n": np.int64(3)}
        written = Identification.of({"kind": "beam", **result}).result
        assert written == {"kind": "beam", "estimates": [1.5, None], "wide": [None, 2.0], "n": 3}

    @pytest.mark.parametrize(("stiffness", "written"), [(math.inf, None), (2.5, 2.5)])
    def test_the_stiffness_of_a_rigid_clamp_is_null(self, paper_beam, tmp_path, stiffness, written):
        """No other number may be null, and values have their ranges; a beam without the key has a rigid clamp."""
        path = tmp_path / "beam.json"
        document = Document(Model(paper_beam(2, clamp_stiffness=stiffness)))
        write_document(path, document)
        data = json.loads(path.read_text())
        [clamp] = data["beam"]["supports"]
        assert clamp["stiffness"] == written
        assert read_document(path).model == document.model
        for key, wrong in (("point", None), ("stiffness", 0.0), ("stiffness", [None]), ("point", -1.0)):
            message = refused(
                tmp_path, json.dumps(data | {"beam": data["beam"] | {"supports": [clamp | {key: wrong}]}})
            )
            assert message.startswith(f"$.beam.supports[0].{key}: must ")
        del data["beam"]["supports"]
        path.write_text(json.dumps(data))
        assert read_document(path).model == Model(paper_beam(2))

    def test_a_document_of_an_earlier_release_is_read_and_written_unchanged(self, paper_beam, tmp_path):
        """Its modal law holds modes of another beam."""
        path = tmp_path / "beam.json"
        path.write_text(VERSION_1)
        found = read_document(path)
        supports = (Clamp(), Roller(0.25, (0.6, 0.8), displacement=(0.0, 1e-3)))
        assert found.model == Model(paper_beam(2, tip_mass=1e-3, supports=supports, natural_curvature=[0.2, -0.1]))
        rayleigh, modal = found.damping.laws
        assert rayleigh == RayleighDamping(alpha=1 / 7)
        assert modal.modes.model == Model(paper_beam(2, thickness=0.6e-3))
        assert (modal.ratios, modal.frequencies) == ((0.01,), (1.9,))
        assert found.identifications[0].result == {"kind": "decay", "estimates": [], "drift_stderr_m_per_s": None}
        assert found.provenance == Provenance(WRITTEN, {"ancf-casadi": "0.1.0"}, "by an earlier release")
        assert json.dumps(found.to_dict()) == json.dumps(json.loads(VERSION_1))

    @pytest.mark.parametrize(
        ("field", "table", "message"),
        [
            ("supports", {"point": 0.0}, "$.beam.supports[0]: the key 'kind' is missing; "),
            ("supports", {"kind": "pin", "point": 9.0}, "$.beam: supports: the point 9.0 m is not on the beam"),
            ("supports", {"kind": "guide", "point": 0, "direction": [0, 0]}, "$.beam: supports: 1: direction: must"),
        ],
    )
    def test_wrong_supports_and_attachments_are_refused(self, paper_beam, tmp_path, field, table, message):
        data = Document(Model(paper_beam(2))).to_dict()
        assert refused(tmp_path, json.dumps(data | {"beam": data["beam"] | {field: [table]}})).startswith(message)


class TestSchema:
    def test_it_is_valid_and_validates_a_written_document(self, written):
        jsonschema.Draft202012Validator.check_schema(schema())
        jsonschema.validate(json.loads(written.read_text()), schema(), jsonschema.Draft202012Validator)

    def test_it_has_every_field_of_a_beam(self):
        assert {field.name for field in fields(Beam)} <= schema()["$defs"]["BeamSpec"]["properties"].keys()
        measures = schema()["$defs"]["StrainMeasuresSpec"]["properties"]
        assert list(measures) == [field.name for field in fields(StrainMeasures)]

    @pytest.mark.slow
    def test_the_reader_refuses_what_the_schema_refuses(self, written, tmp_path):
        """Each value in turn is replaced, removed, or joined by an unknown key; the message names the place."""
        data = json.loads(written.read_text())
        data["identifications"][0]["result"] = {"kind": "decay", "estimates": []}
        validator = jsonschema.Draft202012Validator(schema())
        count = 0
        for path, changed in mutations(data):
            if validator.is_valid(changed):
                continue
            message = refused(tmp_path, json.dumps(changed))
            named = [key for key in path if isinstance(key, str)][-2:]
            assert any(key in message for key in [*named, "unknown key 'extra'"])
            count += 1
        assert count > 250


def mutations(data):
    """Yield the place of each change and the changed document; long lists are changed at their first entry."""
    wrong = [None, -1, "text", [1.0, "2"]]

    def walk(value, path):
        yield path
        if isinstance(value, dict):
            for key in value:
                yield from walk(value[key], (*path, key))
        elif isinstance(value, list) and value:
            ends = value if isinstance(value[0], dict) else value[:1]
            for index, item in enumerate(ends):
                yield from walk(item, (*path, index))

    for path in walk(data, ()):
        if not path or (path[:3] == ("identifications", 0, "result") and len(path) > 3):
            continue
        for value in wrong:
            yield path, edited(data, path, lambda parent, key, value=value: parent.__setitem__(key, value))
        yield path, edited(data, path, lambda parent, key: parent.pop(key))
        if isinstance(path[-1], str):
            yield path, edited(data, path, lambda parent, key: parent.update(extra=1))


def edited(data, path, change):
    found = copy.deepcopy(data)
    parent = found
    for key in path[:-1]:
        parent = parent[key]
    change(parent, path[-1])
    return found


class TestRefusals:
    @pytest.mark.parametrize(
        ("old", "new", "words"),
        [
            ('"format": "ancf-casadi"', '"format": "other"', "$.format: must be 'ancf-casadi'"),
            ('"schema": 1', '"schema": 2', "$.schema: must be 1"),
            ('"length": 0.5', '"length": NaN', "is not JSON (NaN"),
            ('"length": 0.5', '"length": 1e999', "$.beam.length: is beyond the range of numbers"),
            ('"length": 0.5', f'"length": 1{"0" * 5000}', "is not JSON"),
            ('"length": 0.5', '"length": "0.5"', "$.beam.length: must be a number, got '0.5'"),
            ('"length": 0.5', '"length": 0.5, "length": 0.5', "$.beam.length: the key appears twice"),
            ('"length": 0.5', '"length": 0.5, "colour": 1', "$.beam: unknown key 'colour'; known are "),
            ('"length": 0.5', '"length": -0.5', "$.beam.length: must be positive, got -0.5"),
            ('"length": 0.5', f'"length": 0.5, "{"k" * 300}": 1', "$.beam: has a key of 300 characters"),
            ('"law": "quadratic"', '"law": "cubic"', "$.damping.laws[2].law: must be one of rayleigh, quadratic"),
            ('"law": "quadratic"', f'"law": "{"c" * 500}"', "$.damping.laws[2].law: must be one of rayleigh"),
            ('"note": "a note"', '"note": "\\ud800"', "$.provenance.note: holds half a character"),
            ('"axial_points": 2', '"axial_points": 2.0', "$.strain_measures.axial_points: must be a whole number"),
            ('"2025-01-31T', '"2025-02-31T', "$.provenance: written: must be a time"),
        ],
    )
    def test_one_line_names_place_and_reason(self, written, tmp_path, old, new, words):
        text = written.read_text()
        assert old in text
        assert words in refused(tmp_path, text.replace(old, new, 1))

    def test_mode_shapes_of_wrong_size(self, written, tmp_path):
        data = json.loads(written.read_text())
        modes = ("damping", "laws", 1, "modes")
        short = edited(data, (*modes, "shapes", 0), lambda parent, key: parent[key].pop())
        assert refused(tmp_path, json.dumps(short)).startswith(
            "$.damping.laws[1].modes.shapes[0]: has 11 values for 12"
        )
        fewer = edited(data, (*modes, "shapes", 0), lambda parent, key: parent.pop(key))
        assert "has 1 shapes for 2 frequencies" in refused(tmp_path, json.dumps(fewer))

    def test_modes_of_another_mesh(self, paper_beam):
        law = ModalDamping(natural_modes(Model(paper_beam(3)), count=1), (0.01,)) + RayleighDamping(alpha=0.1)
        with pytest.raises(InputError, match="another number of elements"):
            Document(Model(paper_beam(4)), law)

    def test_files_that_are_not_json(self, tmp_path):
        assert refused(tmp_path, b"") == "is empty"
        assert refused(tmp_path, b" ").startswith("is not JSON")
        assert refused(tmp_path, b"\xff\xfe{}").startswith("is not JSON")
        assert refused(tmp_path, "[1, 2]") == "must hold a JSON object"
        assert refused(tmp_path, "{}").startswith("$.format: must be")
        deep = f'{{"a": {"[" * MAX_LEVELS}{"]" * MAX_LEVELS}}}'
        assert f"has more than {MAX_LEVELS} levels" in refused(tmp_path, deep)
        assert refused(tmp_path, '{"a": ' + "[" * 100_000) == f"has more than {MAX_LEVELS} levels"

    def test_a_file_that_is_too_large(self, tmp_path):
        path = tmp_path / "large.json"
        with open(path, "wb") as file:
            os.truncate(file.fileno(), MAX_BYTES + 1)
        with pytest.raises(InputError, match="larger than 64 MiB"):
            read_document(path)

    def test_a_law_of_another_package_cannot_be_written(self, paper_beam, tmp_path):
        class Other(DampingLaw):
            parameters = ()
            with_parameters = local_force = damping_ratios = None

        with pytest.raises(InputError, match="a Other cannot be written to a document"):
            write_document(tmp_path / "beam.json", Document(Model(paper_beam(4)), Other()))
        assert list(tmp_path.iterdir()) == []

    def test_objects_that_are_not_the_result_of_a_fit(self, tmp_path):
        endless: dict = {"kind": "beam", "estimates": 1}
        endless["self"] = endless
        for result, message in (
            ({"a": 1}, "is not the result of a fit"),
            ({"kind": "beam", "estimates": [1, object()]}, r"result.estimates\[1\]: must be numbers"),
            (endless, "levels"),
        ):
            with pytest.raises(InputError, match=message):
                Identification.of(result)
        with pytest.raises(InputError, match="cannot be read"):
            Identification.of({"kind": "beam", "estimates": []}, data=[tmp_path / "none.csv"])

    def test_the_hash_is_that_of_the_content(self, tmp_path):
        """SHA-256 of "abc": FIPS 180-4, example 1."""
        (tmp_path / "abc.csv").write_bytes(b"abc")
        expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
        assert DataFile.of(tmp_path / "abc.csv") == DataFile("abc.csv", expected)


class TestParts:
    """Parts that a document could not hold are refused."""

    @pytest.mark.parametrize(
        ("make", "message"),
        [
            (lambda: Identification(FIT | {"kind": 3}), "result.kind: must be a text, got 3"),
            (lambda: Identification(3), "result: is not the result of a fit"),
            (lambda: Identification(FIT | {1: 2}), "result: has a key that is no text"),
            (lambda: Identification(FIT | {"k" * 201: 2}), "result: has a key of 201 characters"),
            (lambda: Identification(FIT | {"a": 10**5000}), "result.a: is beyond the range of numbers"),
            (lambda: Identification(FIT, ["x.csv"]), "data: must be a DataFile"),
            (lambda: Identification(FIT | {"a": {1: 2}}), "result.a: must be a text, got 1"),
            (lambda: Identification(FIT | {"a": "\ud800"}), "result.a: holds half a character"),
            (lambda: DataFile("a", "A" * 64), "sha256: expected `str` matching regex"),
            (lambda: DataFile("a\udc80", "a" * 64), "name: holds half a character"),
            (lambda: Provenance("2025-02-31T12:00:00Z", {}), "written: must be a time such as"),
            (lambda: DataFile.of("."), ".: cannot be read (Is a directory)"),
            (lambda: Provenance(WRITTEN, {1: "2"}), "versions: has a key that is no text"),
            (lambda: Provenance(WRITTEN, {"casadi": 3.8}), "versions: casadi: must be a text, got 3.8"),
        ],
    )
    def test_unusable_arguments(self, make, message):
        with pytest.raises(InputError, match=f"^{re.escape(message)}"):
            make()

    def test_the_summary_of_a_fit_without_standard_errors_is_its_kind(self):
        assert Identification({"kind": "frequency matching", "estimates": None}).summary() == "frequency matching"
