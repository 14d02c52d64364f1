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
from ancf_casadi.support.arrays import Array
from problems.beam.curves.driven import Driven
from problems.beam.curves.points import CurvePoints, Measured, NoMotionError, PointMotion, closest, motion_from_rest
from problems.beam.curves.residuals import CurveResiduals
from problems.beam.properties import SIGNED

if TYPE_CHECKING:
    from problems.beam.curves.block import CurveBlock

DIFFERENCE = 1e-4  # relative change of a property for its derivative


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
            ends = [self.block.driven({**values, name: values[name] + side * step}) for side in (1, -1)]
            neighbours.append((self.block.names.index(name), 2 * step, ends))
        found = []
        for k, (number, record) in enumerate(self.block.numbered):
            own = [(place, width, [end[k] for end in ends]) for place, width, ends in neighbours]
            changes = np.array([self._change(motion, s, own) for motion in self._last[k]])
            if factor := self.block.excitation(number):
                changes[:, 2, self.block.names.index(factor)] -= record.a
            found.append(changes)
        return found

    def _change(self, motion: PointMotion, s: Array, neighbours: Sequence[tuple[int, float, list[Driven]]]) -> Array:
        """Return the derivatives of amplitude, phase and level of a motion at the same amplitude, (3, n)."""
        z, balance, setting = motion.point.z, motion.point.family.balance, motion.point.setting
        directions = self.block.shared_directions
        forces = balance.by_parameters(motion.point.coefficients, setting, directions)
        polar = motion.reading[2] @ directions
        for place, width, ends in neighbours:
            curves = [end.curve(setting.omega, s) for end in ends]
            above, below = (curve.residual(z) for curve in curves)
            forces[:, place] = (above - below) / width
            above, below = (end.read(curve, z)[0] for end, curve in zip(ends, curves, strict=True))
            polar[:, place] = (above - below) / width
        return motion.sensitivities(forces, polar)

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
