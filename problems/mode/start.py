"""Starting values of a mode from response curves, by linear regressions.

With the measured motion h = A exp(i psi) and the force per mass and modal constant G (``oscillator``), g = G/h and the
balance of each point

    W^2 = omega(A)^2 + 2 i c(A) W - kappa g

is linear in kappa, in omega^2, in the coefficient of the change of omega(A)^2 with the amplitude, and in those of the
rate of decay c(A).  Its real and imaginary parts, over |g|, are one regression of all points with phases; exponents and
corners take the best of a list.  Without phases, the squares of the modulus at the lowest level,

    (W^2)^2 = -omega^4 + 2 (omega^2 - 2 c^2) W^2 + kappa^2 |g|^2,

give a mode whose frequency is constant, and then each point near the resonance its own omega^2, from which follows the
change with the amplitude.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np
from scipy.optimize import lsq_linear

from ancf_casadi.decay.first_guess import DecayGuess
from ancf_casadi.exceptions import FitError
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
            h = A + 0j
            if record.measured_phases is not None:
                h = A * np.exp(1j * (record.measured_phases - record.sensor.derivatives * math.pi / 2))
            omega.append(W)
            amplitude.append(A)
            g.append(force_factor(record.excitation_unit, W) * record.a / h)
        return cls(unit, *(np.concatenate(part) for part in (omega, amplitude, g)))


def guess_of(omega: float, ratio: float, amplitude: float) -> DecayGuess:
    """Return the mode as the guess of a decay, which gives unknowns their scales and first values."""
    length = 1 / (ratio * omega)
    return DecayGuess(0, "", length, length, omega, ratio, amplitude, 0.0, 0.0)


def from_phases(model: DecayModel, groups: Sequence[Points], known: float | None) -> dict[str, float]:
    """Return values by name of the laws and, by unit of the level, of the modal constants, from points with phases."""
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
        columns.append(np.concatenate([model.change(A, 1.0, *bending), none]))
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
    lower[1 : 1 + model.bends] = -np.inf
    found = lsq_linear(rows / size, target * np.tile(weight, 2), (lower, np.full(len(columns), np.inf)))
    x = found.x / size
    square = max(float(x[0]), 1e-6 * middle**2)
    values = {"omega": math.sqrt(square)}
    if model.bends:
        values |= dict(zip(model.frequency_terms, (float(x[1]) / (2 * square), *bending), strict=True))
    values |= dict(zip(names, x[1 + model.bends :].tolist(), strict=False))
    if p:
        values["exponent"] = p[0]
    if known is None:
        values |= dict(zip((one.unit for one in groups), x[-len(groups) :].tolist(), strict=True))
    return float(found.cost), values


def from_amplitudes(model: DecayModel, groups: Sequence[Sequence[Points]]) -> dict[str, float]:
    """Return values by name of the laws and modal constants, from the records of each group, which have no phases."""
    lowest = min((one for group in groups for one in group), key=lambda one: float(one.amplitude.max()))
    omega, g = lowest.omega, np.abs(lowest.g)
    middle = float(np.mean(omega**2))
    y = omega**2 - middle
    rows = np.array([np.ones(len(y)), y, g**2]).T / (g**2)[:, None]
    size = np.linalg.norm(rows, axis=0)
    if len(y) < 3:
        raise FitError(f"the curve has {len(y)} points; measure more of the resonance")
    alpha, beta, square = (np.linalg.lstsq(rows / size, y**2 / g**2)[0] / size).tolist()
    peak = float(omega[np.argmin(g)])
    s = middle + beta / 2
    found = math.sqrt(s) if 0.25 * peak**2 < s < 4 * peak**2 else peak
    kappa = math.sqrt(square) if square > 0.0 else float(np.median(np.abs(omega**2 - found**2) / g))
    rate = math.sqrt(max((-alpha - (beta / 2) ** 2) / (4 * found**2), (1e-4 * found) ** 2))
    rate = min(rate, kappa * float(g.min()) / found)  # that of the peak, or less
    values = {"omega": found, **_equal_parts(model, rate, found), lowest.unit: kappa}
    every = [one for group in groups for one in group]
    for unit in {one.unit for one in every} - {lowest.unit}:
        values[unit] = modal_constant_of(model, [one for one in every if one.unit == unit], values)
    if model.bends:
        values |= _bent(model, every, values, rate)
    return values


def _bent(model: DecayModel, every: Sequence[Points], values: Mapping[str, float], rate: float) -> dict[str, float]:
    """Return the frequency and its change with the amplitude, from the frequency that each point near a peak has."""
    squares, amplitudes = [], []
    for one in every:
        force, top = values[one.unit] * np.abs(one.g), float(one.omega[np.argmin(np.abs(one.g))])
        near = np.abs(one.g) < 4 * np.abs(one.g).min()
        apart = np.sqrt(np.maximum(force**2 - (2 * rate * one.omega) ** 2, 0.0)) * np.where(one.omega > top, -1.0, 1.0)
        squares.append((one.omega**2 + apart)[near])
        amplitudes.append(one.amplitude[near])
    y, A, best = np.concatenate(squares), np.concatenate(amplitudes), (math.inf, dict[str, float]())
    for shape in SHAPES.get(model.frequency_law, ((),)):
        rows = np.array([np.ones(len(A)), model.change(A, 1.0, *shape)]).T
        square, slope = np.linalg.lstsq(rows, y)[0].tolist()
        left = float(np.sum((rows @ [square, slope] - y) ** 2))
        if square > 0.0 and left < best[0]:
            terms = zip(model.frequency_terms, (slope / (2 * square), *shape), strict=True)
            best = left, {"omega": math.sqrt(square), **dict(terms)}
    return best[1]


def _equal_parts(model: DecayModel, rate: float, omega: float) -> dict[str, float]:
    """Return the unknowns of the damping with a rate of decay at the amplitude of reference."""
    guess = guess_of(omega, rate / omega, model.reference)
    return {u.name: u.guess for u in model.shared(guess) if u.name not in ("omega", *model.frequency_terms)}


def modal_constant_of(model: DecayModel, points: Sequence[Points], values: Mapping[str, float]) -> float:
    """Return the modal constant of points by values of the laws: the median of those of the points."""
    found = []
    for one in points:
        ratio, frequency = law_at(model, one.amplitude, values)
        square = (2 * math.pi * frequency) ** 2 - one.omega**2
        found.append(np.abs(square + 2j * ratio * values["omega"] * one.omega) / np.abs(one.g))
    return float(np.median(np.concatenate(found)))


def law_at(model: DecayModel, amplitude: Array, values: Mapping[str, float]) -> tuple[Array, Array]:
    """Return damping ratio and frequency (Hz) at amplitudes for values of the unknowns by name."""
    names = [one.name for one in model.shared(guess_of(values["omega"], LEAST_RATIO, model.reference))]
    law = [cs.MX(values[name]) for name in names]
    ratio, frequency = model.against_amplitude(amplitude, *law, cs.MX(1), cs.MX(0))
    return np.asarray(cs.evalf(ratio)).ravel(), np.asarray(cs.evalf(frequency)).ravel()
