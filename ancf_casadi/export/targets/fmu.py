"""The beam as a functional mock-up unit: FMI 3.0, model exchange, for co-simulation and control.

    states       q, v of ``BeamFunctions``, and the motion of the clamp, (u, u_t)
    inputs       the accelerations u_tt of the clamp: x, y and rotation
    parameters   gravity, the properties of the elements, those of the damping law
    outputs      tip, markers, energies

or q, v of ``ReducedModel``, which has no properties of the elements among its parameters and is not stiff,

with q_t = v, v_t = rhs(q, v, (u, u_t, u_tt), p).  The clamp is driven by its accelerations, and its motion is a state,
for thus position, rate and acceleration belong together however an importer interpolates or holds its inputs; a motion
given by positions would set off axial waves at each kink.  States start in the static equilibrium of the beam as
exported.  After a change of a parameter it is that no longer: the importer sets other start values, or the beam swings
to its new state of rest.

CasADi's DaeBuilder writes the equations and their derivatives as C, and the wrapper of FMI.  What its description of
the model lacks is put in: all digits of the start values, the definitions of the units, and what the model is.  The
document that the FMU was made from lies in it as ``resources/beam.json``.

References
----------
Modelica Association, "Functional Mock-up Interface Specification", version 3.0.1.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import os
import platform
import re
import shlex
import subprocess
import tempfile
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

import casadi as cs
from tqdm import tqdm

from ancf_casadi.damping import SumOfLaws
from ancf_casadi.dynamics.signals import MotionFunctions, Signal
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.document.model_document import Document
from ancf_casadi.export.functions.motion_functions import beam_functions
from ancf_casadi.reduction.reduced import ReducedFunctions, reduce_model
from ancf_casadi.support.compilation import LIBRARY, SECONDS, c_compiler
from ancf_casadi.support.files import write_file
from ancf_casadi.support.inputs import numbers
from ancf_casadi.support.tables import to_json
from ancf_casadi.version import __version__

NAME = "beam"  # of the model in C
FLAGS = ("-O3", *LIBRARY)
CLAMP = 3  # coordinates of the clamp
BASE_UNITS = {
    "kg": {"kg": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
}
PLATFORMS = {"Linux": ("linux", "so"), "Darwin": ("darwin", "dylib"), "Windows": ("windows", "dll")}
TOLERANCE = "1e-8"  # asked of an importer: CasADi declares nominal values of 1, and 1e-5 of these is no accuracy
MODAL_TOLERANCE = "1e-10"  # of modal coordinates, which are far smaller than 1
BAR = "{desc} {bar}| [{elapsed}]"


def write_fmu(
    path: str | Path,
    document: Document,
    *,
    markers: Sequence[float] = (),
    modes: int | None = None,
    progress: bool = False,
) -> None:
    """Write a beam as an FMU, with a binary for this machine and the sources for others.

    The current folder of the process is another one for a moment, while CasADi writes its files.

    Parameters
    ----------
    path : path
        The file, ``....fmu``.
    document : Document
        The beam, its damping, and what they were identified from.
    markers : sequence of float
        Arc lengths of the points whose positions are outputs, m.
    modes : int, optional
        How many modes the reduced model keeps, which is then written; the full model if not given.
    progress : bool
        Whether to show a progress bar.

    Raises
    ------
    InputError
        If a marker is not on the beam, it has no such reduced model, fmpy or a C compiler is missing, the compiler
        fails, or the file cannot be written.
    EquilibriumError
        If the beam has no stable equilibrium under gravity.
    """
    for s in numbers(markers, "markers"):
        document.model.element_at(s)
    headers, compiler = fmi_headers(), c_compiler()
    if not compiler:
        raise InputError("an FMU needs a C compiler, and there is none; install one, or name it in CC", "CC")
    functions: MotionFunctions
    if modes is None:
        functions = beam_functions(document.model, document.damping, markers=markers, modes=1)
    else:
        functions = reduce_model(document.model, damping=document.damping, markers=markers, modes=modes)
    with (
        tempfile.TemporaryDirectory() as temporary,
        tqdm(total=2, disable=not progress, bar_format=BAR, desc="C") as bar,
    ):
        folder = Path(temporary)
        with contextlib.chdir(folder):
            files = dae_builder(functions).export_fmu({"with_serialization": False, "no_warning": True})
        description = _described(folder / "modelDescription.xml", Path(path).stem, functions, document)
        _advance(bar, "compiler")
        system, suffix = PLATFORMS.get(platform.system(), ("linux", "so"))
        library = folder / f"{NAME}.{suffix}"
        _compile(compiler, [folder / f"{NAME}.c", folder / f"{NAME}_wrap.c"], library, headers)
        _advance(bar, "done")
        machine = {"AMD64": "x86_64", "arm64": "aarch64"}.get(platform.machine(), platform.machine())
        content = {archived.removeprefix("./"): (folder / name).read_bytes() for name, archived in files.items()}
        content |= {
            "modelDescription.xml": description,
            "resources/beam.json": to_json(document.to_dict()).encode(),
            f"binaries/{machine}-{system}/{library.name}": library.read_bytes(),
        }
    write_file(Path(path), _zipped(content))


def fmi_headers() -> Path:
    """Return the folder of the headers of FMI 3.0, which the package fmpy brings.

    Raises
    ------
    InputError
        If they are not there.
    """
    found = importlib.util.find_spec("fmpy")
    if found is None or found.origin is None:
        raise InputError("an FMU needs the headers of FMI, which fmpy has; pip install 'ancf-casadi[fmu]'", "fmpy")
    folder = Path(found.origin).parent / "c-code"
    if not (folder / "fmi3Functions.h").is_file():
        raise InputError(f"has no headers of FMI 3.0; {folder} lacks fmi3Functions.h, install another fmpy", "fmpy")
    return folder


def dae_builder(functions: MotionFunctions) -> cs.DaeBuilder:
    """Return the equation of motion as CasADi's DaeBuilder, with one scalar variable for each signal."""
    dae = cs.DaeBuilder(NAME)

    def add(signals: Sequence[Signal], causality: str = "local", variability: str = "continuous") -> list[cs.MX]:
        about = [{"description": signal.description, "unit": _unit(signal) or ""} for signal in signals]
        return [dae.add(s.name, causality, variability, opts) for s, opts in zip(signals, about, strict=True)]

    clamped, driving = functions.base[: 2 * CLAMP], functions.base[2 * CLAMP :]
    states, clamp = add(functions.states), add(clamped)
    inputs, parameters = add(driving, "input"), add(functions.parameters, "parameter", "tunable")
    outputs = add(functions.outputs, "output")
    for signal in (*functions.states, *functions.base, *functions.parameters):
        dae.set_start(signal.name, signal.value)
    for signal in (*functions.states, *clamped):
        dae.set_initial(signal.name, "exact")
    q, v = cs.vertcat(*states[: functions.free]), cs.vertcat(*states[functions.free :])
    base, p = cs.vertcat(*clamp, *inputs), cs.vertcat(*parameters)
    rates = cs.vertcat(v, functions.rhs(q, v, base, p), base[CLAMP:])
    for state, rate in zip([*states, *clamp], cs.vertsplit(rates), strict=True):
        dae.eq(dae.der(state), rate)
    points = [functions.tip(q, base), cs.vec(functions.markers(q, base))]
    values = cs.vertcat(*points, *functions.energies(q, v, base, p))
    for output, value in zip(outputs, cs.vertsplit(values), strict=True):
        dae.eq(output, value)
    return dae


