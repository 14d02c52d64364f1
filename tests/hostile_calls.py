"""Calls of all public functions with valid arguments, of which one or two are replaced by hostile values."""

import importlib.util
import random
import signal
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from decimal import Decimal
from functools import cache
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import casadi as cs
import numpy as np

import ancf_casadi
import problems
from ancf_casadi import export
from ancf_casadi.response.harmonic_balance.system import SecondOrderSystem

SECONDS = 10.0  # of processor time that a call may take before it is interrupted as by Ctrl-C
GRACE = 2.0  # s of processor time that it may take to end then
PATIENCE = 8  # times as long by the clock, since other programs may use the machine too


class Refused(Exception):
    """The error of a caller's own function."""


def failing(*_, **__):
    raise Refused


def drawn_samples():
    """Stand-in for samples of a posterior distribution."""
    values = np.random.default_rng(0).standard_normal((2, 2, 50))
    columns = {name: SimpleNamespace(values=own, attrs={}) for name, own in zip("ab", values, strict=True)}
    return SimpleNamespace(posterior=SimpleNamespace(data_vars=columns))


def moving_dot(path):
    """Write a video of a dot, or a text where there is no OpenCV, and return its path."""
    if not importlib.util.find_spec("cv2"):
        path.write_text("no video")
        return path
    cv2 = importlib.import_module("cv2")
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 30.0, (96, 64), isColor=False)
    for k in range(12):
        writer.write(cv2.circle(np.full((64, 96), 200, np.uint8), (30 + k, 30), 5, 30, -1))
    writer.release()
    return path


class Other:
    """A class that takes any arguments."""

    def __init__(self, *_, **__):
        pass


HOSTILE = {
    "None": None, "True": True, "0": 0, "-1": -1, "1": 1, "2.5": 2.5, "nan": np.nan, "inf": np.inf, "-inf": -np.inf,
    "1e308": 1e308, "-1e308": -1e308, "1e-308": 1e-308, "1e9": 1e9, "10^30": 10**30, "10^400": 10**400, "1j": 1j,
    "empty text": "", "x": "x", "null": "\0", "long text": "x" * 100_000, "bytes": b"x", "list": [], "nested": [[]],
    "table": {}, "keys": {1: 2}, "set": {1}, "object": object(), "class": Other, "callable": failing,
    "pair": (1.0, 2.0), "pair of nan": (np.nan, 1.0), "pair of texts": ("a", "b"), "large pair": (1e308, -1e308),
    "pair of None": (None, None), "ragged": [[1.0], [1.0, 2.0]], "date": np.datetime64("2024-05-17"),
    "dates": np.arange("2024-05-01", "2024-05-11", dtype="M8[D]"), "NaT": np.datetime64("NaT"),
    "decimal": Decimal("1e400"), "no numbers": np.zeros(0), "one number": np.array(1.0), "row": np.zeros((1, 40)),
    "cube": np.zeros((2, 2, 2)), "nans": np.full(40, np.nan), "large": np.full(40, 1e308), "zeros": np.zeros(40),
    "complex": np.ones(40, complex), "objects": np.array([None, "a"], dtype=object), "words": np.array(["a"] * 40),
    "flags": np.ones(40, bool), "range": range(40), "iterator": iter(()), "numpy 1": np.float32(1.0),
    "whole": np.int8(-1), "base": ancf_casadi.HarmonicBase(1e-3, 2.0), "law": ancf_casadi.RayleighDamping(0.1),
    "sensor": ancf_casadi.Sensor(), "section": ancf_casadi.Section(1e-3, 1e-3), "path": Path("none.csv"),
    "folder": Path("."), "pair of large whole numbers": (10**30, 10**400),
}  # fmt: skip
NOT_CALLED = frozenset(
    "Attachment BaseMotion DampingLaw Support TipLoad __version__"  # abstract
    " Backbone Equilibrium LinearFrf Modes PeriodicMotion ReducedModel ReducedTrajectory ResponseCurve Trajectory"
    " DampingCurve LawCurve BeamFunctions MotionFunctions ReducedFunctions ExportedBeam DecayFit DecayFits DecayModes"
    " CriticalLoad CriticalPoint DampedModes EquilibriumPath FrequencyMatch FrfFit ModeFit AmplitudeFit"
    " IsolatedMode LawComparison LogDensity MonteCarlo Plan PlannedComparison RayleighFit RecordPrediction SavedFit"
    " StudyReport BeamFit"  # results, which the package makes
    " fit_transient".split()  # fit_beam
)


