"""Beams, laws and base motions from TOML files.

A file has the table ``[beam]``, with the keys of ``Beam.uniform``, and as the command asks

    [match]       targets (Hz), frequency_std (Hz), bounds, objective, starts, seed;
                  points (m), shapes, shape_std where shapes were measured;
                  unknowns = {width = "element", density = "global", thickness = {smooth = 3, bounds = 0.05}}
    [[damping]]   law = "rayleigh":  alpha, beta, stiffness
                  law = "quadratic": eta1 (1/s), eta2 (1/m)
                  law = "modal":     ratios, frequencies (Hz);  several tables add up
    [base]        amplitude (m), frequency (Hz), stop (s), direction, stop_at
    [simulation]  duration (s), sample_rate (1/s), start, method, tolerance
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from ancf_casadi.beam import Beam
from ancf_casadi.damping import DampingLaw, ModalDamping, QuadraticDamping, RayleighDamping
from ancf_casadi.exceptions import InputError
from ancf_casadi.excitation import HarmonicBase
from ancf_casadi.inputs import check_keys, number, read_toml
from ancf_casadi.model import Model
from ancf_casadi.modes import natural_modes
from problems.matching_unknowns import Global, PerElement, PropertyUnknown, Smooth
from problems.measured_modes import MeasuredModes

Made = TypeVar("Made")

MODES = ("frequency_std", "points", "shapes", "shape_std")  # what [match] may have of MeasuredModes
MATCH = ("bounds", "objective", "starts", "seed", "unknowns")
TABLES = ("beam", "match", "damping", "base", "simulation")


@dataclass(frozen=True)
class Simulation:
    """What ``simulate`` is asked for in a file.

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


def read_beam(path: str) -> Beam:
    """Read the beam of a file.

    Raises
    ------
    InputError
        If the file cannot be read, or a table, key or value is not usable.
    """
    return Beam.from_table(_document(path).get("beam"), path)


def read_match(path: str) -> tuple[Beam, dict[str, Any]]:
    """Read a beam, and the arguments of ``match_frequencies`` to match it.

    Raises
    ------
    InputError
        As ``read_beam``.
    """
    document = _document(path)
    beam = Beam.from_table(document.get("beam"), path)
    where = f"{path}: [match]"
    request = dict(_table(document.get("match"), {"targets"}, {*MODES, *MATCH}, where))
    measured = {key: request.pop(key) for key in MODES if key in request}
    targets = _made(lambda: numbers(request["targets"], "targets"), where)
    request["targets"] = (
        _made(lambda: MeasuredModes(frequencies=tuple(targets), **measured), where) if measured else targets
    )
    if "unknowns" in request:
        request["unknowns"] = _unknowns(request["unknowns"], where)
    return beam, request


def read_simulation(path: str) -> Simulation:
    """Read a beam, its damping, the motion of its base and the settings of the simulation.

    Raises
    ------
    InputError
        As ``read_beam``.
    """
    document = _document(path)
    model = Model(Beam.from_table(document.get("beam"), path))
    where = f"{path}: [simulation]"
    settings = _table(document.get("simulation"), {"duration"}, {"sample_rate", "start", "method", "tolerance"}, where)
    return Simulation(
        model, _damping(document.get("damping", []), model, path), _base(document.get("base"), path), settings
    )


def _unknowns(table: Any, where: str) -> tuple[PropertyUnknown, ...]:
    if not isinstance(table, dict):
        raise InputError(f"must be a table of properties, got {table!r}", f"{where}: unknowns")
    return tuple(_made(partial(_unknown, name, given), where) for name, given in table.items())


def _unknown(name: str, given: Any) -> PropertyUnknown:
    """Make an unknown from "global", "element", {smooth = 3}, or {element = true, bounds = 0.05}."""
    table = {given: True} if isinstance(given, str) else given
    kinds = sorted({"global", "element", "smooth"} & set(table)) if isinstance(table, dict) else []
    if len(kinds) != 1 or set(table) - {kinds[0], "bounds"}:
        raise InputError(
            f'must be "global", "element", {{smooth = 3}} or {{element = true, bounds = 0.05}}, got {given!r}',
            f"unknowns: {name}",
        )
    bounds = table.get("bounds")
    if kinds[0] == "smooth":
        return Smooth(name, terms=table["smooth"], bounds=bounds)
    return Global(name, bounds) if kinds[0] == "global" else PerElement(name, bounds)


def _document(path: str) -> dict[str, Any]:
    document = read_toml(path)
    check_keys(document, {"beam"}, set(TABLES), path)
    return document


def _table(table: Any, required: set[str], optional: set[str], where: str) -> dict[str, Any]:
    if table is None:
        raise InputError("the table is missing", where)
    if not isinstance(table, dict):
        raise InputError(f"must be a table, got {table!r}", where)
    check_keys(table, required, optional, where)
    return table


def _base(table: Any, path: str) -> HarmonicBase | None:
    if table is None:
        return None
    where = f"{path}: [base]"
    given = _table(table, {"amplitude", "frequency"}, {"stop", "direction", "stop_at"}, where)
    return _made(lambda: HarmonicBase(**given), where)


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
        raise InputError(f"law must be one of {', '.join(known)}, got {kind!r}", where)
    required = {"law", "ratios"} if kind == "modal" else {"law"}
    given = _table(table, required, known[kind], where)
    arguments = {key: value for key, value in given.items() if key != "law"}
    if kind == "rayleigh":
        return _made(lambda: RayleighDamping(**arguments), where)
    if kind == "quadratic":
        return _made(lambda: QuadraticDamping(**arguments), where)
    ratios = numbers(arguments.pop("ratios"), f"{where}: ratios")
    if "frequencies" in arguments:
        arguments["frequencies"] = numbers(arguments["frequencies"], f"{where}: frequencies")
    count = min(max(1, len(ratios)), model.size - model.free.start)
    return _made(lambda: ModalDamping(natural_modes(model, count=count), ratios, **arguments), where)


def numbers(values: Any, where: str) -> list[float]:
    """Return a list of finite numbers.

    Raises
    ------
    InputError
        If it is anything else.
    """
    if not isinstance(values, list | tuple):
        raise InputError(f"must be a list of numbers, got {values!r}", where)
    return [number(value, where) for value in values]


def _made(make: Callable[[], Made], where: str) -> Made:
    try:
        return make()
    except InputError as error:
        raise InputError(str(error), where) from None
