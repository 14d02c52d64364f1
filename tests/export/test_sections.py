"""Exports of beams with other sections than rectangles: what a reader of each file gets back."""

import ast
import json
import math
import runpy
import sys
from unittest.mock import MagicMock

import jsonschema
import numpy as np
import pytest

from ancf_casadi import Beam, InputError, Model, QuadraticDamping, RayleighDamping, Section
from ancf_casadi.export import (
    Document,
    beam_functions,
    load_functions,
    read_document,
    save_functions,
    schema,
    values,
    write_document,
    write_exudyn,
    write_mujoco,
    write_newton,
    write_pyelastica,
)

D, BORE = 6e-3, 0.5
LAW = RayleighDamping(alpha=0.2, beta=1e-4)
SECTIONS = {
    "rod": (Section.circle(D), 2e9 * math.pi * D**4 / 64, 1200 * math.pi * D**2 / 4),
    "tube": (
        Section.tube(outer=D, inner=BORE * D),
        2e9 * math.pi * D**4 * (1 - BORE**4) / 64,
        1200 * math.pi * D**2 * (1 - BORE**2) / 4,
    ),
    "cable": (Section.stiffness(bending=0.02, axial=4e4, mass_per_length=0.05, depth=4e-3), 0.02, 0.05),
}
cases = pytest.mark.parametrize(("section", "bending", "line_mass"), SECTIONS.values(), ids=SECTIONS)


def model_of(section, elements=4):
    """Return a level model of 0.4 m without gravity."""
    material = {} if section.elastic_modulus else {"density": 1200.0, "elastic_modulus": 2e9}
    return Model(Beam.uniform(length=0.4, section=section, elements=elements, axis=(1.0, 0.0), gravity=(0.0, 0.0),
                              **material))  # fmt: skip


def first_frequency(bending, line_mass):
    """Return the first frequency of the cantilever, Hz."""
    return 1.8751040687**2 * math.sqrt(bending / line_mass) / 0.4**2 / (2 * math.pi)


def constant(path, name):
    """Return the array that a script binds to a name at its beginning."""
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == name:
            return np.array(ast.literal_eval(node.value.args[0]))
    raise AssertionError(f"{name} is missing")


@cases
def test_a_document_keeps_the_sections_to_the_last_bit(tmp_path, section, bending, line_mass):
    document = Document(model_of(section), LAW, [])
    write_document(tmp_path / "beam.json", document)
    again = read_document(tmp_path / "beam.json")
    assert again.model == document.model and again.model.beam.sections == (section,) * 4
    jsonschema.validate(json.loads((tmp_path / "beam.json").read_text()), schema())
    assert "section_shape" not in Document(model_of(Section(D, D)), LAW, []).to_dict()["beam"]


def test_a_document_written_by_hand_may_state_sections(tmp_path):
    path, model = tmp_path / "beam.json", model_of(Section.circle(D))
    write_document(path, Document(model, None, []))
    data = json.loads(path.read_text())
    for name in ("width", "thickness", "section_shape"):
        del data["beam"][name]
    data["beam"]["section"] = {"kind": "circle", "diameter": D}
    path.write_text(json.dumps(data))
    assert read_document(path).model == model
    data["beam"]["section_shape"] = [{"kind": "rectangle"}] * 4
    path.write_text(json.dumps(data))
    with pytest.raises(InputError, match="section_shape: follows from the section; give one or the other"):
        read_document(path)


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ({"kind": "hexagon"}, r"section_shape\[0\]\.kind"),
        ({"kind": "round", "bore": 1.0}, r"section_shape\[0\]\.bore: must be at least 0 and below 1"),
        ({"kind": "stiffness", "depth": -1.0}, r"section_shape\[0\]\.depth: must be positive"),
        ({"kind": "round", "bore": 0.9}, "width, thickness: the section of element 1 is round"),
    ],
)
def test_a_damaged_section_in_a_document_is_refused_in_one_line(tmp_path, shape, message):
    path = tmp_path / "beam.json"
    write_document(path, Document(model_of(Section.circle(D)), None, []))
    data = json.loads(path.read_text())
    data["beam"]["section_shape"][0] = shape
    path.write_text(json.dumps(data))
    with pytest.raises(InputError, match=message) as caught:
        read_document(path)
    assert "\n" not in str(caught.value)


