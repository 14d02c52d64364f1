"""Response curves of one mode as a block of a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as cs
import numpy as np

from ancf_casadi.support.arrays import Array
from problems.beam.curves.points import POINTS_CLOSE, CurvePoints
from problems.beam.curves.record import BASE_MOTIONS, ResponseRecord
from problems.beam.curves.response_block import ResponseBlock, first_weights
from problems.decay.laws import DecayModel
from problems.mode.oscillator import closest_motions, response_curve

# factor on standard deviations below which rounding hides the closest points (test_known_values_are_recovered...)
LEAST_FACTOR = 1e-4


@dataclass(frozen=True, eq=False, kw_only=True)
class ModeCurveBlock(ResponseBlock):
    """Measured response curves of one mode; the names of the unknowns begin with those of the laws."""

    model: DecayModel  # laws of the mode, without an equilibrium
    law_names: tuple[str, ...]
    constants: tuple[str, ...]  # name of the modal constant of each record
    given_constants: Mapping[str, float]  # given modal constants by name

    systematic = 10 * POINTS_CLOSE  # error of the closest points: without noise, it ends the fit

    @cached_property
    def curves(self) -> list[cs.Function]:
        """The curve of each record; other weights share them."""
        if self.before:
            return list(self.before.curves)
        return [response_curve(self.model, record, len(self.law_names)) for record in self.records]

    @cached_property
    def last_derivatives(self) -> list[Array]:
        """Derivatives of the last motions of each record by the unknowns, (m, 3, k)."""
        return []

    def motions(self, values: Mapping[str, float]) -> list[CurvePoints]:
        """Return the motions closest to the points of each record, for values of the unknowns by name."""
        all_values = {**self.given_constants, **values}
        results = [
            closest_motions(curve, record, points, np.array([all_values[name] for name in (*self.law_names, constant)]))
            for curve, record, points, constant in zip(
                self.curves, self.records, self.measured_points(values), self.constants, strict=True
            )
        ]
        self.last_derivatives[:] = [derivatives for _, derivatives in results]
        return [motions for motions, _ in results]

    def sensitivities(self, values: Mapping[str, float]) -> list[Array]:
        """Return the derivatives by the unknowns of amplitude, phase and excess of the level, (m, 3, n) each."""
        sensitivities, names = [], self.names
        for derivatives, constant in zip(self.last_derivatives, self.constants, strict=True):
            sensitivity = np.zeros((*derivatives.shape[:2], len(names)))
            for k, name in enumerate((*self.law_names, constant)):
                if name in names:
                    sensitivity[:, :, names.index(name)] = derivatives[:, :, k]
            sensitivities.append(sensitivity)
        return sensitivities


def mode_curve_block(
    model: DecayModel,
    records: Sequence[ResponseRecord],
    law_names: Sequence[str],
    constant_names: Mapping[str, str],
    modal_constant: float | None,
) -> ModeCurveBlock:
    """Return response curves as a block with first weights; ``constant_names`` has one name per unit of levels."""
    constants = tuple(constant_names[record.excitation_unit] for record in records)
    estimated_constants = tuple(dict.fromkeys(constants)) if modal_constant is None else ()
    weights = first_weights(records)
    return ModeCurveBlock(
        tuple(enumerate(records, start=1)),
        (*law_names, *estimated_constants),
        weights=replace(weights, floors=np.full(len(weights.lengths), LEAST_FACTOR)),
        model=model,
        law_names=tuple(law_names),
        constants=constants,
        given_constants={} if modal_constant is None else dict.fromkeys(constants, modal_constant),
    )


def constant_unit(motion_unit: str, excitation_unit: str) -> str:
    """Return the unit of a modal constant: force per mass and level; none for a motion of the base in m."""
    if excitation_unit in BASE_MOTIONS:
        return "" if motion_unit == "m" else f"{motion_unit or '1'}/m"
    if excitation_unit == "N" and motion_unit == "m":
        return "1/kg"
    return f"{motion_unit or '1'}/(s^2 {excitation_unit})"
