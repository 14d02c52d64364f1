"""Measured response curves of a beam as a block of a fit, and the reduced model that is fitted to them.

The beam is the reduced model in a few modes, each with several harmonics; a last evaluation with one mode and two
harmonics more shows the effect of this truncation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Self

import numpy as np

from ancf_casadi.damping import DampingLaw, FrictionDamping, ModalDamping, QuadraticDamping
from ancf_casadi.damping.law import SumOfLaws
from ancf_casadi.estimation.block import Account, Evaluation, Fitted
from ancf_casadi.estimation.solve import LARGEST_SHIFT, meaningful
from ancf_casadi.exceptions import NumericsError
from ancf_casadi.mechanics.lumped import lumped_kind
from ancf_casadi.mechanics.model import Model
from ancf_casadi.reduction import ReducedModel, reduce_model
from ancf_casadi.reduction.reduced import Reduction, rebuilt
from ancf_casadi.response.harmonic_balance.system import beam_drive
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.tables import known
from problems.beam.curves.beam_residuals import BeamResponses
from problems.beam.curves.checks import checked
from problems.beam.curves.driven import Driven, driven, small_response
from problems.beam.curves.record import ResponseRecord
from problems.beam.curves.residuals import first_weights
from problems.beam.curves.response_block import ResponseBlock
from problems.beam.properties import ELASTIC, Owners, value_of
from problems.beam.unknowns import frequency_name, mode_of

MODULUS = ("elastic_modulus", "bending_stiffness")  # the strain energy of all elements is proportional to each
LEVEL_ERROR = 0.01  # relative error of the levels whose effect the result states
LEAST_SHIFT = 1e-4  # relative shift of an estimate that is worth more modes and harmonics
WITHOUT_MODULUS = (FrictionDamping, ModalDamping, QuadraticDamping)  # laws whose forces do not contain the modulus


@dataclass(frozen=True, eq=False, kw_only=True)
class CurveBlock(ResponseBlock):
    """Measured response curves of a beam in one configuration."""

    model: Model
    law: DampingLaw
    first: Mapping[str, float]  # values of the unknown properties by name, SI units
    modes: int  # of the motion
    harmonics: int
    refinements: int = 0  # times that modes and harmonics were added
    notes: tuple[str, ...] = ()  # corrections of phases, and doubts about levels

    @property
    def meaningful(self) -> float:
        """Relative shift of an estimate that is worth more modes and harmonics."""
        return LEAST_SHIFT

    def evaluation(self, before: Evaluation | None = None) -> BeamResponses:
        """Return the residuals; the search for each motion starts from the last one."""
        return BeamResponses(self, before if isinstance(before, BeamResponses) else None)

    def error(self, values: Mapping[str, float], residuals: Array, evaluation: Any) -> Array:
        """Return the error of residuals, from one mode and two harmonics more."""
        return np.asarray(self.finer().evaluation(evaluation).at(values)[0] - residuals)

    def refined(self, shift: float) -> Self | None:
        """Return the block with one mode and two harmonics more, twice at most."""
        return self.finer() if self.refinements < 2 else None

    def checked(self, frequencies: Array) -> Self:
        """Return the block with the phases of its records as they should be; ``frequencies`` are those of the model."""
        numbered, notes = [], list[str]()
        s = self.shared({})
        for (number, record), system in zip(self.numbered, self.driven({}), strict=True):
            own = float(frequencies[mode_of(record, frequencies)])
            try:
                computed = small_response(system, record, own, s)
            except NumericsError:  # without damping there is no response at the resonance
                computed = None
            if computed is not None:
                record, found = checked(record, computed)
                notes += found
            numbered.append((number, record))
        return replace(self, numbered=tuple(numbered), notes=tuple(notes))

    def finer(self) -> Self:
        """Return the block with one mode and two harmonics more."""
        most = self.model.freedoms
        return replace(
            self, modes=min(self.modes + 1, most), harmonics=self.harmonics + 2, refinements=self.refinements + 1
        )

    def account(self, fitted: Fitted) -> Account:
        """Return errors of the amplitudes, the effects of truncation and levels, and points without a stable motion."""
        own, worst = super().account(fitted), meaningful(fitted.shifts, fitted.fit, LEAST_SHIFT)
        truncation = (
            f"{self.modes} modes with {self.harmonics} harmonics; one mode and two harmonics more shift no "
            f"estimate by more than {np.abs(fitted.shifts).max():.2g} standard errors"
        )
        names, by_levels = fitted.fit.names, self._level_shifts(fitted)
        notes = [*self.notes, *self._shift_warnings(worst, by_levels, names), *own.warnings]
        data = own.data | {
            "modes": self.modes,
            "harmonics": self.harmonics,
            "truncation_shifts": [known(shift) for shift in fitted.shifts.tolist()],
            "level_shifts": [known(shift) for shift in by_levels.tolist()],
        }
        return Account([*own.lines, truncation], notes, data)

    def _level_shifts(self, fitted: Fitted) -> Array:
        """Return the shift of each estimate if all levels are larger by ``LEVEL_ERROR``, in standard errors."""
        common = replace(self, names=(*(n for n in self.names if not n.startswith("excitation")), "excitation"))
        derivatives = common.evaluation(fitted.evaluation).at({**fitted.values, "excitation": 1.0})[1][:, -1]
        change = np.zeros(len(fitted.fit.residuals))
        change[fitted.rows] = fitted.scale * LEVEL_ERROR * derivatives
        return fitted.fit.shifts(change)

    def _shift_warnings(self, by_finer: Array, by_levels: Array, names: Sequence[str]) -> list[str]:
        """Return warnings about the effects of more modes and harmonics, and of errors of levels held exact."""
        notes, worst = [], int(np.nanargmax(np.abs(by_levels)))
        if by_finer.max() > LARGEST_SHIFT:
            notes.append(
                f"one mode and two harmonics more shift {names[int(by_finer.argmax())]} by {by_finer.max():.2g} "
                "standard errors; give more (modes, harmonics)"
            )
        if abs(by_levels[worst]) > 1.0 and not any(self.excitation(number) for number, _ in self.numbered):
            notes.append(
                f"the levels of the excitation count as exact: if all of them are 1 % too small, {names[worst]} shifts "
                f"by {by_levels[worst]:+.2g} standard errors; if they are not that certain, add 'excitation' to the "
                "unknowns and give it a prior"
            )
        return notes

    def driven(self, values: Mapping[str, float]) -> list[Driven]:
        """Return the driven beam of each record, for values of the unknowns by name."""
        reduced = self.reduction(values)
        kinds: dict[Any, Driven] = {}  # records that differ in size alone share their Functions
        found = []
        for record in self.records:
            kind = record.sensor, record.load, record.base and record.base.direction
            kinds[kind] = kinds.get(kind) or driven(reduced, record, self.harmonics)
            found.append(replace(kinds[kind], drive=beam_drive(record.base, record.load)))
        return found

    def reduction(self, values: Mapping[str, float]) -> Reduction:
        """Return the reduction of the beam for values of the unknowns by name."""
        factors = [values.get(name, one) / one if name in self.of_model else 1.0 for name, one in self.first.items()]
        model = self._owners.changed(self.model, np.array(factors))
        first = _reduced(self.model, self.modes, self.law)
        return first if model is self.model else rebuilt(first, model)

    @cached_property
    def _owners(self) -> Owners:
        return Owners.of(self.model.beam, tuple(self.first))

    @property
    def of_model(self) -> tuple[str, ...]:
        """The properties in the constants of the reduced model."""
        terms, beam = self.law.laws if isinstance(self.law, SumOfLaws) else (self.law,), self.model.beam
        free = not any(lumped_kind(name) in ELASTIC for name in beam.lumped)
        free = free and all(isinstance(term, WITHOUT_MODULUS) for term in terms)
        without = {*(MODULUS if free else ()), *(name for name in self.first if not value_of(beam, name))}
        return tuple(name for name in self.first if name not in without)

    @cached_property
    def _places(self) -> dict[str, tuple[int, float]]:
        """Place of each possible unknown in s (``driven``), and the derivative of s by it."""
        names = [*(own.name for own in self.law.parameters), *(frequency_name(k) for k in range(self.modes))]
        moduli = [name for name in MODULUS if name in self.first and name not in self.of_model]
        places = {name: (k, 1.0) for k, name in enumerate(names)}
        return places | {name: (len(names), 1 / self.first[name]) for name in moduli}

    def shared(self, values: Mapping[str, float]) -> Array:
        """Return the unknowns s of the equation of motion (``driven``), for values by name."""
        s = np.array([*(own.value for own in self.law.parameters), *np.ones(self.modes + 1)])
        for name in self._places.keys() & values.keys():
            place, slope = self._places[name]
            s[place] = slope * values[name]
        return s

    @cached_property
    def shared_directions(self) -> Array:
        """Derivatives of s by the unknowns of the fit, (s, n)."""
        directions = np.zeros((len(self.law.parameters) + self.modes + 1, len(self.names)))
        for k, name in enumerate(self.names):
            if name in self._places:
                place, slope = self._places[name]
                directions[place, k] = slope
        return directions


@lru_cache(maxsize=4)
def _reduced(model: Model, modes: int, law: DampingLaw) -> ReducedModel:
    """Return the reduced model of a beam, which all others of the same block resemble."""
    return reduce_model(model, modes=modes, damping=law)


def curve_block(
    model: Model,
    numbered: Sequence[tuple[int, ResponseRecord]],
    law: DampingLaw,
    names: Sequence[str],
    first: Mapping[str, float],
    *,
    modes: int,
    harmonics: int,
) -> CurveBlock:
    """Return response curves as a block with first weights, which knows those of the unknowns that matter to it."""
    weights, known = first_weights([record for _, record in numbered]), {*first, *(own.name for own in law.parameters)}
    own = tuple(name for name in names if name in known or name.startswith(("frequency_", "excitation")))
    most = model.freedoms
    return CurveBlock(
        tuple(numbered), own, weights, model=model, law=law, first=first, modes=min(modes, most), harmonics=harmonics
    )
