"""The unknowns of a fit to the large motion of a beam: names, guesses, scales, bounds and units.

    alpha, beta, eta1, eta2, ratio1, ...        parameters of the law; in a sum, a second eta1 is called ``eta1_2``
    width, thickness, density, elastic_modulus  factors on the properties, common to all elements
    base_amplitude_1, ...                       amplitude of the base motion of each record
    start_force_x_1, start_force_x_rate_1, ...  tip load that holds the beam at the start of each record, and its rate

The scale of an unknown is its guess.  The scale of a force is a tenth of E I/L^2, of a moment a tenth of E I/L, and of
a rate this times the angular frequency of the first mode.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ancf_casadi.damping import DampingLaw, Parameter
from ancf_casadi.dynamics.derivatives.release_load import LOAD, START
from ancf_casadi.estimation.least_squares import Unknown
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import PROPERTIES
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.inputs import array, choices, shown
from ancf_casadi.vibration.equilibrium import Equilibrium
from problems.transient.marker_record import MarkerRecord

NEAR = 0.10  # distance of the bounds of a property from its guess
SLIGHT = 0.1  # scale of a load, relative to one that bends a beam by about its length
FIRST_MODE = 3.516  # angular frequency of a cantilever over (E I/(mu L^4))^1/2

Bounds = Mapping[str, tuple[float, float]]


def transient_unknowns(
    model: Model,
    records: Sequence[MarkerRecord],
    damping: DampingLaw,
    properties: Sequence[str],
    base_amplitude: bool,
    load: Sequence[str],
    fixed: Sequence[str],
    bounds: Bounds,
) -> list[Unknown]:
    """Return the unknowns; the arguments are those of ``fit_transient``.

    Raises
    ------
    InputError
        If a name is unknown, nothing is to be estimated, bounds are not a pair or do not contain the guess, or a
        record whose load is to be estimated does not start from an equilibrium.
    """
    choices(fixed, [parameter.name for parameter in damping.parameters], "fixed")
    choices(properties, PROPERTIES, "properties")
    unknowns = []

    def add(name: str, guess: float, usual: tuple[float, float], unit: str, scale: float = 0.0) -> None:
        lower, upper = _pair(bounds[name], f"bounds: {name}") if name in bounds else usual
        unknowns.append(Unknown(name, guess, scale or abs(guess) or 1.0, lower=lower, upper=upper, unit=unit))

    def add_parameter(name: str, parameter: Parameter) -> None:
        unit = "" if parameter.unit == "1" else parameter.unit
        add(name, parameter.value, (parameter.lower, parameter.upper), unit)

    for parameter in damping.parameters:
        if parameter.name not in fixed:
            add_parameter(parameter.name, parameter)
    for name in properties:
        add(name, 1.0, (1.0 - NEAR, 1.0 + NEAR), "")
    for k, record in enumerate(records):
        if base_amplitude:
            for parameter in record.own_base.parameters:
                add_parameter(amplitude_name(k, parameter.name), parameter)
        if load:
            if not (isinstance(record.start, Equilibrium) or record.start == "equilibrium"):
                raise InputError("must be an equilibrium if its load is to be estimated", "start")
            scales = _load_scales(model)
            for name, value in loads(record):
                if name in load:
                    unit = f"N{' m' * ('moment' in name)}{'/s' * name.endswith('rate')}"
                    add(load_name(k, name), value, (-math.inf, math.inf), unit, scales[name])
    if not unknowns:
        raise InputError(
            "nothing is to be estimated; give a coefficient a guess above 0, or fix fewer of them", "damping"
        )
    strange = set(bounds) - {unknown.name for unknown in unknowns}
    if strange:
        raise InputError(f"{', '.join(sorted(strange))}: not among the unknowns; remove these bounds", "bounds")
    return unknowns


def amplitude_name(record: int, name: str) -> str:
    """Return the name of a parameter of a record's base motion."""
    return f"base_{name}_{record + 1}"


def load_name(record: int, name: str) -> str:
    """Return the name of a component of the load at the start of a record, or of its rate."""
    return f"start_{name}_{record + 1}"


def loads(record: MarkerRecord) -> list[tuple[str, float]]:
    """Return the load at the start of a record, zero where it is unknown, and zero for its rate, by name."""
    start = record.start
    known = (*start.tip_force, start.tip_moment) if isinstance(start, Equilibrium) else (0.0,) * len(LOAD)
    return list(zip(START, (*known, *(0.0,) * len(LOAD)), strict=True))


def _pair(bounds: Any, where: str) -> tuple[float, float]:
    values = array(bounds, where, finite=False)
    if values.shape != (2,):
        raise InputError(f"must be a pair (lower, upper), got {shown(bounds)}", where)
    return float(values[0]), float(values[1])


def _load_scales(model: Model) -> dict[str, float]:
    width, thickness, density, modulus = model.properties
    stiffness = float(np.mean(modulus * width * thickness**3 / 12))
    length, mass = model.beam.length, float(np.mean(density * width * thickness))
    sizes = SLIGHT * stiffness / length**2 * np.array([1.0, 1.0, length])
    rate = FIRST_MODE * math.sqrt(stiffness / (mass * length**4))
    return dict(zip(START, [*sizes.tolist(), *(rate * sizes).tolist()], strict=True))
