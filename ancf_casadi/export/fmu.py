"""The beam as a functional mock-up unit (FMU): FMI 3.0, for simulation and control.

An FMU for model exchange holds the equation of motion, and the importer integrates:

    states       q, v of the Functions, and the motion (u, u_t) of the base
    inputs       the accelerations u_tt of the base: x, y and rotation
    parameters   p of the Functions: gravity, properties of the elements (full model only), parameters of the law
    outputs      tip, markers, energies, force of the clamp

with q_t = v, v_t = rhs(q, v, (u, u_t, u_tt), p).  The FMU of a reduced model is not stiff.

An FMU for co-simulation has its own integrator (``co_simulation``); a force at the tip is a further input.

The inputs are the accelerations of the base, whose position and velocity are states.  They stay consistent however an
importer interpolates or holds its inputs; a prescribed position would excite axial waves at each kink.  The states
start in the static equilibrium of the exported beam.  If a parameter is changed, the importer must set other start
values; otherwise the beam swings about its new equilibrium.

For model exchange, CasADi's DaeBuilder writes the equations and their derivatives as C, and the FMI wrapper.  The
description of the model is completed: by all digits of the start values, the definitions of the units, the tolerance,
and what the model is.  The FMU may hold a document of the beam, as ``resources/beam.json``.

References
----------
Modelica Association, "Functional Mock-up Interface Specification", version 3.0.1.
"""

from __future__ import annotations

import contextlib
import io
import platform
import re
import shlex
import tempfile
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Sequence
from pathlib import Path
from types import NoneType
from typing import Literal, NoReturn, get_args

import casadi as cs
from tqdm import tqdm

from ancf_casadi.damping import RayleighDamping, SumOfLaws
from ancf_casadi.damping.spec import law_spec
from ancf_casadi.dynamics.signals import MotionFunctions, Signal
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.co_simulation import (
    BASE_COORDINATES,
    BASE_STATES,
    co_simulation_description,
    co_simulation_source,
)
from ancf_casadi.export.identification import Provenance
from ancf_casadi.export.model_document import Document
from ancf_casadi.export.motion_functions import BeamFunctions
from ancf_casadi.reduction.reduced import ReducedFunctions, ReducedModel
from ancf_casadi.support.compilation import LIBRARY, c_compiler, compiler_failure
from ancf_casadi.support.files import check_file, write_file
from ancf_casadi.support.inputs import check_instance, choice
from ancf_casadi.support.optional import find_module
from ancf_casadi.support.tables import to_json
from ancf_casadi.version import __version__

