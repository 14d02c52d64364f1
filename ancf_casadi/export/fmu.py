"""The beam as a functional mock-up unit (FMU): FMI 3.0, model exchange, for simulation and control.

    states       q, v of the Functions, and the motion (u, u_t) of the clamp
    inputs       the accelerations u_tt of the clamp: x, y and rotation
    parameters   p of the Functions: gravity, properties of the elements (full model only), parameters of the law
    outputs      tip, markers, energies

with q_t = v, v_t = rhs(q, v, (u, u_t, u_tt), p).  The FMU of a reduced model is not stiff.

The clamp is driven by its accelerations, and its position and velocity are states.  They stay consistent however an
importer interpolates or holds its inputs; a prescribed position would excite axial waves at each kink.  The states
start in the static equilibrium of the exported beam.  If a parameter is changed, the importer must set other start
values; otherwise the beam swings to its new equilibrium.

CasADi's DaeBuilder writes the equations and their derivatives as C, and the FMI wrapper.  ``fmu_description`` completes
its description of the model.  The FMU may hold a document of the beam, as ``resources/beam.json``.

References
----------
Modelica Association, "Functional Mock-up Interface Specification", version 3.0.1.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import platform
import shlex
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path
from types import NoneType
from typing import NoReturn

import casadi as cs
from tqdm import tqdm

from ancf_casadi.damping import RayleighDamping
from ancf_casadi.dynamics.equations import Equations
from ancf_casadi.dynamics.signals import MotionFunctions, Signal, parameter_signals
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.fmu_description import CLAMP_COORDINATES, described
from ancf_casadi.export.model_document import Document
from ancf_casadi.support.compilation import LIBRARY, c_compiler, compiler_failure
from ancf_casadi.support.files import check_file, write_file
from ancf_casadi.support.inputs import check_instance
from ancf_casadi.support.tables import to_json

MODEL = "beam"  # of the model in C
FMU_FLAGS = ("-O3", *LIBRARY)
PLATFORMS = {"Linux": ("linux", "so"), "Darwin": ("darwin", "dylib"), "Windows": ("windows", "dll")}
BUILD_BAR = "{desc} {bar}| [{elapsed}]"


def write_fmu(
    functions: MotionFunctions, path: str | Path, *, document: Document | None = None, progress: bool = False
) -> None:
    """Write the Functions as an FMU, with a binary for this machine and the sources for others.

    The process changes its current folder for a moment, because CasADi writes there.

    Parameters
    ----------
    functions : BeamFunctions, ReducedModel or ReducedFunctions
        The model, full or reduced.
    path : path
        The file, ``....fmu``.
    document : Document, optional
        The beam, its damping law and its identifications, which the FMU then describes and holds.
    progress : bool
        Whether to show a progress bar.

    Raises
    ------
    InputError
        If the document describes another beam or law, fmpy or a C compiler is missing, the compiler fails, or the file
        cannot be written.

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
    target = check_file(path)
    _check_document(document, functions)
    headers, compiler = _fmi_headers(), c_compiler()
    if not compiler:
        raise InputError("an FMU needs a C compiler, and none was found; install one, or set CC to its command", "CC")
    with (
        tempfile.TemporaryDirectory() as temporary,
        tqdm(total=2, disable=not progress, bar_format=BUILD_BAR, desc="C") as bar,
    ):
        folder = Path(temporary)
        with contextlib.chdir(folder):
            files = _dae_builder(functions).export_fmu({"with_serialization": False, "no_warning": True})
        description = described(folder / "modelDescription.xml", target.stem, functions, document)
        _advance(bar, "compiler")
        system, suffix = PLATFORMS.get(platform.system(), ("linux", "so"))
        library = folder / f"{MODEL}.{suffix}"
        _compile(compiler, [folder / f"{MODEL}.c", folder / f"{MODEL}_wrap.c"], library, headers)
        _advance(bar, "done")
        machine = {"AMD64": "x86_64", "arm64": "aarch64"}.get(platform.machine(), platform.machine())
        content = {archived.removeprefix("./"): (folder / name).read_bytes() for name, archived in files.items()}
        content |= {
            "modelDescription.xml": description,
            f"binaries/{machine}-{system}/{library.name}": library.read_bytes(),
        }
    if document is not None:
        content["resources/beam.json"] = to_json(document.to_dict()).encode()
    write_file(Path(path), _zipped(content))


def _check_document(document: Document | None, functions: MotionFunctions) -> None:
    """Refuse a document whose beam and law do not have the parameters of the Functions, with the same values."""
    if document is None:
        return
    law = RayleighDamping() if document.damping is None else document.damping
    if not set(functions.parameters) <= set(parameter_signals(Equations(document.model, law))):
        raise InputError("describes another beam or damping law than the Functions do", "document")


def _fmi_headers() -> Path:
    """Return the folder of the FMI 3.0 headers, which the package fmpy contains."""
    found = importlib.util.find_spec("fmpy")
    if found is None or found.origin is None:
        raise InputError("is not installed, but an FMU needs its FMI headers; pip install fmpy", "fmpy")
    folder = Path(found.origin).parent / "c-code"
    if not (folder / "fmi3Functions.h").is_file():
        raise InputError(f"has no FMI 3.0 headers: {folder} lacks fmi3Functions.h; install another version", "fmpy")
    return folder


def _dae_builder(functions: MotionFunctions) -> cs.DaeBuilder:
    """Return the equation of motion as a DaeBuilder, with one scalar variable per signal."""
    dae = cs.DaeBuilder(MODEL)

    def add(signals: Sequence[Signal], causality: str = "local", variability: str = "continuous") -> list[cs.MX]:
        labels = [{"description": s.description, "unit": "" if s.unit == "1" else s.unit} for s in signals]
        return [dae.add(s.name, causality, variability, label) for s, label in zip(signals, labels, strict=True)]

    clamped, driving = functions.base[: 2 * CLAMP_COORDINATES], functions.base[2 * CLAMP_COORDINATES :]
    states, clamp = add(functions.states), add(clamped)
    inputs, parameters = add(driving, "input"), add(functions.parameters, "parameter", "tunable")
    outputs = add(functions.outputs, "output")
    for signal in (*functions.states, *functions.base, *functions.parameters):
        dae.set_start(signal.name, signal.value)
    for signal in (*functions.states, *clamped):
        dae.set_initial(signal.name, "exact")
    q, v = cs.vertcat(*states[: functions.free]), cs.vertcat(*states[functions.free :])
    base, p = cs.vertcat(*clamp, *inputs), cs.vertcat(*parameters)
    derivatives = cs.vertcat(v, functions.rhs(q, v, base, p), base[CLAMP_COORDINATES:])
    for state, derivative in zip([*states, *clamp], cs.vertsplit(derivatives), strict=True):
        dae.eq(dae.der(state), derivative)
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
    failure = compiler_failure([*compiler, *FMU_FLAGS, *own, f"-I{headers}", *map(str, sources)], library)
    if failure:
        advice = "check the command in CC, or use fewer elements or modes"
        raise InputError(f"cannot compile the FMU ({failure}); {advice}", shlex.join(compiler))


def _zipped(content: dict[str, bytes]) -> bytes:
    """Return a zip archive that depends on its content alone, not on the time."""
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
        for name in sorted(content):
            file.writestr(zipfile.ZipInfo(name), content[name], zipfile.ZIP_DEFLATED)
    return archive.getvalue()
