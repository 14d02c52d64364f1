"""The result of a matching: the beam, how well it fits, and how certain its properties are."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ancf_casadi.estimation.fit import CONFIDENCE_LEVEL, quantile
from ancf_casadi.estimation.prediction import PredictedChannel, RecordPrediction
from ancf_casadi.estimation.result import FitResult, Interval
from ancf_casadi.estimation.solver.unknown import share_lines
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.lumped import lumped_kind, property_unit
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import Figure
from ancf_casadi.support.tables import Table
from ancf_casadi.support.tables import finite_or_none as finite
from ancf_casadi.vibration.modes import unit_warning
from problems.matching.identifiability import Identifiability
from problems.matching.measured_modes import MeasuredModes
from problems.matching.response import Matching

MOST_NAMES = 6  # largest number of bounds that a warning names
PREFERENCE_ERROR = 1e-5  # largest relative error that a preference leaves if the targets can be met
LARGEST_DEVIATION = 3.0  # error in standard deviations beyond which a target is out of reach
LIMITING_MULTIPLIER = 0.01  # least multiplier of a limiting bound, relative to the largest
SAME_SHAPE = 0.9  # MAC below which two shapes differ visibly


@dataclass(frozen=True, eq=False)
class FrequencyMatch(FitResult):
    """A beam matched to measured modes.

    The estimates are the properties that may change, such as ``density`` and ``thickness[3]``.

    Parameters
    ----------
    beam : Beam
        The matched beam.
    targets : tuple of float
        Measured frequencies, Hz.
    standard : tuple of float
        Frequencies of the given beam, Hz.
    frequencies : tuple of float
        Frequencies of the matched beam, Hz.
    iterations : int
        Iterations of IPOPT.
    build_seconds : float
        Time to build the nonlinear program, s.
    solve_seconds : float
        Time to solve it, s.
    matching : Matching
        The matching problem.
    unknowns : array (N,)
        The unknowns, in the order of ``matching.space.names``.
    modes : tuple of int
        Numbers, from 1, of the modes of the matched beam to which the targets are assigned.
    mac : array (m, c) or None
        MAC of the measured shapes with the lowest modes of the matched beam.
    residuals : array (R,)
        Residuals of frequencies, shapes and priors in units of their standard deviations; relative errors if none are
        given.
    multipliers : array (F,)
        Decrease of the objective per unit by which a bound of a factor is widened, by ``matching.space.factor_names``.
    identifiability : Identifiability
        The information in the data about the unknowns.
    starts : int
        Number of starts.
    reached : int
        Number of starts that ended at this optimum.
    failed : int
        Number of starts that did not converge.
    again : callable
        Takes other targets; returns the match of the same beam to them.

    Examples
    --------
    >>> from ancf_casadi import Beam
    >>> from problems import Global, match_frequencies
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> unknowns = [Global("thickness"), Global("density")]
    >>> match = match_frequencies(beam, targets=(1.85, 10.4), unknowns=unknowns)
    >>> [f"{100 * error:.2f} %" for error in match.relative_errors]
    ['-0.03 %', '0.02 %']
    """

    kind = "frequency matching"
    _drawing = "problems.matching.result.match_figure"

    beam: Beam
    targets: tuple[float, ...]
    standard: tuple[float, ...]
    frequencies: tuple[float, ...]
    iterations: int
    build_seconds: float
    solve_seconds: float
    matching: Matching
    unknowns: Array
    modes: tuple[int, ...]
    mac: Array | None
    residuals: Array
    multipliers: Array
    identifiability: Identifiability
    starts: int = 1
    reached: int = 1
    failed: int = 0
    again: Callable[[Any], Any] = field(kw_only=True)

    @property
    def relative_errors(self) -> Array:
        """Relative differences between matched and measured frequencies, (m,)."""
        return np.asarray(np.array(self.frequencies) / np.array(self.targets) - 1)

    @property
    def max_relative_error(self) -> float:
        """Largest relative difference between matched and measured frequencies."""
        return float(np.abs(self.relative_errors).max())

    @property
    def out_of_reach(self) -> bool:
        """True if no beam within the bounds has the measured frequencies."""
        if not self.matching.noisy:
            return self.max_relative_error > PREFERENCE_ERROR
        return bool(np.abs(self.relative_errors / self.matching.measured.relative_std).max() > LARGEST_DEVIATION)

    @cached_property
    def at_bound(self) -> tuple[str, ...]:
        """Properties at a bound, with their element from 1, such as ``thickness[3]``."""
        return self.matching.space.at_bound(self.unknowns)

    @property
    def estimates(self) -> dict[str, float]:
        """Value of each property that may change, SI units."""
        return self._by_name(self.identifiability.factors * self._given_values)

    @property
    def units(self) -> dict[str, str]:
        """SI unit of each property that may change."""
        return {name: property_unit(name) for name in self._names}

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard error of each property that may change, SI units.

        Nan if the data do not determine it, and for ``worst-error``, whose scatter ``monte_carlo`` shows.
        """
        return self._by_name(self.identifiability.standard_errors * np.abs(self._given_values))

    def intervals(self, level: float = CONFIDENCE_LEVEL) -> dict[str, Interval]:
        """Return the interval of each property that may change, within its bounds; nan if it is not determined.

        Raises
        ------
        InputError
            If the level is not between 0 and 1.
        """
        fit = self.identifiability
        half, (lower, upper) = quantile(level, math.inf) * fit.standard_errors, fit.room
        ends = fit.factors + np.array([np.maximum(-half, lower), np.minimum(half, upper)])  # nan stays nan
        low, high = np.sort(ends * self._given_values, axis=0).tolist()  # a natural curvature may be negative
        return dict(zip(self._names, zip(low, high, strict=True), strict=True))

    @property
    def _names(self) -> tuple[str, ...]:
        return self.matching.space.factor_names

    @property
    def _given_values(self) -> Array:
        return self.matching.space.given_values

    def _by_name(self, values: Array) -> dict[str, float]:
        return dict(zip(self._names, values.tolist(), strict=True))

    @property
    def covariance(self) -> Array:
        """Covariance (p, p) of the properties that may change, SI units; nan for those that are not determined."""
        return np.asarray(self.identifiability.factor_covariance * np.outer(self._given_values, self._given_values))

    @property
    def degrees_of_freedom(self) -> float:
        """Infinite: standard deviations are given, or none are known."""
        return math.inf

    @property
    def residual_count(self) -> int:
        """Number of residuals with known scatter; 0 if no standard deviation is given."""
        return len(self.residuals) if self.matching.noisy else 0

    def profile(self, name: str, level: float = CONFIDENCE_LEVEL) -> Interval:
        """Return the range of a property over all beams within the bounds that fit nearly as well, for a level.

        It is that of ``FitResult.profile``, to first order in the residuals, and includes the beams that fit equally
        well; standard deviations must be known.

        Raises
        ------
        InputError
            If there is no such property, the level is not between 0 and 1, or no standard deviation is known.
        FitError
            If a nonlinear program for an end does not converge.
        """
        self.check_name(name)
        t = quantile(level, math.inf)
        if not self.matching.weighted:
            advice = (
                "match by least squares, or use monte_carlo" if self.matching.noisy else "give those of the targets"
            )
            raise InputError(f"has no standard deviations that weigh its residuals; {advice}", "fit")
        k = self._names.index(name)
        low, high = sorted(end * float(self._given_values[k]) for end in self.identifiability.extremes(k, t**2))
        return low, high

    def predict(self, record: MeasuredModes | Sequence[float]) -> RecordPrediction:
        """Compute the frequencies of other targets of the same beam, such as higher modes, and compare.

        Raises
        ------
        InputError
            If they are not usable, or match no mode of the beam.
        EquilibriumError
            If the beam has no stable equilibrium.
        """
        measured = MeasuredModes.of(record)
        measured.check_beam(self.beam)
        matching, fit, m = Matching(self.matching.space, measured), self.identifiability, self.unknowns
        size, count = np.array(measured.frequencies) * matching.relative, measured.count
        tangents = matching.jacobian(m)[:count]  # of the frequencies, relative to ``size``
        errors = size * np.sqrt(np.einsum("ij,jk,ik->i", tangents, fit.covariance, tangents))
        errors[~fit.determines(tangents) | (not self.matching.weighted)] = math.nan
        noise = float(np.sqrt(np.mean(np.square(measured.frequency_std or math.nan)))) if matching.noisy else math.nan
        predicted, places = matching.state(m).frequencies, np.arange(1.0, count + 1.0)
        channel = PredictedChannel(
            "frequency", "Hz", np.array(measured.frequencies), predicted, errors, places, "target", noise
        )
        unknown = "the match leaves properties open that change these frequencies: their standard errors are unknown"
        notes = (unknown,) if self.matching.weighted and np.isnan(errors).any() else ()
        return RecordPrediction(self.kind, (channel,), notes)

    def resampled(self, noise: Array) -> Array:
        """Return the properties (p,) of the match to the modes of this beam plus noise of each residual (m,)."""
        priors = self.matching.synthetic_priors(self.unknowns, noise)
        match = self.again(self.matching.synthetic(self.unknowns, noise), **({"priors": priors} if priors else {}))
        return np.array(list(match.estimates.values()))

    @property
    def data_shares(self) -> dict[str, float]:
        """Share of each property with a prior that the data determine, 1 - (standard error/std of the prior)^2."""
        errors = self.standard_errors
        return {prior.name: prior.data_share(errors[prior.name]) for prior in self.matching.priors}

    @property
    def holding(self) -> tuple[tuple[str, float], ...]:
        """Active bounds that limit the fit, with their multipliers in descending order."""
        costs = self._by_name(self.multipliers)
        active = sorted(((name, costs[name]) for name in self.at_bound), key=lambda pair: -pair[1])
        return tuple((name, cost) for name, cost in active if cost > LIMITING_MULTIPLIER * active[0][1])

    @property
    def warnings(self) -> tuple[str, ...]:
        """Limitations of the match, one sentence each."""
        notes = []
        if self.out_of_reach:
            names = [name for name, _ in self.holding]
            remainder = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
            limit = (
                f"these bounds keep the beam from fitting better: {', '.join(names[:MOST_NAMES])}{remainder}; widen "
                "them if the beam may differ by more, or let other properties change"
                if names
                else "no bound limits the fit; let other properties change"
            )
            worst = f"a frequency error of {100 * self.max_relative_error:.3g} % remains"
            reason = unit_warning(np.array(self.targets), np.array(self.standard)) or limit
            notes.append(f"these unknowns cannot meet the targets: {worst}, and {reason}")
        given_modes = (self.matching.numbers + 1).tolist()
        if self.mac is None and given_modes != [*self.modes]:
            notes.append(
                f"the targets are matched to modes {', '.join(map(str, self.modes))}, which are not the lowest modes "
                "of the matched beam; give measured shapes to identify the modes"
            )
        for target, (mode, given_mode) in enumerate(zip(self.modes, given_modes, strict=True), start=1):
            if mode != given_mode:
                notes.append(
                    f"target {target} is mode {given_mode} of the given beam, and mode {mode} of the matched one"
                )
        for target, row in enumerate([] if self.mac is None else self.mac, start=1):
            mode, best = self.modes[target - 1], int(row.argmax()) + 1
            mac = row[mode - 1]
            if best != mode:
                notes.append(
                    f"the shape of target {target} is closer to mode {best} than to mode {mode}, which was followed "
                    f"(MAC {row.max():.2f} and {mac:.2f})"
                )
            elif mac < SAME_SHAPE:
                notes.append(f"the shape of target {target} differs from mode {mode}: their MAC is only {mac:.2f}")
        if self.reached < self.starts:
            failed = f"; {self.failed} did not converge" if self.failed else ""
            notes.append(f"{self.reached} of {self.starts} starts ended at this optimum, the best found{failed}")
        return tuple(notes)

    def tables(self) -> tuple[Table, Table]:
        """Return the table of frequencies, and that of properties with the ranges that the data leave open."""
        columns = {
            "mode": self.modes,
            "target": self.targets,
            "before": self.standard,
            "matched": self.frequencies,
            "error_%": (100 * self.relative_errors).tolist(),
        }
        if self.mac is not None:
            columns["MAC"] = [row[mode - 1] for row, mode in zip(self.mac.tolist(), self.modes, strict=True)]
        rows = list(zip(*columns.values(), strict=True))
        worst = f"largest relative error {self.max_relative_error:.1e}"
        if self.matching.objective == "worst-error":
            worst += ", the smallest that the bounds allow"
        title = "Properties of the matched beam"
        if not self.out_of_reach:
            title += "; lowest and highest value of each that fits equally well"
        return (
            Table("frequencies", "Natural frequencies, Hz", tuple(columns), rows, (worst,)),
            Table(
                "properties",
                title,
                ("property", "unit", "value", "change_%", "lowest", "highest", "stderr"),
                [tuple({**row, "change": 100 * row["change"]}.values()) for row in self._properties],
                (
                    *self._statements,
                    *share_lines(self.data_shares),
                    f"at a bound: {', '.join(self.at_bound) or 'nothing'}",
                ),
            ),
        )

    def table(self) -> Table:
        """Return the properties with the ranges that the data leave open."""
        return self.tables()[1]

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON: SI units, lists in the order of targets and elements, None for unknown values."""
        return {
            **super().to_dict(),
            "target_hz": list(self.targets),
            "standard_hz": list(self.standard),
            "matched_hz": list(self.frequencies),
            "width_m": list(self.beam.width),
            "thickness_m": list(self.beam.thickness),
            "density": list(self.beam.density),
            "elastic_modulus": list(self.beam.elastic_modulus),
            "tip_mass": self.beam.tip_mass,
            "clamp_stiffness": self.beam.clamp_stiffness if math.isfinite(self.beam.clamp_stiffness) else None,
            "lumped": self.beam.lumped,
            "max_relative_error": self.max_relative_error,
            "holding": [{"name": name, "multiplier": cost} for name, cost in self.holding],
            "out_of_reach": self.out_of_reach,
            "objective": self.matching.objective,
            "modes": list(self.modes),
            "mac": None if self.mac is None else self.mac.tolist(),
            "unknowns": dict(zip(self.matching.space.names, self.unknowns.tolist(), strict=True)),
            "rank": self.identifiability.rank,
            "identified": list(self._statements),
            "properties": self._properties,
            "priors": [
                {"name": prior.name, "prior": (prior.prior[0], prior.prior_std), "data_share": finite(share)}
                for prior, share in zip(self.matching.priors, self.data_shares.values(), strict=True)
                if prior.prior
            ],
            "starts": {"number": self.starts, "reached": self.reached, "failed": self.failed},
            "iterations": self.iterations,
            "solve_seconds": self.solve_seconds,
        }

    @property
    def _statements(self) -> tuple[str, ...]:
        if self.out_of_reach:
            return ("The targets are out of reach: no beam within the bounds fits, so no property has a range.",)
        return self.identifiability.statements()

    @cached_property
    def _properties(self) -> list[dict[str, Any]]:
        """The properties; without a range if the fit is out of reach."""
        factors = self.identifiability.factors
        ranges = np.full((len(factors), 2), math.nan) if self.out_of_reach else self.identifiability.spread
        lowest, highest = (map(finite, ends) for ends in np.sort(ranges * self._given_values[:, None], axis=1).T)
        columns = {
            "name": self._names,
            "unit": self.units.values(),
            "value": self.estimates.values(),
            "change": (factors - 1).tolist(),
            "lowest": lowest,
            "highest": highest,
            "stderr": map(finite, self.standard_errors.values()),
        }
        return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def match_figure(matches: Mapping[str, FrequencyMatch]) -> Figure:
    """Draw frequencies beside targets, and the changes of the properties, with the ranges that the data leave open."""
    from ancf_casadi.figures import beams  # slow to import: matplotlib

    (match,) = matches.values()
    fit, space = match.identifiability, match.matching.space
    ends = np.column_stack([fit.factors, fit.factors]) if match.out_of_reach else fit.spread
    changes = {name: ranges for name, ranges in space.by_property(ends - 1).items() if not lumped_kind(name)}
    targets, standard, matched = map(np.array, (match.targets, match.standard, match.frequencies))
    return beams.match_figure(targets, standard, matched, space.beam, match.beam, changes)
