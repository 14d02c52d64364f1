"""Response curves of one mode as a block of a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ancf_casadi.estimation.block import Evaluation
from ancf_casadi.support.arrays import Array
from problems.beam.curves.points import CurvePoints
from problems.beam.curves.record import BASE_MOTIONS, ResponseRecord
from problems.beam.curves.residuals import CurveResiduals, first_weights
from problems.beam.curves.response_block import ResponseBlock
from problems.decay.laws import DecayModel
from problems.mode.oscillator import POINTS_CLOSE, ModeCurve

# factor on standard deviations below which rounding hides the closest points (test_known_values_are_recovered...)
LEAST_FACTOR = 1e-4


@dataclass(frozen=True, eq=False, kw_only=True)
class ModeCurveBlock(ResponseBlock):
    """Measured response curves of one mode; the names of the unknowns begin with those of the laws."""

    model: DecayModel  # laws of the mode, without an equilibrium
    law_names: tuple[str, ...]
    constants: tuple[str, ...]  # name of the modal constant of each record
    known: Mapping[str, float]  # modal constants that are given, by name

    @property
    def systematic(self) -> float:
        """Error of the closest points, in standard deviations: without noise, it ends the fit."""
        return 10 * POINTS_CLOSE

    def evaluation(self, before: Evaluation | None = None) -> ModeResponses:
        """Return the residuals."""
        return ModeResponses(self)


class ModeResponses(CurveResiduals):
    """The residuals of a block and their Jacobian."""

    block: ModeCurveBlock

    def __init__(self, block: ModeCurveBlock) -> None:
        """Build the curves of the records."""
        self.block = block
        self._last: list[Array] = []  # derivatives of the last motions by the unknowns of each record

    def close(self) -> None:
        """Keep the Functions, which are small."""

    @cached_property
    def curves(self) -> list[ModeCurve]:
        """The curves of each record."""
        return [ModeCurve(self.block.model, record, len(self.block.law_names)) for record in self.block.records]

    def motions(self, values: Mapping[str, float]) -> list[CurvePoints]:
        """Return the motions closest to the points of each record, for values of the unknowns by name."""
        given, block = {**self.block.known, **values}, self.block
        found = [
            curve.closest(points, np.array([given[name] for name in (*block.law_names, constant)]))
            for curve, points, constant in zip(self.curves, block.measured(values), block.constants, strict=True)
        ]
        self._last = [by_x for _, by_x in found]
        return [motions for motions, _ in found]

    def sensitivities(self, values: Mapping[str, float]) -> list[Array]:
        """Return the derivatives by the unknowns of amplitude, phase and excess of the level, (m, 3, n) each."""
        found, names = [], self.block.names
        for by_x, constant in zip(self._last, self.block.constants, strict=True):
            change = np.zeros((*by_x.shape[:2], len(names)))
            for k, name in enumerate((*self.block.law_names, constant)):
                if name in names:
                    change[:, :, names.index(name)] = by_x[:, :, k]
            found.append(change)
        return found


def curves_of_mode(
    model: DecayModel,
    curves: Sequence[ResponseRecord],
    law_names: Sequence[str],
    names: Mapping[str, str],
    known: float | None,
) -> ModeCurveBlock:
    """Return response curves as a block with first weights; ``names`` has the modal constant of each unit of levels."""
    constants = tuple(names[one.excitation_unit] for one in curves)
    free = tuple(dict.fromkeys(constants)) if known is None else ()
    weights = first_weights(curves)
    return ModeCurveBlock(
        tuple(enumerate(curves, start=1)),
        (*law_names, *free),
        replace(weights, floors=np.full(len(weights.lengths), LEAST_FACTOR)),
        model=model,
        law_names=tuple(law_names),
        constants=constants,
        known={} if known is None else dict.fromkeys(constants, known),
    )


def constant_unit(motion_unit: str, excitation_unit: str) -> str:
    """Return the unit of a modal constant: force per mass and level; none for a motion of the base in m."""
    if excitation_unit in BASE_MOTIONS and motion_unit == "m":
        return ""
    force = {"m": "m", "m/s": "m", "m/s^2": "m"}.get(excitation_unit)
    if force:
        return f"{motion_unit or '1'}/{force}"
    if excitation_unit == "N" and motion_unit == "m":
        return "1/kg"
    return f"{motion_unit or '1'}/(s^2 {excitation_unit})"
