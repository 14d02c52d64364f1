"""Beams in other simulators: the segments against closed forms, and the files against runs of the programs."""

import json
import math
import re
import runpy

import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    Clamp,
    InputError,
    ModalDamping,
    Model,
    Pin,
    PointMass,
    QuadraticDamping,
    RayleighDamping,
    Section,
    Spring,
    natural_modes,
    simulate,
    static_equilibrium,
)
from ancf_casadi.export import write_exudyn, write_mujoco, write_newton, write_pyelastica
from ancf_casadi.export.simulators.exudyn import CableMeasures
from ancf_casadi.export.simulators.segments import divide_beam, poles, step_matrix
from ancf_casadi.export.simulators.settings import damping_coefficients
from problems import fit_decay, fit_modes
from problems.cli import main

RAYLEIGH = RayleighDamping(alpha=0.15, beta=1e-4)


def test_segments_keep_mass_and_inertia(paper_beam):
    """A beam of varying thickness and a mass on it: mass, first and second moment about the clamp."""
    thickness = np.linspace(0.7e-3, 0.4e-3, 7).tolist()
    beam = paper_beam(7, thickness=thickness, attachments=[PointMass(0.31, 3e-3, 1e-7)])
    found = divide_beam(beam, 11)
    ends, nodes = np.arange(11) * found.length, beam.node_points
    density = 8000.0 * 5e-3 * np.array(thickness)
    for power in range(3):
        exact = density @ np.diff(nodes ** (power + 1)) / (power + 1)
        places = ends + found.centres
        own = found.masses @ places**power + (found.inertias.sum() if power == 2 else 0.0)
        assert own == pytest.approx(exact, rel=1e-12)
    ((segment, distance, _),) = found.point_masses
    assert segment * found.length + distance == pytest.approx(0.31)


def test_the_frequencies_of_segments_converge_to_those_of_a_cantilever(paper_beam, bending_stiffness):
    beam = paper_beam(gravity=(0.0, 0.0))
    unit = math.sqrt(bending_stiffness(beam) / (beam.mass / 0.5)) / 0.5**2
    exact = np.array([1.8751040687, 4.6940911330, 7.8547574382]) ** 2 * unit
    errors = [np.abs(divide_beam(beam, n).small_motion().modes(3)[0] / exact - 1.0).max() for n in (12, 24)]
    assert errors[0] < 7e-3  # 1.8e-2 with half a segment behind the clamp
    assert errors[1] < errors[0] / 3.5


@pytest.mark.parametrize("changes", [
    {"axis": (1.0, 0.0), "natural_curvature": 2.0, "tip_mass": 2e-3},
    {"axis": (1.0, 0.0), "clamp_stiffness": 0.2},
    {"axis": (1.0, 0.3), "supports": (Clamp(displacement=(0.01, 0.02), rotation=0.4),)},
    {"supports": (Pin(0.0),)},
])  # fmt: skip
def test_segments_rest_and_vibrate_like_the_beam(paper_beam, changes):
    model = Model(paper_beam(**changes))
    beam = divide_beam(model.beam, 40)
    small = beam.small_motion()
    angles = small.equilibrium
    tip = np.array(beam.origin) + beam.length * np.array([np.cos(angles).sum(), np.sin(angles).sum()])
    assert tip == pytest.approx(static_equilibrium(model).tip, abs=2e-4 * 0.5)
    assert small.modes(3)[0] / (2 * math.pi) == pytest.approx(natural_modes(model, count=3).frequencies, rel=1e-3)


def test_poles_of_a_step_are_those_of_the_closed_form():
    """One mass: z^2 (1 + h d) - z (2 + h d - h^2 k) + 1 = 0."""
    d, k, h = 0.3, 400.0, 1e-3
    f, ratio, stable = poles(step_matrix(*(np.array([[x]]) for x in (1.0, d, k)), h), h, 1)
    z = np.roots([1 + h * d, -(2 + h * d - h * h * k), 1])[0]
    s = np.log(z) / h
    assert stable and f[0] == pytest.approx(abs(s) / (2 * math.pi)) and ratio[0] == pytest.approx(-s.real / abs(s))
    assert ratio[0] == pytest.approx(d / 2 / math.sqrt(k), rel=1e-3)
    assert not poles(step_matrix(*(np.array([[x]]) for x in (1.0, d, k)), 0.11), 0.11, 1)[2]


