"""Starting values of a mode from response curves, by linear regressions.

With the measured motion h = A exp(i psi) and the force per mass and modal constant G (``oscillator``), g = G/h and the
balance of each point

    W^2 = omega(A)^2 + 2 i c(A) W - kappa g

is linear in kappa, in omega^2, in the coefficient of the change of omega(A)^2 with the amplitude, and in those of the
rate of decay c(A).  Its real and imaginary parts, over |g|, are one regression of all points with phases; exponents and
corners take the best of a list.  Where no phases were measured, sin(psi) is the response per level over the largest
one: exact for a rate of decay that does not depend on the amplitude, also on bent curves.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np
from scipy.optimize import lsq_linear

from ancf_casadi.decay.first_guess import DecayGuess
from ancf_casadi.support.arrays import Array, ComplexArray
from problems.beam.curves.record import ResponseRecord
from problems.decay.laws import DECAY_TERMS, DecayModel
from problems.decay.start import SHAPES
from problems.mode.oscillator import force_factor, motion_amplitudes

LEAST_RATIO = 1e-5  # damping ratio that a start assumes at least, for the scales of the unknowns
EXPONENT_STARTS = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0)  # of the power law


@dataclass(frozen=True)
class Points:
    """Points of the records of one kind of level: W, A and g = G/h, complex or its modulus, (m,)."""

    unit: str
    omega: Array
    amplitude: Array
    g: ComplexArray

    @classmethod
    def of(cls, records: Sequence[ResponseRecord], unit: str) -> Points:
        """Return the points of records whose levels have a unit."""
        omega, amplitude, g = [], [], []
        for record in records:
            W, A = 2 * math.pi * record.f, motion_amplitudes(record)
            h = A * np.exp(1j * motion_phases(record))
            omega.append(W)
            amplitude.append(A)
            g.append(force_factor(record.excitation_unit, W) * record.a / h)
        return cls(unit, *(np.concatenate(part) for part in (omega, amplitude, g)))


def motion_phases(record: ResponseRecord) -> Array:
    """Return the phases psi of the motion (m,), or about those if they were not measured."""
    if record.measured_phases is not None:
        return record.measured_phases - record.sensor.derivatives * math.pi / 2
    response = record.amplitudes / record.a / (2 * math.pi * record.f) ** record.sensor.derivatives
    behind = np.arcsin(response / response.max())
    reference = np.angle(force_factor(record.excitation_unit, 2 * math.pi * record.f))
    return np.asarray(reference - np.where(record.f < record.f[response.argmax()], behind, math.pi - behind))


def guess_of(omega: float, ratio: float, amplitude: float) -> DecayGuess:
    """Return the mode as the guess of a decay, which gives unknowns their scales and first values."""
    length = 1 / (ratio * omega)
    return DecayGuess(0, "", length, length, omega, ratio, amplitude, 0.0, ())


def from_points(model: DecayModel, groups: Sequence[Points], known: float | None) -> dict[str, float]:
    """Return values by name of the laws and, by unit of the level, of the modal constants, from points."""
    best: tuple[float, dict[str, float]] | None = None
    for bending in SHAPES.get(model.frequency_law, ((),)):
        for damping in ((p,) for p in EXPONENT_STARTS) if model.law == "power" else ((),):
            left, values = _regression(model, groups, known, bending, damping)
            if best is None or left < best[0]:
                best = left, values
    assert best is not None
    return best[1]


def _regression(
    model: DecayModel, groups: Sequence[Points], known: float | None, bending: tuple[float, ...], p: tuple[float, ...]
) -> tuple[float, dict[str, float]]:
    """Return the misfit and the values for given exponents and corners."""
    omega, A, g = (np.concatenate([getattr(one, name) for one in groups]) for name in ("omega", "amplitude", "g"))
    weight, middle, none = 1 / np.abs(g), float(np.median(omega)), np.zeros(len(g))
    columns = [np.concatenate([none + 1, none])]
    if model.bends:
        linear = np.eye(len(model.frequency_terms) - len(bending))
        columns += [np.concatenate([model.change(A, *one, *bending), none]) for one in linear]
    first = len(columns)  # of the damping
    names = DECAY_TERMS[model.law] if model.law not in ("linear", "power") else ("zeta",)
    shapes = {
        "zeta": middle * (A / model.reference) ** (p[0] - 1) if p else none + middle,
        "eta1": none + 0.5,
        "eta2": 4 * middle * A / (3 * math.pi),
        "eta0": 2 / (math.pi * middle * A),
    }
    columns += [np.concatenate([none, 2 * shapes[name] * omega]) for name in names]
    owners = np.repeat(np.arange(len(groups)), [len(one.omega) for one in groups])
    forces = [np.concatenate([(-g).real, (-g).imag]) * np.tile(owners == k, 2) for k in range(len(groups))]
    target = np.concatenate([omega**2, none])
    if known is None:
        columns += forces
    else:
        target = target - known * sum(forces)
    rows = np.array(columns).T * np.tile(weight, 2)[:, None]
    size = np.linalg.norm(rows, axis=0)
    lower = np.zeros(len(columns))
    lower[1:first] = -np.inf
    found = lsq_linear(rows / size, target * np.tile(weight, 2), (lower, np.full(len(columns), np.inf)))
    x = found.x / size
    square = max(float(x[0]), 1e-6 * middle**2)
    values = {"omega": math.sqrt(square)}
    if model.bends:
        changes = x[1:first] / (2 * square)
        values |= dict(zip(model.frequency_terms, (*changes.tolist(), *bending), strict=True))
    values |= dict(zip(names, x[first:].tolist(), strict=False))
    if p:
        values["exponent"] = p[0]
    if known is None:
        values |= dict(zip((one.unit for one in groups), x[-len(groups) :].tolist(), strict=True))
    return float(found.cost), values


def modal_constant_of(model: DecayModel, points: Points, values: Mapping[str, float]) -> float:
    """Return the modal constant of points by values of the laws: the median of those of the points."""
    ratio, frequency = law_at(model, points.amplitude, values)
    square = (2 * math.pi * frequency) ** 2 - points.omega**2
    return float(np.median(np.abs(square + 2j * ratio * values["omega"] * points.omega) / np.abs(points.g)))


def law_at(model: DecayModel, amplitude: Array, values: Mapping[str, float]) -> tuple[Array, Array]:
    """Return damping ratio and frequency (Hz) at amplitudes for values of the unknowns by name."""
    names = [one.name for one in model.shared(guess_of(values["omega"], LEAST_RATIO, model.reference))]
    law = [cs.MX(values[name]) for name in names]
    ratio, frequency = model.against_amplitude(amplitude, *law, cs.MX(1), cs.MX(0))
    return np.asarray(cs.evalf(ratio)).ravel(), np.asarray(cs.evalf(frequency)).ravel()
