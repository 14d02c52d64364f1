"""All measurements of a fit: response curves, motions, and further evidence, in one vector of residuals.

Each kind of record has residuals in units of its own: G (distance) for curves, G' (computed - measured)/s for motions,
with the mean sizes G and G' of their standard deviations.  With the mean of both over all residuals, G_0,

    G_0/G r_curves,    G_0/G' r_motions,    G_0 r_evidence,

the likelihood of the normal distribution is that of all measurements together.  The standard deviation of a factor on
the levels of the excitation is evidence too: (x - 1)/deviation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array, Mask
from problems.response.problem import ResponseProblem
from problems.response.residuals import Responses
from problems.response.unknowns import excitation_name
from problems.transient.motion_record import MotionRecord
from problems.transient.problem import TransientProblem
from problems.transient.tolerance import first_tolerance
from problems.transient.unknowns import Evidence
from problems.transient.weights import first_weights

ALLOWED = 0.1  # largest shift of an estimate by more modes and harmonics, in standard errors
NEGLIGIBLE = 1e-4  # relative shift of an estimate below which it has no meaning
LEVEL_ERROR = 0.01  # relative error of the levels whose effect the result states
OPTIONS: Mapping[str, Any] = {
    "ipopt.tol": 1e-4,
    "ipopt.compl_inf_tol": 1e-7,
    "ipopt.max_iter": 60,
    "ipopt.mu_init": 1e-4,  # small, so that bounds do not push a good guess away
    "ipopt.bound_mult_init_method": "mu-based",
}


@dataclass(frozen=True, eq=False)
class JointProblem:
    """Response curves, motions and evidence that are fitted together.

    Parameters
    ----------
    names : tuple of str
        The unknowns.
    curves : ResponseProblem
        The response curves.
    motions : TransientProblem or None
        The motions, if there are any.
    evidence : tuple of Evidence
        Further measurements.
    excitation_deviation : float or None
        Standard deviation of the factors on the levels; None if they have none.
    """

    names: tuple[str, ...]
    curves: ResponseProblem
    motions: TransientProblem | None
    evidence: tuple[Evidence, ...]
    excitation_deviation: float | None

    @property
    def series(self) -> list[int]:
        """Lengths of the series of residuals: curves, motions, and single values of the evidence."""
        motions = self.motions.series if self.motions else []
        return [*self.curves.series, *motions, *[1] * self._single]

    @property
    def times(self) -> Array:
        """Times of the residuals, s; the places in their order for those of curves."""
        places = [np.arange(length, dtype=float) for length in self.curves.series]
        motions = [self.motions.times] if self.motions else []
        return np.concatenate([*places, *motions, np.zeros(self._single)])

    @property
    def rows(self) -> list[Mask]:
        """Residuals of each record, first of the curves, then of the motions."""
        motions = self.motions.rows if self.motions else []
        before = sum(self.curves.series)
        behind = sum(self.series) - before
        after = behind - (len(motions[0]) if motions else 0)
        return [
            *(np.concatenate([row, np.zeros(behind, dtype=bool)]) for row in self.curves.rows),
            *(np.concatenate([np.zeros(before, bool), row, np.zeros(after, bool)]) for row in motions),
        ]

    @property
    def scale(self) -> float:
        """The mean size G_0 of the standard deviations, the expected standard deviation of the residuals."""
        curves, motions = sum(self.curves.series), sum(self.motions.series) if self.motions else 0
        logarithms = curves * math.log(self.curves.weights.scale)
        if self.motions:
            logarithms += motions * math.log(self.motions.weights.scale)
        return math.exp(logarithms / (curves + motions))

    def residuals(self, responses: Responses, runs: Sequence[cs.Function], given: Mapping[str, cs.MX]) -> cs.MX:
        """Return the residuals for unknowns by name.

        Parameters
        ----------
        responses : Responses
            The residuals of the curves.
        runs : sequence of Function
            The motions, from ``TransientProblem.runs``.
        given : mapping
            The unknowns.
        """
        scale = self.scale
        vector = cs.vertcat(*(given[name] for name in self.names))
        parts = [scale / self.curves.weights.scale * responses.differentiable(vector)]
        if self.motions:
            parts.append(scale / self.motions.weights.scale * self.motions.residuals(runs, given))
        parts += [scale * one.residuals(given) for one in self.evidence]
        if self.excitation_deviation is not None:
            parts += [scale * (given[name] - 1) / self.excitation_deviation for name in self._factors]
        return cs.vertcat(*parts)

    def finer(self, values: Mapping[str, float], near: Responses) -> tuple[JointProblem, Array, Array]:
        """Return the problem with one mode and two harmonics more, and its curves for values of the unknowns by name.

        The curves are those residuals (m,) and their derivatives by the levels of all records (m,); zero for motions
        and evidence.  ``near`` has the motions to start from.
        """
        problem = self.curves.finer()
        excitation = "common" if problem.excitation == "known" else problem.excitation
        names = tuple(dict.fromkeys(excitation_name(k, excitation) for k in range(len(problem.records))))
        residuals, jacobian = near.continued(replace(problem, excitation=excitation), names).at(values)
        count = sum(self.series)
        padded = np.zeros((2, count))
        padded[0, : len(residuals)], padded[1, : len(residuals)] = residuals, jacobian.sum(axis=1)
        padded *= self.scale / problem.weights.scale
        return replace(self, curves=problem), padded[0], padded[1]

    def improved(self, residuals: Array) -> JointProblem:
        """Return the problem with the standard deviations of the curves that weighted residuals give."""
        own = residuals[: sum(self.curves.series)] * self.curves.weights.scale / self.scale
        return replace(self, curves=replace(self.curves, weights=self.curves.weights.improved(own)))

    @property
    def _factors(self) -> list[str]:
        """The factors on levels that have a standard deviation."""
        return [] if self.excitation_deviation is None else [one for one in self.names if one.startswith("excitation")]

    @property
    def _single(self) -> int:
        """Number of single values of the evidence."""
        return len(self._factors) + sum(len(one.deviations) for one in self.evidence if one.deviations is not None)


def motion_problem(model: Model, records: tuple[MotionRecord, ...], damping: DampingLaw) -> TransientProblem:
    """Return motions as a problem, integrated as accurately as ``fit_transient`` does at first."""
    weights = first_weights(records)
    return TransientProblem(model, records, damping, (), first_tolerance(records, weights, model.beam.length), weights)