def test_modal_damping_becomes_rates_that_meet_mode_1(hanging):
    modes = natural_modes(hanging, count=3)
    found = damping_coefficients([ModalDamping(modes, (0.01, 0.0028, 0.0028))], modes, 0.01)
    ratios = RayleighDamping(found.alpha, found.beta).damping_ratios(modes, [0.0] * 3)
    assert ratios[0] == pytest.approx(0.01, rel=1e-9)
    assert ratios[1:] == pytest.approx([0.0028, 0.0028], rel=0.12)
    assert "ModalDamping becomes alpha" in found.warnings[0]


SMALL = {"length": 2e-3, "width": 1e-4, "thickness": 5e-6, "density": 2e3, "elastic_modulus": 2e11, "elements": 10}


@pytest.mark.parametrize(
    ("changes", "options", "message"),
    [
        ({"supports": (Clamp(0.0), Clamp(0.5))}, {}, "^supports: must be one clamp or pin"),
        ({"attachments": (Spring(0.3, (0.0, 1.0)),)}, {}, "a Spring cannot be written"),
        ({}, {"damping": QuadraticDamping(eta1=0.1, flow=(1.0, 0.0))}, "a flow of air"),
        ({}, {"damping": RayleighDamping(beta=1e-4, stiffness="tangent")}, "the stiffness 'tangent'"),
        ({}, {"damping": RayleighDamping(beta=1.5e-2)}, "mode 3 has the damping ratio 1"),
        ({}, {"tolerance": 1e-9}, "tolerance: 64 segments only reach"),
        ({}, {"amplitude": 1e308}, "^amplitude: .* check the unit"),
        (SMALL, {}, "^model: is so small"),
    ],
)
def test_what_cannot_be_written_is_refused_in_one_line(paper_beam, tmp_path, changes, options, message):
    with pytest.raises(InputError, match=message):
        write_mujoco(Model(paper_beam(**{"elements": 4, **changes})), tmp_path / "beam.xml", **options)


def test_a_file_of_another_origin_is_not_overwritten(paper_beam, tmp_path):
    (tmp_path / "beam.xml").write_text("mine")
    with pytest.raises(InputError, match="already exists"):
        write_mujoco(Model(paper_beam(4)), tmp_path / "beam.xml")


