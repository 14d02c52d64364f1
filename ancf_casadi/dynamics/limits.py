"""Checks of a motion before its first step: limits of its excitation, and a start that fits the beam and its base.

An excitation beyond the limits would keep an integrator busy for minutes before it fails, so that it is refused before
the first step.  The limits are far beyond experiments: a gantry travels some tens of lengths of its beam.
"""

from __future__ import annotations

import math
import warnings
from typing import get_args

import numpy as np

from ancf_casadi.dynamics.base_motion import FixedBase
from ancf_casadi.dynamics.excitation import Excitation
from ancf_casadi.dynamics.start import Start
from ancf_casadi.dynamics.tolerance import deflection
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.mechanics.state import State
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import is_choice, shown
from ancf_casadi.vibration.equilibrium import Equilibrium

MOST_LENGTHS = 1000.0  # of travel of the clamp, and of deflection under the load by the theory of small deflections
MOST_WAVE_SPEEDS = 10.0  # of velocity; a body that meets another at one wave speed is stretched by its own length
MAX_STRAIN = 0.01  # of a given state; an equilibrium needs no check
ROUNDED_STRAIN = 1e-12  # strain that rounding of the coordinates may cause
START_TOLERANCE = 1e-6  # deviation of a state from its base, relative to length, unit slope and largest velocity


def check_excitation(model: Model, times: Array, excitations: Array) -> None:
    """Refuse an excitation that is not finite or beyond the limits, from its values (k, 16) at instants (k,), s."""
    length, clamp = model.beam.length, excitations[:, : 3 * NODE]
    finite = np.isfinite(clamp).all(axis=1)
    if not finite.all():
        raise InputError(f"its position, velocity or acceleration is not finite at {times[~finite][0]:g} s", "base")
    travel = np.hypot(*(clamp[:, :2] - clamp[0, :2]).T)
    if travel.max() > MOST_LENGTHS * length:
        raise InputError(
            f"moves the clamp by {travel.max():.3g} m until {times[travel.argmax()]:g} s, but the beam is {length:g} m "
            f"long; at most {MOST_LENGTHS:g} lengths are possible. Check the unit",
            "base",
        )
    velocity = clamp[:, NODE : 2 * NODE]
    speed = np.hypot(velocity[:, 0], velocity[:, 1]) + length * np.hypot(velocity[:, 2], velocity[:, 3])
    _check_speed(model, float(speed.max()), f"at {times[speed.argmax()]:g} s", "base")
    load = excitations[:, 3 * NODE :]
    bent = max(deflection(model, times, load - load[0]), deflection(model, times, np.broadcast_to(load[0], load.shape)))
    if not bent <= MOST_LENGTHS:
        raise InputError(
            f"would bend the beam by {bent:.3g} of its lengths, if the deflection were small; at most {MOST_LENGTHS:g} "
            "are possible. Check the unit",
            "load",
        )


def check_start(model: Model, excitation: Excitation, start: Start | Equilibrium | State) -> None:
    """Refuse a start that is unknown, does not fit the model, stretches the beam, or disagrees with its base."""
    if isinstance(start, State):
        _check_state(model, excitation.at(start.time), start)
        return
    if isinstance(start, Equilibrium):
        if start.model != model:
            raise InputError("the equilibrium belongs to another model", "start")
        if not (start.stable or model.has_short_elements):
            warnings.warn(
                "the start is an unstable equilibrium, so rounding decides when and to which side the beam leaves it; "
                "start from static_equilibrium(model), which is stable, or from a State beside it",
                stacklevel=4,
            )
    elif not is_choice(start, get_args(Start)):
        names = ", ".join(get_args(Start))
        raise InputError(f"must be one of {names}, an Equilibrium or a State, got {shown(start)}", "start")
    if start == "straight":
        check_supports(model, model.straight_at_support)
    check_clamp(model, excitation.at(0.0))


def check_supports(model: Model, coordinates: Array) -> None:
    """Refuse the coordinates of a start that supports, where they are displaced or turned, would change."""
    held = model.whole(model.of_free(coordinates), coordinates[:NODE])
    if np.abs((held - coordinates) / model.scale).max() > START_TOLERANCE:
        raise InputError(
            "the shape does not fit the supports where they are displaced or turned, and would be stretched or bent to "
            "them at once; start from the equilibrium, or from a State that fits",
            "start",
        )


def check_clamp(model: Model, excitation: Array) -> None:
    """Refuse an excitation (16,) whose base begins away from the clamp of the beam at rest."""
    if _distance(model, model.straight, excitation) > START_TOLERANCE:
        raise InputError(
            f"begins with the clamp at {_point(excitation)} m, turned by "
            f"{FixedBase.at(excitation, model.beam.axis).rotation:.6g} rad, but the beam starts with its clamp at the "
            "origin, along its axis; measure the motion from there, change the axis of the beam, or start from a State",
            "base",
        )


