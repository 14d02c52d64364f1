"""Measured response curves and the reduced model that is fitted to them, for values of the unknowns by name."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ancf_casadi.damping import DampingLaw, FrictionDamping, ModalDamping, QuadraticDamping
from ancf_casadi.damping.law import SumOfLaws
from ancf_casadi.mechanics.model import Model
from ancf_casadi.reduction import reduce_model
from ancf_casadi.support.arrays import Array, Mask
from problems.properties.observation import FACTORS
from problems.properties.response import changed
from problems.response.balance import DrivenBalance
from problems.response.driven import Driven, driven
from problems.response.points import Measured
from problems.response.record import ResponseRecord
from problems.response.unknowns import excitation_name, frequency_name
from problems.response.weights import Weights

MODULUS = "elastic_modulus"
WITHOUT_MODULUS = (FrictionDamping, ModalDamping, QuadraticDamping)  # laws whose forces do not contain the modulus


@dataclass(frozen=True, eq=False)
class ResponseProblem:
    """Measured response curves, and the reduced model that is fitted to them.

    Parameters
    ----------
    model : Model
        The beam.
    records : tuple of ResponseRecord
        The measurements.
    law : DampingLaw
        The damping law.
    modes, harmonics : int
        Numbers of modes and of harmonics of the motion.
    weights : Weights
        The standard deviations.
    excitation : str
        ``known``, ``common`` or ``each``.
    """

    model: Model
    records: tuple[ResponseRecord, ...]
    law: DampingLaw
    modes: int
    harmonics: int
    weights: Weights
    excitation: str

    def finer(self) -> ResponseProblem:
        """Return the problem with one mode and two harmonics more."""
        most = self.model.size - self.model.free.start
        return replace(self, modes=min(self.modes + 1, most), harmonics=self.harmonics + 2)

    @property
    def series(self) -> list[int]:
        """Lengths of the series of residuals."""
        return list(self.weights.lengths)

    @property
    def rows(self) -> list[Mask]:
        """Residuals of each record among all."""
        owner = np.repeat([record for record, _ in self.weights.owners], self.weights.lengths)
        return [owner == k for k in range(len(self.records))]

    def measured(self, values: Mapping[str, float]) -> list[list[Measured]]:
        """Return the points of each record, with the levels that belong to values of the unknowns by name."""
        found = []
        for k, record in enumerate(self.records):
            factor = values.get(excitation_name(k, self.excitation), 1.0)
            phases = np.full(record.f.size, math.nan) if record.measured_phases is None else record.measured_phases
            rows = np.array([record.amplitudes, phases, factor * record.a]).T
            pairs = zip(record.f, rows, self.weights.deviations(k).T, strict=True)
            found.append([Measured(2 * math.pi * f, row, own) for f, row, own in pairs])
        return found

    def balances(self, values: Mapping[str, float]) -> list[DrivenBalance]:
        """Return the driven beam of each record, for values of the unknowns by name."""
        factors = np.array([values.get(name, 1.0) if name in self.of_model else 1.0 for name in FACTORS])
        model = changed(self.model, factors) if (factors != 1.0).any() else self.model
        reduced = reduce_model(model, modes=self.modes, damping=self.law)
        kinds: dict[Any, Driven] = {}  # records that differ in size alone share their Functions
        found = []
        for record in self.records:
            kind = record.sensor, record.load, record.base and record.base.direction
            kinds[kind] = kinds.get(kind) or driven(reduced, record)
            size = record.base.amplitude if record.base else kinds[kind].drive.amplitude
            found.append(DrivenBalance(kinds[kind], self.harmonics, size))
        return found

    @property
    def of_model(self) -> tuple[str, ...]:
        """The properties in the constants of the reduced model; the modulus only if the damping contains it."""
        terms = self.law.laws if isinstance(self.law, SumOfLaws) else (self.law,)
        free = all(isinstance(term, WITHOUT_MODULUS) for term in terms)
        return tuple(name for name in FACTORS if not (free and name == MODULUS))

    def shared(self, values: Mapping[str, float]) -> Array:
        """Return the unknowns s of the equation of motion (``driven``), for values by name."""
        law = [values.get(own.name, own.value) for own in self.law.parameters]
        modulus = 1.0 if MODULUS in self.of_model else values.get(MODULUS, 1.0)
        return np.array([*law, *(values.get(frequency_name(k), 1.0) for k in range(self.modes)), modulus])

    def shared_columns(self, names: Sequence[str]) -> list[tuple[int, int]]:
        """Return the pairs of a column in s and the place of its unknown."""
        own = [parameter.name for parameter in self.law.parameters]
        known = [*own, *(frequency_name(k) for k in range(self.modes)), MODULUS]
        shared = [name in known and name not in self.of_model for name in names]
        return [(known.index(name), place) for place, name in enumerate(names) if shared[place]]
