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
from operator import itemgetter

import casadi as cs
import numpy as np
from scipy.optimize import lsq_linear

from ancf_casadi.decay.first_guess import DecayGuess
from ancf_casadi.decay.smooth import smooth_nodes
from ancf_casadi.exceptions import NumericsError
from ancf_casadi.support.arrays import Array, ComplexArray
from ancf_casadi.support.compilation import evaluate_dense
from problems.beam.curves.points import MOST_STEPS, POINTS_CLOSE, CurvePoints, Measured
from problems.beam.curves.record import BASE_MOTIONS, ResponseRecord
from problems.decay.laws import DAMPING_TERMS, DecayModel, evaluate
from problems.decay.solution import simpler_models, smooth_values
from problems.decay.starting_values import DAMPING_STARTS, FREQUENCY_STARTS

POINTS_CLOSE_ENOUGH = 1e-3  # step, in standard deviations, that is small enough if rounding keeps it from shrinking
MOST_HALVINGS = 20
NO_INCREASE = 1e-9  # increase of a squared distance that counts as none, relative and absolute
LEAST_RATIO = 1e-5  # least damping ratio of a start, for the scales of the unknowns

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
    slope = cs.jtimes(g, A, cs.DM.ones(m))
    results = [g, slope, cs.jtimes(slope, A, cs.DM.ones(m)), cs.jacobian(g, x)]
    return cs.Function("curve", [A, x], [cs.densify(result) for result in results])


def motions_at(curve: cs.Function, amplitude: Array, x: Array) -> tuple[Array, Array, Array, Array]:
    """Return g (m, 3), its derivatives by A, once and twice, and those by the unknowns, (m, 3, n)."""
    *columns, by_x = evaluate_dense(curve, amplitude, x)
    g, slopes, curvatures = (column.reshape(3, -1).T for column in columns)
    return g, slopes, curvatures, by_x.reshape(3, len(amplitude), -1).transpose(1, 0, 2)


def closest_motions(
    curve: cs.Function, record: ResponseRecord, points: Measured, x: Array
) -> tuple[CurvePoints, Array]:
    """Return the motions closest to the points of a record, and their derivatives by the unknowns (m, 3, n)."""
    log_a, d = np.log(motion_amplitudes(record)), record.sensor.derivatives
    log_a = np.maximum(log_a, np.log(1e-6 * record.amplitudes / (2 * math.pi * record.f) ** d))
    g, slopes, curvatures, by_x = motions_at(curve, np.exp(log_a), x)
    closest = np.zeros(len(log_a), dtype=bool)  # points that no step brings closer
    last_size = np.full(len(log_a), math.inf)  # step before, in standard deviations
    for _ in range(MOST_STEPS):
        A, squared_distance = np.exp(log_a)[:, None], np.sum(points.distance(g) ** 2, axis=1)
        step, size = points.step(g, A * slopes, A * slopes + A**2 * curvatures, 0.1)
        closest |= (size <= POINTS_CLOSE) | ((size > last_size / 2) & (size <= POINTS_CLOSE_ENOUGH))
        if closest.all():
            return (g, slopes), by_x
        last_size = size
        step = np.where(closest, 0.0, step)
        for _ in range(MOST_HALVINGS):
            g, slopes, curvatures, by_x = motions_at(curve, np.exp(log_a + step), x)
            worse = np.sum(points.distance(g) ** 2, axis=1) > squared_distance * (1 + NO_INCREASE) + NO_INCREASE
            if not worse.any():
                break
            step = np.where(worse, step / 2, step)
        else:
            closest |= worse
            step = np.where(worse, 0.0, step)
            g, slopes, curvatures, by_x = motions_at(curve, np.exp(log_a + step), x)
        log_a = log_a + step
    raise NumericsError(f"{record.label}: the motion closest to the measured points is not found")


def relative_motion(record: ResponseRecord) -> ComplexArray:
    """Return the motion A exp(i psi) relative to the base (m,), approximate if no phases were measured."""
    omega, derivatives = 2 * math.pi * record.f, record.sensor.derivatives
    amplitudes = record.amplitudes / omega**derivatives
    if record.measured_phases is not None:
        motion = amplitudes * np.exp(1j * (record.measured_phases - derivatives * math.pi / 2))
        return np.asarray(motion - base_factor(record) * record.a)
    response = amplitudes / record.a
    lag = np.arcsin(response / response.max())
    lag = np.where(record.f < record.f[response.argmax()], lag, math.pi - lag)
    return np.asarray(amplitudes * np.exp(1j * (np.angle(force_factor(record.excitation_unit, omega)) - lag)))


def motion_amplitudes(record: ResponseRecord) -> Array:
    """Return the amplitudes A (m,) of the motion relative to the base, approximate if no phases were measured."""
    return np.asarray(np.abs(relative_motion(record)))


def reading_factor(record: ResponseRecord) -> ComplexArray:
    """Return the reading (m,) of the motion that a unit level causes per unit modal constant, times its stiffness."""
    omega = 2 * math.pi * record.f
    return np.asarray(force_factor(record.excitation_unit, omega) * (1j * omega) ** record.sensor.derivatives)


