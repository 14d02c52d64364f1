"""The unknowns of a fit to the large motion of a beam: names, guesses, scales, bounds and units.

    alpha, beta, eta1, eta2, ratio1, ...        parameters of the law; in a sum, a second eta1 is called ``eta1_2``
    width, thickness, density, elastic_modulus  factors on the properties, common to all elements
    base_amplitude_1, ...                       amplitude of the base motion of each record
    start_force_x_1, start_force_x_rate_1, ...  tip load that holds the beam at the start of each record, and its rate
    release_1, camera_scale_1, ...              start of the motion, and view of the camera, of each record
    offset_1_2, zero_1_2                        time offset and zero of the second channel of the first record

The scale of an unknown of a sensor is half the distance of its bounds, that of any other its guess.  The scale of a
force is a tenth of E I/L^2, of a moment a tenth of E I/L, and of a rate this times the angular frequency of the first
mode.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol, runtime_checkable

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw, Parameter
from ancf_casadi.dynamics.derivatives.release_load import LOAD, START
from ancf_casadi.estimation.least_squares import Unknown
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import PROPERTIES
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import array, check_keys, choices, shown
from ancf_casadi.vibration.equilibrium import Equilibrium
from problems.transient.motion_record import Channel, MotionRecord

NEAR = 0.10  # distance of the bounds of a property from its guess
SLIGHT = 0.1  # scale of a load, relative to one that bends a beam by about its length
FIRST_MODE = 3.516  # angular frequency of a cantilever over (E I/(mu L^4))^1/2

Bounds = Mapping[str, tuple[float, float]]


@runtime_checkable
class Evidence(Protocol):
    """Further measurements of the same beam, such as a ``StaticRecord``, that enter a fit with its unknowns."""

    @property
    def deviations(self) -> Array | None:
        """Standard deviations of the measured values; None if they are not known."""

    def residuals(self, given: Mapping[str, cs.MX]) -> cs.MX:
        """Return computed less measured values over their standard deviations, (m,), for unknowns by name."""


def transient_unknowns(
    model: Model,
    records: Sequence[MotionRecord],
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
    found = [of_parameter(own.name, own) for own in damping.parameters if own.name not in fixed]
    found += [Unknown(name, 1.0, lower=1.0 - NEAR, upper=1.0 + NEAR) for name in properties]
    for k, record in enumerate(records):
        if base_amplitude:
            found += [of_parameter(amplitude_name(k, own.name), own) for own in record.own_base.parameters]
        if load:
            found += _of_load(k, record, load, model)
        found += of_sensors(k, record, model)
    if not found:
        raise InputError(
            "nothing is to be estimated; give a coefficient a guess above 0, or fix fewer of them", "damping"
        )
    check_keys(dict(bounds), set(), {unknown.name for unknown in found}, "bounds")
    return [within(unknown, bounds) for unknown in found]


def of_parameter(name: str, parameter: Parameter) -> Unknown:
    """Return a parameter of a law or of a base motion as an unknown."""
    unit = "" if parameter.unit == "1" else parameter.unit
    guess, scale = parameter.value, abs(parameter.value) or 1.0
    return Unknown(name, guess, scale, lower=parameter.lower, upper=parameter.upper, unit=unit)


def _of_load(k: int, record: MotionRecord, load: Sequence[str], model: Model) -> list[Unknown]:
    """Return the unknown components of the load at the start of a record, and of its rate."""
    if not (isinstance(record.start, Equilibrium) or record.start == "equilibrium"):
        raise InputError("must be an equilibrium if its load is to be estimated", "start")
    if record.load is not None:
        raise InputError("cannot be estimated for a record whose load is given", "load")
    if any(name.endswith("rate") for name in load) and record.earliest < 0.0:
        raise InputError(
            "samples are, or may be, before the release; while the load changes the beam is not at rest: cut the "
            "record, or estimate no rates",
            "load",
        )
    scales = _load_scales(model)
    units = {name: f"N{' m' * ('moment' in name)}{'/s' * name.endswith('rate')}" for name in load}
    values = [(name, value) for name, value in loads(record) if name in load]
    return [Unknown(load_name(k, name), value, abs(value) or scales[name], unit=units[name]) for name, value in values]


def of_sensors(k: int, record: MotionRecord, model: Model) -> list[Unknown]:
    """Return the unknown release of a record, view of its camera, and offset and zero of each channel."""
    found = []
    if isinstance(record.release, tuple):
        found.append(_between(f"release_{k + 1}", record.release, "s"))
    for name, limits, _, unit in record.camera.unknowns if record.camera else ():
        if limits:
            found.append(_between(f"{name}_{k + 1}", limits, unit))
    for j, channel in enumerate(record.own_channels):
        if channel.offset:
            found.append(_between(f"offset_{k + 1}_{j + 1}", channel.offset, "s"))
        if channel.zero:
            found.append(_between(f"zero_{k + 1}_{j + 1}", channel.zero, channel.sensor.unit))
        elif channel.sensor.quantity == "displacement":
            guess = _origin_guess(channel, model)
            found.append(Unknown(f"zero_{k + 1}_{j + 1}", guess, SLIGHT * model.beam.length, unit="m"))
    return found


def _between(name: str, limits: tuple[float, float], unit: str) -> Unknown:
    """Return an unknown whose guess is the middle of its bounds."""
    lower, upper = limits
    return Unknown(name, (lower + upper) / 2, (upper - lower) / 2, lower=lower, upper=upper, unit=unit)


def _origin_guess(channel: Channel, model: Model) -> float:
    """Return the zero of a displacement whose mean is that of the straight beam, m."""
    point = model.beam.length if channel.sensor.point is None else channel.sensor.point
    straight = np.array(channel.sensor.unit_direction) @ model.interpolation(point) @ model.straight
    return float(channel.measurement.values.mean() - straight)


def within(unknown: Unknown, bounds: Bounds) -> Unknown:
    """Return an unknown with the bounds that the user gave."""
    if unknown.name not in bounds:
        return unknown
    lower, upper = _pair(bounds[unknown.name], f"bounds: {unknown.name}")
    return replace(unknown, lower=lower, upper=upper)


def amplitude_name(record: int, name: str) -> str:
    """Return the name of a parameter of a record's base motion."""
    return f"base_{name}_{record + 1}"


def load_name(record: int, name: str) -> str:
    """Return the name of a component of the load at the start of a record, or of its rate."""
    return f"start_{name}_{record + 1}"


def loads(record: MotionRecord) -> list[tuple[str, float]]:
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