def _advance(bar: tqdm[NoReturn], step: str) -> None:
    bar.update()
    bar.set_description(step)


def _compile(compiler: tuple[str, ...], sources: Sequence[Path], library: Path, headers: Path) -> None:
    """Compile the sources of the FMU to a library that binds its names to itself."""
    own = ["-Wl,-Bsymbolic"] if library.suffix == ".so" else []
    drafts = os.environ | {"TMPDIR": str(library.parent)}  # which a compiler that is stopped leaves behind
    call = [*compiler, *FLAGS, *own, f"-I{headers}", *map(str, sources), "-o", str(library), "-lm"]
    name = shlex.join(compiler)
    try:
        subprocess.run(call, check=True, capture_output=True, timeout=SECONDS, env=drafts)
    except subprocess.TimeoutExpired:
        raise InputError(f"did not compile the FMU in {SECONDS} s; take fewer elements or modes", name) from None
    except subprocess.CalledProcessError as error:
        said = [line for line in error.stderr.decode(errors="replace").splitlines() if "error" in line] or ["no reason"]
        raise InputError(f"cannot compile the FMU ({said[0]})", name) from None
    except OSError as error:
        raise InputError(f"cannot be run ({error.strerror or error})", name) from None


def _described(path: Path, title: str, functions: MotionFunctions, document: Document) -> bytes:
    """Return CasADi's description of the model with what it lacks."""
    tree = ET.parse(path)
    root = tree.getroot()
    root.attrib |= {
        "modelName": _text(title),
        "description": _text(_about(functions, document)),
        "generationTool": f"ancf-casadi {__version__} with CasADi {cs.CasadiMeta.version()}",
        "generationDateAndTime": document.provenance.written,
        "variableNamingConvention": "flat",
    }
    for interface in root.iter("ModelExchange"):  # CasADi 3.8.2 takes up seeds left by the other kind of derivative
        interface.set("providesAdjointDerivatives", "false")
    signals = {s.name: s for s in (*functions.parameters, *functions.states, *functions.base, *functions.outputs)}
    derived = {f"der({s.name})": _rate(s.unit) for s in (*functions.states, *functions.base[: 2 * CLAMP])}
    (variables,) = root.iter("ModelVariables")
    for variable in list(variables):
        name = variable.attrib["name"]
        if name.startswith("__assign__"):  # CasADi's names for right-hand sides
            variables.remove(variable)
        if "start" in variable.attrib:
            variable.set("start", repr(signals[name].value))
        if name in derived:
            variable.set("unit", derived[name])
    for unknown in root.iter("InitialUnknown"):
        unknown.attrib.pop("dependencies", None)  # they lack the parameters; without, it may depend on everything
    units = sorted({variable.attrib["unit"] for variable in variables if "unit" in variable.attrib})
    definitions = ET.Element("UnitDefinitions")
    for unit in units:
        definition, exponents = ET.SubElement(definitions, "Unit", name=unit), _exponents(unit)
        if exponents is not None:
            ET.SubElement(definition, "BaseUnit", {base: str(power) for base, power in exponents.items()})
    root.insert(1, definitions)
    tolerance = MODAL_TOLERANCE if isinstance(functions, ReducedFunctions) else TOLERANCE
    root.insert(2, ET.Element("DefaultExperiment", startTime="0", tolerance=tolerance))
    ET.indent(tree)
    content: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return content


