"""The mode as one oscillator under harmonic excitation: response curves in closed form, and the points closest to data.

One mode with the amplitude A of its motion has the frequency omega(A) and the rate of decay c(A) = zeta(A) omega of the
damping and frequency laws of a free decay (``problems.decay.laws``).  Under a force per mass kappa a sin(W t), its
steady motion A sin(W t + psi) balances the fundamental,

    (omega(A)^2 - W^2 + 2 i c(A) W) A exp(i psi) = kappa a.

At a frequency W, level a and phase psi are therefore explicit functions of A, also beside folds, where a level belongs
to three motions: A is the parameter of the curve (``curves.response_block``).  The modal constant kappa is 1/mass for a
force at the sensor.  The base displacement u = a sin(W t) acts as the force -u'' on the motion relative to the base,
so that

    unit of the level     force per mass                 base displacement
    N, V                  kappa a
    m                     kappa W^2 a                    a
    m/s                   kappa W a, 90 degrees behind   a/W, 90 degrees behind
    m/s^2                 kappa a, reversed              a/W^2, reversed

with kappa the participation of the mode.  A reading in the laboratory is the sum of A and the base displacement; each
derivative that the sensor measures multiplies it by i W.

Closest point.  With g(A) = (Y, phi, a) over their standard deviations and the measured point m, Newton's method in
log A, with exact derivatives, minimises |g - m|^2 for all points at once.  A step that does not reduce the distance of
a point is halved.  The search begins at the measured amplitude, which decides the branch.

Starting values.  With the measured motion h = A exp(i psi) and the force per mass and modal constant G, g = G/h and the
balance of each point

    W^2 = omega(A)^2 + 2 i c(A) W - kappa g

is linear in kappa, in omega^2, in the coefficient of the change of omega(A)^2 with the amplitude, and in those of the
rate of decay c(A).  Its real and imaginary parts, over |g|, are one regression of all points with phases; exponents and
corners take the best of a list.  Where no phases were measured, sin(psi) is the response per level over the largest
one: exact for a rate of decay that does not depend on the amplitude, also on bent curves.

References
----------
A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations, Wiley (1979), Sections 4.1, 4.2.
M. Krack, J. Gross, Harmonic Balance for Nonlinear Vibration Problems, Springer (2019).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import casadi as cs
import numpy as np
from scipy.optimize import lsq_linear

from ancf_casadi.decay.first_guess import DecayGuess
from ancf_casadi.decay.smooth import smooth_nodes
from ancf_casadi.exceptions import NumericsError
from ancf_casadi.support.arrays import Array, ComplexArray
from ancf_casadi.support.compilation import evaluated
from problems.beam.curves.points import MOST_STEPS, POINTS_CLOSE, CurvePoints, Measured
from problems.beam.curves.record import BASE_MOTIONS, ResponseRecord
from problems.decay.laws import DECAY_TERMS, DecayModel
from problems.decay.solution import simpler_models, smooth_values
from problems.decay.starting_values import NONLINEAR_STARTS

POINTS_CLOSE_ENOUGH = 1e-3  # the same, where rounding keeps further steps from shrinking
LONGEST_STEP = 0.2  # of log A
LEAST_RATIO = 1e-5  # damping ratio that a start assumes at least, for the scales of the unknowns
EXPONENT_STARTS = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0)  # of the power law

Points = tuple[Array, Array, ComplexArray]  # W, A and g = G/h of m points, (m,)


def force_factor(unit: str, omega: Array) -> ComplexArray:
    """Return the force per mass and unit modal constant (m,) of a unit level at angular frequencies (m,)."""
    powers = {"m": omega**2, "m/s": -1j * omega, "m/s^2": -np.ones(len(omega))}
    return np.asarray(powers.get(unit, np.ones(len(omega))), dtype=complex)


def base_factor(record: ResponseRecord) -> ComplexArray:
    """Return the base displacement per level (m,) that the sensor reads; 0 if it reads the relative motion."""
    omega = 2 * math.pi * record.f
    if record.relative or record.excitation_unit not in BASE_MOTIONS or record.sensor.motion_unit != "m":
        return np.zeros(len(omega), dtype=complex)
    return force_factor(record.excitation_unit, omega) / omega**2


def response_curve(model: DecayModel, record: ResponseRecord, count: int) -> cs.Function:
    """Return the curve of a mode at the frequencies of a record, for ``count`` unknowns of the laws.

    (A (m,), unknowns) -> Y, phi and level, (3 m,), their first and second derivatives by A, and those by the unknowns,
    of which the last one is the modal constant.
    """
    m, W, d = record.f.size, 2 * math.pi * record.f, record.sensor.derivatives
    A, x = cs.MX.sym("A", m), cs.MX.sym("x", count + 1)
    *law, kappa = cs.vertsplit(x)
    ratio, frequency = model.against_amplitude(A, *law, cs.MX(1), cs.MX(0))
    real, imaginary = (2 * math.pi * frequency) ** 2 - cs.DM(W**2), 2 * ratio * law[0] * cs.DM(W)
    factor = force_factor(record.excitation_unit, W)
    level = A * cs.hypot(real, imaginary) / (kappa * cs.DM(np.abs(factor)))
    angle = cs.DM(np.angle(factor)) - cs.atan2(imaginary, real)
    base = base_factor(record)
    sine = A * cs.sin(angle) + level * cs.DM(base.imag)
    cosine = A * cs.cos(angle) + level * cs.DM(base.real)
    amplitude = cs.hypot(cosine, sine) * cs.DM(W**d)
    g = cs.vertcat(amplitude, cs.atan2(sine, cosine) + d * math.pi / 2, level)
    one = cs.DM.ones(m)
    first = cs.jtimes(g, A, one)
    results = [g, first, cs.jtimes(first, A, one), cs.jacobian(g, x)]
    return cs.Function("curve", [A, x], [cs.densify(part) for part in results])


def motions_at(curve: cs.Function, amplitude: Array, x: Array) -> tuple[Array, Array, Array, Array]:
    """Return g (m, 3), its derivatives by A, once and twice, and those by the unknowns, (m, 3, n)."""
    values, first, second, by_x = evaluated(curve, amplitude, x)
    g, once, twice = (part.reshape(3, -1).T for part in (values, first, second))
    return g, once, twice, by_x.reshape(3, len(amplitude), -1).transpose(1, 0, 2)


def closest_motions(
    curve: cs.Function, record: ResponseRecord, points: Measured, x: Array
) -> tuple[CurvePoints, Array]:
    """Return the motions closest to the points of a record, and their derivatives by the unknowns (m, 3, n)."""
    log_a, d = np.log(motion_amplitudes(record)), record.sensor.derivatives
    log_a = np.maximum(log_a, np.log(1e-6 * record.amplitudes / (2 * math.pi * record.f) ** d))
    g, first, second, by_x = motions_at(curve, np.exp(log_a), x)
    resting = np.zeros(len(log_a), dtype=bool)  # points that no step brings closer
    last = np.full(len(log_a), math.inf)  # step before, in standard deviations
    for _ in range(MOST_STEPS):
        A, before = np.exp(log_a)[:, None], np.sum(points.distance(g) ** 2, axis=1)
        step, size = points.step(g, A * first, A * first + A**2 * second, 0.1)
        resting |= (size <= POINTS_CLOSE) | ((size > last / 2) & (size <= POINTS_CLOSE_ENOUGH))
        if resting.all():
            return (g, first), by_x
        last = size
        step = np.where(resting, 0.0, np.clip(step, -LONGEST_STEP, LONGEST_STEP))
        for _ in range(20):  # halvings
            g, first, second, by_x = motions_at(curve, np.exp(log_a + step), x)
            # increase of a squared distance that counts as none, relative and absolute
            worse = np.sum(points.distance(g) ** 2, axis=1) > before * (1 + 1e-9) + 1e-9
            if not worse.any():
                break
            step = np.where(worse, step / 2, step)
        else:
            resting |= worse
            step = np.where(worse, 0.0, step)
            g, first, second, by_x = motions_at(curve, np.exp(log_a + step), x)
        log_a = log_a + step
    raise NumericsError(f"{record.label}: the motion closest to the measured points is not found")


def motion_amplitudes(record: ResponseRecord) -> Array:
    """Return the amplitudes A (m,) of the motion relative to the base, about those if the phases were not measured."""
    omega = 2 * math.pi * record.f
    total = record.amplitudes / omega**record.sensor.derivatives
    base = base_factor(record) * record.a
    if record.measured_phases is None:
        return total
    phases = record.measured_phases - record.sensor.derivatives * math.pi / 2
    return np.asarray(np.abs(total * np.exp(1j * phases) - base))


def reading_factor(record: ResponseRecord) -> ComplexArray:
    """Return the reading (m,) of the motion that a unit level causes per unit modal constant, times its stiffness."""
    omega = 2 * math.pi * record.f
    return np.asarray(force_factor(record.excitation_unit, omega) * (1j * omega) ** record.sensor.derivatives)


def points_of(records: Sequence[ResponseRecord]) -> Points:
    """Return the points of records with one kind of level; of g the modulus alone counts if it has no phase."""
    found = []
    for record in records:
        W, A = 2 * math.pi * record.f, motion_amplitudes(record)
        h = A * np.exp(1j * motion_phases(record))
        found.append((W, A, force_factor(record.excitation_unit, W) * record.a / h))
    omega, amplitude, g = map(np.concatenate, zip(*found, strict=True))
    return omega, amplitude, g


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


def from_points(model: DecayModel, groups: Mapping[str, Points], known: float | None) -> dict[str, float]:
    """Return values by name of the laws and, by unit of the level, of the modal constants, from points.

    Those of smooth laws come from the best simpler ones, since their own regression would swing between the levels.
    """
    models = simpler_models(model)
    regressions = [_best_regression(simpler, groups, known) for simpler in models]
    best = int(np.argmin([cost for cost, _ in regressions]))
    values = regressions[best][1]
    at_nodes = law_at(models[best], smooth_nodes(model.reference, model.span), values)
    return {**values, **smooth_values(model, *at_nodes)}


def _best_regression(
    model: DecayModel, groups: Mapping[str, Points], known: float | None
) -> tuple[float, dict[str, float]]:
    """Return the misfit and the values of the best exponents and corners."""
    best: tuple[float, dict[str, float]] | None = None
    for bending in NONLINEAR_STARTS.get(model.frequency_law, ((),)):
        for damping in ((p,) for p in EXPONENT_STARTS) if model.law == "power" else ((),):
            left, values = _regression(model, groups, known, bending, damping)
            if best is None or left < best[0]:
                best = left, values
    assert best is not None
    return best


def _regression(
    model: DecayModel,
    groups: Mapping[str, Points],
    known: float | None,
    bending: tuple[float, ...],
    p: tuple[float, ...],
) -> tuple[float, dict[str, float]]:
    """Return the misfit and the values for given exponents and corners."""
    omega, A, g = map(np.concatenate, zip(*groups.values(), strict=True))
    weight, middle, none = 1 / np.abs(g), float(np.median(omega)), np.zeros(len(g))
    columns = [np.concatenate([none + 1, none])]
    if model.frequency_varies:
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
    owners = np.repeat(np.arange(len(groups)), [len(one) for one, *_ in groups.values()])
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
    if model.frequency_varies:
        changes = x[1:first] / (2 * square)
        values |= dict(zip(model.frequency_terms, (*changes.tolist(), *bending), strict=True))
    values |= dict(zip(names, x[first:].tolist(), strict=False))
    if p:
        values["exponent"] = p[0]
    if known is None:
        values |= dict(zip(groups, x[-len(groups) :].tolist(), strict=True))
    return float(found.cost), values


def modal_constant_of(model: DecayModel, points: Points, values: Mapping[str, float]) -> float:
    """Return the modal constant of points by values of the laws: the median of those of the points."""
    omega, amplitude, g = points
    ratio, frequency = law_at(model, amplitude, values)
    square = (2 * math.pi * frequency) ** 2 - omega**2
    return float(np.median(np.abs(square + 2j * ratio * values["omega"] * omega) / np.abs(g)))


def law_at(model: DecayModel, amplitude: Array, values: Mapping[str, float]) -> tuple[Array, Array]:
    """Return damping ratio and frequency (Hz) at amplitudes for values of the unknowns by name."""
    names = [one.name for one in model.mode_unknowns(guess_of(values["omega"], LEAST_RATIO, model.reference))]
    law = [cs.MX(values[name]) for name in names]
    ratio, frequency = model.against_amplitude(amplitude, *law, cs.MX(1), cs.MX(0))
    return np.asarray(cs.evalf(ratio)).ravel(), np.asarray(cs.evalf(frequency)).ravel()