MODEL = "beam"  # of the model in C
FMU_FLAGS = ("-O3", *LIBRARY)
PLATFORMS = {"Linux": ("linux", "so"), "Darwin": ("darwin", "dylib"), "Windows": ("windows", "dll")}
BUILD_BAR = "{desc} {bar}| [{elapsed}]"
BASE_UNITS = {
    "kg": {"kg": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
}
FmuKind = Literal["model-exchange", "co-simulation"]
FMU_TOLERANCES: dict[FmuKind, tuple[str, str]] = {  # of the full and the reduced model
    # Relative to CasADi's nominal values of 1; modal coordinates are far smaller.  fmpy holds its inputs within a step:
    # below these tolerances, test_an_input_that_jumps_does_not_stop_the_importer fails.
    "model-exchange": ("1e-7", "1e-8"),
    "co-simulation": ("2e-8", "2e-9"),  # benchmarks/co_simulation.py
}
BUILD = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0">
  <BuildConfiguration modelIdentifier="{MODEL}">
    <SourceFileSet language="C99"><SourceFile name="{MODEL}.c"/></SourceFileSet>
  </BuildConfiguration>
</fmiBuildDescription>
"""


def write_fmu(
    functions: MotionFunctions,
    path: str | Path,
    *,
    kind: FmuKind = "model-exchange",
    document: Document | None = None,
    progress: bool = False,
) -> None:
    """Write the Functions as an FMU, with a binary for this machine and the sources for others.

    The process changes its current folder for a moment, because CasADi writes there.

    Parameters
    ----------
    functions : BeamFunctions, ReducedModel or ReducedFunctions
        The model, full or reduced.
    path : path
        The file, ``....fmu``.
    kind : str
        "model-exchange", whose importer integrates, or "co-simulation", with steps of its own.
    document : Document, optional
        The beam, its damping law and its identifications, which the FMU then describes and holds.
    progress : bool
        Whether to show a progress bar.

    Raises
    ------
    InputError
        If the document describes another beam or law, or is given with Functions from a file, fmpy or a C compiler is
        missing, the compiler fails, or the file cannot be written.

    Examples
    --------
    >>> from pathlib import Path
    >>> from ancf_casadi import Beam, Model, reduce_model
    >>> from ancf_casadi.export import write_fmu
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> write_fmu(reduce_model(Model(beam), modes=2), "strip.fmu")  # needs fmpy and a C compiler
    >>> Path("strip.fmu").exists()
    True
    """
    check_instance(functions, "functions", MotionFunctions)
    check_instance(document, "document", Document, NoneType)
    choice(kind, get_args(FmuKind), "kind")
    target = check_file(path)
    if document is not None:
        _check_document(document, functions)
    headers, compiler = _fmi_headers(), c_compiler()
    if not compiler:
        raise InputError("an FMU needs a C compiler, and none was found; install one, or set CC to its command", "CC")
    with (
        tempfile.TemporaryDirectory() as temporary,
        tqdm(total=2, disable=not progress, bar_format=BUILD_BAR, desc="C") as bar,
    ):
        folder = Path(temporary)
        tolerance = FMU_TOLERANCES[kind][isinstance(functions, ReducedFunctions)]
        if kind == "model-exchange":
            root, content = _model_exchange_files(functions, folder)
        else:
            root, content = _co_simulation_files(functions, folder, headers, tolerance)
        description = complete_description(root, target.stem, functions, document, tolerance)
        _advance(bar, "compiler")
        system, suffix = PLATFORMS.get(platform.system(), ("linux", "so"))
        library = folder / f"{MODEL}.{suffix}"
        _compile(compiler, sorted(folder.glob("*.c")), library, headers)
        _advance(bar, "done")
        machine = {"AMD64": "x86_64", "arm64": "aarch64"}.get(platform.machine(), platform.machine())
        content |= {
            "modelDescription.xml": description,
            f"binaries/{machine}-{system}/{library.name}": library.read_bytes(),
        }
    if document is not None:
        content["resources/beam.json"] = to_json(document.to_dict()).encode()
    write_file(target, _zip_archive(content))


def _check_document(document: Document, functions: MotionFunctions) -> None:
    """Refuse a document of another beam or damping law than that of the Functions."""
    if not isinstance(functions, (BeamFunctions, ReducedModel)) or functions.model is None or functions.law is None:
        advice = "give those of beam_functions or reduce_model, or no document"
        raise InputError(f"cannot be compared with Functions from a file; {advice}", "document")
    law, model = RayleighDamping() if document.damping is None else document.damping, document.model
    if functions.model != model or law_spec(functions.law, model) != law_spec(law, model):
        raise InputError("describes another beam or damping law than the Functions do", "document")


def _fmi_headers() -> Path:
    """Return the folder of the FMI 3.0 headers, which the package fmpy contains."""
    folder = Path(str(find_module("fmpy", "an FMU needs its FMI headers").origin)).parent / "c-code"
    if not (folder / "fmi3Functions.h").is_file():
        raise InputError(f"has no FMI 3.0 headers: {folder} lacks fmi3Functions.h; install another version", "fmpy")
    return folder


def _model_exchange_files(functions: MotionFunctions, folder: Path) -> tuple[ET.Element, dict[str, bytes]]:
    """Write CasADi's FMU for model exchange to a folder; return its description, and its files by archived name."""
    with contextlib.chdir(folder):
        files = _dae_builder(functions).export_fmu({"with_serialization": False, "no_warning": True})
    wrapper = folder / f"{MODEL}_wrap.c"  # where CasADi 3.8.2 does not set the variable of the time, its first
    wrapper.write_text(wrapper.read_text().replace("m->t = ", "m->t = m->v[0] = "))
    content = {archived.removeprefix("./"): (folder / name).read_bytes() for name, archived in files.items()}
    return ET.parse(folder / "modelDescription.xml").getroot(), content


def _co_simulation_files(
    functions: MotionFunctions, folder: Path, headers: Path, tolerance: str
) -> tuple[ET.Element, dict[str, bytes]]:
    """Write the source for co-simulation to a folder; return its description, and its files by archived name."""
    source, token = co_simulation_source(functions, tolerance, headers)
    content = {f"sources/{MODEL}.c": source.encode(), "sources/buildDescription.xml": BUILD.encode()}
    (folder / f"{MODEL}.c").write_bytes(content[f"sources/{MODEL}.c"])
    return co_simulation_description(functions, MODEL, token), content


def _dae_builder(functions: MotionFunctions) -> cs.DaeBuilder:
    """Return the equation of motion as a DaeBuilder, with one scalar variable per signal."""
    dae = cs.DaeBuilder(MODEL)

    def add(signals: Sequence[Signal], causality: str = "local", variability: str = "continuous") -> list[cs.MX]:
        labels = [{"description": s.description, "unit": "" if s.unit == "1" else s.unit} for s in signals]
        return [dae.add(s.name, causality, variability, label) for s, label in zip(signals, labels, strict=True)]

    add([Signal("time", "s", "time")], "independent")
    base_state_signals, acceleration_signals = functions.base[:BASE_STATES], functions.base[BASE_STATES:]
    states, base_states = add(functions.states), add(base_state_signals)
    inputs, parameters = add(acceleration_signals, "input"), add(functions.parameters, "parameter", "tunable")
    outputs = add(functions.outputs, "output")
    for signal in (*functions.states, *functions.base, *functions.parameters):
        dae.set_start(signal.name, signal.value)
    for signal in (*functions.states, *base_state_signals):
        dae.set_initial(signal.name, "exact")
    q, v = cs.vertcat(*states[: functions.free]), cs.vertcat(*states[functions.free :])
    base, p = cs.vertcat(*base_states, *inputs), cs.vertcat(*parameters)
    derivatives = cs.vertcat(v, functions.rhs(q, v, base, p), base[BASE_COORDINATES:])
    for state, derivative in zip([*states, *base_states], cs.vertsplit(derivatives), strict=True):
        dae.eq(dae.der(state), derivative)
    points = [functions.tip(q, base), cs.vec(functions.markers(q, base))]
    force = functions.clamp_force(q, v, derivatives[functions.free : 2 * functions.free], base, p)
    values = cs.vertcat(*points, *functions.energies(q, v, base, p), force)
    for output, value in zip(outputs, cs.vertsplit(values), strict=True):
        dae.eq(output, value)
    return dae


def _advance(bar: tqdm[NoReturn], step: str) -> None:
    bar.update()
    bar.set_description(step)


def _compile(compiler: tuple[str, ...], sources: Sequence[Path], library: Path, headers: Path) -> None:
    """Compile the sources of the FMU to a library that resolves its own symbols first."""
    linker_flags = ["-Wl,-Bsymbolic"] if library.suffix == ".so" else []
    failure = compiler_failure({library: [*compiler, *FMU_FLAGS, *linker_flags, f"-I{headers}", *map(str, sources)]})
    if failure:
        advice = "check the command in CC, or use fewer elements or modes"
        raise InputError(f"cannot compile the FMU ({failure}); {advice}", shlex.join(compiler))


def _zip_archive(content: dict[str, bytes]) -> bytes:
    """Return a zip archive whose bytes depend on the content only, not on the time."""
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
        for name in sorted(content):
            file.writestr(zipfile.ZipInfo(name), content[name], zipfile.ZIP_DEFLATED)
    return archive.getvalue()


def complete_description(
    root: ET.Element, title: str, functions: MotionFunctions, document: Document | None, tolerance: str
) -> bytes:
    """Complete a model description with the title, the origin, start values, units and tolerance; return it as XML."""
    provenance = document.provenance if document else Provenance.of_this()
    root.attrib |= {
        "modelName": _xml_text(title),
        "description": _xml_text(_summary(functions, document)),
        "generationTool": f"ancf-casadi {__version__} with CasADi {cs.CasadiMeta.version()}",
        "generationDateAndTime": provenance.written,
        "variableNamingConvention": "flat",
    }
    for interface in root.iter("ModelExchange"):  # CasADi 3.8.2 mixes up the seeds of both kinds of derivatives
        interface.set("providesAdjointDerivatives", "false")
    for unknown in root.iter("InitialUnknown"):
        unknown.attrib.pop("dependencies", None)  # CasADi omits the parameters; without a list, all are dependencies
    (variables,) = root.iter("ModelVariables")
    _complete_variables(variables, functions)
    root.insert(1, _unit_definitions(variables))
    root.insert([*root].index(variables), ET.Element("DefaultExperiment", startTime="0", tolerance=tolerance))
    ET.indent(root)
    content: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return content


def _complete_variables(variables: ET.Element, functions: MotionFunctions) -> None:
    """Set all digits of the start values and the units of the derivatives; remove CasADi's auxiliary variables."""
    differentiated = (*functions.states, *functions.base[:BASE_STATES])
    signals = {s.name: s for s in (*functions.parameters, *functions.states, *functions.base, *functions.outputs)}
    derivative_units = {
        f"der({signal.name})": f"{signal.unit}{2 if signal.unit.endswith('/s') else '/s'}" for signal in differentiated
    }
    for variable in list(variables):
        name = variable.attrib["name"]
        if name.startswith("__assign__"):  # CasADi's names for right-hand sides
            variables.remove(variable)
        if name in signals and "start" in variable.attrib:
            variable.set("start", repr(signals[name].value))
        if name in derivative_units:
            variable.set("unit", derivative_units[name])


def _unit_definitions(variables: ET.Element) -> ET.Element:
    definitions = ET.Element("UnitDefinitions")
    for unit in sorted({variable.attrib["unit"] for variable in variables if "unit" in variable.attrib}):
        definition, exponents = ET.SubElement(definitions, "Unit", name=unit), _exponents(unit)
        if exponents is not None:
            ET.SubElement(definition, "BaseUnit", {base: str(power) for base, power in exponents.items()})
    return definitions


def _summary(functions: MotionFunctions, document: Document | None) -> str:
    """Return one line: the beam, its damping laws, the number of modes, and the identifications."""
    reduced = isinstance(functions, ReducedFunctions)
    if document is None:
        return f"Beam in {functions.free} {'modes' if reduced else 'nodal coordinates'}"
    beam, law = document.model.beam, document.damping
    terms = law.laws if isinstance(law, SumOfLaws) else [law] if law else []
    damping = " and ".join(type(term).__name__ for term in terms) or "no damping"
    clauses = [f"Beam of {beam.elements} elements, {beam.length:g} m long, {damping}"]
    clauses += [f"modes kept: {functions.free}"] if reduced else []
    clauses += [f"identified by {identification.summary()}" for identification in document.identifications]
    return "; ".join(clauses)


def _exponents(unit: str) -> dict[str, int] | None:
    """Return the exponents of the base units in a unit such as ``kg/m3``; None if FMI cannot express the unit."""
    exponents: dict[str, int] = {}
    numerator, *denominators = unit.split("/")
    for sign, product in [(1, numerator), *((-1, factor) for factor in denominators)]:
        for base, power in re.findall(r"([A-Za-z]+)([^ ]*)", product):
            if base not in BASE_UNITS or not re.fullmatch(r"\d*", power):
                return None
            for name, exponent in BASE_UNITS[base].items():
                exponents[name] = exponents.get(name, 0) + sign * exponent * int(power or 1)
    return exponents


def _xml_text(text: str) -> str:
    """Return a text without the characters that XML cannot hold."""
    return re.sub("[\x00-\x1f\ud800-\udfff\ufffe\uffff]", "?", text)