@cases
def test_functions_and_the_fmu_keep_the_section(tmp_path, section, bending, line_mass):
    functions = beam_functions(model_of(section), LAW, modes=1)
    save_functions(functions, tmp_path / "beam.casadi")
    exact = first_frequency(bending, line_mass)
    for exported in (functions, load_functions(tmp_path / "beam.casadi")):
        assert float(exported.frequencies(values(exported.parameters))) == pytest.approx(exact, rel=1e-4)
    assert functions.parameters[2].description == "width of the equivalent rectangle of element 1"


@cases
def test_exudyn_gets_the_stiffnesses(tmp_path, section, bending, line_mass):
    write_exudyn(model_of(section), tmp_path / "beam.py", damping=LAW)
    np.testing.assert_allclose(constant(tmp_path / "beam.py", "BENDING"), bending, rtol=1e-9)
    np.testing.assert_allclose(constant(tmp_path / "beam.py", "DENSITY"), line_mass, rtol=1e-9)
    if section.elastic_modulus:
        np.testing.assert_allclose(constant(tmp_path / "beam.py", "AXIAL"), 4e4, rtol=1e-9)


@cases
def test_mujoco_gets_cylinders_of_the_inertia_of_the_section(tmp_path, section, bending, line_mass):
    mujoco = pytest.importorskip("mujoco")
    model = model_of(section, 16)
    drag = QuadraticDamping.from_drag(1.2, 1.2, model.beam)
    found = write_mujoco(model, tmp_path / "beam.xml", damping=drag)
    there = mujoco.MjModel.from_xml_path(str(tmp_path / "beam.xml"))
    assert there.body_mass.sum() == pytest.approx(0.4 * line_mass, rel=1e-9)
    assert found.reached_frequencies[0] == pytest.approx(first_frequency(bending, line_mass), rel=0.01)
    assert found.reached_damping_ratios[0] == pytest.approx(found.damping_ratios[0], rel=0.02)  # with its drag
    kinds = {int(kind) for kind in there.geom_type}
    if section.elastic_modulus:
        assert kinds == {int(mujoco.mjtGeom.mjGEOM_BOX)}
        return
    assert kinds == {int(mujoco.mjtGeom.mjGEOM_CYLINDER)}
    np.testing.assert_allclose(there.geom_size[:, 0], D / 2, rtol=1e-9)
    np.testing.assert_allclose(there.geom_size[:, 1], there.body_pos[2, 0] / 2, rtol=1e-9)
    about_axis = there.body_mass[1:] * D**2 * (1 + section.shape.bore**2) / 8
    np.testing.assert_allclose(np.sort(there.body_inertia[1:])[:, 0], about_axis, rtol=1e-6)


def test_newton_gets_cylinders_along_the_links(tmp_path, monkeypatch):
    sections = [Section.circle(D)] * 2 + [Section(D, D)] * 2
    for module in ("newton", "warp"):
        monkeypatch.setitem(sys.modules, module, MagicMock())
    for section, cylinders, boxes in ((sections[0], 12, 0), (sections, 6, 6), (Section(D, D), 0, 12)):
        beam = model_of(Section.circle(D)).beam.with_(section=section)
        write_newton(Model(beam), tmp_path / "beam.py", segments=12)
        there = runpy.run_path(str(tmp_path / "beam.py"))
        builder = there["newton"].ModelBuilder.return_value
        builder.reset_mock()
        there["build"]()
        assert (builder.add_shape_cylinder.call_count, builder.add_shape_box.call_count) == (cylinders, boxes)
        for call in builder.add_shape_cylinder.call_args_list:
            assert call.kwargs["radius"] == pytest.approx(D / 2, rel=1e-9)
            assert call.kwargs["half_height"] == pytest.approx(0.4 / 24, rel=1e-9)


def test_pyelastica_gets_the_radius(tmp_path):
    write_pyelastica(model_of(Section.tube(D, 2e-3)), tmp_path / "beam.py", segments=10)
    np.testing.assert_allclose(constant(tmp_path / "beam.py", "RADII"), np.full(10, D / 2), rtol=1e-9)
    write_pyelastica(model_of(Section(D, D)), tmp_path / "beam.py", segments=10)
    assert "RADII" not in (tmp_path / "beam.py").read_text()
