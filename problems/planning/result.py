"""The result of a plan: expected standard errors, best lists, sensor places, durations."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ancf_casadi.estimation.determination import product
from ancf_casadi.estimation.solver.unknown import Coordinates, Unknown
from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance, choice, physical, whole
from ancf_casadi.support.tables import Reported, Table, finite, finite_or_none, plural
from problems.planning.design import Design, ExpectedRecord, best_subset
from problems.planning.record import Template

TOGETHER = "all together"  # name of the list of all candidates
INSTANTS = 60  # number of instants at which a record may end


@dataclass(frozen=True, eq=False)
class Plan(Reported):
    """Standard errors that candidate records will have, and the lists that are worth measuring.

    A goal is ``"D"``, the volume of the region of confidence; ``"A"``, the sum of the squared standard errors relative
    to the guesses; or the name of an unknown, its standard error.

    Parameters
    ----------
    names : tuple of str
        The candidates.
    costs : tuple of float
        Cost of each.
    unknowns : tuple of Unknown
        The unknowns that records share, with their guess.
    records : tuple
        Each candidate as a record with its expected values, without noise.
    expected : tuple of ExpectedRecord
        How the residuals of each depend on the unknowns.
    prior : ndarray (n, n)
        Information of priors and of earlier records, with the unknowns in units of their scales.
    model : Model
        The beam with the guess.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, RayleighDamping, Sensor, static_equilibrium
    >>> from problems import PlannedRecord, plan
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9, elements=4)
    >>> model = Model(beam)
    >>> pulled = static_equilibrium(model, tip_force=(5e-3, 0.0))
    >>> release = PlannedRecord.motion(Sensor(), duration=1.0, sample_rate=50.0, std=1e-4, start=pulled)
    >>> found = plan(model, {"release": release}, RayleighDamping(alpha=0.5))
    >>> f"{found.errors_of({'release': 1})['alpha']:.3f} 1/s", found.units
    ('0.006 1/s', {'alpha': '1/s'})
    """

    kind = "plan"
    _drawing = "problems.planning.drawing.plan_figure"

    names: tuple[str, ...]
    costs: tuple[float, ...]
    unknowns: tuple[Unknown, ...]
    records: tuple[Template, ...]
    expected: tuple[ExpectedRecord, ...]
    prior: Array
    model: Model

    @property
    def guess(self) -> dict[str, float]:
        """Guess of each unknown by name."""
        return {unknown.name: unknown.guess for unknown in self.unknowns}

    @property
    def units(self) -> dict[str, str]:
        """Unit of each unknown by name."""
        return {unknown.name: unknown.unit for unknown in self.unknowns}

    @cached_property
    def design(self) -> Design:
        """The candidates as matrices of information, with the unknowns in units of their scales."""
        informations = np.array([record.information for record in self.expected])
        negligible = max(record.negligible for record in self.expected)
        return Design(informations, self.prior, negligible, np.array(self.costs))

    def errors_of(self, counts: Mapping[str, float]) -> dict[str, float]:
        """Return the standard error of each unknown from a list of records, infinite if they do not determine it.

        Parameters
        ----------
        counts : mapping of str to float
            Number of records by the name of the candidate; none if not given.

        Raises
        ------
        InputError
            If there is no such candidate, or a number is negative.
        """
        return self._errors_by_name(self.design.errors(self.design.total(self._amounts(counts))))

    def shares(self, budget: float = 1.0, goal: str = "D") -> dict[str, float]:
        """Return the share of a budget that is best spent on each candidate, as if records were divisible.

        Raises
        ------
        InputError
            If the goal is unknown, or the budget is not positive.
        FitError
            If all candidates together do not determine the goal.
        """
        weights = self._goal(goal)
        return self._by_candidate(self.design.shares(physical(budget, "budget"), weights))

    def best(self, budget: float, goal: str = "D", most_each: int | None = None) -> dict[str, int]:
        """Return the number of records of each candidate that is best within a budget, by exchange.

        Parameters
        ----------
        budget : float
            Largest sum of the costs.
        goal : str
            ``"D"``, ``"A"``, or the name of an unknown.
        most_each : int, optional
            Largest number of records of one candidate.

        Raises
        ------
        InputError
            If the goal is unknown, or the budget pays for no candidate.
        FitError
            If the candidates, or those that the budget pays for, do not determine the goal.
        """
        weights, budget = self._goal(goal), physical(budget, "budget")
        if budget < min(self.costs):
            raise InputError(f"pays for no candidate; the cheapest costs {min(self.costs):g}", "budget")
        count_limit = None if most_each is None else whole(most_each, "most_each", 1)
        counts = self._by_candidate(self.design.counts(budget, weights, count_limit))
        errors = self.errors_of(counts)
        undetermined = [name for name in ([goal] if goal in errors else errors) if not math.isfinite(errors[name])]
        if undetermined:
            raise FitError(f"no list within the budget determines {', '.join(undetermined)}; spend more")
        return {name: int(count) for name, count in counts.items()}

    def gains(self, counts: Mapping[str, float], goal: str = "D") -> dict[str, float]:
        """Return how much one more record of each candidate improves a list, to first order.

        For ``"D"`` this is the decrease of the logarithm of the determinant of the covariance, for others that of the
        squared standard errors relative to the scales of the unknowns.

        Raises
        ------
        InputError
            If there is no such candidate or goal, or a number is negative.
        """
        return self._by_candidate(self.design.gains(self._amounts(counts), self._goal(goal)))

    def places(
        self, name: str, count: int = 1, goal: str = "D", counts: Mapping[str, float] | None = None
    ) -> tuple[float, ...]:
        """Return the best places for sensors of a motion, among those of its channels, by exchange.

        Parameters
        ----------
        name : str
            The candidate, with a channel, or several, at each possible place.
        count : int
            Number of places.
        goal : str
            ``"D"``, ``"A"``, or the name of an unknown.
        counts : mapping of str to float, optional
            Other records on the list; none if not given.

        Returns
        -------
        tuple of float
            Arc lengths, m.

        Raises
        ------
        InputError
            If the candidate is no motion or has fewer places, or the goal is unknown.
        """
        (record, other_information), weights = self._motion(name, counts), self._goal(goal)
        points = np.unique(record.places)
        count = whole(count, "count", 1, len(points))

        def loss(subset: tuple[int, ...]) -> float:
            series = np.flatnonzero(np.isin(record.places, points[list(subset)])).tolist()
            return float(self.design.loss(other_information + record.series_information(series), weights))

        return tuple(points[list(best_subset(count, len(points), loss))].tolist())

    def over_places(self, name: str, counts: Mapping[str, float] | None = None) -> tuple[Array, dict[str, Array]]:
        """Return the standard errors if a motion had the sensors of one place only.

        Parameters
        ----------
        name : str
            The candidate, a motion.
        counts : mapping of str to float, optional
            Other records on the list; none if not given.

        Returns
        -------
        points : ndarray (p,)
            Arc lengths of the places, m.
        errors : dict of str to ndarray (p,)
            Standard error of each unknown.

        Raises
        ------
        InputError
            If the candidate is no motion, or as in ``errors_of``.
        """
        record, other_information = self._motion(name, counts)
        points = np.unique(record.places)
        series = [np.flatnonzero(record.places == point).tolist() for point in points]
        informations = [other_information + record.series_information(indices) for indices in series]
        return points, self._errors_by_name([self.design.errors(information) for information in informations])

    def over_time(self, name: str, counts: Mapping[str, float] | None = None) -> tuple[Array, dict[str, Array]]:
        """Return the standard errors if a motion ended earlier, at up to 60 instants.

        Parameters
        ----------
        name, counts
            As in ``over_places``.

        Returns
        -------
        times : ndarray (t,)
            End of the record, s.
        errors : dict of str to ndarray (t,)
            Standard error of each unknown.

        Raises
        ------
        InputError
            If the candidate is no motion, or as in ``errors_of``.
        """
        record, other_information = self._motion(name, counts)
        distinct = np.unique(record.times)
        times = distinct[np.unique(np.linspace(0, len(distinct) - 1, INSTANTS + 1).astype(int)[1:])]
        informations = other_information + record.informations_until(times)
        return times, self._errors_by_name([self.design.errors(information) for information in informations])

    def duration(self, name: str, unknown: str, error: float, counts: Mapping[str, float] | None = None) -> float:
        """Return the time that a motion must last for a standard error of an unknown, s; infinite if it is too short.

        Raises
        ------
        InputError
            If there is no such unknown, the error is not positive, or as in ``over_time``.
        """
        choice(unknown, tuple(self.guess), "unknown")
        error = physical(error, "error")
        times, errors = self.over_time(name, counts)
        enough = np.flatnonzero(errors[unknown] <= error)
        return float(times[enough[0]]) if enough.size else math.inf

    @property
    def warnings(self) -> tuple[str, ...]:
        """Products of powers of the unknowns that the candidates do not determine, one sentence each."""
        values, vectors = np.linalg.eigh(self.design.total(np.ones(len(self.names))))
        y = Coordinates.of(self.unknowns)
        slopes = y.relative_slopes(y.guess) / y.scale
        undetermined = vectors[:, values <= self.design.negligible**2].T / np.where(slopes == 0.0, 1.0, slopes)
        return tuple(
            f"the candidates do not determine {product(list(self.guess), row / row[np.abs(row).argmax()])}; add one "
            "that does, or fix an unknown"
            for row in undetermined
        )

    def table(self) -> Table:
        """Return the standard errors from one record of each candidate alone, relative to the guess."""
        rows = []
        for name, cost in zip(self.names, self.costs, strict=True):
            rows.append((name, cost, *map(finite_or_none, self.relative(self.errors_of({name: 1})).values())))
        together = self.relative(self.errors_of(dict.fromkeys(self.names, 1)))
        rows.append((TOGETHER, sum(self.costs), *map(finite_or_none, together.values())))
        columns = ("candidate", "cost", *column_headings(self.unknowns))
        return Table("plan", "Expected standard errors from one record of each", columns, rows)

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON: SI units, None for unknown values."""
        data = {
            "kind": self.kind,
            "unknowns": [{"name": u.name, "guess": u.guess, "unit": u.unit} for u in self.unknowns],
            "candidates": [
                {"name": name, "cost": cost, "standard_errors": self.errors_of({name: 1})}
                for name, cost in zip(self.names, self.costs, strict=True)
            ],
            "together": self.errors_of(dict.fromkeys(self.names, 1)),
            "warnings": list(self.warnings),
        }
        return finite(data)

    def _summary(self) -> str:
        return f"{plural(len(self.names), 'candidate')} for {', '.join(self.guess)}"

    @cached_property
    def _sizes(self) -> Array:
        """Changes (n,) of the unknowns by changes of their coordinates in units of the scales."""
        y = Coordinates.of(self.unknowns)
        return np.asarray(np.abs(y.slopes(y.guess)) * y.scale)

    def _errors_by_name(self, errors: Any) -> dict[str, Any]:
        """Convert standard errors in units of the scales, (n,) or (t, n), to those of the unknowns by name."""
        named_errors = (np.asarray(errors) * self._sizes).T
        return dict(zip(self.guess, named_errors if named_errors.ndim > 1 else named_errors.tolist(), strict=True))

    def relative(self, errors: Mapping[str, Any]) -> dict[str, Any]:
        """Return standard errors in per cent of the guesses; absolute ones for guesses of 0."""
        return {
            name: 100 * error / abs(self.guess[name]) if self.guess[name] else error for name, error in errors.items()
        }

    def _by_candidate(self, values: Array) -> dict[str, float]:
        return dict(zip(self.names, values.tolist(), strict=True))

    def _amounts(self, counts: Mapping[str, float]) -> Array:
        check_instance(counts, "counts", Mapping)
        for name, count in counts.items():
            choice(name, self.names, "counts")
            if count:
                physical(count, f"counts: {name}")
        return np.array([float(counts.get(name, 0.0)) for name in self.names])

    def _goal(self, goal: str) -> Array | None:
        """Return the weights of the squared standard errors in a goal; None for D."""
        names = tuple(self.guess)
        choice(goal, ("D", "A", *names), "goal")
        weights = np.array([float(goal in ("D", "A", name)) for name in names])
        errors = self.design.errors(self.design.total(np.ones(len(self.names))))
        if not np.isfinite(errors[weights > 0]).all():
            raise FitError("; ".join(self.warnings))
        return None if goal == "D" else weights

    def _motion(self, name: str, counts: Mapping[str, float] | None) -> tuple[ExpectedRecord, Array]:
        """Return a motion among the candidates, and the information of the other records on the list."""
        choice(name, self.names, "name")
        record = self.expected[self.names.index(name)]
        if np.isnan(record.times).any():
            raise InputError(f"{name} is no motion", "name")
        return record, self.design.total(self._amounts(counts or {}))


def column_headings(unknowns: Sequence[Unknown]) -> list[str]:
    """Return each unknown with the unit of its relative standard error."""
    return [f"{unknown.name}, {'%' if unknown.guess else unknown.unit or '1'}" for unknown in unknowns]