def public():
    """Names of the public functions and classes of the two packages."""
    names = {*ancf_casadi.__all__, *export.__all__, *problems.__all__} - NOT_CALLED
    own = {name: next(getattr(m, name) for m in (ancf_casadi, export, problems) if hasattr(m, name)) for name in names}
    return {n: o for n, o in own.items() if not (isinstance(o, type) and issubclass(o, Exception))}


@cache
def calls(folder: Path) -> dict[str, tuple[Callable, dict]]:
    """Valid calls by name: the function, and its arguments."""
    a, p = ancf_casadi, problems
    uniform = {
        "length": 0.5, "width": 5e-3, "thickness": 5e-4, "density": 8e3, "elastic_modulus": 2.1e11, "elements": 2,
    }  # fmt: skip
    beam = a.Beam.uniform(**uniform)
    model = a.Model(beam)
    rest = a.static_equilibrium(model)
    pulled = a.static_equilibrium(model, tip_force=(5e-3, 0.0))
    modes = a.natural_modes(model, count=2)
    f = float(modes.frequencies[0])
    law, base = a.ModalDamping(modes, (0.02, 0.01)), a.HarmonicBase(1e-3, f, stop=0.05)
    load, rayleigh = a.HarmonicLoad((0.01, 0.0), f), a.RayleighDamping(0.2)
    reduced = a.reduce_model(model, modes=1, damping=rayleigh)
    instants = np.arange(200) / (20 * f)
    values = 5e-3 * np.exp(-0.02 * 2 * np.pi * f * instants) * np.cos(2 * np.pi * f * instants)
    noise = 1e-5 * np.random.default_rng(1).standard_normal(200)
    record = a.Measurement(instants, values + noise)
    fit = p.fit_decay(record)
    fit.save(folder / "fit.json")
    columns = np.column_stack([instants, values])
    np.savetxt(folder / "a.csv", columns, delimiter=",", header="t (s),x (mm)", comments="")
    recording = a.read_recording(folder / "a.csv")
    sweep = np.column_stack([np.linspace(1.8, 2.0, 20), np.ones(20), np.linspace(1.0, 2.0, 20), np.linspace(0, -2, 20)])
    np.savetxt(folder / "sweep.csv", sweep, delimiter=",", header="f (Hz),F (N),x (mm),phase (rad)", comments="")
    np.savetxt(folder / "frf.csv", sweep[:, [0, 2, 3]], delimiter=",", header="f (Hz),x (m/N),phase (rad)", comments="")
    columns_read = {"column": 3, "frequency": 1, "phase": 4, "unit": "mm", "phase_unit": "rad"}
    level_read = columns_read | {"path": folder / "sweep.csv", "level": 2, "level_unit": "N", "sensor": None}
    (folder / "a.toml").write_text("[beam]\n" + "".join(f"{key} = {value}\n" for key, value in uniform.items()))
    (folder / "study.toml").write_text(
        '[[steps]]\nkind = "rayleigh"\nfrequencies = [1.85, 10.19]\nratios = [0.01, 0.0028]\n'
    )
    export.write_document(folder / "a.json", export.Document(model, rayleigh))
    functions = export.beam_functions(model, modes=1)
    export.save_functions(functions, folder / "a.casadi")
    q, v, acceleration, u, c = (cs.SX.sym(name) for name in ("q", "v", "a", "u", "c"))
    oscillator = {
        "q": q, "v": v, "a": acceleration, "u": u, "p": c, "conservative": acceleration + q, "damping": c * v,
        "excitation": u, "parameters": (a.Parameter("c", 0.1, "", ""),), "rest": [0.0], "scale": [1.0],
    }  # fmt: skip
    grid = np.linspace(0.8 * f, 1.2 * f, 40)
    hit_times = np.arange(400) / 100.0
    hit_force = np.where(np.abs(hit_times - 0.1) < 0.015, 1.0, 0.0)
    hit_response = np.exp(-hit_times) * np.sin(30.0 * hit_times)
    frf = (1 + 1e-3 * np.random.default_rng(1).standard_normal(40)) / (f**2 - grid**2 + 0.04j * f * grid)
    frequencies = tuple(modes.frequencies.tolist())
    markers = np.zeros((40, 1, 2)) + [0.0, -0.5] + np.outer(values[:40], [1.0, 0.0])[:, None, :]
    driven = a.simulate(model, duration=instants[39], damping=rayleigh, base=base, sample_rate=20 * f)
    motion_record = p.MotionRecord([a.Measurement(driven.time, driven.tip[:, 0])], base)
    point = a.PointLoad((0.01, 0.0))
    static = p.StaticRecord(model, [point], [1e-3], a.Sensor("displacement"))
    natural = p.FrequencyRecord(model, frequencies)
    steady = a.HarmonicBase(1e-4, f)
    curve = p.ResponseRecord(grid[::8], [1e-4] * 5, base=steady, sweep="up")
    damped = {"damping": law, "base": steady}
    time40, x40 = instants[:40], values[:40]
    found = {
        "Beam": (a.Beam, {
            "length": 0.5, "width": (5e-3,) * 2, "thickness": (5e-4,) * 2, "density": (8e3,) * 2,
            "elastic_modulus": (2e11,) * 2, "axis": (0.0, -1.0), "gravity": (0.0, -9.81),
            "natural_curvature": (0.1,) * 2, "prestress": (1e5,) * 2, "supports": (a.Clamp(),),
            "attachments": (a.PointMass(0.5, 1e-3),),
        }),
        "Clamp": (a.Clamp, {"point": 0.1, "stiffness": 1.0, "displacement": (0.0, 0.01), "rotation": 0.1}),
        "Pin": (a.Pin, {"point": 0.1, "displacement": (0.0, 0.01)}),
        "Roller": (a.Roller, {"point": 0.1, "direction": (1.0, 0.0), "displacement": (0.0, 0.01)}),
        "Guide": (a.Guide, {"point": 0.1, "direction": (1.0, 0.0), "displacement": (0.0, 0.0), "rotation": 0.1}),
        "PointMass": (a.PointMass, {"point": 0.1, "mass": 1e-3, "rotary_inertia": 1e-8}),
        "Spring": (a.Spring, {"point": 0.1, "stiffness": (1.0, 0.0)}),
        "RotationalSpring": (a.RotationalSpring, {"point": 0.1, "stiffness": 1.0}),
        "Dashpot": (a.Dashpot, {"point": 0.1, "coefficient": (0.1, 0.0)}),
        "LineLoad": (a.LineLoad, {"force": (0.0, 0.1), "begin": 0.1, "end": 0.4, "follower": True}),
        "damped_modes": (a.damped_modes, {"model": model, "damping": law, "count": 2, "equilibrium": rest}),
        "critical_load": (a.critical_load, {
            "model": model, "loads": [point], "damping": law, "largest_factor": 1.0, "steps": 2,
        }),
        "equilibrium_path": (a.equilibrium_path, {
            "model": model, "loads": [point], "largest_factor": 1.0, "most_steps": 5, "start": None, "side": 1,
        }),
        "Beam.uniform": (a.Beam.uniform, uniform),
        "Beam.with_": (beam.with_, {"length": 0.4, "axis": (1.0, 0.0)}),
        "Beam.from_toml": (a.Beam.from_toml, {"path": folder / "a.toml"}),
        "FixedBase": (a.FixedBase, {"displacement": (0.0, 0.0), "rotation": 0.1}),
        "ViscoelasticDamping": (a.ViscoelasticDamping, {"ratios": [0.3], "times": [0.03]}),
        "FrictionDamping": (a.FrictionDamping, {"eta0": 0.1, "smoothing_speed": 1e-3}),
        "HarmonicBase": (a.HarmonicBase, {
            "amplitude": 1e-3, "frequency": 2.0, "stop": 1.0, "direction": (1.0, 0.0), "stop_at": "rest", "ramp": 0.1,
        }),
        "HarmonicForce": (a.HarmonicForce, {"amplitude": 1.0, "frequency": 2.0, "direction": (1.0,)}),
        "HarmonicLoad": (a.HarmonicLoad, {
            "force": (0.1, 0.0), "frequency": 2.0, "moment": 0.0, "stop": 1.0, "ramp": 0.1,
        }),
        "SweepBase": (a.SweepBase, {
            "amplitude": 1e-3, "frequencies": (1.0, 2.0), "stop": 1.0, "direction": (1.0, 0.0), "stop_at": "rest",
            "ramp": 0.1,
        }),
        "SampledBase": (a.SampledBase, {"time": time40, "displacement": np.zeros((40, 2)), "rotation": 0 * time40}),
        "SampledLoad": (a.SampledLoad, {"time": time40, "force": np.zeros((40, 2)), "moment": 0 * time40}),
        "Measurement": (a.Measurement, {"time": time40, "values": x40, "name": "a", "sensor": a.Sensor()}),
        "Measurement.from_file": (a.Measurement.from_file, {
            "path": folder / "a.csv", "column": 2, "time": 1, "unit": "mm", "time_unit": "s", "sample_rate": None,
        }),
        "Measurement.from_recording": (a.Measurement.from_recording, {
            "recording": recording, "column": 2, "unit": "mm", "sensor": None,
        }),
        "Measurement.decimated": (record.decimated, {"factor": 2}),
        "Measurement.filtered": (record.filtered, {"low": None, "high": 5.0}),
        "Measurement.cut": (record.cut, {"begin": 0.1, "end": 0.5}),
        "ModalDamping": (a.ModalDamping, {"modes": modes, "ratios": (0.01, 0.02), "frequencies": None}),
        "Model": (a.Model, {"beam": beam, "measures": a.StrainMeasures()}),
        "MovingForce": (a.MovingForce, {"force": (0.0, 1.0), "speed": 2.0, "point": 0.1, "begin": 0.1, "end": 0.3}),
        "Parameter": (a.Parameter, {
            "name": "a", "value": 1.0, "unit": "m", "description": "b", "lower": 0.0, "upper": 2.0,
        }),
        "PointLoad": (a.PointLoad, {"force": (0.0, 1.0), "moment": 0.1, "point": 0.3}),
        "QuadraticDamping": (a.QuadraticDamping, {"eta1": 0.1, "eta2": 0.2, "flow": (1.0, 0.0)}),
        "RayleighDamping": (a.RayleighDamping, {"alpha": 0.1, "beta": 1e-4, "stiffness": "strain-rate"}),
        "track_video": (a.track_video, {
            "path": moving_dot(folder / "a.avi"), "markers": [[30.0, 30.0]], "region": (0, 0, 90, 60), "radius": 8,
            "ruler": (0, 0, 90, 0, 0.1), "clamp": (10, 10), "vertical": (0, 0, 0, 9), "sample_rate": 240.0,
            "lens": (90.0, 90.0, 48.0, 32.0, 0.1, 0.0, 0.0, 0.0), "begin": 0.0, "end": 1.0,
            "preview": folder / "a.png", "progress": False,
        }),
        "Recording": (a.Recording, {"path": "a.csv", "channels": recording.channels, "notes": ()}),
        "Recording.channel": (recording.channel, {"column": 2}),
        "SecondOrderSystem": (SecondOrderSystem.of, oscillator),
        "Section": (a.Section, {"width": 1e-3, "thickness": 1e-3}),
        "Sensor": (a.Sensor, {
            "quantity": "displacement", "point": 0.3, "direction": (1.0, 0.0), "frame": "inertial", "gravity": False,
            "distance": None, "signal_unit": "",
        }),
        "TableLayout": (a.TableLayout, {
            "names_row": 1, "skip_rows": (2,), "leave_out": ("x",), "imaginary": None,
        }),
        "Footage": (a.Footage, {
            "time": (0.0, 0.1), "images": np.zeros((2, 8, 8), np.uint8), "scale": 1e-3, "origin": (4.0, 0.0),
            "rotation": 0.1,
        }),
        "State": (a.State, {"coordinates": rest.coordinates, "velocities": 0 * rest.coordinates, "time": 0.0}),
        "StrainMeasures": (a.StrainMeasures, {
            "axial": "engineering", "curvature": "material", "axial_points": 2, "bending_points": 2,
        }),
        "amplitude_response": (a.amplitude_response, {"model": reduced, "amplitudes": (1e-5, 1e-4), "points": 5}
            | {"base": steady, "load": None, "force": None, "tolerance": 1e-5}),
        "backbone": (a.backbone, {"model": reduced, "mode": 1, "amplitude": 1e-3, "points": 3, "tolerance": 1e-5}),
        "separate_takes": (a.separate_takes, {"record": record}),
        "damping_curve": (a.damping_curve, {"record": record, "periods": 3.0, "release_time": 0.0}),
        "frequency_response": (a.frequency_response, {
            "model": reduced, "frequencies": (0.9 * f, 1.1 * f), "base": steady, "points": 5, "start": None,
            "tolerance": 1e-5,
        }),
        "linear_frf": (a.linear_frf, {
            "model": model, "damping": law, "frequencies": grid, "kind": "receptance", "points": 0.5,
            "load_points": 0.5, "direction": (1.0, 0.0), "load_direction": (1.0, 0.0), "equilibrium": rest,
        }),
        "mac": (a.mac, {"first": modes.shapes, "second": modes.shapes}),
        "motion": (a.motion, damped | {
            "model": model, "duration": 0.01, "load": load, "sample_rate": 1000.0, "start": "equilibrium",
            "tolerance": 1e-5, "largest_step": np.inf, "start_load": False, "most_steps": 1000,
            "lumped": False,
        }),
        "motion_function": (a.motion_function, {
            "motion": a.periodic_motion(reduced, base=steady), "point": 0.3, "direction": (1.0, 0.0), "relative": True,
        }),
        "natural_modes": (a.natural_modes, {"model": model, "count": 2, "equilibrium": rest}),
        "parameter_response": (a.parameter_response, {
            "model": reduced, "parameter": "alpha", "values": (0.1, 0.2), "base": steady, "points": 5,
        }),
        "periodic_motion": (a.periodic_motion, {
            "model": reduced, "damping": None, "base": steady, "load": None, "force": None, "tolerance": 1e-5,
        }),
        "read_recording": (a.read_recording, {
            "path": folder / "a.csv", "time": 1, "time_unit": "s", "sample_rate": None, "layout": a.TableLayout(),
            "progress": False,
        }),
        "reduce_model": (a.reduce_model, {
            "model": model, "modes": 1, "damping": law, "markers": (0.3,), "slope_points": None, "drag_points": None,
        }),
        "run_all": (a.run_all, {
            "tasks": [dict], "executor": None, "jobs": 1, "sizes": [1.0], "title": "a", "each": None,
        }),
        "simulate": (a.simulate, damped | {
            "model": model, "duration": 0.01, "load": load, "sample_rate": 1000.0, "start": "equilibrium",
            "method": "radau", "tolerance": 1e-5, "largest_step": np.inf, "options": None, "most_steps": 2000,
        }),
        "simulate_reduced": (a.simulate_reduced, {
            "reduced": reduced, "duration": 0.01, "base": base, "sample_rate": 1000.0, "start": "equilibrium",
            "steps_per_period": 20,
        }),
        "static_equilibrium": (a.static_equilibrium, {
            "model": model, "tip_force": (0.01, 0.0), "tip_moment": 1e-3, "loads": [point],
        }),
        "DataFile": (export.DataFile, {"name": "a", "sha256": "a" * 64}),
        "DataFile.of": (export.DataFile.of, {"path": folder / "a.csv"}),
        "Document": (export.Document, {"model": model, "damping": law, "identifications": ()}),
        "Identification": (export.Identification, {"result": {"kind": "decay", "estimates": []}, "data": ()}),
        "Provenance": (export.Provenance, {"written": "2025-02-28T12:00:00Z", "versions": {}, "note": ""}),
        "Signal": (export.Signal, {"name": "a", "unit": "m", "description": "b", "value": 1.0}),
        "beam_functions": (export.beam_functions, {"model": model, "damping": law, "markers": (0.3,), "modes": 1}),
        "load_functions": (export.load_functions, {"path": folder / "a.casadi"}),
        "read_document": (export.read_document, {"path": folder / "a.json"}),
        "save_functions": (export.save_functions, {"functions": functions, "path": folder / "b.casadi"}),
        "schema": (export.schema, {}),
        "values": (export.values, {"signals": functions.states}),
        "write_c": (export.write_c, {"functions": reduced, "folder": folder / "c", "name": "beam", "also": ()}),
        "write_document": (export.write_document, {
            "path": folder / "b.json", "document": export.Document(model, law),
        }),
        "write_fmu": (export.write_fmu, {
            "functions": functions, "path": folder / "a.fmu", "kind": "co-simulation", "document": None,
        }),
        "write_mujoco": (export.write_mujoco, {
            "model": model, "path": folder / "a.xml", "damping": law, "segments": 6, "tolerance": 0.1,
            "amplitude": 0.01,
        }),
        "write_pyelastica": (export.write_pyelastica, {
            "model": model, "path": folder / "a.py", "damping": law, "segments": 6, "tolerance": 0.1,
            "amplitude": 0.01,
        }),
        "write_newton": (export.write_newton, {
            "model": model, "path": folder / "c.py", "damping": law, "segments": 6, "tolerance": 0.1,
            "amplitude": 0.01,
        }),
        "write_exudyn": (export.write_exudyn, {
            "model": model, "path": folder / "b.py", "damping": law, "tolerance": 0.1, "amplitude": 0.01,
        }),
        "Camera": (p.Camera, {"scale": (0.9, 1.1), "rotation": (-0.1, 0.1), "origin": ((0.0, 1.0), (0.0, 1.0))}),
        "Channel": (p.Channel, {"measurement": record, "std": 1e-5, "offset": (-1.0, 1.0), "zero": (0.0, 1.0)}),
        "FrequencyRecord": (p.FrequencyRecord, {
            "model": model, "frequencies": frequencies, "std": 0.01, "modes": (1, 2), "name": "a",
        }),
        "FrfRecord.from_file": (p.FrfRecord.from_file, columns_read | {
            "path": folder / "frf.csv", "kind": "receptance", "column": 2, "phase": 3, "unit": "m/N", "points": None,
        }),
        "ResponseRecord.from_file": (p.ResponseRecord.from_file, level_read | {
            "base": None, "load": None, "sweep": "up", "control": "excitation",
        }),
        "FrfRecord": (p.FrfRecord, {
            "frequencies": grid, "values": frf, "kind": "receptance", "coherence": None, "std": None, "points": None,
        }),
        "Global": (p.Global, {"name": "density", "relative_bounds": 0.1}),
        "LeastChange": (p.LeastChange, {"weight": 1.0}),
        "MarkerRecord": (p.MarkerRecord, {
            "time": time40, "positions": markers, "points": (0.5,), "base": base, "start": "equilibrium",
            "release_time": 0.0, "camera": None, "load": None,
        }),
        "MeasuredModes": (p.MeasuredModes, {
            "frequencies": frequencies, "frequency_std": (0.1, 0.1), "points": (0.2, 0.5),
            "shapes": ((0.1, 1.0), (-0.5, 1.0)), "shape_std": ((0.1, 0.1), (0.1, 0.1)),
        }),
        "MotionRecord": (p.MotionRecord, {
            "channels": [record], "base": base, "start": "equilibrium", "release_time": 0.0,
            "camera": None, "load": None,
        }),
        "PerElement": (p.PerElement, {"name": "density", "relative_bounds": 0.1}),
        "ResponseRecord": (p.ResponseRecord, {
            "frequencies": grid[:5], "values": [1e-4] * 5, "phases": None, "sensor": a.Sensor(), "base": steady,
            "load": None, "levels": None, "sweep": "up", "control": "excitation", "amplitude_std": None,
            "phase_std": None, "level_std": None, "name": "", "excitation_unit": "", "relative": False,
        }),
        "Smooth": (p.Smooth, {"name": "density", "terms": 2, "relative_bounds": 0.1}),
        "Smoothness": (p.Smoothness, {"weight": 1.0}),
        "StaticRecord": (p.StaticRecord, {
            "model": model, "loads": [point], "values": [1e-3], "sensors": a.Sensor(), "std": 1e-5,
            "tared": True, "name": "a",
        }),
        "amplitude_table": (p.amplitude_table, {"fit": fit}),
        "compare_decay_laws": (p.compare_decay_laws, {
            "time": instants, "displacement": values + noise, "laws": ("linear",), "frequency_laws": ("constant",),
            "rests": ("constant",), "release_time": 0.0, "ratio_bounds": (0.0, 0.9),
        }),
        "compare_laws": (p.compare_laws, {"model": model, "records": [motion_record], "laws": [rayleigh]}),
        "fit_decay": (p.fit_decay, {
            "time": instants, "displacement": values + noise, "law": "linear", "frequency_law": None, "rest": None,
            "release_time": 0.0, "ratio_bounds": (0.0, 0.9), "priors": {"frequency": (2.0, 0.1)}, "robust": False,
        }),
        "fit_decay, amplitudes": (p.fit_decay, {
            "time": instants, "displacement": np.exp(-0.1 * np.array(instants)) * (2.0 + np.tanh(noise)),
            "quantity": "amplitude", "frequency": 2.0, "law": "quadratic", "robust": False,
        }),
        "fit_decays": (p.fit_decays, {
            "records": [record], "law": "linear", "frequency_law": "constant", "rest": "constant",
            "release_times": None, "ratio_bounds": (0.0, 0.9), "robust": False,
        }),
        "fit_frf": (p.fit_frf, {
            "record": p.FrfRecord(grid, frf, "receptance"), "modes": 1, "frequencies": None, "band": None,
        }),
        "frf_of": (p.frf_of, {
            "force": a.Measurement(hit_times, hit_force, sensor=a.Sensor("force")),
            "response": a.Measurement(hit_times, hit_response), "estimator": "H1", "excitation": "auto",
            "window": None, "time_constant": 1.0, "block": None, "overlap": 0.5, "kind": None, "points": None,
        }),
        "fit_mode": (p.fit_mode, {
            "records": [record], "law": "linear", "frequency_law": "constant", "modal_constant": None,
            "rest": "constant", "release_times": None, "ratio_bounds": (0.0, 0.9), "priors": None, "robust": False,
        }),
        "fit_modes": (p.fit_modes, {
            "time": instants, "displacement": values + noise, "modes": 1, "offset": True, "release_time": 0.0,
        }),
        "fit_beam": (p.fit_beam, {
            "model": model, "records": [motion_record], "damping": rayleigh, "unknowns": None, "fixed": (),
            "bounds": None, "priors": None, "robust": False, "tolerance": 1e-4, "modes": 1, "harmonics": 3,
        }),
        "fit_beam, curves": (p.fit_beam, {
            "model": model, "records": [curve], "damping": rayleigh, "unknowns": ("excitation",),
            "bounds": None, "priors": {"excitation": (1.0, 0.1)}, "modes": 1, "harmonics": 3,
        }),
        "fit_beam, values": (p.fit_beam, {"model": model, "records": [static, natural], "unknowns": ["density"]}),
        "fit_rayleigh": (p.fit_rayleigh, {
            "frequencies": (1.0, 5.0, 9.0), "ratios": (0.01, 0.02, 0.03), "ratio_std": 1e-3,
        }),
        "load_fit": (p.load_fit, {"path": folder / "fit.json"}),
        "isolate_mode": (p.isolate_mode, {"record": record, "band": (0.7 * f, 1.4 * f), "release_time": 0.0}),
        "law_curve": (p.law_curve, {"fit": fit, "amplitudes": [1e-3, 2e-3], "level": 0.9}),
        "match_frequencies": (p.match_frequencies, {
            "beam": beam, "targets": frequencies, "unknowns": [p.Global("density")], "bounds": 0.1,
            "preference": None, "objective": "least-squares", "guess": None, "starts": 1, "seed": 0,
        }),
        "PlannedRecord": (p.PlannedRecord, {"template": natural, "cost": 1.0}),
        "PlannedRecord, motion": (p.PlannedRecord.motion, {
            "sensors": a.Sensor(), "duration": 0.1, "sample_rate": 200.0, "std": 1e-4, "offset": None, "zero": None,
            "cost": 1.0,
        }),
        "PlannedRecord, response": (p.PlannedRecord.response, {
            "frequencies": [1.8, 1.9], "sensor": a.Sensor(), "phases": True, "cost": 1.0, "base": steady,
        }),
        "PlannedRecord, static": (p.PlannedRecord.static, {
            "model": model, "loads": [point], "sensors": a.Sensor(), "std": 1e-4, "tared": False, "cost": 1.0,
        }),
        "PlannedRecord, frequencies": (p.PlannedRecord.natural_frequencies, {
            "model": model, "modes": [1, 2], "std": 0.01, "cost": 1.0,
        }),
        "plan": (p.plan, {
            "model": model, "damping": None,
            "candidates": {"tones": p.PlannedRecord.natural_frequencies(model, [1, 2], std=0.01)},
            "unknowns": ["elastic_modulus"], "fixed": (), "priors": None, "before": None, "modes": 1, "harmonics": 3,
        }),
        "plan_comparison": (p.plan_comparison, {
            "model": model, "laws": [rayleigh, a.QuadraticDamping(eta2=1.0)], "counts": {"swing": 1},
            "candidates": {"swing": p.PlannedRecord.motion(a.Sensor(), duration=0.05, sample_rate=200.0, std=1e-4,
                                                           start=pulled)},
        }),
        "corner_figure": (p.corner_figure, {"samples": drawn_samples()}),
        "monte_carlo": (p.monte_carlo, {"fit": fit, "runs": 2, "seed": 0, "method": "parametric"}),
        "reproduce": (p.reproduce, {"out": folder / "paper", "quick": True, "jobs": 1, "progress": False}),
        "run_study": (p.run_study, {
            "path": folder / "study.toml", "out": folder / "study", "quick": False, "jobs": 1, "command": "a",
        }),
    }  # fmt: skip
    return found


