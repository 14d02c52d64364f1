"""The unknowns of a fit to steady-state vibration: names, guesses, scales and bounds.

    alpha, beta, eta1, eta2, ratio1, ...         parameters of the law
    frequency_1, ...                             factor on the natural frequency of a mode
    excitation, or excitation_1, ...             factor on the levels of all records, or of each
    width, thickness, density, elastic_modulus   factors on the properties, common to all elements
    tip_mass, clamp_stiffness                    factors on these

The guess of a frequency is the peak of the response over the level, in the record with the smallest response among
those about the mode.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.estimation.least_squares import Unknown
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import LUMPED, PROPERTIES
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.inputs import check_keys, choices
from problems.response.record import ResponseRecord
from problems.transient.motion_record import MotionRecord
from problems.transient.unknowns import NEAR, Bounds, of_parameter, of_sensors, within

KNOWN = (*PROPERTIES, *LUMPED)
FREQUENCY_RANGE = 0.10  # distance of the bounds of a frequency from its guess, relative
TYPICAL_FREQUENCY = 1e-3  # scale of a frequency, relative
TYPICAL_EXCITATION = 0.01  # scale of an excitation without a standard deviation, relative
EXCITATION_RANGE = 0.5  # distance of the bounds of an excitation from 1
WIDEST = 100.0  # factor on a tip mass or a clamp stiffness, either way, without other bounds


def frequency_name(mode: int) -> str:
    """Return the name of the factor on the natural frequency of a mode, from 0."""
    return f"frequency_{mode + 1}"


def excitation_name(record: int, excitation: str) -> str:
    """Return the name of the factor on the levels of a record."""
    return "excitation" if excitation == "common" else f"excitation_{record + 1}"


def mode_of(record: ResponseRecord, frequencies: np.ndarray) -> int:
    """Return the mode, from 0, whose natural frequency is nearest to that of the largest response of a record."""
    return int(np.argmin(np.abs(np.log(frequencies / _peak(record)))))


def response_unknowns(
    model: Model,
    frequencies: np.ndarray,
    records: Sequence[ResponseRecord],
    motions: Sequence[MotionRecord],
    law: DampingLaw,
    properties: Sequence[str],
    excitation: str,
    fixed: Sequence[str],
    bounds: Bounds,
) -> list[Unknown]:
    """Return the unknowns; the arguments are those of ``fit_response``, with the natural frequencies of the modes.

    Raises
    ------
    InputError
        If a name is unknown, nothing is to be estimated, the beam lacks a property, or bounds are not a pair or do not
        contain the guess.
    """
    choices(fixed, [parameter.name for parameter in law.parameters], "fixed")
    found = [of_parameter(own.name, own) for own in law.parameters if own.name not in fixed]
    if not properties:
        found += _frequencies(frequencies, records)
    for name in properties:
        if name in LUMPED:
            _check_lumped(model, name)
        near = name not in LUMPED
        limits = (1.0 - NEAR, 1.0 + NEAR) if near else (1 / WIDEST, WIDEST)
        found.append(Unknown(name, 1.0, lower=limits[0], upper=limits[1]))
    if excitation != "known":
        names = dict.fromkeys(excitation_name(k, excitation) for k in range(len(records)))
        limits = 1.0 - EXCITATION_RANGE, 1.0 + EXCITATION_RANGE
        found += [Unknown(name, 1.0, TYPICAL_EXCITATION, *limits) for name in names]
    for k, motion in enumerate(motions):
        found += of_sensors(k, motion, model)
    if not found:
        raise InputError(
            "nothing is to be estimated; give a coefficient a guess above 0, or fix fewer of them", "damping"
        )
    check_keys(dict(bounds), set(), {unknown.name for unknown in found}, "bounds")
    return [within(unknown, bounds) for unknown in found]


def _frequencies(frequencies: np.ndarray, records: Sequence[ResponseRecord]) -> list[Unknown]:
    """Return the factors on the natural frequencies of the modes that the records are about."""
    found = []
    modes = [mode_of(record, frequencies) for record in records]
    for mode in sorted(set(modes)):
        own = [record for record, one in zip(records, modes, strict=True) if one == mode]
        guess = _peak(min(own, key=lambda record: float(record.amplitudes.max()))) / float(frequencies[mode])
        limits = (1.0 - FREQUENCY_RANGE) * guess, (1.0 + FREQUENCY_RANGE) * guess
        found.append(Unknown(frequency_name(mode), guess, TYPICAL_FREQUENCY, *limits))
    return found


def _peak(record: ResponseRecord) -> float:
    """Return the frequency of the largest response over the level, Hz."""
    return float(record.f[int(np.argmax(record.amplitudes / record.a))])


def _check_lumped(model: Model, name: str) -> None:
    value = getattr(model.beam, name)
    if not (value > 0.0 and np.isfinite(value)):
        what = "a tip mass" if name == "tip_mass" else "an elastic clamp (clamp_stiffness)"
        raise InputError(f"the beam has no {name} as a first value; give the beam {what}", "properties")