def test_the_command_writes_a_beam_for_a_simulator_and_says_how_well_it_fits(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "beam.toml").write_text(
        "[beam]\nlength = 0.5\nwidth = 5e-3\nthickness = 0.5e-3\ndensity = 8000.0\nelastic_modulus = 210e9\n"
        'elements = 4\n\n[[damping]]\nlaw = "rayleigh"\nalpha = 0.2\n'
    )
    call = ["export", "beam.toml", "--format", "mujoco", "--out", "beam.xml"]
    assert main([*call, "--segments", "14"]) == 0
    assert "14 segments, steps of 0.0003 s" in capsys.readouterr().out
    assert main([*call, "--tolerance", "0.03", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["beam"]
    assert found["reached_frequencies_hz"] == pytest.approx(found["frequencies_hz"], rel=0.03)
    assert main([*call, "--markers", "0.2"]) == 2
    assert main(["export", "beam.toml", "--format", "json", "--out", "beam.json", "--segments", "9"]) == 2


@pytest.mark.slow
@pytest.mark.parametrize("case", ["hanging", "bent", "drag"])
def test_mujoco_decays_like_the_beam(paper_beam, tmp_path, case):
    """Steps of the program: their poles, and the decay that ``fit_decay`` finds."""
    mujoco = pytest.importorskip("mujoco")
    changes, law, decay = {
        "hanging": ({}, RAYLEIGH, "linear"),
        "bent": ({"axis": (1.0, 0.0), "natural_curvature": 2.0, "tip_mass": 2e-3}, RAYLEIGH, "linear"),
        "drag": ({}, QuadraticDamping(eta1=0.1, eta2=0.2), "quadratic"),
    }[case]
    model = Model(paper_beam(**changes))
    found = write_mujoco(model, tmp_path / "beam.xml", damping=law)
    there = mujoco.MjModel.from_xml_path(str(tmp_path / "beam.xml"))
    data = mujoco.MjData(there)
    mujoco.mj_resetDataKeyframe(there, data, 0)
    mujoco.mj_forward(there, data)
    rest, size = data.sensor("tip").data.copy(), 2 * there.nv
    assert rest[[0, 2]] == pytest.approx(static_equilibrium(model).tip, abs=5e-4)
    step = np.zeros((size, size))
    mujoco.mjd_transitionFD(there, data, 1e-6, True, step, None, None, None)
    frequencies, ratios, _ = poles(step, found.step, 3)
    assert frequencies == pytest.approx(found.frequencies, rel=0.01)
    assert frequencies == pytest.approx(found.reached_frequencies, rel=1e-4)
    if case != "drag":  # without drag at rest
        assert ratios == pytest.approx(found.reached_damping_ratios, rel=1e-3)
    mujoco.mj_resetDataKeyframe(there, data, 1)
    samples = []
    for _ in range(round(12 / found.frequencies[0] / found.step)):
        mujoco.mj_step(there, data)
        samples.append(data.sensor("tip").data - rest)
    x = (np.array(samples) @ np.linalg.svd(samples[::20], full_matrices=False)[2][0])[::20]
    fit = fit_decay(20 * found.step * np.arange(len(x)), x, law=decay)
    assert fit.frequency == pytest.approx(found.frequencies[0], rel=0.01)
    if case == "drag":
        assert fit.estimates["eta2"] == pytest.approx(0.2, rel=0.03)
        assert fit.estimates["eta1"] == pytest.approx(0.1, rel=0.03)
    else:
        assert fit.damping_ratio == pytest.approx(found.damping_ratios[0], rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("amplitude", [0.01, 0.1])
def test_quadratic_drag_in_mujoco_is_that_of_the_beam(paper_beam, tmp_path, amplitude):
    """The decays of MuJoCo and of ``simulate`` have the same coefficients to 1 %, with a tip amplitude to 20 % of L."""
    mujoco = pytest.importorskip("mujoco")
    model, law = Model(paper_beam()), QuadraticDamping(eta1=0.1, eta2=0.2)
    found = write_mujoco(model, tmp_path / "beam.xml", damping=law, amplitude=amplitude)
    assert found.reached_damping_ratios == pytest.approx(found.damping_ratios, rel=0.05)
    there = mujoco.MjModel.from_xml_path(str(tmp_path / "beam.xml"))
    data, motion = mujoco.MjData(there), []
    mujoco.mj_resetDataKeyframe(there, data, 1)
    duration = 8 / found.frequencies[0]
    for _ in range(round(duration / found.step)):
        mujoco.mj_step(there, data)
        motion.append(data.sensor("tip").data[0])
    in_mujoco = fit_decay(found.step * np.arange(1, 1 + len(motion))[::10], motion[::10], law="quadratic")
    start = natural_modes(model, count=1).state(1, amplitude)
    run = simulate(model, damping=law, start=start, duration=duration, sample_rate=200.0)
    here = fit_decay(run.time, run.tip[:, 0], law="quadratic")
    for name in ("eta1", "eta2"):
        assert in_mujoco.estimates[name] == pytest.approx(here.estimates[name], rel=0.01)
    assert in_mujoco.estimates["eta2"] == pytest.approx(0.2, rel=0.05)


def along(motion, rest):
    """Return the component of a motion of the tip in its own direction."""
    motion = motion - rest
    return motion @ np.linalg.svd(motion, full_matrices=False)[2][0]


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize(("program", "write"), [("elastica", write_pyelastica), ("newton", write_newton)])
def test_a_script_at_the_advised_settings_vibrates_and_decays_like_the_beam(paper_beam, tmp_path, program, write):
    """A release in three modes: their frequencies, and the damping ratio of the first."""
    pytest.importorskip(program)
    model = Model(paper_beam(axis=(1.0, 0.0), natural_curvature=2.0, tip_mass=2e-3))
    law = RayleighDamping(alpha=0.02, beta=4e-4) + QuadraticDamping(eta1=0.02)
    found = write(model, tmp_path / "beam.py", damping=law)
    there = runpy.run_path(str(tmp_path / "beam.py"))
    rest = there["run"](0.0, (0.0, 0.0, 0.0))[0, 1:]
    assert rest == pytest.approx(static_equilibrium(model).tip, abs=1e-3)
    time, *motion = there["run"](5 / found.frequencies[0], (2e-3, 6e-4, 2e-4), every=20).T
    fits = fit_modes(time, along(np.array(motion).T, rest), modes=3).fits
    frequencies = [fit.frequency for fit in fits]
    assert frequencies == pytest.approx(found.frequencies, rel=0.01)
    assert frequencies == pytest.approx(found.reached_frequencies, rel=2e-3)
    assert fits[0].damping_ratio == pytest.approx(found.damping_ratios[0], rel=0.03)
    assert fits[0].damping_ratio == pytest.approx(found.reached_damping_ratios[0], rel=5e-3)


CABLE = {"axis": (1.0, 0.0), "natural_curvature": 1.0}


def test_a_curve_for_newton_is_the_chain_of_the_report(paper_beam, tmp_path, bending_stiffness):
    """Equal segments, the clamp in the middle of the first; mass, stiffness, and the ratio with that of the steps."""
    model = Model(paper_beam(**CABLE))
    found = write_newton(model, tmp_path / "cable.usda", damping=RayleighDamping(beta=2e-3))
    text = (tmp_path / "cable.usda").read_text()
    assert text.startswith("#usda 1.0\n")

    def values(name):
        return np.array([float(x) for x in re.findall(r"[-+.\de]+", re.search(rf" {name} = (.*)", text)[1])])

    points, unloaded = (values(name).reshape(-1, 3)[:, [0, 2]] for name in ("points", "physics:restShapePoints"))
    length = 0.5 / (found.segments + 0.5)
    for ends in (points, unloaded):
        assert len(ends) == found.segments + 2 and ends[:2] == pytest.approx(length * np.array([[-0.5, 0], [0.5, 0]]))
        assert np.linalg.norm(np.diff(ends, axis=0), axis=1) == pytest.approx(length, rel=1e-6)
    assert points[-1] == pytest.approx(static_equilibrium(model).tip, abs=1e-3)
    turns = np.diff(np.unwrap(np.arctan2(*np.diff(unloaded, axis=0).T[::-1])))
    assert turns == pytest.approx(length * 1.0, rel=1e-6)
    area = math.pi * values("physics:thicknesses") ** 2 / 4
    assert values("physics:density") * area * 0.5 == pytest.approx(model.beam.mass)
    bending = bending_stiffness(model.beam)
    assert values("float physics:curvesBendStiffness") == pytest.approx(bending)
    by_steps = math.pi * found.frequencies[0] * found.step
    assert found.reached_damping_ratios[0] == pytest.approx(found.damping_ratios[0], rel=0.01)
    of_curve = values("float newton:curvesBendDamping") / bending * math.pi * found.frequencies[0]
    assert of_curve + by_steps == pytest.approx(found.damping_ratios[0], rel=0.02)
    assert found.reached_frequencies == pytest.approx(found.frequencies, rel=0.01)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tip_mass": 1e-3}, "rigid clamp and without attachments"),
        ({"clamp_stiffness": 0.2}, "rigid clamp"),
        ({"supports": (Pin(0.0),)}, "rigid clamp"),
        ({"width": [5e-3, 5e-3, 4e-3, 4e-3]}, "same section"),
        ({"rotary_sections": True}, "no rotary inertia"),
    ],
)
def test_beams_that_are_no_curve_are_refused(paper_beam, tmp_path, changes, message):
    with pytest.raises(InputError, match=message):
        write_newton(Model(paper_beam(elements=4, **changes)), tmp_path / "cable.usda")


def test_a_curve_whose_damping_and_steps_stop_the_oscillation_is_refused(paper_beam, tmp_path):
    with pytest.raises(InputError, match=r"damping: .*does not oscillate with steps of"):
        write_newton(Model(paper_beam(elements=4)), tmp_path / "cable.usda", damping=RayleighDamping(alpha=8.0))
    assert not any(tmp_path.iterdir())


def test_segments_of_a_thin_curve_keep_the_inertia_that_newton_would_correct(tmp_path):
    """Newton adds 1e-6 kg m^2 to a segment whose inertia m d^2/8 about its axis is below 1e-10 kg m^2."""
    beam = Beam.uniform(length=0.3, section=Section.circle(0.5e-3), density=1500.0, elastic_modulus=2e9, elements=6)
    found = write_newton(Model(beam), tmp_path / "cable.usda")
    diameter = float(re.search(r"thicknesses = \[(.*)\]", (tmp_path / "cable.usda").read_text())[1])
    assert beam.mass / (found.segments + 0.5) * diameter**2 / 8 > 1e-10


def test_the_usd_library_reads_the_curve_and_its_material(paper_beam, tmp_path, bending_stiffness):
    pytest.importorskip("pxr")
    from pxr import Usd, UsdGeom, UsdShade

    model = Model(paper_beam(**CABLE))
    found = write_newton(model, tmp_path / "cable.usda", damping=RayleighDamping(beta=2e-3))

    stage = Usd.Stage.CreateInMemory()  # as IsaacLab does
    stage.DefinePrim("/World/Cable").GetReferences().AddReference(str(tmp_path / "cable.usda"))
    curve = stage.GetPrimAtPath("/World/Cable/Curve")
    assert "PhysicsCurvesDeformableSimAPI" in curve.GetPrimTypeInfo().GetAppliedAPISchemas()
    points = UsdGeom.BasisCurves(curve).GetPointsAttr().Get()
    assert list(UsdGeom.BasisCurves(curve).GetCurveVertexCountsAttr().Get()) == [len(points)] == [found.segments + 2]
    material, _ = UsdShade.MaterialBindingAPI(curve).ComputeBoundMaterial("physics")
    assert material.GetPath() == "/World/Cable/Material"
    schemas = material.GetPrim().GetPrimTypeInfo().GetAppliedAPISchemas()
    assert {"PhysicsCurvesDeformableMaterialAPI", "NewtonCurvesDeformableMaterialAPI"} <= set(schemas)
    stiffness = material.GetPrim().GetAttribute("physics:curvesBendStiffness").Get()
    assert stiffness == pytest.approx(bending_stiffness(model.beam), rel=1e-6)
    assert material.GetPrim().GetAttribute("newton:curvesBendDamping").Get() > 1e-3 * stiffness
    clamp = stage.GetPrimAtPath("/World/Cable/Clamp")
    assert clamp.GetRelationship("physics:src0").GetTargets() == [curve.GetPath()]
    assert UsdGeom.GetStageMetersPerUnit(Usd.Stage.Open(str(tmp_path / "cable.usda"))) == 1.0


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_a_curve_swings_in_newton_as_the_report_says(paper_beam, tmp_path):
    newton = pytest.importorskip("newton")
    pytest.importorskip("pxr")
    model = Model(paper_beam())  # hanging
    found = write_newton(model, tmp_path / "cable.usda", damping=RayleighDamping(beta=2e-3))
    builder = newton.ModelBuilder()
    builder.add_usd(str(tmp_path / "cable.usda"))
    builder.color()
    cable = builder.finalize(device="cpu")
    assert cable.body_mass.numpy()[1:].sum() == pytest.approx(model.beam.mass / (1 + 0.5 / found.segments), rel=1e-5)
    solver = newton.solvers.SolverVBD(cable, iterations=20)
    state, after, control = cable.state(), cable.state(), cable.control()
    places = state.body_q.numpy()
    speeds, along = np.zeros((len(places), 6)), np.maximum(-places[:, 2] / 0.5, 0.0)
    speeds[:, 0], speeds[:, 4] = 0.1 * along**2 * (3 - along) / 2, -0.1 * (6 * along - 3 * along**2) / 2 / 0.5
    speeds[0] = 0.0
    state.body_qd.assign(speeds.astype(np.float32))
    samples = []
    for _ in range(round(3 / found.frequencies[0] / found.step)):
        state.clear_forces()
        solver.step(state, after, control, None, found.step)
        state, after = after, state
        samples.append(float(state.body_q.numpy()[-1, 0]))
    fit = fit_decay(found.step * np.arange(1, 1 + len(samples))[::20], np.array(samples)[::20])
    assert fit.frequency == pytest.approx(found.reached_frequencies[0], rel=3e-3)
    assert fit.damping_ratio == pytest.approx(found.damping_ratios[0], rel=0.03)


@pytest.mark.slow
def test_the_advised_rod_meets_the_tolerances(paper_beam, tmp_path):
    found = write_pyelastica(Model(paper_beam()), tmp_path / "beam.py", damping=RAYLEIGH)
    assert found.reached_frequencies == pytest.approx(found.frequencies, rel=0.01)
    assert found.reached_damping_ratios[0] == pytest.approx(found.damping_ratios[0], rel=0.03)


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("case", ["bent", "modal and drag"])
def test_exudyn_decays_like_the_beam(paper_beam, tmp_path, case):
    pytest.importorskip("exudyn")
    bent = case == "bent"
    changes = {"axis": (1.0, 0.0), "natural_curvature": 2.0, "tip_mass": 2e-3} if bent else {}
    model = Model(paper_beam(6, **changes))
    modes = natural_modes(model, count=3)
    law = RAYLEIGH if bent else ModalDamping(modes, (0.005, 0.0028, 0.0028)) + QuadraticDamping(eta2=0.2)
    found = write_exudyn(model, tmp_path / "beam.py", damping=law)
    there = runpy.run_path(str(tmp_path / "beam.py"))
    values = there["build"](0.0)[0].ComputeODE2Eigenvalues()[0]
    assert np.sqrt(np.sort(np.abs(values))[:3]) / (2 * math.pi) == pytest.approx(found.frequencies, rel=2e-3)
    time, *motion = there["run"](4 / found.frequencies[0], every=10).T
    x = along(np.array(motion).T, static_equilibrium(model).tip)
    fit = fit_decay(time, x, law="linear" if bent else "quadratic")
    assert fit.frequency == pytest.approx(found.frequencies[0], rel=1e-3)
    if bent:
        assert fit.damping_ratio == pytest.approx(found.damping_ratios[0], rel=2e-3)
    else:
        middle, eta1, eta2 = 0.95 * found.amplitude, fit.estimates["eta1"], fit.estimates["eta2"]
        ratio = eta1 / (4 * math.pi * fit.frequency) + 4 * eta2 * middle / (3 * math.pi)
        assert ratio == pytest.approx(law.damping_ratios(modes, [middle, 0.0, 0.0])[0], rel=0.01)


def test_a_prestressed_beam_with_a_free_end_is_as_short_in_exudyn(paper_beam, tmp_path):
    """200 MPa shorten the beam by 0.1 %, which raises its frequencies by 0.1 %."""
    pytest.importorskip("exudyn")
    model = Model(paper_beam(gravity=(0.0, 0.0), prestress=2e8))
    found = write_exudyn(model, tmp_path / "beam.py")
    system, tip, _ = runpy.run_path(str(tmp_path / "beam.py"))["build"](0.0)
    assert system.GetSensorValues(tip)[:2] == pytest.approx(static_equilibrium(model).tip, abs=1e-5)
    values = system.ComputeODE2Eigenvalues()[0]
    assert np.sqrt(np.sort(np.abs(values))[:3]) / (2 * math.pi) == pytest.approx(found.frequencies, rel=1e-4)


def test_the_error_of_a_stretching_mode_in_exudyn_is_reported(paper_beam, tmp_path):
    """The third mode of a thick beam stretches it; the closed form is that of a rod, (E/rho)^(1/2)/(4 L)."""
    pytest.importorskip("exudyn")
    model = Model(paper_beam(8, thickness=0.05))
    exported = write_exudyn(model, tmp_path / "beam.py")
    system, *_ = runpy.run_path(str(tmp_path / "beam.py"))["build"](0.0)
    frequencies = np.sqrt(np.sort(np.abs(system.ComputeODE2Eigenvalues()[0]))[:3]) / (2 * math.pi)
    cable_modes = natural_modes(Model(model.beam, CableMeasures()), count=3)
    assert cable_modes.frequencies == pytest.approx(frequencies, rel=1e-6)
    assert exported.reached_frequencies == pytest.approx(frequencies, rel=4e-3)
    assert exported.frequencies[2] == pytest.approx(math.sqrt(210e9 / 8000.0) / (4 * 0.5), rel=2e-3)
    assert exported.reached_frequencies[2] > 1.015 * exported.frequencies[2]


@pytest.mark.parametrize("tip_mass", [0.01, 0.03])
@pytest.mark.parametrize(
    ("write", "name"),
    [(write_mujoco, "beam.xml"), (write_newton, "beam.py"), (write_pyelastica, "beam.py")],
    ids=["mujoco", "newton", "pyelastica"],
)
def test_two_modal_ratios_are_both_met(tmp_path, write, name, tip_mass):
    """Two coefficients meet two ratios: a third mode, which has none, takes no part, nor the tip mass in MuJoCo."""
    beam = Beam.uniform(length=0.4, width=8e-3, thickness=8e-3, density=1900.0, elastic_modulus=60e6, elements=10,
                        axis=(1.0, 0.0), tip_mass=tip_mass)  # fmt: skip
    model = Model(beam)
    law = ModalDamping(natural_modes(model, count=2), (0.03, 0.02)) + QuadraticDamping(eta2=0.3)
    found = write(model, tmp_path / name, damping=law)
    assert found.reached_damping_ratios[:2] == pytest.approx(found.damping_ratios[:2], rel=0.01)
