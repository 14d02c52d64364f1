"""The unknowns of a fit of a beam: guesses, scales, bounds and priors of the names that a user gives.

The parameters of the law are unknown unless they are fixed, and so are those that the records leave open within bounds:
releases, offsets, zeros, the view of a camera.  The user names the others (``fit_beam``).  The names in the result,
with records, sensors and modes counted from 1, are

    alpha, beta, eta1, eta2, ratio1, ...         parameters of the law; in a sum, a second eta1 is called ``eta1_2``
    elastic_modulus, thickness[3:5], tip_mass    properties of the beam (``properties``)
    frequency_1, ...                             factor on the natural frequency of a mode of the response curves
    excitation, or excitation_1, ...             factor on the levels of all response curves, or of each
    base_amplitude_1, ...                        amplitude of the base motion of each motion
    start_force_x_1, start_force_x_rate_1, ...   tip load that holds the beam at the start of each motion, and its rate
    release_1, camera_scale_1, ...               start of the motion, and view of the camera, of each motion
    offset_1_2, zero_1_2                         time offset and zero of the second channel of the first motion

If none is named, a fit of response curves has the natural frequencies, or with other records the elastic modulus:
without one of them, no model is near enough to a resonance.

The scale of an unknown of a sensor is half the distance of its bounds, that of any other its guess.  The scale of a
force is a tenth of E I/L^2, of a moment a tenth of E I/L, and of a rate this times the angular frequency of the first
mode.  The guess of a frequency is the peak of the response over the level, in the record with the smallest response
among those about the mode.

First values.  A motion whose frequency is off by too much slips by whole cycles against its record, and the fit ends in
a wrong minimum.  A record of a free decay shows its frequency without a beam (``decay.first_guess``).  If it is so far
from that of the nearest natural mode at the first values that the decay would slip, the properties are fitted to the
frequencies of the decays first, and the fit of the motions starts from there as well; the best optimum counts.

Along the beam, a large motion shows twice the frequency that it has across: a point comes nearer to the clamp by about
the square of its deflection.  A decay at twice the frequency of another one of its record is therefore left out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain, product

import numpy as np

from ancf_casadi.damping import DampingLaw, Parameter
from ancf_casadi.decay.first_guess import first_guess
from ancf_casadi.dynamics.base_motion import BaseMotion, FixedBase
from ancf_casadi.dynamics.start import LOAD_NAMES, START_LOAD_NAMES
from ancf_casadi.dynamics.tip_load import TipLoad
from ancf_casadi.estimation.problem import FitProblem
from ancf_casadi.estimation.solve import solve
from ancf_casadi.estimation.solver.unknown import Priors, Unknown, with_prior
from ancf_casadi.exceptions import AncfError, InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_keys, choices, two_numbers
from ancf_casadi.vibration.equilibrium import Equilibrium
from ancf_casadi.vibration.modes import natural_modes
from problems.beam.curves.record import ResponseRecord
from problems.beam.motions.record import Channel, MotionRecord
from problems.beam.properties import CLAMP_STIFFNESS, property_value
from problems.beam.values.records import FrequencyRecord, ValueBlock
from problems.beam.values.response import place

LOAD_SCALE = 0.1  # scale of a load, relative to one that bends a beam by about its length
FREQUENCY_RANGE = 0.10  # distance of the bounds of a frequency from its guess, relative
EXCITATION_RANGE = 0.5  # distance of the bounds of an excitation from 1
OTHER_START = 0.02  # second start of a tip mass, and of the compliance of a clamp, relative to the first
MOST_SLIP = 0.25  # cycles by which a decay may slip: from half a cycle on, the nearest minimum is a wrong one
FREQUENCY_ERROR = 0.01  # of a decay, relative to the natural frequency: large motion changes it
DOUBLED = 0.1  # largest relative distance from twice a frequency, for a doubled one that noise hides in part

NATURAL_FREQUENCIES, BASE_AMPLITUDE = "natural_frequencies", "base_amplitude"
COMMON, EACH = "excitation", "excitations"
LOADS = tuple(f"start_{name}" for name in START_LOAD_NAMES)
GROUPS = (NATURAL_FREQUENCIES, COMMON, EACH, BASE_AMPLITUDE, *LOADS)

Bounds = Mapping[str, tuple[float, float]]


def base_name(name: str, number: int) -> str:
    """Return the name of a parameter of a record's base motion."""
    return f"base_{name}_{number}"


