"""The residuals of response curves of a beam: the steady motions of the reduced model closest to the measured points.

Properties, tip mass and clamp enter the constants of the reduced model, except for the elastic modulus if the damping
does not contain it.  The derivatives of F and of the reading by these are central differences at fixed coefficients,
between two models at the relative distances ``DIFFERENCE``, of the first value if either sign is possible; all other
derivatives are exact.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ancf_casadi.exceptions import NumericsError
from ancf_casadi.mechanics.lumped import lumped_kind
from ancf_casadi.reduction.reduced import Reduction
from ancf_casadi.support.arrays import Array
from problems.beam.curves.driven import Driven, analysed
from problems.beam.curves.points import CurvePoints, Measured, NoMotionError, PointMotion, closest, motion_from_rest
from problems.beam.curves.record import ResponseRecord
from problems.beam.curves.residuals import CurveResiduals
from problems.beam.properties import SIGNED

if TYPE_CHECKING:
    from problems.beam.curves.block import CurveBlock

DIFFERENCE = 1e-4  # relative change of a property for its derivative

Neighbours = tuple[int, float, list[Reduction]]  # place of an unknown, distance of two beams, and these


class BeamResponses(CurveResiduals):
    """The residuals of a block and their Jacobian; the search for every motion starts from its last one."""

    block: CurveBlock

    def __init__(self, block: CurveBlock, before: BeamResponses | None = None) -> None:
        """Begin with the last motions of a block with other weights, or fewer modes and harmonics."""
        self.block = block
        self._last: list[list[PointMotion]] = before._last if before else []
        same = before and (block.modes, block.harmonics) == (before.block.modes, before.block.harmonics)
        self._constant: list[Driven] = before._constant if before and same else []

    def close(self) -> None:
        """Keep the last motions, from which predictions start."""

    def motions(self, values: Mapping[str, float]) -> list[CurvePoints]:
        """Return the motions closest to the points of each record, for values of the unknowns by name."""
        s, beams, found = self.block.shared(values), self._driven(values), []
        for k, (record, points) in enumerate(zip(self.block.records, self.block.measured(values), strict=True)):
            own: list[PointMotion] = []
            for j, point in enumerate(points.each()):
                try:
                    own.append(_motion(beams[k], point, s, self._last[k][j] if self._last else None))
                except NumericsError as error:
                    raise NoMotionError(f"{record.label}, {record.f[j]:.6g} Hz: {error}") from None
            found.append(own)
        self._last = found
        return [CurvePoints(*(np.array([getattr(m, part) for m in own]) for part in ("values", "slopes")))
                for own in found]  # fmt: skip

    def sensitivities(self, values: Mapping[str, float]) -> list[Array]:
        """Return the derivatives by the unknowns of amplitude, phase and excess of the level, (m, 3, n) each."""
        s, neighbours = self.block.shared(values), []
        for name in self.block.of_model:
            step = DIFFERENCE * (self.block.first if lumped_kind(name) in SIGNED else values)[name]
            ends = [self.block.reduction({**values, name: values[name] + side * step}) for side in (1, -1)]
            neighbours.append((self.block.names.index(name), 2 * step, ends))
        found = []
        for motions, (number, record) in zip(self._last, self.block.numbered, strict=True):
            changes = self._changes(motions, record, s, neighbours)
            if factor := self.block.excitation(number):
                changes[:, 2, self.block.names.index(factor)] -= record.a
            found.append(changes)
        return found

    def _changes(
        self, motions: Sequence[PointMotion], record: ResponseRecord, s: Array, neighbours: Sequence[Neighbours]
    ) -> Array:
        """Return the derivatives of amplitude, phase and level of m motions at the same amplitude, (m, 3, n)."""
        directions, balance = self.block.shared_directions, motions[0].point.family.balance
        given = [(own.point.coefficients, own.point.setting) for own in motions]
        forces = np.array([balance.by_parameters(*own, directions) for own in given])
        polar = np.array([own.reading[2] @ directions for own in motions])
        samples = [np.hstack(parts) for parts in zip(*(balance.motion(*own) for own in given), strict=True)]
        for place, width, ends in neighbours:
            (F_above, above), (F_below, below) = (analysed(end, record, balance.fourier, samples, s) for end in ends)
            forces[:, :, place] = (F_above - F_below)[:, balance.allowed] / width
            polar[:, 0, place] = (abs(above) - abs(below)) / width
            polar[:, 1, place] = np.angle(above * below.conj()) / width
        return np.array([own.sensitivities(*pair) for own, *pair in zip(motions, forces, polar, strict=True)])

    def _driven(self, values: Mapping[str, float]) -> list[Driven]:
        """Return the driven beams; they are built anew only if properties change."""
        if self.block.of_model:
            return self.block.driven(values)
        self._constant = self._constant or self.block.driven({})
        return self._constant


def _motion(driven: Driven, point: Measured, s: Array, last: PointMotion | None) -> PointMotion:
    """Return the motion closest to a point, from the last one or, if there is none or that fails, from rest."""
    if last is not None:
        try:
            return closest(driven, point, s, last)
        except NumericsError:
            pass
    return closest(driven, point, s, motion_from_rest(driven, point, s))