def _check_state(model: Model, excitation: Array, state: State) -> None:
    """Refuse a state that does not fit the model, stretches the beam, or disagrees with the excitation (16,)."""
    for name, vector in (("coordinates", state.coordinates), ("velocities", state.velocities)):
        if vector.shape != (model.size,) or not np.isfinite(vector).all():
            raise InputError(f"the {name} must be {model.size} finite numbers", "start")
    check_supports(model, state.coordinates)
    _check_stretch(model, state)
    _check_speed(model, np.abs(state.velocities).max(), "in the state", "start")
    if _distance(model, state.coordinates, excitation) > START_TOLERANCE:
        raise InputError(
            f"the clamp of the state is at {_point(state.coordinates)}, that of the base motion at "
            f"{_point(excitation)} at {state.time:g} s, or its direction differs; give the base motion that led to the "
            "state and the time of the state, or no base to hold the clamp where it is",
            "start",
        )
    velocity = excitation[NODE : 2 * NODE]
    difference = np.abs(state.velocities[:NODE] - velocity).max()
    if difference > START_TOLERANCE * max(np.abs(state.velocities).max(), np.abs(velocity).max()):
        raise InputError(
            f"the clamp of the state has the velocity {_point(state.velocities)} m/s, the base motion "
            f"{_point(velocity)} m/s at {state.time:g} s, which is an impact; give the base motion that led to the "
            "state and the time of the state",
            "start",
        )


def _check_stretch(model: Model, state: State) -> None:
    """Refuse a state that stretches the beam, and warn if axial waves will take the steps of its motion.

    They do if stretch that nothing holds has more energy than bending.  Supports hold an even strain of each span;
    weight and swing, forces of m (|g| + v^2/L), hold some unevenness.
    """
    beam, strain = model.beam, model.gauss_strains(state.coordinates)
    largest = np.abs(strain).max()
    if largest > MAX_STRAIN:
        raise InputError(
            f"stretches the beam by {100 * largest:.1f} %, which sets off axial waves; bend it without stretching, "
            "as modes.state(mode, amplitude) and static_equilibrium with a tip load do",
            "start",
        )
    width, thickness, _, modulus = model.properties
    lengths, stiffness = np.repeat(beam.element_lengths / 2, 2), np.repeat(modulus * width * thickness, 2)
    # number of the span at each Gauss point
    spans = np.searchsorted(np.sort([support.point for support in beam.supports]), model.all_gauss_points)
    means = np.bincount(spans, lengths * strain) / np.maximum(np.bincount(spans, lengths), np.finfo(float).tiny)
    held_force = beam.mass * (math.hypot(*beam.gravity) + np.abs(state.velocities).max() ** 2 / beam.length)
    deviation = np.abs(strain - means[spans])
    uneven = np.maximum(deviation - held_force / stiffness - ROUNDED_STRAIN, 0.0)
    strain_energy = float(model.strain_energy(state.coordinates, model.properties))
    bending_energy = strain_energy - float(stiffness * lengths @ strain**2) / 2
    if float(stiffness * lengths @ uneven**2) / 2 > abs(bending_energy):
        warnings.warn(
            f"the start stretches the beam unevenly, by up to {100 * uneven.max():.2g} %, as a linear mode shape does: "
            "axial waves take most of the steps; start from modes.state(mode, amplitude), which bends the beam only",
            stacklevel=6,
        )


def _check_speed(model: Model, speed: float, when: str, where: str) -> None:
    """Refuse a velocity, m/s, of more than ten times that of longitudinal waves in the beam, (E/rho)^1/2."""
    _, _, density, modulus = model.properties
    waves = math.sqrt(float((modulus / density).max()))
    if not speed <= MOST_WAVE_SPEEDS * waves:
        raise InputError(
            f"moves at {speed:.3g} m/s {when}, more than {MOST_WAVE_SPEEDS:g} times as fast as longitudinal waves in "
            f"the beam, {waves:.3g} m/s. Check the unit",
            where,
        )


def _distance(model: Model, coordinates: Array, excitation: Array) -> float:
    """Return the largest difference of the clamps of a beam and its base, relative to length and unit slope."""
    length = model.beam.length
    return float((np.abs(coordinates[:NODE] - excitation[:NODE]) / np.array([length, length, 1.0, 1.0])).max())


def _point(values: Array) -> str:
    return f"({values[0] + 0.0:.6g}, {values[1] + 0.0:.6g})"  # no negative zero
