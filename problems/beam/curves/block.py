"""Measured response curves of a beam as a block of a fit, and the reduced model that is fitted to them.

The beam is the reduced model in a few modes, each with several harmonics; a last evaluation with one mode and two
harmonics more shows the effect of this truncation.

Properties, tip mass and clamp enter the constants of the reduced model, except for the elastic modulus if the damping
does not contain it.  The derivatives of F and of the reading by these are central differences at fixed coefficients,
between two models at the relative distances ``DIFFERENCE``, of the first value if either sign is possible; all other
derivatives are exact.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Self

import numpy as np

from ancf_casadi.damping import DampingLaw, FrictionDamping, ModalDamping, QuadraticDamping
from ancf_casadi.damping.law import law_terms
from ancf_casadi.estimation.block import Account, Fitted
from ancf_casadi.estimation.refinement import LARGEST_SHIFT, meaningful
from ancf_casadi.exceptions import NumericsError
from ancf_casadi.mechanics.lumped import lumped_kind
from ancf_casadi.mechanics.mesh_limits import largest_bend
from ancf_casadi.mechanics.model import Model
from ancf_casadi.reduction import ReducedModel, reduce_model
from ancf_casadi.reduction.reduced import Reduction, rebuild_reduction
from ancf_casadi.response.harmonic_balance.system import beam_drive
from ancf_casadi.support.arrays import Array, Index
from ancf_casadi.support.tables import finite_or_none
from problems.beam.curves.checks import orient_from_model
from problems.beam.curves.driven import Driven, driven_beam, fourier_coefficients, shapes, small_response
from problems.beam.curves.points import CurvePoints, Measured, PointMotion, closest, motion_from_rest
from problems.beam.curves.record import ResponseRecord
from problems.beam.curves.response_block import ResponseBlock, first_weights
from problems.beam.mesh import split_law, split_model
from problems.beam.properties import ELASTIC, SIGNED, property_owners, property_value, scaled_model
from problems.beam.unknowns import frequency_name, mode_at_peak

MODULUS = ("elastic_modulus", "bending_stiffness")  # the strain energy of all elements is proportional to each
DIFFERENCE = 1e-4  # relative change of a property for its derivative
LEVEL_ERROR = 0.01  # relative error of the levels whose effect the result states
LEAST_SHIFT = 1e-4  # relative shift of an estimate that is worth more modes and harmonics
WITHOUT_MODULUS = (FrictionDamping, ModalDamping, QuadraticDamping)  # laws whose forces do not contain the modulus

Neighbours = tuple[int, float, list[Reduction]]  # place of an unknown, distance of two beams, and these


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

    meaningful = LEAST_SHIFT

    @cached_property
    def last(self) -> list[list[PointMotion]]:
        """The last motions of each record, from which the search for the next ones starts."""
        return list(self.before.last) if self.before else []

    @cached_property
    def _constant(self) -> list[Driven]:
        """The driven beams if no properties change; other weights share them."""
        before = self.before
        same = before and (before.modes, before.harmonics) == (self.modes, self.harmonics)
        return list(before._constant) if same else self.driven_beams({})

    def motions(self, values: Mapping[str, float]) -> list[CurvePoints]:
        """Return the motions closest to the points of each record, for values of the unknowns by name."""
        s, by_record = self.system_unknowns(values), []
        beams = self.driven_beams(values) if self.of_model else self._constant
        for k, (record, points) in enumerate(zip(self.records, self.measured_points(values), strict=True)):
            of_record: list[PointMotion] = []
            for j, point in enumerate(points.each()):
                try:
                    of_record.append(_motion(beams[k], point, s, self.last[k][j] if self.last else None))
                except NumericsError as error:
                    raise NumericsError(f"{record.label}, {record.f[j]:.6g} Hz: {error}") from None
            by_record.append(of_record)
        self.last[:] = by_record
        return [
            (np.array([motion.values for motion in of_record]), np.array([motion.slopes for motion in of_record]))
            for of_record in by_record
        ]

    def sensitivities(self, values: Mapping[str, float]) -> list[Array]:
        """Return the derivatives by the unknowns of amplitude, phase and excess of the level, (m, 3, n) each."""
        s, neighbours = self.system_unknowns(values), []
        for name in self.of_model:
            step = DIFFERENCE * (self.first if lumped_kind(name) in SIGNED else values)[name]
            ends = [self.reduction({**values, name: values[name] + side * step}) for side in (1, -1)]
            neighbours.append((self.names.index(name), 2 * step, ends))
        sensitivities = []
        for motions, (number, record) in zip(self.last, self.numbered, strict=True):
            changes = self._changes(motions, record, s, neighbours)
            if factor := self.excitation(number):
                changes[:, 2, self.names.index(factor)] -= record.a
            sensitivities.append(changes)
        return sensitivities

    def _changes(
        self, motions: Sequence[PointMotion], record: ResponseRecord, s: Array, neighbours: Sequence[Neighbours]
    ) -> Array:
        """Return the derivatives of amplitude, phase and level of m motions at the same amplitude, (m, 3, n)."""
        directions, balance = self.system_directions, motions[0].point.family.balance
        states = [(motion.point.coefficients, motion.point.setting) for motion in motions]
        forces = np.array([balance.by_parameters(*state, directions) for state in states])
        polar = np.array([motion.reading[2] @ directions for motion in motions])
        samples = [np.hstack(arrays) for arrays in zip(*(balance.motion(*state) for state in states), strict=True)]
        for place, width, ends in neighbours:
            at_ends = [fourier_coefficients(end, record, balance.fourier, samples, s) for end in ends]
            (F_above, above), (F_below, below) = at_ends
            forces[:, :, place] = (F_above - F_below)[:, balance.allowed] / width
            polar[:, 0, place] = (abs(above) - abs(below)) / width
            polar[:, 1, place] = np.angle(above * below.conj()) / width
        return np.array([motion.sensitivities(*pair) for motion, *pair in zip(motions, forces, polar, strict=True)])

    def error(self, values: Mapping[str, float], residuals: Array, small: Callable[[Array], bool]) -> Array:
        """Return the error of residuals, from one mode and two harmonics more."""
        return np.asarray(self.finer().at(values)[0] - residuals)

    def refine(self, shift: float, error: Array) -> Self | None:
        """Return the block with one mode and two harmonics more, twice at most."""
        return self.finer() if shift > LARGEST_SHIFT and self.refinements < 2 else None

    def orient(self, frequencies: Array) -> Self:
        """Return the block with the phases of its records as they should be; ``frequencies`` are those of the model."""
        numbered, notes = [], list[str]()
        s = self.system_unknowns({})
        for (number, record), system in zip(self.numbered, self.driven_beams({}), strict=True):
            natural_frequency = float(frequencies[mode_at_peak(record, frequencies)])
            try:
                computed = small_response(system, record, natural_frequency, s)
            except NumericsError:  # without damping there is no response at the resonance
                computed = None
            if computed is not None:
                record, record_notes = orient_from_model(record, computed)
                notes += record_notes
            numbered.append((number, record))
        return replace(self, numbered=tuple(numbered), notes=tuple(notes))

    def finer(self) -> Self:
        """Return the block with one mode and two harmonics more."""
        modes, harmonics = min(self.modes + 1, self.model.freedoms), self.harmonics + 2
        return replace(self, modes=modes, harmonics=harmonics, refinements=self.refinements + 1, before=self)

    def largest_bend(self, values: Mapping[str, float]) -> float:
        """Return the largest bend of an element in the motions of all points, rad."""
        self.motions(values)
        points = [motion.point for motions in self.last for motion in motions]
        samples = [point.family.balance.motion(point.coefficients, point.setting) for point in points]
        return largest_bend(self.model, shapes(self.reduction(values), samples))

    def split(self) -> Self:
        """Return the same curves with each element in two halves."""
        return replace(self, model=split_model(self.model), law=split_law(self.law), before=None)

    def account(self, fitted: Fitted) -> Account:
        """Return errors of the amplitudes, the effects of truncation and levels, and points without a stable motion."""
        account, worst = super().account(fitted), meaningful(fitted.shifts, fitted.fit, LEAST_SHIFT)
        truncation = (
            f"{self.modes} modes with {self.harmonics} harmonics; one more mode and two more harmonics shift no "
            f"estimate by more than {np.abs(fitted.shifts).max():.2g} standard errors"
        )
        names, by_levels = fitted.fit.names, self._level_shifts(fitted)
        notes = [*self.notes, *self._shift_warnings(worst, by_levels, names), *account.warnings]
        data = account.data | {
            "modes": self.modes,
            "harmonics": self.harmonics,
            "truncation_shifts": [finite_or_none(shift) for shift in fitted.shifts.tolist()],
            "level_shifts": [finite_or_none(shift) for shift in by_levels.tolist()],
        }
        return Account([*account.lines, truncation], notes, data)

    def _level_shifts(self, fitted: Fitted) -> Array:
        """Return the shift of each estimate if all levels are larger by ``LEVEL_ERROR``, in standard errors."""
        names = *(name for name in self.names if not name.startswith("excitation")), "excitation"
        common = replace(self, names=names, before=self)
        derivatives = common.at({**fitted.values, "excitation": 1.0})[1][:, -1]
        change = np.zeros(len(fitted.fit.residuals))
        change[fitted.rows] = fitted.scale * LEVEL_ERROR * derivatives
        return fitted.fit.shifts(change)

    def _shift_warnings(self, by_finer: Array, by_levels: Array, names: Sequence[str]) -> list[str]:
        """Return warnings about the effects of more modes and harmonics, and of errors of levels held exact."""
        notes, worst = [], int(np.nanargmax(np.abs(by_levels)))
        if by_finer.max() > LARGEST_SHIFT:
            notes.append(
                f"one more mode and two more harmonics shift {names[int(by_finer.argmax())]} by {by_finer.max():.2g} "
                "standard errors; give more (modes, harmonics)"
            )
        if abs(by_levels[worst]) > 1.0 and not any(self.excitation(number) for number, _ in self.numbered):
            notes.append(
                f"the levels of the excitation are taken as exact: if all of them are 1 % too small, {names[worst]} "
                f"shifts by {by_levels[worst]:+.2g} standard errors; if they are not that certain, add 'excitation' "
                "to the unknowns and give it a prior"
            )
        return notes

    def driven_beams(self, values: Mapping[str, float]) -> list[Driven]:
        """Return the driven beam of each record, for values of the unknowns by name."""
        reduced = self.reduction(values)
        kinds: dict[Any, Driven] = {}  # records that differ in size alone share their Functions
        beams = []
        for record in self.records:
            kind = record.sensor, record.load, record.base and record.base.direction
            kinds[kind] = kinds.get(kind) or driven_beam(reduced, record, self.harmonics)
            beams.append(replace(kinds[kind], drive=beam_drive(record.base, record.load)))
        return beams

    def reduction(self, values: Mapping[str, float]) -> Reduction:
        """Return the reduction of the beam for values of the unknowns by name."""
        factors = [
            values.get(name, first_value) / first_value if name in self.of_model else 1.0
            for name, first_value in self.first.items()
        ]
        model = scaled_model(self.model, self._owners, np.array(factors))
        first = _reduction(self.model, self.modes, self.law)
        return first if model is self.model else rebuild_reduction(first, model)

    @cached_property
    def _owners(self) -> Index:
        return property_owners(self.model.beam, tuple(self.first))

    @property
    def of_model(self) -> tuple[str, ...]:
        """The properties in the constants of the reduced model."""
        beam = self.model.beam
        scales_all_stiffness = not any(lumped_kind(name) in ELASTIC for name in beam.lumped)
        scales_no_damping = all(isinstance(term, WITHOUT_MODULUS) for term in law_terms(self.law))
        as_factor = MODULUS if scales_all_stiffness and scales_no_damping else ()
        return tuple(name for name in self.first if name not in as_factor and property_value(beam, name))

    @cached_property
    def _places(self) -> dict[str, tuple[int, float]]:
        """Place of each possible unknown in s (``driven``), and the derivative of s by it."""
        names = [
            *(parameter.name for parameter in self.law.parameters),
            *(frequency_name(k) for k in range(self.modes)),
        ]
        moduli = [name for name in MODULUS if name in self.first and name not in self.of_model]
        places = {name: (k, 1.0) for k, name in enumerate(names)}
        return places | {name: (len(names), 1 / self.first[name]) for name in moduli}

    def system_unknowns(self, values: Mapping[str, float]) -> Array:
        """Return the unknowns s of the equation of motion (``driven``), for values by name."""
        s = np.array([*(parameter.value for parameter in self.law.parameters), *np.ones(self.modes + 1)])
        for name in self._places.keys() & values.keys():
            place, slope = self._places[name]
            s[place] = slope * values[name]
        return s

    @cached_property
    def system_directions(self) -> Array:
        """Derivatives of s by the unknowns of the fit, (s, n)."""
        directions = np.zeros((len(self.law.parameters) + self.modes + 1, len(self.names)))
        for k, name in enumerate(self.names):
            if name in self._places:
                place, slope = self._places[name]
                directions[place, k] = slope
        return directions


@lru_cache(maxsize=4)
def _reduction(model: Model, modes: int, law: DampingLaw) -> ReducedModel:
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
    of_beam = {*first, *(parameter.name for parameter in law.parameters)}
    return CurveBlock(
        tuple(numbered),
        tuple(name for name in names if name in of_beam or name.startswith(("frequency_", "excitation"))),
        weights=first_weights([record for _, record in numbered]),
        model=model,
        law=law,
        first=first,
        modes=min(modes, model.freedoms),
        harmonics=harmonics,
    )


def _motion(driven: Driven, point: Measured, s: Array, last: PointMotion | None) -> PointMotion:
    """Return the motion closest to a point, from the last one or, if there is none or that fails, from rest."""
    if last is not None:
        try:
            return closest(driven, point, s, last)
        except NumericsError:
            pass
    return closest(driven, point, s, motion_from_rest(driven, point, s))