def load_name(name: str, number: int) -> str:
    """Return the name of a component of the load at the start of a record, or of its rate."""
    return f"start_{name}_{number}"


def frequency_name(mode: int) -> str:
    """Return the name of the factor on the natural frequency of a mode, from 0."""
    return f"frequency_{mode + 1}"


def loads(record: MotionRecord) -> list[tuple[str, float]]:
    """Return the load at the start of a record, zero where it is unknown, and zero for its rate, by name."""
    start = record.start
    components = (*start.tip_force, start.tip_moment) if isinstance(start, Equilibrium) else (0.0,) * len(LOAD_NAMES)
    return list(zip(START_LOAD_NAMES, (*components, *(0.0,) * len(LOAD_NAMES)), strict=True))


def of_law(law: DampingLaw | None, fixed: Sequence[str]) -> list[Unknown]:
    """Return the parameters of a law that are not fixed."""
    parameters = law.parameters if law else ()
    choices(fixed, [parameter.name for parameter in parameters], "fixed")
    return [_of_parameter(parameter.name, parameter) for parameter in parameters if parameter.name not in fixed]


def of_curves(wanted: Sequence[str], frequencies: Array, records: Sequence[ResponseRecord]) -> list[Unknown]:
    """Return the factors on the natural frequencies (Hz) of the modes of response curves, and on their levels."""
    factors, modes = [], [mode_at_peak(record, frequencies) for record in records]
    for mode in sorted(set(modes)) if NATURAL_FREQUENCIES in wanted else ():
        of_mode = [record for record, record_mode in zip(records, modes, strict=True) if record_mode == mode]
        guess = _peak(min(of_mode, key=lambda record: float(record.amplitudes.max()))) / float(frequencies[mode])
        limits = (1.0 - FREQUENCY_RANGE) * guess, (1.0 + FREQUENCY_RANGE) * guess
        factors.append(Unknown(frequency_name(mode), guess, 1e-3, *limits))  # scale of a frequency, relative
    names = [COMMON] if COMMON in wanted else []
    names += [f"excitation_{k}" for k in range(1, len(records) + 1)] if EACH in wanted else []
    limits = 1.0 - EXCITATION_RANGE, 1.0 + EXCITATION_RANGE
    return factors + [Unknown(name, 1.0, 0.01, *limits) for name in names]  # scale of an excitation without a prior


def of_motions(wanted: Sequence[str], model: Model, records: Sequence[MotionRecord]) -> list[Unknown]:
    """Return the unknowns of motions: amplitudes of their bases, loads at the start, sensors."""
    unknowns = []
    for k, record in enumerate(records, start=1):
        if BASE_AMPLITUDE in wanted:
            unknowns += [
                _of_parameter(base_name(parameter.name, k), parameter) for parameter in record.own_base.parameters
            ]
        unknowns += _of_load(k, record, [name for name in LOADS if name in wanted], model)
        unknowns += _of_sensors(k, record, model)
    return unknowns


def mode_at_peak(record: ResponseRecord, frequencies: Array) -> int:
    """Return the mode, from 0, whose natural frequency is nearest to that of the largest response of a record."""
    return nearest_mode(_peak(record), frequencies)


def nearest_mode(frequency: float, frequencies: Array) -> int:
    """Return the mode, from 0, whose natural frequency has the ratio nearest to 1 to a frequency."""
    return int(np.abs(np.log(np.maximum(frequencies, np.finfo(float).tiny) / frequency)).argmin())


def sought_frequencies(model: Model) -> Array:
    """Return the natural frequencies, Hz, of the modes among which those of records are sought."""
    return natural_modes(model, count=min(12, model.freedoms)).frequencies


