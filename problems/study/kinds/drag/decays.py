"""Decays in mode 1 under laws of the quadratic kind, which the parts about eta1 and eta2 share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ancf_casadi.damping import QuadraticDamping
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.support.inputs import is_sequence, located, physical, shown
from problems.schema.beam import law_of
from problems.study.drag.effects import RESOLVED, STEPS, Decay, Envelope, simulate_decay
from problems.study.part import Effort, Task
from problems.study.source import LawChoice, Source

DURATION, AMPLITUDE = 15.0, 0.076  # s, m at the tip
SECONDS, SECONDS_PER_PERIOD = 0.3, 0.006  # computing time of a decay, and of each of its periods


@dataclass(frozen=True)
class Variant:
    """A law whose decays are simulated.

    Parameters
    ----------
    name, title : str
        Name in the file, and title in figures.
    law : QuadraticDamping
        The law.
    """

    name: str
    title: str
    law: QuadraticDamping


@dataclass(frozen=True)
class Release:
    """Start and length of decays.

    Parameters
    ----------
    amplitude : float
        Displacement of the tip at the start, m.
    duration : float
        Length, s.
    steps_per_period : int
        Least number of integrator steps per period.
    """

    amplitude: float
    duration: float
    steps_per_period: int = STEPS

    def shortened(self, effort: Effort) -> Release:
        """Return the release of a quick study, whose decays are shorter and have longer steps."""
        return Release(self.amplitude, effort.window * self.duration, effort.steps_per_period)

    def task(self, beam: Beam, law: QuadraticDamping, frequency: float) -> Task:
        """Return the simulation of a decay as a task."""
        inputs = (beam, law, frequency, self.amplitude, self.duration, self.steps_per_period)
        return Task(simulate_decay, inputs, SECONDS + SECONDS_PER_PERIOD * frequency * self.duration)


def read_variants(source: Source, given: Mapping[str, Any], where: str) -> tuple[Variant, ...]:
    """Return the laws that the key ``laws`` names.

    Raises
    ------
    InputError
        If it is no list of names, or a law is not the quadratic one.
    """
    names = given["laws"]
    if not is_sequence(names) or not names:
        raise InputError(f"name one or more of [[laws]], got {shown(names)}", f"{where}: laws")
    found = []
    for name in names:
        place = f"{where}: laws"
        choice: LawChoice = source.law_choice(name, place)
        law = law_of(choice.terms, source.model, place) if not choice.needs else None
        if not isinstance(law, QuadraticDamping):
            raise InputError(f'{name!r} must have one term, with law = "quadratic"', place)
        found.append(Variant(choice.name, choice.title, law))
    return tuple(found)


def read_release(given: Mapping[str, Any], where: str) -> Release:
    """Return start and length of the decays.

    Raises
    ------
    InputError
        If a number is not positive.
    """
    with located(where):
        return Release(
            physical(given.get("amplitude", AMPLITUDE), "amplitude"),
            physical(given.get("duration", DURATION), "duration"),
        )


def decay_numbers(variant: Variant, decay: Decay, times: Sequence[float]) -> dict[str, Any]:
    """Return the numbers of a decay for ``results.json``: None for what the decay does not reach."""

    def reached(value: float) -> float | None:
        return value if np.isfinite(value) else None

    return {
        "law": variant.name,
        "frequency_hz": decay.frequency,
        "eta1": decay.law.eta1,
        "eta2_per_m": decay.law.eta2,
        "start_amplitude_m": decay.start_amplitude,
        "mode_2_at_the_start": decay.other_modes,
        "time_to_a_tenth_s": reached(decay.envelope.time_to(0.1)),
        "time_to_a_tenth_by_formula_s": reached(decay.formula.time_to(0.1)),
        "times_s": list(times),
        "amplitude_m": [reached(decay.envelope.at(time)) for time in times],
        "amplitude_by_formula_m": [reached(decay.formula.at(time)) for time in times],
        "steps": decay.steps,
    }


def amplitude_left(envelope: Envelope, time: float) -> float | str:
    """Return the amplitude at a time (s) in mm for a table; what a simulation does not resolve as an upper limit."""
    amplitude = envelope.at(time)
    if amplitude < RESOLVED or (np.isnan(amplitude) and envelope.amplitude[-1] < RESOLVED):
        return f"< {1e3 * RESOLVED:g}"
    return 1e3 * amplitude
