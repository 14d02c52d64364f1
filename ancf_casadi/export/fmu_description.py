"""Description of an FMU: CasADi's ``modelDescription.xml`` with what CasADi leaves out.

Added are all digits of the start values, the definitions of the units, the tolerance, and what the model is.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import casadi as cs

from ancf_casadi.damping import SumOfLaws
from ancf_casadi.dynamics.signals import MotionFunctions
from ancf_casadi.export.identification import Provenance
from ancf_casadi.export.model_document import Document
from ancf_casadi.reduction.reduced import ReducedFunctions
from ancf_casadi.version import __version__

CLAMP_COORDINATES = 3  # coordinates of the clamp: x, y and rotation
BASE_UNITS = {
    "kg": {"kg": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
}
FMU_TOLERANCE = "1e-8"  # recommended to importers: CasADi declares nominal values of 1, for which 1e-5 is too coarse
MODAL_TOLERANCE = "1e-10"  # for modal coordinates, which are far smaller than 1


def described(path: Path, title: str, functions: MotionFunctions, document: Document | None) -> bytes:
    """Return CasADi's model description in a file, completed for a model with a title and, if given, its document."""
    tree = ET.parse(path)
    root = tree.getroot()
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
    tolerance = MODAL_TOLERANCE if isinstance(functions, ReducedFunctions) else FMU_TOLERANCE
    root.insert(2, ET.Element("DefaultExperiment", startTime="0", tolerance=tolerance))
    ET.indent(tree)
    content: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return content


def _complete_variables(variables: ET.Element, functions: MotionFunctions) -> None:
    """Set all digits of the start values and the units of the derivatives; remove CasADi's auxiliary variables."""
    differentiated = (*functions.states, *functions.base[: 2 * CLAMP_COORDINATES])
    signals = {s.name: s for s in (*functions.parameters, *functions.states, *functions.base, *functions.outputs)}
    derivative_units = {f"der({signal.name})": _per_second(signal.unit) for signal in differentiated}
    for variable in list(variables):
        name = variable.attrib["name"]
        if name.startswith("__assign__"):  # CasADi's names for right-hand sides
            variables.remove(variable)
        if "start" in variable.attrib:
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
    parts = [f"Beam of {beam.elements} elements, {beam.length:g} m long, {damping}"]
    parts += [f"modes kept: {functions.free}"] if reduced else []
    parts += [f"identified by {found.summary()}" for found in document.identifications]
    return "; ".join(parts)


def _per_second(unit: str) -> str:
    """Return the unit of a time derivative."""
    return f"{unit}2" if unit.endswith("/s") else f"{unit}/s"


def _exponents(unit: str) -> dict[str, int] | None:
    """Return the exponents of the base units in a unit such as ``kg/m3``; None if FMI cannot express the unit."""
    exponents: dict[str, int] = {}
    above, *below = unit.split("/")
    for sign, product in [(1, above), *((-1, part) for part in below)]:
        for base, power in re.findall(r"([A-Za-z]+)([^ ]*)", product):
            if base not in BASE_UNITS or not re.fullmatch(r"\d*", power):
                return None
            for name, exponent in BASE_UNITS[base].items():
                exponents[name] = exponents.get(name, 0) + sign * exponent * int(power or 1)
    return exponents


def _xml_text(text: str) -> str:
    """Return a text without the characters that XML cannot hold."""
    return re.sub("[\x00-\x1f\ud800-\udfff\ufffe\uffff]", "?", text)