def _about(functions: MotionFunctions, document: Document) -> str:
    """Return what the model is, and the identification it came from, in a line."""
    beam, law = document.model.beam, document.damping
    terms = law.laws if isinstance(law, SumOfLaws) else [law] if law else []
    damping = " and ".join(type(term).__name__ for term in terms) or "no damping"
    parts = [f"Beam of {beam.elements} elements, {beam.length:g} m long, {damping}"]
    if isinstance(functions, ReducedFunctions):
        parts.append(f"modes kept: {functions.free}")
    parts += [f"identified by {found.summary()}" for found in document.identifications]
    return "; ".join(parts)


def _unit(signal: Signal) -> str | None:
    return None if signal.unit == "1" else signal.unit


def _rate(unit: str) -> str:
    """Return the unit of the rate of something."""
    return f"{unit}2" if unit.endswith("/s") else f"{unit}/s"


def _exponents(unit: str) -> dict[str, int] | None:
    """Return the exponents of the base units in a unit such as ``kg/m3``; None if it is not known or has others."""
    exponents: dict[str, int] = {}
    above, *below = unit.split("/")
    for sign, product in [(1, above), *((-1, part) for part in below)]:
        for base, power in re.findall(r"([A-Za-z]+)([^ ]*)", product):
            if base not in BASE_UNITS or not re.fullmatch(r"\d*", power):
                return None
            for name, exponent in BASE_UNITS[base].items():
                exponents[name] = exponents.get(name, 0) + sign * exponent * int(power or 1)
    return exponents


def _text(text: str) -> str:
    """Return a text without what XML cannot hold."""
    return re.sub("[\x00-\x1f\ud800-\udfff\ufffe\uffff]", "?", text)


def _zipped(content: dict[str, bytes]) -> bytes:
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
        for name in sorted(content):
            file.writestr(zipfile.ZipInfo(name), content[name], zipfile.ZIP_DEFLATED)
    return archive.getvalue()
