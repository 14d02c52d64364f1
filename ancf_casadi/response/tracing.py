"""Curves of periodic motions: frequency response, amplitude response, and response to a parameter.

A curve begins with the motion that a slowly growing excitation reaches (``onset``) at the first value of the
frequency, the amplitude or the parameter, and is followed (``harmonic_balance.continuation``) until it leaves the range
or closes.  The curve turns at folds; the Floquet multipliers of neighbouring points show the other bifurcations
(``floquet``).  Each is located as the zero of a test function along the curve:

    fold                component of the tangent along the frequency, amplitude or parameter
    branch point        product of 1 - mu over all multipliers mu
    period doubling     product of 1 + mu
    Neimark-Sacker      largest |mu| - 1 of the complex multipliers
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.base_motion import BaseMotion
from ancf_casadi.dynamics.tip_load import TipLoad
from ancf_casadi.exceptions import ContinuationError, InputError, NumericsError
from ancf_casadi.response.curve import BifurcationPoint, ResponseCurve
from ancf_casadi.response.excited import Body, Excited, excite
from ancf_casadi.response.floquet import Bifurcation, bifurcations
from ancf_casadi.response.harmonic_balance.balance import HarmonicBalance
from ancf_casadi.response.harmonic_balance.continuation import (
    ContinuationStep,
    chord,
    follow,
    locate_zero,
    point_at,
    transfer_vector,
)
from ancf_casadi.response.harmonic_balance.family import Family, NotFound, Point
from ancf_casadi.response.harmonic_balance.system import HarmonicForce
from ancf_casadi.response.onset import (
    RESPONSE_ERROR,
    as_periodic_motion,
    continue_to_amplitude,
    follow_onset,
    point_at_value,
)
from ancf_casadi.response.periodic import PeriodicMotion
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import LARGEST_TIME, check_instance, choice, physical, positive, vector, whole
from ancf_casadi.support.interrupts import lasting_interrupts

CURVE_POINTS = 60
MOST_CURVE_POINTS = 2000

Free = Literal["omega", "amplitude", "value"]
RANGES: Mapping[Free, str] = {"omega": "frequencies", "amplitude": "amplitudes", "value": "values"}


@lasting_interrupts()
def frequency_response(
    model: Body,
    frequencies: tuple[float, float],
    *,
    damping: DampingLaw | None = None,
    base: BaseMotion | None = None,
    load: TipLoad | None = None,
    force: HarmonicForce | None = None,
    start: PeriodicMotion | None = None,
    points: int = CURVE_POINTS,
    tolerance: float = RESPONSE_ERROR,
) -> ResponseCurve:
    """Return the steady states of a forced vibration against the frequency, through folds.

    Parameters
    ----------
    model : Model, ReducedModel or SecondOrderSystem
        The full beam, the beam in a few modes, or another system.
    frequencies : (float, float)
        First and last frequency, Hz.  The curve begins at the first, and ends where it leaves the range.
    damping, base, load, force
        As in ``periodic_motion``; the frequency of the excitation is not used.
    start : PeriodicMotion, optional
        First motion of the curve, such as one on a closed curve (isola), in place of the one that a slowly growing
        excitation reaches.  If its system or amplitude of excitation differs, the curve begins at the nearest motion of
        this system.  It then proceeds towards the last frequency.
    points : int
        Smallest number of points over the range; folds and resonances get more.
    tolerance : float
        As in ``periodic_motion``.

    Raises
    ------
    InputError
        If an argument is not in its range, or there is not exactly one excitation.
    EquilibriumError
        If the beam has no equilibrium under gravity.
    NumericsError
        If the first motion is not found.
    ContinuationError
        If the curve cannot be followed; its ``partial`` holds the curve up to there.

    Examples
    --------
    >>> from ancf_casadi import Beam, HarmonicBase, Model, RayleighDamping, frequency_response, reduce_model
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> reduced = reduce_model(Model(beam), modes=2, damping=RayleighDamping(alpha=0.3))
    >>> curve = frequency_response(reduced, (10.0, 11.0), base=HarmonicBase(amplitude=1e-3, frequency=10.0))
    >>> [f"{bifurcation.kind} at {bifurcation.motion.frequency:.2f} Hz" for bifurcation in curve.bifurcations]
    ['fold at 10.27 Hz']
    >>> print(f"{1e3 * curve.amplitude().max():.0f} mm")
    45 mm
    """
    first, last = (physical(value, "frequencies") for value in vector(frequencies, "frequencies"))
    subject, tolerance = excite(model, damping, base, load, force), positive(tolerance, "tolerance")
    omega, end = 2 * math.pi * first, 2 * math.pi * last
    if start is None:
        point = follow_onset(subject, omega, subject.drive.amplitude, tolerance)
    else:
        point = _continue_start(subject, start, tolerance)
        if not min(omega, end) <= point.setting.omega <= max(omega, end):
            raise InputError(f"vibrates at {start.frequency:.6g} Hz, outside the range of frequencies", "start")
    return _trace_curve(subject, point, "omega", (omega, end), points)


@lasting_interrupts()
def amplitude_response(
    model: Body,
    amplitudes: tuple[float, float],
    *,
    damping: DampingLaw | None = None,
    base: BaseMotion | None = None,
    load: TipLoad | None = None,
    force: HarmonicForce | None = None,
    points: int = CURVE_POINTS,
    tolerance: float = RESPONSE_ERROR,
) -> ResponseCurve:
    """Return the steady states of a forced vibration against the amplitude of its excitation, at one frequency.

    Parameters
    ----------
    model, damping, base, load, force
        As in ``periodic_motion``; the amplitude of the excitation gives its direction only.
    amplitudes : (float, float)
        First and last amplitude of the excitation: of the base motion, m, of the force, N, or of a moment alone, N m.
    points, tolerance
        As in ``frequency_response``.

    Raises
    ------
    InputError
        If an argument is not in its range, or there is not exactly one excitation.
    EquilibriumError, NumericsError, ContinuationError
        As in ``frequency_response``.

    Examples
    --------
    >>> from ancf_casadi import Beam, HarmonicBase, Model, RayleighDamping, amplitude_response, reduce_model
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> reduced = reduce_model(Model(beam), modes=2, damping=RayleighDamping(alpha=0.3))
    >>> curve = amplitude_response(reduced, (1e-4, 2e-3), base=HarmonicBase(amplitude=1e-3, frequency=10.4))
    >>> len(curve.jumps.up), len(curve.jumps.down)
    (1, 1)
    """
    first, last = (physical(value, "amplitudes") for value in vector(amplitudes, "amplitudes"))
    subject, tolerance = excite(model, damping, base, load, force), positive(tolerance, "tolerance")
    point = follow_onset(subject, subject.drive.omega, first, tolerance)
    return _trace_curve(subject, point, "amplitude", (first, last), points)


@lasting_interrupts()
def parameter_response(
    model: Body,
    parameter: str,
    values: tuple[float, float],
    *,
    damping: DampingLaw | None = None,
    base: BaseMotion | None = None,
    load: TipLoad | None = None,
    force: HarmonicForce | None = None,
    points: int = CURVE_POINTS,
    tolerance: float = RESPONSE_ERROR,
) -> ResponseCurve:
    """Return the steady states of a forced vibration against a parameter, such as a coefficient of the damping law.

    Parameters
    ----------
    model, damping, base, load, force
        As in ``periodic_motion``.
    parameter : str
        Name of a parameter: one of the damping law, ``gravity_x`` or ``gravity_y``, for the full beam also a property
        of an element such as ``elastic_modulus_1``; for another system one of its parameters.
    values : (float, float)
        First and last value.
    points, tolerance
        As in ``frequency_response``.

    Raises
    ------
    InputError
        If there is no such parameter, an argument is not in its range, or there is not exactly one excitation.
    EquilibriumError, NumericsError, ContinuationError
        As in ``frequency_response``.

    Examples
    --------
    >>> from ancf_casadi import Beam, HarmonicBase, Model, QuadraticDamping, parameter_response, reduce_model
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> reduced = reduce_model(Model(beam), modes=1, damping=QuadraticDamping(eta2=1.0))
    >>> curve = parameter_response(reduced, "eta2", (1.0, 0.5), base=HarmonicBase(amplitude=5e-3, frequency=1.9))
    >>> curve.amplitude()[[0, -1]].round(3)
    array([0.094, 0.129])
    """
    subject, tolerance = excite(model, damping, base, load, force), positive(tolerance, "tolerance")
    names = [p.name for p in subject.system.parameters]
    index = names.index(choice(parameter, names, "parameter"))
    first, last = vector(values, "values")
    if max(abs(first), abs(last)) > LARGEST_TIME:
        raise InputError(f"must be within {LARGEST_TIME:g}, got {max(abs(first), abs(last)):g}", "values")
    parameter_values = subject.system.values
    parameter_values[index] = first
    subject = replace(subject, system=subject.system.with_values(parameter_values))
    point = follow_onset(subject, subject.drive.omega, subject.drive.amplitude, tolerance)
    balance, setting = replace(point.family.balance, varied=index), replace(point.setting, value=first)
    point = replace(point, family=replace(point.family, balance=balance, setting=setting))
    return _trace_curve(subject, point, "value", (first, last), points)


def _continue_start(subject: Excited, start: PeriodicMotion, tolerance: float) -> Point:
    """Return the motion of a system near a start, continued to the amplitude of the excitation."""
    check_instance(start, "start", PeriodicMotion)
    if start.balance.system.size != subject.system.size:
        raise InputError("belongs to a system with another number of coordinates", "start")
    balance = HarmonicBalance(subject.system, subject.drive, start.balance.fourier)
    family = Family(balance, start.setting, ("amplitude",), (start.setting.amplitude,), 1.0, tolerance)
    try:
        point = point_at(family, family.join(start.coefficients, start.setting), family.unit("amplitude"))
    except NotFound:
        raise NumericsError("the system has no steady state near the given start; give another one") from None
    amplitude = subject.drive.amplitude
    return point if start.drive_amplitude == amplitude else continue_to_amplitude(point, amplitude)


def _trace_curve(subject: Excited, start: Point, name: Free, ends: tuple[float, float], points: int) -> ResponseCurve:
    """Follow a curve in one free entry of the setting until it leaves the range or closes."""
    points = whole(points, "points", 2)
    if ends[0] == ends[1]:
        raise InputError("the first and the last value are equal", RANGES[name])
    family = replace(start.family, setting=start.setting, free=(name,), scales=(abs(ends[1] - ends[0]),))
    point = family.at(family.join(start.coefficients, start.setting), family.unit(name))
    motions, bifurcation_points, closed = [as_periodic_motion(subject, point)], list[BifurcationPoint](), False
    try:
        for step in _steps(point, name, ends, points):
            for kind, motion in _locate_bifurcations(subject, step, name):
                bifurcation_points.append(BifurcationPoint(kind, len(motions), motion))
                motions.append(motion)
            motions.append(as_periodic_motion(subject, step.end))
            closed = len(motions) > 5 and _passes_point(step, point)  # points of a closed curve
            if closed:
                break
            if len(motions) >= MOST_CURVE_POINTS:
                raise NumericsError(
                    f"the curve does not leave the range within {MOST_CURVE_POINTS} points; narrow the range"
                )
    except NumericsError as error:
        partial = ResponseCurve(name, tuple(motions), tuple(bifurcation_points), closed)
        raise ContinuationError(str(error), error.stats, partial) from None
    return ResponseCurve(name, tuple(motions), tuple(bifurcation_points), closed)


def _steps(point: Point, name: Free, ends: tuple[float, float], points: int) -> Iterator[ContinuationStep]:
    """Yield the steps along a curve from its first point; the last ends at a limit of the range."""
    lowest, highest = min(ends), max(ends)
    direction = np.sign(ends[1] - ends[0]) * point.family.unit(name)
    index, longest_change = point.family.place(name) - len(point.z), (highest - lowest) / points

    def longest(from_point: Point, tangent: Array) -> float:
        rate = abs(tangent[index]) * from_point.family.scale[index]
        return float(longest_change / rate) if rate else math.inf

    for step in follow(point, direction, 0.1, longest):
        value = getattr(step.end.setting, name)
        if lowest < value < highest:
            yield step
            continue
        last = point_at_value(step, name, highest if value >= highest else lowest)
        yield replace(step, end=last, end_tangent=last.tangent(transfer_vector(step.tangent, step.start, last)))
        return


def _locate_bifurcations(
    subject: Excited, step: ContinuationStep, name: Free
) -> Iterator[tuple[Bifurcation, PeriodicMotion]]:
    """Yield the bifurcations in a step."""

    def changes_sign(test: Callable[[Point, Array], float]) -> bool:
        return test(step.start, step.tangent) * test(step.end, step.end_tangent) < 0.0

    turned = changes_sign(_test_function("fold", name))
    for kind in bifurcations(step.start.multipliers, step.end.multipliers, turned=turned):
        test = _test_function(kind, name)
        try:
            point = locate_zero(step, test) if changes_sign(test) else step.end
        except NotFound:
            point = step.end
        yield kind, as_periodic_motion(subject, point)


def _test_function(kind: Bifurcation, name: Free) -> Callable[[Point, Array], float]:
    """Return the function of point and tangent with a change of sign at a bifurcation."""
    if kind == "fold":
        return lambda point, tangent: float(tangent[point.family.place(name)])
    if kind == "branch point":
        return lambda point, _: float(np.prod(1.0 - point.multipliers).real)
    if kind == "period doubling":
        return lambda point, _: float(np.prod(1.0 + point.multipliers).real)
    return lambda point, _: float(np.abs(point.multipliers[point.multipliers.imag != 0.0]).max(initial=0.0)) - 1.0


def _passes_point(step: ContinuationStep, first: Point) -> bool:
    """Return whether a step passes the first point of the curve."""
    step_vector, offset = chord(step.start, step.end), chord(step.start, first)
    fraction = step_vector @ offset / (step_vector @ step_vector)
    distance = np.linalg.norm(offset - fraction * step_vector) / np.linalg.norm(step_vector)
    return bool(0.0 < fraction <= 1.0 and distance <= 0.1)  # step lengths
