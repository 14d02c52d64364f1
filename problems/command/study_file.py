"""Reading of beams, damping laws and base motions from TOML files, and of beams and laws from JSON documents.

A TOML file has the table ``[beam]``, either with the keys of ``Beam.uniform`` or with the single key ``document``, the
path of a JSON document.  The damping of the document holds unless the file has its own.  ``TABLE_KEYS`` lists all
tables and keys.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ancf_casadi.damping import DampingLaw, ModalDamping, QuadraticDamping, RayleighDamping
from ancf_casadi.dynamics.base_motion import HarmonicBase
from ancf_casadi.exceptions import InputError
from ancf_casadi.export.document.model_document import Document, read_document
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.strain import StrainMeasures
from ancf_casadi.support.files import read_toml
from ancf_casadi.support.inputs import check_keys, located, numbers, shown
from ancf_casadi.vibration.modes import natural_modes
from problems.matching.measured_modes import MeasuredModes
from problems.matching.unknowns import Global, PerElement, PropertyUnknown, Smooth

MODES = ("frequency_std", "points", "shapes", "shape_std")  # keys of [match] that belong to MeasuredModes
MATCH = ("bounds", "objective", "starts", "seed", "unknowns")
SIMULATION = ("sample_rate", "start", "method", "tolerance")  # optional keys of [simulation]
TABLES = ("beam", "match", "damping", "base", "simulation")
TABLE_KEYS = """\
tables of a TOML file:
  [beam]        length (m), elements; width, thickness (m), density (kg/m^3),
                elastic_modulus (Pa): each a number, or a list with one value
                per element; optional: axis, gravity (m/s^2), tip_mass (kg),
                clamp_stiffness (N m/rad);
                or only document = "BEAM.json": a JSON document with a beam and
                its damping; a relative path starts at the folder of this file
  [match]       targets (Hz), frequency_std (Hz), bounds, starts, seed,
                objective ("least-squares" or "worst-error");
                for measured shapes: points (m), shapes, shape_std;
                unknowns = {width = "element", density = "global",
                thickness = {smooth = 3, bounds = 0.05}}
  [[damping]]   law = "rayleigh": alpha (1/s), beta (s),
                stiffness ("strain-rate", "tangent" or "reference")
                law = "quadratic": eta1 (1/s), eta2 (1/m)
                law = "modal": ratios, frequencies (Hz)
                several tables add up
  [base]        amplitude (m), frequency (Hz), stop (s), direction,
                stop_at ("rest" or "once")
  [simulation]  duration (s), sample_rate (1/s), tolerance,
                method ("auto", "idas" or "radau"),
                start ("equilibrium", "straight" or "impact")