def hostile_call(rng: random.Random, folder: Path) -> tuple[str, dict, Callable]:
    """Draw a call; return its description, its arguments and its function."""
    every = calls(folder)
    name = rng.choice(sorted(every))
    function, arguments = every[name]
    replaced = {
        key: rng.choice(sorted(HOSTILE))
        for key in rng.sample(sorted(arguments), min(len(arguments), rng.choice((1, 1, 2))))
    }
    return f"{name} {replaced}", arguments | {key: HOSTILE[value] for key, value in replaced.items()}, function


def every_call(folder: Path) -> Iterator[tuple[str, dict, Callable]]:
    """Yield the calls in which one argument has one hostile value, described as by ``hostile_call``."""
    for name, (function, arguments) in sorted(calls(folder).items()):
        for key, value in product(arguments, HOSTILE):
            yield f"{name} { ({key: value}) }", arguments | {key: HOSTILE[value]}, function


def outcome(function: Callable, arguments: dict, positional: Sequence = ()) -> str:
    """Call; return ``returned``, ``refused``, ``stopped`` by Ctrl-C after long work, or the description of a fault."""

    def late(*_):
        raise TimeoutError("waits too long")

    def stop(*_):
        signal.raise_signal(signal.SIGINT)

    before = {number: signal.signal(number, act) for number, act in ((signal.SIGALRM, late), (signal.SIGPROF, stop))}
    signal.setitimer(signal.ITIMER_REAL, PATIENCE * SECONDS)
    signal.setitimer(signal.ITIMER_PROF, SECONDS, GRACE)
    began = time.process_time()
    try:
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            function(*positional, **arguments)
        found = "returned"
    except ancf_casadi.AncfError as error:
        text = str(error)
        found = "refused" if "\n" not in text and len(text) < 1000 else f"a message of {len(text)} characters"
    except Refused:
        found = "refused"
    except KeyboardInterrupt:
        found = "stopped"
    except Exception as error:
        return f"{type(error).__name__}: {' '.join(str(error).split())[:150]}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, act in before.items():
            signal.signal(number, act)
    foreign = [w for w in warned if w.category is not UserWarning]
    if foreign:
        return f"warns: {foreign[0].category.__name__}: {foreign[0].message}"
    used = time.process_time() - began
    if used < SECONDS:
        return found
    return "stopped" if used < SECONDS + GRACE else f"takes {used:.0f} s in spite of Ctrl-C"
