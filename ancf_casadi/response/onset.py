"""The periodic motion that a harmonic excitation reaches when it grows slowly from zero.

If several steady states exist, as between the folds of a response curve, this one is found by continuation: the curve
of motions is followed in the amplitude of the excitation, from small motion to the first point with the requested
amplitude.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.dynamics.base_motion import BaseMotion
from ancf_casadi.dynamics.tip_load import TipLoad
from ancf_casadi.exceptions import NumericsError
from ancf_casadi.response.excited import Body, Excited, excite
from ancf_casadi.response.harmonic_balance.balance import HarmonicBalance, Setting, motion_size
from ancf_casadi.response.harmonic_balance.continuation import (
    SMALLEST_SIZE,
    ContinuationStep,
    follow,
    locate_zero,
    point_at,
)
from ancf_casadi.response.harmonic_balance.family import Family, NotFound, Point
from ancf_casadi.response.harmonic_balance.system import HarmonicForce
from ancf_casadi.response.periodic import PeriodicMotion
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import positive
from ancf_casadi.support.interrupts import lasting_interrupts

RESPONSE_ERROR = 1e-6
START_SHARE = 0.01  # of the requested amplitude of the excitation; the continuation begins there
MAX_ONSET_STEPS = 300


@lasting_interrupts()
def periodic_motion(
    model: Body,
    *,
    damping: DampingLaw | None = None,
    base: BaseMotion | None = None,
    load: TipLoad | None = None,
    force: HarmonicForce | None = None,
    tolerance: float = RESPONSE_ERROR,
) -> PeriodicMotion:
    """Return the steady state of a vibration under harmonic excitation.

    Of several steady states, it is the one reached when the excitation grows slowly from zero.  It need not be stable:
    see ``stable`` of the result.

    Parameters
    ----------
    model : Model, ReducedModel or SecondOrderSystem
        The full beam, the beam in a few modes, or another system.
    damping : DampingLaw, optional
        The damping law; undamped if not given, and the law of the reduced model for a reduced model.
    base : HarmonicBase, optional
        Motion of the clamp.  A ``ramp`` has no effect on the steady state.
    load : HarmonicLoad, optional
        Load at the tip or another point, instead of a base motion; it must not follow the beam.
    force : HarmonicForce, optional
        Excitation of a SecondOrderSystem.
    tolerance : float
        Largest estimated error of the motion, relative to its size; it decides the numbers of harmonics and samples.

    Raises
    ------
    InputError
        If there is not exactly one excitation, it is not harmonic, or it stops.
    EquilibriumError
        If the beam has no equilibrium under gravity.
    NumericsError
        If the motion cannot be followed up to the amplitude of the excitation, or needs too many harmonics.

    Examples
    --------
    >>> from ancf_casadi import Beam, HarmonicBase, Model, RayleighDamping, periodic_motion, reduce_model
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> reduced = reduce_model(Model(beam), modes=2, damping=RayleighDamping(alpha=0.5))
    >>> motion = periodic_motion(reduced, base=HarmonicBase(amplitude=5e-3, frequency=1.9))
    >>> print(f"the tip swings {1e3 * motion.amplitude():.0f} mm")
    the tip swings 155 mm
    """
    tolerance = positive(tolerance, "tolerance")
    subject = excite(model, damping, base, load, force)
    return as_periodic_motion(subject, follow_onset(subject, subject.drive.omega, subject.drive.amplitude, tolerance))


def as_periodic_motion(subject: Excited, point: Point) -> PeriodicMotion:
    """Return a point of a curve as a periodic motion."""
    balance = point.family.balance
    return PeriodicMotion(subject, balance, point.coefficients, point.setting, point.multipliers, point.errors)


def follow_onset(subject: Excited, omega: float, amplitude: float, tolerance: float) -> Point:
    """Return the motion that a slowly growing excitation reaches, with the amplitude as the free entry."""
    balance = subject.balance
    response = linear_response(balance, omega)
    # 0.01 limits the size of the first motion, relative to the scale of the system
    size = max(motion_size(balance, amplitude * response[1]), SMALLEST_SIZE)
    start_amplitude = amplitude * min(START_SHARE, 0.01 / size)
    if start_amplitude < 1e-9 * amplitude:
        raise _resonance_error(omega)
    start = small_motion_at(balance, omega, response, start_amplitude, amplitude, tolerance)
    return continue_to_amplitude(start, amplitude)


def linear_response(balance: HarmonicBalance, omega: float) -> tuple[Array, Array]:
    """Return the coefficients in equilibrium and their derivatives by the amplitude of the excitation, (2 H + 1, n)."""
    at_rest = solve_equilibrium(balance, omega)
    linear, change = balance.linearise(at_rest, Setting(omega, 0.0)), np.zeros_like(at_rest)
    try:
        change[balance.allowed] = -np.linalg.solve(linear.by_coefficients, linear.by["amplitude"])
    except np.linalg.LinAlgError:
        raise _resonance_error(omega) from None
    return at_rest, change


def small_motion_at(
    balance: HarmonicBalance,
    omega: float,
    response: tuple[Array, Array],
    amplitude: float,
    scale: float,
    tolerance: float,
) -> Point:
    """Return the motion near the linear response to a small amplitude; ``scale`` is a typical amplitude."""
    (at_rest, response_slope), setting = response, Setting(omega, 0.0)
    size = motion_size(balance, amplitude * response_slope)
    # a force of second order in the excitation has a response although the linear one is zero
    family = Family(balance, setting, ("amplitude",), (scale,), size if size > SMALLEST_SIZE else 0.01, tolerance)
    start, change = family.join(at_rest, setting), family.join(amplitude * response_slope, Setting(omega, amplitude))
    try:
        return point_at(family, family.add_change(start, change), family.unit("amplitude"))
    except NotFound:
        raise NumericsError(
            f"no steady state was found at {omega / (2 * np.pi):.6g} Hz even for a small fraction of the excitation: "
            "replace a force that jumps, such as dry friction, by a smooth one, or change the frequency"
        ) from None


def continue_to_amplitude(point: Point, amplitude: float) -> Point:
    """Follow the curve of motions to the first point at which the excitation has the amplitude."""
    direction = np.sign(amplitude - point.setting.amplitude) * point.family.unit("amplitude")
    step = crossing(point, direction, lambda end: end.setting.amplitude - amplitude, 4.0)
    if step is None:
        raise NumericsError(
            f"the amplitude of the excitation stays below {amplitude:g} for {MAX_ONSET_STEPS} steps along "
            "the curve of motions; "
            "without enough damping a resonance has no steady state: add damping, or change the frequency"
        )
    return point_at_value(step, "amplitude", amplitude)


def crossing(
    point: Point,
    direction: Array,
    test: Callable[[Point], float],
    first_step: float,
    longest: Callable[[Point, Array], float] = lambda point, tangent: math.inf,
) -> ContinuationStep | None:
    """Return the first of 300 steps along a curve in which a function changes its sign, or None."""
    for step in itertools.islice(follow(point, direction, first_step, longest), MAX_ONSET_STEPS + 1):
        if (test(step.start) < 0.0) != (test(step.end) < 0.0):
            return step
    return None


def point_at_value(step: ContinuationStep, name: str, value: float) -> Point:
    """Return the point of a step at which a free entry of the setting has the value."""
    family = step.start.family
    scale = family.scale[family.place(name)]

    try:
        nearby = locate_zero(step, lambda point, _: float((getattr(point.setting, name) - value) / scale))
        guess = nearby.z.copy()
        guess[nearby.family.place(name)] = value
        return point_at(nearby.family, guess, nearby.family.unit(name), nearby)
    except NotFound:
        raise NumericsError(
            f"no periodic motion was found at {name} = {value:g}; try a slightly different value"
        ) from None


def solve_equilibrium(balance: HarmonicBalance, omega: float) -> Array:
    """Return the coefficients in equilibrium without excitation, (2 H + 1, n)."""
    C = np.zeros((balance.fourier.size, balance.system.size))
    C[0] = balance.system.rest
    setting = Setting(omega, 0.0)
    for _ in range(50):
        derivatives = balance.linearise(C, setting)
        K = balance.system.matrix(derivatives.matrices[0][0])
        try:
            change = -np.linalg.solve(K, balance.residual(C, setting)[0])
        except np.linalg.LinAlgError:
            break
        C[0] += change
        if (np.abs(change) / balance.system.scale).max() <= 1e-12:
            return C
    raise NumericsError(
        "the system has no equilibrium near its state of rest, or may drift; give another state of rest, or a stiffness"
    )


def _resonance_error(omega: float) -> NumericsError:
    return NumericsError(
        f"there is no steady state at {omega / (2 * np.pi):.6g} Hz, even of small motion: an undamped mode is in "
        "resonance there; add damping, or change the frequency"
    )