"""


@dataclass(frozen=True)
class Simulation:
    """The arguments of ``simulate`` from a file.

    Parameters
    ----------
    model : Model
        The beam.
    damping : DampingLaw or None
        The law, or the sum of several.
    base : HarmonicBase or None
        Motion of the clamp.
    settings : dict
        Other arguments of ``simulate``.
    """

    model: Model
    damping: DampingLaw | None
    base: HarmonicBase | None
    settings: dict[str, Any]


def read_source(path: str) -> Document:
    """Read a beam and its damping from a TOML file, or from a JSON document (a name that ends in ``.json``).

    Raises
    ------
    InputError
        If the file cannot be read, or a table, key or value cannot be used.
    """
    return read_document(path) if _is_document(path) else _source(_tables(path), path)


def read_model(path: str) -> Model:
    """Read the beam of a file, with its strain measures.

    Raises
    ------
    InputError
        As ``read_source``.
    """
    return read_document(path).model if _is_document(path) else _beam(_tables(path), path).model


def read_match(path: str) -> tuple[Beam, dict[str, Any]]:
    """Read a beam and the arguments of ``match_frequencies``.

    Raises
    ------
    InputError
        As ``read_source``, or if the strain measures of the beam are not those of a match.
    """
    tables = _tables(path)
    model = _beam(tables, path).model
    if model.measures != StrainMeasures():
        raise InputError(
            "the document has strain measures that a match does not support; use the defaults", f"{path}: [beam]"
        )
    where = f"{path}: [match]"
    request = dict(_table(tables.get("match"), {"targets"}, {*MODES, *MATCH}, where))
    measured = {key: request.pop(key) for key in MODES if key in request}
    with located(where):
        targets = list(numbers(request["targets"], "targets"))
        request["targets"] = MeasuredModes(frequencies=tuple(targets), **measured) if measured else targets
    if "unknowns" in request:
        request["unknowns"] = _unknowns(request["unknowns"], where)
    return model.beam, request


def read_simulation(path: str) -> Simulation:
    """Read a beam, its damping, the motion of its base and the settings of the simulation.

    Raises
    ------
    InputError
        As ``read_source``.
    """
    tables = _tables(path)
    source, where = _source(tables, path), f"{path}: [simulation]"
    settings = _table(tables.get("simulation"), {"duration"}, set(SIMULATION), where)
    return Simulation(source.model, source.damping, _base(tables.get("base"), path), settings)


def _is_document(path: str) -> bool:
    return Path(path).suffix.lower() == ".json"


def _tables(path: str) -> dict[str, Any]:
    if _is_document(path):
        raise InputError(
            f'a document holds only beam and damping; write a TOML file with [beam] document = "{Path(path).name}"',
            path,
        )
    tables = read_toml(path)
    check_keys(tables, {"beam"}, set(TABLES), path)
    return tables


def _source(tables: dict[str, Any], path: str) -> Document:
    """Return the beam of a file with its damping."""
    source = _beam(tables, path)
    if "damping" not in tables:
        return source
    return replace(source, damping=_damping(tables["damping"], source.model, path))


def _beam(tables: dict[str, Any], path: str) -> Document:
    """Return the beam of a file, with damping if it comes from a document."""
    table, where = tables["beam"], f"{path}: [beam]"
    if isinstance(table, dict) and "document" in table:
        check_keys(table, {"document"}, set(), where)
        if not isinstance(table["document"], str):
            raise InputError(f"must be the name of a file, got {shown(table['document'])}", f"{where}: document")
        with located(f"{where}: document"):
            return read_document(Path(path).parent / table["document"])
    return Document(Model(Beam.from_table(table, path)))


def _unknowns(table: Any, where: str) -> tuple[PropertyUnknown, ...]:
    if not isinstance(table, dict):
        raise InputError(f"must be a table of properties, got {shown(table)}", f"{where}: unknowns")
    with located(where):
        return tuple(_unknown(name, given) for name, given in table.items())


def _unknown(name: str, given: Any) -> PropertyUnknown:
    """Make an unknown from "global", "element", {smooth = 3}, or {element = true, bounds = 0.05}."""
    table = {given: True} if given in ("global", "element") else given
    kinds = sorted({"global", "element", "smooth"} & set(table)) if isinstance(table, dict) else []
    usable = len(kinds) == 1 and set(table) <= {kinds[0], "bounds"}
    if not usable or (kinds[0] != "smooth" and table[kinds[0]] is not True):
        raise InputError(
            f'must be "global", "element", {{smooth = 3}} or {{element = true, bounds = 0.05}}, got {shown(given)}',
            f"unknowns: {name}",
        )
    bounds = table.get("bounds")
    if kinds[0] == "smooth":
        return Smooth(name, terms=table["smooth"], bounds=bounds)
    return Global(name, bounds) if kinds[0] == "global" else PerElement(name, bounds)


def _table(table: Any, required: set[str], optional: set[str], where: str) -> dict[str, Any]:
    if table is None:
        raise InputError("the table is missing; --help lists its keys", where)
    if not isinstance(table, dict):
        raise InputError(f"must be a table, got {shown(table)}", where)
    check_keys(table, required, optional, where)
    return table


def _base(table: Any, path: str) -> HarmonicBase | None:
    if table is None:
        return None
    where = f"{path}: [base]"
    given = _table(table, {"amplitude", "frequency"}, {"stop", "direction", "stop_at"}, where)
    with located(where):
        return HarmonicBase(**given)


def _damping(tables: Any, model: Model, path: str) -> DampingLaw | None:
    if isinstance(tables, dict):
        tables = [tables]
    if not isinstance(tables, list):
        raise InputError("must be a table [damping], or several [[damping]]", path)
    total: DampingLaw | None = None
    for table in tables:
        law = _law(table, model, f"{path}: [damping]")
        total = law if total is None else total + law
    return total


def _law(table: Any, model: Model, where: str) -> DampingLaw:
    known = {
        "rayleigh": {"alpha", "beta", "stiffness"},
        "quadratic": {"eta1", "eta2"},
        "modal": {"ratios", "frequencies"},
    }
    kind = table.get("law") if isinstance(table, dict) else None
    if not isinstance(kind, str) or kind not in known:
        raise InputError(f"law must be one of {', '.join(known)}, got {shown(kind)}", where)
    required = {"law", "ratios"} if kind == "modal" else {"law"}
    given = _table(table, required, known[kind], where)
    arguments = {key: value for key, value in given.items() if key != "law"}
    if kind != "modal":
        with located(where):
            return RayleighDamping(**arguments) if kind == "rayleigh" else QuadraticDamping(**arguments)
    ratios = numbers(arguments.pop("ratios"), f"{where}: ratios")
    if "frequencies" in arguments:
        arguments["frequencies"] = numbers(arguments["frequencies"], f"{where}: frequencies")
    count = min(max(1, len(ratios)), model.size - model.free.start)
    with located(where):
        return ModalDamping(natural_modes(model, count=count), ratios, **arguments)
