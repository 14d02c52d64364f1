"""Blocks: measurements of one kind with the physics that explains them.

A fit is a sum of blocks.  Each has residuals (computed - measured)/s in standard deviations, as an expression of the
unknowns that it knows by name, and says how sure they are: standard deviations that it found in the data (``scale``),
or that the user states (``stated``), and errors of its sensors and of its computation.  A block can be asked for better
weights once residuals are known, and for a finer discretisation once its error is known; ``solve`` does the rest.

A block keeps the Functions and the last solutions from which its residuals come.  A version of it with other weights,
or a finer one, finds them in ``before``.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, Self

import casadi as cs
import numpy as np

from ancf_casadi.estimation.fit import Fit
from ancf_casadi.estimation.prediction import PredictedChannel, RecordPrediction
from ancf_casadi.estimation.solver.gauss_newton import residuals_and_jacobian, robust_deviation
from ancf_casadi.estimation.solver.least_squares import residual_function
from ancf_casadi.estimation.solver.unknown import Coordinates, Unknown
from ancf_casadi.exceptions import FitError
from ancf_casadi.support.arrays import Array, Index, root_mean_square
from ancf_casadi.support.interrupts import delayed_interrupts

MESH_ORDER = 4  # of the error of residuals in the length of an element
MESH_REMAINDER = 1 / (1 - 2.0**-MESH_ORDER)  # error of a mesh over its change by elements half as long


@dataclass(frozen=True, eq=False)
class Fitted:
    """A block after a fit."""

    fit: Fit
    rows: slice  # residuals of the block among all
    scale: float  # factor G of the residuals in the fit
    shifts: Array  # shifts (n,) of the estimates by the error of the discretisation, in standard errors; nan if unknown

    @property
    def values(self) -> dict[str, float]:
        """The estimates by name."""
        return self.fit.estimates

    @property
    def residuals(self) -> Array:
        """The residuals (m,), in standard deviations."""
        return np.asarray(self.fit.residuals[self.rows] / self.scale)

    @property
    def errors(self) -> Array:
        """Standard errors (m,) of the computed values due to those of the estimates, in standard deviations."""
        return np.nan_to_num(self.fit.errors_of(self.fit.jacobian[self.rows] / self.scale))


@dataclass(frozen=True, eq=False)
class Computed:
    """Residuals of a block for values of the unknowns that are no estimates, such as their guesses."""

    values: Mapping[str, float]  # by name
    residuals: Array  # (m,), in standard deviations

    @property
    def errors(self) -> Array:
        """Standard errors (m,) of the computed values, which are unknown."""
        return np.full(len(self.residuals), math.nan)


@dataclass(frozen=True)
class Account:
    """Lines, warnings and data of one block for the result."""

    lines: Sequence[str] = ()  # of the report
    warnings: Sequence[str] = ()  # limitations, one sentence each
    data: dict[str, Any] = field(default_factory=dict)  # for JSON


@dataclass(frozen=True, eq=False)
class SeriesWeights:
    """Standard deviations of the series of residuals of a block, which groups of series share."""

    lengths: Index
    deviations: Array  # standard deviation of each series, in its unit
    floors: Array  # least standard deviation of each series that residuals may give
    groups: tuple[tuple[int, ...], ...]  # series that share a standard deviation
    known: tuple[bool, ...]  # whether the user gave the standard deviation of a group

    @property
    def scale(self) -> float:
        """The geometric mean G of the standard deviations."""
        return math.exp(float(self.lengths @ np.log(self.deviations)) / float(self.lengths.sum()))

    def root_mean_square(self, sizes: Array) -> float:
        """Return the root mean square of the residuals if those of series c have the size ``sizes[c]`` (its unit)."""
        return math.sqrt(float(self.lengths @ (sizes / self.deviations) ** 2) / float(self.lengths.sum()))

    def split(self, residuals: Array) -> list[Array]:
        """Return the residuals of each series, in its unit, from those of all in standard deviations."""
        by_series = np.split(residuals, np.cumsum(self.lengths)[:-1])
        return [of_series * deviation for of_series, deviation in zip(by_series, self.deviations.tolist(), strict=True)]

    def improved(self, series: Sequence[Array], *, robust: bool = False) -> SeriesWeights:
        """Return the weights with the standard deviations of noise, one array per series, where none is known."""
        deviations = self.deviations.copy()
        for group, is_known in zip(self.groups, self.known, strict=True):
            if not is_known:
                noise, group_series = np.concatenate([series[k] for k in group]), list(group)
                size = (robust_deviation if robust else root_mean_square)(noise) if noise.size else 0.0
                deviations[group_series] = np.maximum(size, self.floors[group_series])
        return replace(self, deviations=deviations)


def alike(kinds: Iterable[Hashable]) -> tuple[tuple[int, ...], ...]:
    """Return groups of series of one kind, as their places, for the kind of each."""
    groups: dict[Hashable, list[int]] = {}
    for k, kind in enumerate(kinds):
        groups.setdefault(kind, []).append(k)
    return tuple(map(tuple, groups.values()))


@dataclass(frozen=True, eq=False)
class Block(ABC):
    """Measurements of one kind, and what their residuals depend on."""

    weights: SeriesWeights | None = field(default=None, kw_only=True)  # None if each value has its own
    before: Any = field(default=None, kw_only=True, repr=False)  # version with other weights or less fine; None if none

    meaningful = 0.0  # least relative shift of an estimate by the error of the discretisation that has a meaning
    closed_form = False  # whether the residuals have second derivatives that are cheap
    prior = False  # whether the residuals are no measurements, but distances from what is known without them
    settled: ClassVar[float | None] = None  # relative change of its standard deviations that ends their iteration;
    # None if those that the first fit shows are enough

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the measurements without Functions and solutions, which the receiving process computes again."""
        return {field_.name: getattr(self, field_.name) for field_ in fields(self)} | {"before": None}

    @property
    def inaccuracy(self) -> float:
        """Expected norm of the error of the residuals, in standard deviations, below which no fit can go."""
        return 0.0

    @property
    def jacobian_error(self) -> float:
        """Largest error of the Jacobian relative to its change since the coarser block."""
        return 1.0

    @property
    def accurate(self) -> Self:
        """The block as fine as the check of determination needs it, if it is coarse."""
        return self

    @abstractmethod
    def residuals(self, unknowns: Mapping[str, cs.MX]) -> cs.MX:
        """Return the residuals (m,) for unknowns by name, in standard deviations; others keep their values."""

    @property
    def failure(self) -> str:
        """Reason why the residuals could not be computed; empty if they could."""
        return ""

    @property
    def possible_cause(self) -> str:
        """What in the records may be wrong, should no minimum be found; empty if nothing shows."""
        return ""

    def close(self) -> None:  # noqa: B027 most blocks have nothing large to forget
        """Forget what is no longer needed once the fit has ended."""

    @property
    @abstractmethod
    def lengths(self) -> Sequence[Sequence[int]]:
        """Lengths of the series of residuals of each record, which follow one another; 1 for single values."""

    @property
    def series(self) -> list[int]:
        """Lengths of all series of residuals."""
        return [length for record in self.lengths for length in record]

    @property
    def times(self) -> Array:
        """Times of the residuals, s, (m,); their places in a series without times."""
        return np.concatenate([np.arange(length, dtype=float) for length in self.series])

    @property
    def scale(self) -> float:
        """Geometric mean of the standard deviations that were found in the data; 1 if the user states them."""
        return self.weights.scale if self.weights else 1.0

    @property
    def stated(self) -> bool:
        """True if the user states all standard deviations, which count as known until residuals contradict them."""
        return False

    @property
    def systematic(self) -> float:
        """Root mean square of a systematic error of the residuals, which they need not show, in standard deviations."""
        return 0.0

    @property
    @abstractmethod
    def negligible(self) -> float:
        """Norm of a change of the residuals that the computation does not tell from none, in standard deviations."""

    @property
    def factors(self) -> Array:
        """Reciprocal standard deviations (m,) of the series of the residuals; 1 if each value has its own."""
        weights = self.weights
        return np.repeat(1 / weights.deviations, weights.lengths) if weights else np.ones(sum(self.series))

    def reweight(self, residuals: Array, *, robust: bool) -> Self | None:
        """Return the block with the standard deviations that residuals (m,) show; None if they would not change."""
        if self.weights is None or all(self.weights.known):
            return None
        better = replace(self, weights=self.weights.improved(self.weights.split(residuals), robust=robust), before=self)
        return None if self.settled and self.has_similar_weights(better, self.settled) else better

    def has_similar_weights(self, other: Block, change: float) -> bool:
        """Return whether the standard deviations of a version of the block differ by less than a relative change."""
        return np.allclose(other.factors, self.factors, rtol=change, atol=0.0)

    def error(self, values: Mapping[str, float], residuals: Array, small: Callable[[Array], bool]) -> Array:
        """Return the error (m,) of residuals (m,) due to the discretisation, for values of the unknowns by name.

        ``small`` says whether an error shifts no estimate by much.
        """
        return np.zeros(sum(self.series))

    def doubt(self, error: Array) -> float:
        """Return the root mean square of the part of an error (m,) whose size alone is known."""
        return 0.0

    def margin(self, error: Array) -> float:
        """Return by how much the largest error exceeds the expected one, ``error`` (m,), relative to it."""
        return 0.0

    def refine(self, shift: float, error: Array) -> Self | None:
        """Return the block with a finer discretisation; its error (m,) shifts an estimate by ``shift`` standard errors.

        None if it need not, cannot or must not be finer.
        """
        return None

    @property
    def rough(self) -> Self:
        """The block as accurate as a comparison of two meshes needs it."""
        return self

    def split(self) -> Self | None:
        """Return the block with each element of its beam in two halves; None if it has no beam."""
        return None

    def largest_bend(self, values: Mapping[str, float]) -> float:
        """Return the largest bend of an element of the beam, rad, for values by name; nan if unknown."""
        return math.nan

    def residuals_at(self, values: Mapping[str, float]) -> Array:
        """Return the residuals (m,) for values of the unknowns by name."""
        residuals = self.residuals({name: cs.MX(value) for name, value in values.items()})
        with delayed_interrupts():
            return np.asarray(cs.evalf(residuals)).ravel()

    def allowing(self, fitted: Fitted) -> Fit:
        """Return the fit with a covariance that allows for errors of the measurements that residuals need not show."""
        return fitted.fit

    def unexplained_shares(self, fitted: Fitted) -> list[tuple[str, float]]:
        """Return name and unexplained share of the motion of each record, root mean square; none if unknown."""
        return []

    @abstractmethod
    def account(self, fitted: Fitted) -> Account:
        """Return what a result says of the block."""

    @abstractmethod
    def channels(self, fitted: Fitted | Computed) -> Sequence[PredictedChannel]:
        """Return measured and computed values."""

    def predict_record(self, fit: Fit, kind: str) -> RecordPrediction:
        """Return the values of the block, whose records were not fitted, at the estimates of a fit of some kind."""
        residuals, jacobian = self.linearised(fit.unknowns, fit.values)
        if self.failure:
            raise FitError(f"the record cannot be predicted: {self.failure}")
        prediction_fit = replace(fit, residuals=residuals, jacobian=jacobian / fit.scale)
        fitted = Fitted(prediction_fit, slice(None), 1.0, np.zeros(len(fit.names)))
        return RecordPrediction(kind, tuple(self.channels(fitted)))

    def linearised(self, unknowns: Sequence[Unknown], values: Array) -> tuple[Array, Array]:
        """Return the residuals (m,) at coordinates of unknowns, and their Jacobian in units of the scales of these."""
        names, coordinates = [unknown.name for unknown in unknowns], Coordinates.of(unknowns)
        evaluate = residual_function(lambda *x: self.residuals(dict(zip(names, x, strict=True))), coordinates)
        return residuals_and_jacobian(evaluate, values / coordinates.scale)
