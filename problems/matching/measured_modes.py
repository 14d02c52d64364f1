"""Measured modes: natural frequencies and, if measured, mode shapes at points along the beam.

The scale and the sign of a measured shape psi are arbitrary.  Its residual is therefore the difference from the best
multiple of the computed transverse displacements v of the same points,

    r = (psi - a v)/sigma,    a = (v^T W psi)/(v^T W v),    W = diag(1/sigma^2),

which does not depend on the scale and sign of v.  Transverse means perpendicular to the axis of the beam at its clamp.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array, Mask
from ancf_casadi.support.inputs import is_sequence, numbers, physical, positive, shown
from ancf_casadi.support.tables import Displayed, plural, spread

SMALLEST_STD = 1e-12  # least relative standard deviation


@dataclass(frozen=True)
class MeasuredModes(Displayed):
    """Measured natural frequencies and mode shapes.

    Parameters
    ----------
    frequencies : sequence of float
        Natural frequencies of m modes, Hz; without shapes, those of the m lowest modes, ascending.
    frequency_std : float or sequence of float, optional
        Standard deviations of the frequencies, Hz; one for all, or one for each.  If not given, all relative errors
        have the same weight.
    points : sequence of float
        Arc lengths of k points from the clamp, m.
    shapes : sequence of sequences
        Transverse displacements of the points in each mode, (m, k), with any scale and sign; nan if not measured.
    shape_std : float or sequence, optional
        Standard deviations of the displacements, in the unit of each shape: one for all, one per mode, or (m, k).  If
        not given, the shapes serve only to identify the modes.

    Raises
    ------
    InputError
        If frequencies or deviations are not positive, sizes do not match, frequencies without shapes do not ascend, a
        shape has fewer than two points or is zero, or a deviation is outside 1e-12 to 1e12 times its value.

    Examples
    --------
    >>> from ancf_casadi import Beam
    >>> from problems import Global, MeasuredModes, match_frequencies
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> targets = MeasuredModes((1.90, 10.8), frequency_std=(0.01, 0.05))
    >>> match = match_frequencies(beam, targets=targets, unknowns=[Global("elastic_modulus")])
    >>> modulus, error = match.beam.elastic_modulus[0], match.standard_errors["elastic_modulus"]
    >>> print(f"{modulus / 1e9:.0f} +- {error / 1e9:.0f} GPa")
    218 +- 2 GPa
    """

    frequencies: tuple[float, ...]
    frequency_std: tuple[float, ...] | None = None
    points: tuple[float, ...] = ()
    shapes: tuple[tuple[float, ...], ...] = ()
    shape_std: tuple[tuple[float, ...], ...] | None = None

    def __post_init__(self) -> None:
        """Validate."""
        frequencies: Any = self.frequencies
        if not is_sequence(frequencies):
            raise InputError(f"must be a sequence of frequencies, got {shown(frequencies)}", "targets")
        frequencies = tuple(physical(frequency, "targets") for frequency in frequencies)
        if not frequencies:
            raise InputError("needs at least one frequency", "targets")
        object.__setattr__(self, "frequencies", frequencies)
        if self.frequency_std is not None:
            object.__setattr__(self, "frequency_std", _spread(self.frequency_std, self.count, "frequency_std"))
            _check_ratio(self.relative_std, "frequency_std")
        object.__setattr__(self, "points", numbers(self.points, "points"))
        if not is_sequence(self.shapes):
            raise InputError(f"must be a sequence of shapes, got {shown(self.shapes)}", "shapes")
        if len(self.shapes):
            self._check_shapes()
        elif self.points or self.shape_std is not None:
            raise InputError("are missing, but points or shape_std are given; give the shapes too", "shapes")
        elif (np.diff(frequencies) <= 0.0).any():
            raise InputError(
                f"must be ascending, got {', '.join(f'{f:g}' for f in frequencies)} Hz; sort them, or give shapes",
                "targets",
            )

    @classmethod
    def of(cls, targets: MeasuredModes | Sequence[float]) -> MeasuredModes:
        """Return measured modes unchanged, and a sequence of frequencies as those of the lowest modes."""
        return targets if isinstance(targets, MeasuredModes) else cls(targets)  # type: ignore[arg-type]

    @property
    def count(self) -> int:
        """Number of modes m."""
        return len(self.frequencies)

    @property
    def relative_std(self) -> Array:
        """Relative standard deviations of the frequencies, 1 if none are given, (m,)."""
        if self.frequency_std is None:
            return np.ones(self.count)
        return np.asarray(np.array(self.frequency_std) / np.array(self.frequencies))

    @property
    def measured(self) -> Mask:
        """True for the displacements of the shapes that were measured, (m, k)."""
        return np.asarray(np.isfinite(np.array(self.shapes).reshape(self.count, -1)))

    def observer(self, model: Model) -> Array:
        """Return H, (k, 4 n + 4), from nodal coordinates e to the transverse displacements v = H e of the points."""
        rows = [model.beam.across @ model.interpolation(point) for point in self.points]
        return np.array(rows).reshape(-1, model.size)

    def mac(self, displacements: Array) -> Array:
        """Return the MAC of the measured shapes and of c computed ones (k, c), (m, c); 0 if these do not move."""
        is_measured = self.measured
        shapes = np.where(is_measured, np.array(self.shapes), 0.0)
        shapes = shapes / np.abs(shapes).max(axis=1, keepdims=True)  # the scale is arbitrary
        norms = (shapes**2).sum(axis=1)[:, None] * (is_measured @ displacements**2)
        return np.asarray((shapes @ displacements) ** 2 / np.where(norms > 0.0, norms, 1.0))

    def check_beam(self, beam: Beam) -> None:
        """Raise an ``InputError`` if a point is off the beam, or its mesh has too few modes."""
        if self.count > 2 * beam.elements:
            raise InputError(
                f"{self.count} modes are more than the {2 * beam.elements} that {beam.elements} elements have; "
                "use more elements",
                "targets",
            )
        for point in self.points:
            if not 0.0 <= point <= beam.length:
                raise InputError(f"must be on the beam, 0 to {beam.length:g} m, got {point:g}", "points")

    def _check_shapes(self) -> None:
        if len(self.shapes) != self.count:
            raise InputError(f"{len(self.shapes)} shapes for {self.count} frequencies", "shapes")
        rows = []
        for k, shape in enumerate(self.shapes, start=1):
            if not is_sequence(shape) or len(shape) != len(self.points):
                raise InputError(f"shape {k} needs one displacement per point, {len(self.points)} in all", "shapes")
            try:
                rows.append(tuple(float(value) for value in shape))
            except (TypeError, ValueError):
                raise InputError(f"shape {k} must be numbers, or nan if not measured", "shapes") from None
            displacements = np.array(rows[-1])[~np.isnan(rows[-1])]
            if len(displacements) < 2 or not np.isfinite(displacements).all() or not displacements.any():
                raise InputError(f"shape {k} needs two measured displacements, finite and not all zero", "shapes")
        object.__setattr__(self, "shapes", tuple(rows))
        if self.shape_std is not None:
            if self.frequency_std is None:
                raise InputError("is missing; with shape_std alone the frequencies have no weight", "frequency_std")
            object.__setattr__(self, "shape_std", self._spread_shape_std(self.shape_std))

    def _spread_shape_std(self, given_std: Any) -> tuple[tuple[float, ...], ...]:
        rows = given_std if is_sequence(given_std) else [given_std] * self.count
        if len(rows) != self.count:
            raise InputError(f"has {len(rows)} values for {self.count} shapes", "shape_std")
        shape_std = tuple(_spread(row, len(self.points), "shape_std") for row in rows)
        for shape, deviations in zip(self.shapes, shape_std, strict=True):
            _check_ratio(np.array(deviations) / np.nanmax(np.abs(shape)), "shape_std")
        return shape_std

    def _summary(self) -> str:
        shapes = f", shapes at {len(self.points)} points" if self.shapes else ""
        return f"{plural(len(self.frequencies), 'mode')}, {spread(self.frequencies, 'Hz')}{shapes}"


def _spread(deviations: Any, count: int, where: str) -> tuple[float, ...]:
    if not is_sequence(deviations):
        return (positive(deviations, where),) * count
    if len(deviations) != count:
        raise InputError(f"has {len(deviations)} values for {count}", where)
    return tuple(positive(value, where) for value in deviations)


def _check_ratio(relative: Array, where: str) -> None:
    """Refuse relative deviations whose squares would overflow or vanish."""
    if not ((relative > SMALLEST_STD) & (relative < 1 / SMALLEST_STD)).all():
        raise InputError(
            f"must be within {SMALLEST_STD:g} to {1 / SMALLEST_STD:g} times the measured value; check the unit", where
        )