def with_bounds_and_priors(unknowns: Sequence[Unknown], bounds: Bounds, priors: Priors) -> list[Unknown]:
    """Return the unknowns with the bounds and the priors that the user gave."""
    names = {unknown.name for unknown in unknowns}
    check_keys(dict(bounds), set(), names, "bounds")
    check_keys(dict(priors), set(), names, "priors")
    restricted_unknowns = []
    for unknown in unknowns:
        with_priors = with_prior(unknown, priors[unknown.name]) if unknown.name in priors else unknown
        if unknown.name in bounds:
            lower, upper = two_numbers(bounds[unknown.name], f"bounds: {unknown.name}")
            if not lower <= unknown.guess <= upper:
                raise InputError(
                    f"the first value {unknown.guess:g} is not within [{lower:g}, {upper:g}]", f"bounds: {unknown.name}"
                )
            if unknown.offset is not None:
                lower = max(lower, unknown.lower / 100)  # a stiffness of zero has no reciprocal
            with_priors = replace(with_priors, lower=lower, upper=upper)
        restricted_unknowns.append(with_priors)
    return restricted_unknowns


def _of_parameter(name: str, parameter: Parameter) -> Unknown:
    """Return a parameter of a law or of a base motion as an unknown."""
    unit = "" if parameter.unit == "1" else parameter.unit
    guess, scale = parameter.value, abs(parameter.value) or 1.0
    return Unknown(name, guess, scale, lower=parameter.lower, upper=parameter.upper, unit=unit)


def _peak(record: ResponseRecord) -> float:
    """Return the frequency of the largest response over the level, Hz."""
    return float(record.f[int(np.argmax(record.amplitudes / record.a))])


def _of_load(number: int, record: MotionRecord, wanted: Sequence[str], model: Model) -> list[Unknown]:
    """Return the unknown components of the load at the start of a record, and of its rate."""
    if not wanted:
        return []
    if not (isinstance(record.start, Equilibrium) or record.start == "equilibrium"):
        raise InputError("must be an equilibrium if its load is to be estimated", "start")
    if record.load is not None:
        raise InputError("cannot be estimated for a record whose load is given", "load")
    if any(name.endswith("rate") for name in wanted) and record.earliest < 0.0:
        raise InputError(
            "samples are, or may be, before the release; while the load changes the beam is not at rest: cut the "
            "record, or estimate no rates",
            "load",
        )
    scales, components = _load_scales(model), []
    for name, value in loads(record):
        if f"start_{name}" in wanted:
            unit = f"N{' m' * ('moment' in name)}{'/s' * name.endswith('rate')}"
            components.append(Unknown(load_name(name, number), value, abs(value) or scales[name], unit=unit))
    return components


def _of_sensors(number: int, record: MotionRecord, model: Model) -> list[Unknown]:
    """Return the unknown release of a record, view of its camera, and offset and zero of each channel."""
    unknowns = []
    if isinstance(record.release_time, tuple):
        unknowns.append(_bounded_unknown(f"release_{number}", record.release_time, "s"))
    for name, limits, _, unit in record.camera.unknowns if record.camera else ():
        if limits:
            unknowns.append(_bounded_unknown(f"{name}_{number}", limits, unit))
    for j, channel in enumerate(record.own_channels, start=1):
        if channel.offset:
            unknowns.append(_bounded_unknown(f"offset_{number}_{j}", channel.offset, "s"))
        if channel.zero:
            unknowns.append(_bounded_unknown(f"zero_{number}_{j}", channel.zero, channel.sensor.unit))
        elif channel.sensor.quantity == "displacement":
            guess = _origin_guess(channel, model)
            unknowns.append(Unknown(f"zero_{number}_{j}", guess, LOAD_SCALE * model.beam.length, unit="m"))
    return unknowns


def _bounded_unknown(name: str, limits: tuple[float, float], unit: str) -> Unknown:
    """Return an unknown whose guess is the middle of its bounds."""
    lower, upper = limits
    return Unknown(name, (lower + upper) / 2, (upper - lower) / 2, lower=lower, upper=upper, unit=unit)


def _origin_guess(channel: Channel, model: Model) -> float:
    """Return the zero of a displacement whose mean is that of the straight beam, m."""
    interpolation = model.interpolation(place(model, channel.sensor))
    straight = np.array(channel.sensor.unit_direction) @ interpolation @ model.straight
    return float(channel.measurement.values.mean() - straight)


