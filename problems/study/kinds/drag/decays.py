"""Decays in mode 1 under laws of the quadratic kind, which the parts about eta1 and eta2 share."""

from __future__ import annotations

from abc import ABC
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Self

import numpy as np
from msgspec import Meta

from ancf_casadi.damping import QuadraticDamping
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import Beam
from problems.modal_damping.effects import LEAST_AMPLITUDE, Envelope, SimulatedDecay, simulate_decay
from problems.schema.beam import law_of
from problems.schema.table import UNLISTED, Positive
from problems.study.part import Effort, Part, Task
from problems.study.source import LawChoice, Source


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


@dataclass(frozen=True, kw_only=True)
class DecayPart(Part, ABC):
    """Base class of the parts with decays in mode 1 of the beam of the file."""

    naming, beam = ("beam",), ""

    laws: Annotated[tuple[LawChoice, ...], Meta(min_length=1, description="names of quadratic [[laws]]")]
    frequency: Annotated[Positive, Meta(description="Hz, of mode 1; the elastic modulus is scaled")] = 1.85
    amplitude: Annotated[Positive, Meta(description="m, at the tip")] = 0.076
    duration: Annotated[Positive, Meta(description="s")] = 15.0
    variants: Annotated[tuple[Variant, ...], UNLISTED] = ()

    def checked(self, source: Source, where: str) -> Self:
        """Return the part with its laws, each of them a quadratic one."""
        variants = []
        for choice in self.laws:
            law = law_of(choice.terms, source.model, f"{where}: laws") if not choice.needs else None
            if not isinstance(law, QuadraticDamping):
                raise InputError(f'{choice.name!r} must have one term, with law = "quadratic"', f"{where}: laws")
            variants.append(Variant(choice.name, choice.title, law))
        return replace(self, variants=tuple(variants))

    def task(self, beam: Beam, law: QuadraticDamping, frequency: float, effort: Effort) -> Task:
        """Return the simulation of a decay as a task."""
        duration = effort.window * self.duration
        inputs = (beam, law, frequency, self.amplitude, duration, effort.steps_per_period)
        # computing time of a decay, and of each of its periods
        return Task(simulate_decay, inputs, 0.3 + 0.006 * frequency * duration)


def decay_numbers(variant: Variant, decay: SimulatedDecay, times: Sequence[float]) -> dict[str, Any]:
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
    if amplitude < LEAST_AMPLITUDE or (np.isnan(amplitude) and envelope.amplitude[-1] < LEAST_AMPLITUDE):
        return f"< {1e3 * LEAST_AMPLITUDE:g}"
    return 1e3 * amplitude
