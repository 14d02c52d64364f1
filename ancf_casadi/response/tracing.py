"""Curves of periodic motions: frequency response, amplitude response, and response to a parameter.

A curve begins with the motion that a slowly growing excitation reaches (``onset``) at the first value of the
frequency, the amplitude or the parameter.  It is followed (``harmonic_balance.continuation``) until it leaves the
range, or closes.
Between neighbouring points, a fold is where the curve turns; the Floquet multipliers show other bifurcations
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
from ancf_casadi.response.excited import Body, Excited, excited
from ancf_casadi.response.floquet import Bifurcation, bifurcations
from ancf_casadi.response.harmonic_balance.balance import HarmonicBalance
from ancf_casadi.response.harmonic_balance.continuation import (
    ContinuationStep,
    carried,
    follow,
    located,
    point_at,
)
from ancf_casadi.response.harmonic_balance.family import Family, NotFound, Point
from ancf_casadi.response.harmonic_balance.system import HarmonicForce
from ancf_casadi.response.onset import RESPONSE_ERROR, grown, motion_of, reached, set_to
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
        A motion from which the curve begins, such as one of a closed curve (isola), instead of the one that a slowly
        growing excitation reaches.  If its system or amplitude of excitation differs, the nearest motion of this one is
        taken.  The curve then goes towards the last frequency.
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
    subject, tolerance = excited(model, damping, base, load, force), positive(tolerance, "tolerance")
    omega, end = 2 * math.pi * first, 2 * math.pi * last
    if start is None:
        point = grown(subject, omega, subject.drive.amplitude, tolerance)
    else:
        point = _near(subject, start, tolerance)
        if not min(omega, end) <= point.setting.omega <= max(omega, end):
            raise InputError(f"vibrates at {start.frequency:.6g} Hz, outside the range of frequencies", "start")
    return _traced(subject, point, "omega", (omega, end), points)


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
    subject, tolerance = excited(model, damping, base, load, force), positive(tolerance, "tolerance")
    point = grown(subject, subject.drive.omega, first, tolerance)
    return _traced(subject, point, "amplitude", (first, last), points)


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
        Name of a parameter: of the damping law, ``gravity_x`` or ``gravity_y``, with the full beam a property of an
        element such as ``elastic_modulus_1``; for another system one of its own.
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
    subject, tolerance = excited(model, damping, base, load, force), positive(tolerance, "tolerance")
    names = [own.name for own in subject.system.parameters]
    index = names.index(choice(parameter, names, "parameter"))
    first, last = vector(values, "values")
    if max(abs(first), abs(last)) > LARGEST_TIME:
        raise InputError(f"must be within {LARGEST_TIME:g}, got {max(abs(first), abs(last)):g}", "values")
    given = subject.system.values
    given[index] = first
    subject = replace(subject, system=subject.system.with_values(given))
    point = grown(subject, subject.drive.omega, subject.drive.amplitude, tolerance)
    balance, setting = replace(point.family.balance, varied=index), replace(point.setting, value=first)
    point = replace(point, family=replace(point.family, balance=balance, setting=setting))
    return _traced(subject, point, "value", (first, last), points)


def _near(subject: Excited, start: PeriodicMotion, tolerance: float) -> Point:
    """Return the motion of a system near a given one, continued to the amplitude of its excitation."""
    check_instance(start, "start", PeriodicMotion)
    if start.balance.system.size != subject.system.size:
        raise InputError("belongs to a system with another number of coordinates", "start")
    balance = HarmonicBalance(subject.system, subject.drive, start.balance.fourier)
    family = Family(balance, start.setting, ("amplitude",), (start.setting.amplitude,), 1.0, tolerance)
    try:
        point = point_at(family, family.joined(start.coefficients, start.setting), family.unit("amplitude"))
    except NotFound:
        raise NumericsError("the system has no steady state near the given start; give another one") from None
    amplitude = subject.drive.amplitude
    return point if start.drive_amplitude == amplitude else reached(point, amplitude)


def _traced(subject: Excited, start: Point, name: Free, ends: tuple[float, float], points: int) -> ResponseCurve:
    """Return the curve from a motion, in one free entry of the setting, until it leaves the range or closes."""
    points = whole(points, "points", 2)
    if ends[0] == ends[1]:
        raise InputError("the first and the last value are equal", RANGES[name])
    family = replace(start.family, setting=start.setting, free=(name,), scales=(abs(ends[1] - ends[0]),))
    point = family.at(family.joined(start.coefficients, start.setting), family.unit(name))
    motions, found, closed = [motion_of(subject, point)], list[BifurcationPoint](), False
    try:
        for step in _steps(point, name, ends, points):
            for kind, motion in _bifurcations(subject, step, name):
                found.append(BifurcationPoint(kind, len(motions), motion))
                motions.append(motion)
            motions.append(motion_of(subject, step.end))
            closed = len(motions) > 5 and _passes(step, point)  # points of a closed curve
            if closed:
                break
            if len(motions) >= MOST_CURVE_POINTS:
                raise NumericsError(
                    f"the curve does not leave the range within {MOST_CURVE_POINTS} points; narrow the range"
                )
    except NumericsError as error:
        partial = ResponseCurve(name, tuple(motions), tuple(found), closed)
        raise ContinuationError(str(error), error.stats, partial) from None
    return ResponseCurve(name, tuple(motions), tuple(found), closed)


def _steps(point: Point, name: Free, ends: tuple[float, float], points: int) -> Iterator[ContinuationStep]:
    """Yield the steps along a curve from its first point; the last ends at a limit of the range."""
    lowest, highest = min(ends), max(ends)
    direction = np.sign(ends[1] - ends[0]) * point.family.unit(name)
    place, most = point.family.place(name) - len(point.z), (highest - lowest) / points

    def longest(at: Point, tangent: Array) -> float:
        rate = abs(tangent[place]) * at.family.scale[place]
        return float(most / rate) if rate else math.inf

    for step in follow(point, direction, 0.1, longest):
        value = getattr(step.end.setting, name)
        if lowest < value < highest:
            yield step
            continue
        last = set_to(step, name, highest if value >= highest else lowest)
        yield replace(step, end=last, end_tangent=last.tangent(carried(step.tangent, step.start, last)))
        return


def _bifurcations(subject: Excited, step: ContinuationStep, name: Free) -> Iterator[tuple[Bifurcation, PeriodicMotion]]:
    """Yield the bifurcations in a step."""
    along = [tangent[point.family.place(name)] for point, tangent in
             ((step.start, step.tangent), (step.end, step.end_tangent))]  # fmt: skip
    turned = along[0] * along[1] < 0.0
    for kind in bifurcations(step.start.multipliers, step.end.multipliers, turned=turned):
        test = _test(kind, name)
        at_start, at_end = test(step.start, step.tangent), test(step.end, step.end_tangent)
        try:
            point = located(step, test) if at_start * at_end < 0.0 else step.end
        except NotFound:
            point = step.end
        yield kind, motion_of(subject, point)


def _test(kind: Bifurcation, name: Free) -> Callable[[Point, Array], float]:
    """Return the function of point and tangent that changes its sign at a bifurcation."""
    if kind == "fold":
        return lambda point, tangent: float(tangent[point.family.place(name)])
    if kind == "branch point":
        return lambda point, _: float(np.prod(1.0 - point.multipliers).real)
    if kind == "period doubling":
        return lambda point, _: float(np.prod(1.0 + point.multipliers).real)
    return lambda point, _: float(np.abs(point.multipliers[point.multipliers.imag != 0.0]).max(initial=0.0)) - 1.0


def _passes(step: ContinuationStep, first: Point) -> bool:
    """Return whether a step passes the first point of the curve."""
    family, harmonics = step.start.family, step.start.family.balance.fourier.harmonics
    begin, end, point = (own.family.resized(own.z, harmonics) / family.scale for own in (step.start, step.end, first))
    along, towards = end - begin, point - begin
    share = along @ towards / (along @ along)
    # distance of the first point from a step, relative to its length, at which a curve has closed
    return bool(0.0 < share <= 1.0 and np.linalg.norm(towards - share * along) <= 0.1 * np.linalg.norm(along))