def _load_scales(model: Model) -> dict[str, float]:
    stiffness, mass = (property_value(model.beam, name) for name in ("bending_stiffness", "mass_per_length"))
    length = model.beam.length
    sizes = LOAD_SCALE * stiffness / length**2 * np.array([1.0, 1.0, length])
    # angular frequency of a cantilever over (E I/(mu L^4))^1/2
    rate = 3.516 * math.sqrt(stiffness / (mass * length**4))
    return dict(zip(START_LOAD_NAMES, [*sizes.tolist(), *(rate * sizes).tolist()], strict=True))


def starts(
    unknowns: Sequence[Unknown],
    first: Mapping[str, float],
    motions: Sequence[tuple[Model, Sequence[tuple[int, MotionRecord]]]],
    *,
    only_values: bool,
) -> list[dict[str, float]]:
    """Return the starts of a fit, as guesses by name: one, and a second where a fit may end in another minimum.

    For values alone, a soft clamp and a tip mass have a second one; ``motions`` are those of each configuration.
    """
    listed = []
    for unknown in unknowns:
        second = {"tip_mass": OTHER_START * unknown.guess, CLAMP_STIFFNESS: unknown.guess / OTHER_START}.get(
            unknown.name
        )
        listed.append([{}] if second is None or not only_values else [{}, {unknown.name: second}])
    guesses = [
        {name: value for choice in combination for name, value in choice.items()} for combination in product(*listed)
    ]
    try:
        nearer = _of_frequencies([unknown for unknown in unknowns if unknown.name in first], first, motions)
    except AncfError:  # no equilibrium, or no fit: the first values remain
        nearer = {}
    return [nearer, *guesses] if nearer else guesses


def _of_frequencies(
    properties: Sequence[Unknown],
    first: Mapping[str, float],
    motions: Sequence[tuple[Model, Sequence[tuple[int, MotionRecord]]]],
) -> dict[str, float]:
    """Return properties with the frequencies of the decays, near their first values; none if no decay would slip."""
    if not properties:
        return {}
    blocks, slip = [], 0.0
    for model, numbered in motions:
        decays = [decay for _, record in numbered for decay in _decays(record)]
        if not decays:
            continue
        frequencies = sought_frequencies(model)
        measured: dict[int, float] = {}
        for frequency, duration in decays:
            mode = nearest_mode(frequency, frequencies)
            measured.setdefault(mode, frequency)
            slip = max(slip, abs(float(frequencies[mode]) - frequency) * duration)
        modes = sorted(measured)
        values: Array = np.array([measured[mode] for mode in modes])
        record = FrequencyRecord(model, values, std=FREQUENCY_ERROR * values, modes=[mode + 1 for mode in modes])
        blocks.append(ValueBlock(record, first))
    if slip <= MOST_SLIP:
        return {}
    with_weak_priors = tuple(
        replace(unknown, prior=unknown.prior or (unknown.guess, abs(unknown.guess))) for unknown in properties
    )
    return dict(solve(FitProblem(tuple(blocks), with_weak_priors)).fit.estimates)


def _decays(record: MotionRecord) -> list[tuple[float, float]]:
    """Return frequency, Hz, and duration, s, of the free decay in each channel that shows one of its own."""
    driven: list[BaseMotion | TipLoad] = [record.own_base, *([record.load] if record.load else [])]
    ends = [[piece.end for piece in motion.pieces() if math.isfinite(piece.end)] for motion in driven]
    if not ends[0] and not isinstance(record.own_base, FixedBase):
        return []
    release = max([record.origin, *chain(*ends)]) - record.origin + sum(record.release_bounds) / 2
    decays = []
    for channel in record.own_channels:
        try:
            guess = first_guess(channel.measurement, release_time=release)
        except InputError:  # no decay is long enough, or nothing oscillates
            continue
        decays.append((guess.ω / (2 * math.pi), guess.duration))
    return [
        decay
        for decay in decays
        if not any(abs(decay[0] / (2.0 * frequency) - 1.0) < DOUBLED for frequency, _ in decays)
    ]