def balance_points(records: Sequence[ResponseRecord]) -> Points:
    """Return the points (W, A, g) of records whose levels have the same unit."""
    points = []
    for record in records:
        W, motion = 2 * math.pi * record.f, relative_motion(record)
        points.append((W, np.abs(motion), force_factor(record.excitation_unit, W) * record.a / motion))
    omega, amplitude, g = map(np.concatenate, zip(*points, strict=True))
    return omega, amplitude, g


def mode_guess(omega: float, ratio: float, amplitude: float) -> DecayGuess:
    """Return the guess of a decay for a mode, which gives unknowns their scales and first values."""
    length = 1 / (ratio * omega)
    return DecayGuess(0, "", length, length, omega, ratio, amplitude, 0.0, ())


def regression_start(model: DecayModel, groups: Mapping[str, Points], given_constant: float | None) -> dict[str, float]:
    """Return values by name of the laws and, by unit of the level, of the modal constants, from points.

    Those of smooth laws come from the best simpler ones, since their own regression would swing between the levels.
    """
    regressions = [(simpler, *_best_regression(simpler, groups, given_constant)) for simpler in simpler_models(model)]
    best_model, _, values = min(regressions, key=itemgetter(1))
    return {**values, **smooth_values(model, *law_at(best_model, smooth_nodes(model.reference, model.span), values))}


def _best_regression(
    model: DecayModel, groups: Mapping[str, Points], given_constant: float | None
) -> tuple[float, dict[str, float]]:
    """Return the misfit and the values of the best exponents and corners."""
    regressions = [
        _regression(model, groups, given_constant, frequency_shape, damping_shape)
        for frequency_shape in FREQUENCY_STARTS.get(model.frequency_law, ((),))
        for damping_shape in DAMPING_STARTS.get(model.law, ((),))
    ]
    return min(regressions, key=itemgetter(0))


def _regression(
    model: DecayModel,
    groups: Mapping[str, Points],
    given_constant: float | None,
    frequency_shape: tuple[float, ...],
    damping_shape: tuple[float, ...],
) -> tuple[float, dict[str, float]]:
    """Return the misfit and the values for given exponents and corners."""
    omega, A, g = map(np.concatenate, zip(*groups.values(), strict=True))
    middle, changes = float(np.median(omega)), model.unit_changes(A, *frequency_shape)
    frequency_count, damping_names = len(changes), DAMPING_TERMS[model.law]
    rates = model.term_rates(A, middle, *damping_shape)
    columns = [np.ones(len(A)), *changes, *(2j * rate * omega for rate in rates)]
    target = omega**2 + (given_constant or 0.0) * g
    if given_constant is None:
        owners = np.repeat(np.arange(len(groups)), [len(frequencies) for frequencies, *_ in groups.values()])
        columns += [-g * (owners == k) for k in range(len(groups))]
    matrix, target = np.array(columns).T / np.abs(g)[:, None], target / np.abs(g)
    matrix, target = np.vstack([matrix.real, matrix.imag]), np.concatenate([target.real, target.imag])
    size = np.linalg.norm(matrix, axis=0)
    lower = np.zeros(len(columns))
    lower[1 : 1 + frequency_count] = -np.inf
    solution = lsq_linear(matrix / size, target, (lower, np.full(len(columns), np.inf)))
    x = solution.x / size
    square = max(float(x[0]), 1e-6 * middle**2)
    slopes = x[1 : 1 + frequency_count] / (2 * square)
    values = {"omega": math.sqrt(square)}
    values |= dict(zip(model.frequency_terms, (*slopes.tolist(), *frequency_shape), strict=True))
    values |= dict(zip(damping_names, x[1 + frequency_count :].tolist(), strict=False))
    values |= dict(zip(("exponent",), damping_shape, strict=False))
    if given_constant is None:
        values |= dict(zip(groups, x[-len(groups) :].tolist(), strict=True))
    return float(solution.cost), values


def median_modal_constant(model: DecayModel, points: Points, values: Mapping[str, float]) -> float:
    """Return the median of the modal constants that the points have under given laws."""
    omega, amplitude, g = points
    ratio, frequency = law_at(model, amplitude, values)
    square = (2 * math.pi * frequency) ** 2 - omega**2
    return float(np.median(np.abs(square + 2j * ratio * values["omega"] * omega) / np.abs(g)))


def law_at(model: DecayModel, amplitude: Array, values: Mapping[str, float]) -> tuple[Array, Array]:
    """Return damping ratio and frequency (Hz) at amplitudes for values of the unknowns by name."""
    names = [unknown.name for unknown in model.mode_unknowns(mode_guess(values["omega"], LEAST_RATIO, model.reference))]
    law = [cs.MX(values[name]) for name in names]
    ratio, frequency = model.against_amplitude(amplitude, *law, cs.MX(1), cs.MX(0))
    return evaluate(ratio), evaluate(frequency)
