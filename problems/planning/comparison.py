"""Probabilities that planned experiments tell damping laws apart, before anything is measured.

Each law in turn is taken as true.  ``plan`` computes the records that it would give, without noise, and the other laws
are fitted to them.  What they miss, relative to the noise, decides how often ``compare_laws`` finds the true law
(``ancf_casadi.estimation.criteria``).  This holds as far as noise moves all fits in proportion, and for the parameters
that the laws are given with.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass
from functools import partial
from types import NoneType
from typing import Any

from ancf_casadi.damping import DampingLaw
from ancf_casadi.estimation.criteria import Expectation, expectation
from ancf_casadi.estimation.solve import fitted_once
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.inputs import check_instance, choice, instances, whole
from ancf_casadi.support.interrupts import lasting_interrupts
from ancf_casadi.support.parallel import run_all
from ancf_casadi.support.tables import Reported, Table, plural
from problems.beam.fitting import FitSettings, beam_problem, fit_beam
from problems.beam.result import law_name
from problems.planning.experiments import check_candidates, plan
from problems.planning.record import PlannedRecord
from problems.planning.result import TOGETHER


@dataclass(frozen=True, eq=False)
class PlannedComparison(Reported):
    """Probabilities that candidate records tell damping laws apart.

    Parameters
    ----------
    names : tuple of str
        The laws.
    expected : mapping
        What a comparison is expected to find, by (candidate, number of the true law, number of the other one) from 0.

    Examples
    --------
    >>> from ancf_casadi.estimation.criteria import Expectation
    >>> from problems import PlannedComparison
    >>> sure, unsure = Expectation(difference=20.0, right=0.99), Expectation(difference=3.0, right=0.8)
    >>> found = PlannedComparison(("linear", "drag"), {("release", 0, 1): sure, ("release", 1, 0): unsure})
    >>> found.right
    {'release': 0.8}
    """

    kind = "comparison plan"
    _drawing = "problems.planning.drawing.comparison_plan_figure"

    names: tuple[str, ...]
    expected: Mapping[tuple[str, int, int], Expectation]

    @property
    def right(self) -> dict[str, float]:
        """Probability that each candidate tells the true law from another one, for the pair with the lowest one."""
        lowest: dict[str, float] = {}
        for (name, _, _), expected_choice in self.expected.items():
            lowest[name] = min(expected_choice.right, lowest.get(name, 1.0))
        return lowest

    def table(self) -> Table:
        """Return the expected difference of the criterion and the probability of the right choice, a row per pair."""
        rows = [
            (name, self.names[truth], self.names[rival], expected_choice.difference, expected_choice.right)
            for (name, truth, rival), expected_choice in self.expected.items()
        ]
        columns = ("candidate", "true law", "other law", "difference", "right")
        return Table("comparison_plan", "Expected choices between two laws", columns, rows)

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON."""
        pairs = [
            {"candidate": name, "truth": self.names[truth], "other": self.names[rival], **asdict(expected_choice)}
            for (name, truth, rival), expected_choice in self.expected.items()
        ]
        return {"kind": self.kind, "laws": list(self.names), "pairs": pairs, "right": self.right}

    def _summary(self) -> str:
        return f"{plural(len(self.right), 'candidate')} for {', '.join(self.names)}"


@lasting_interrupts()
def plan_comparison(
    model: Model,
    candidates: Mapping[str, PlannedRecord],
    laws: Sequence[DampingLaw],
    *,
    counts: Mapping[str, int] | None = None,
    executor: Executor | None = None,
    jobs: int = 1,
    progress: bool = False,
    **settings: Any,
) -> PlannedComparison:
    """Compute the probability that ``compare_laws`` finds the true law from records, before anything is measured.

    Parameters
    ----------
    model, candidates
        As in ``plan``.
    laws : sequence of DampingLaw
        The laws with guesses of their parameters, the simplest first.  Each in turn is taken as true, with its guesses.
    counts : mapping of str to int, optional
        Number of records of each candidate that are measured together; one of each if not given.
    executor, jobs, progress
        As in ``run_all``; the laws are computed in parallel.  With ``jobs`` above 1 a script must call this under
        ``if __name__ == "__main__":``.
    **settings
        ``unknowns``, ``fixed``, ``priors``, ``modes`` and ``harmonics`` as in ``plan``.

    Returns
    -------
    PlannedComparison
        Expected differences and probabilities of the right choice, for each candidate alone and all together.

    Raises
    ------
    InputError
        If there are fewer than two laws, or as in ``plan``.
    EquilibriumError, FitError
        If a law cannot be fitted to the records of another one.

    Examples
    --------
    Does a release decide between drag and viscous damping?

    >>> from ancf_casadi import Beam, Model, QuadraticDamping, RayleighDamping, Sensor, static_equilibrium
    >>> from problems import PlannedRecord, plan_comparison
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9, elements=2)
    >>> model = Model(beam)
    >>> start = static_equilibrium(model, tip_force=(5e-3, 0.0))
    >>> release = PlannedRecord.motion(Sensor(), duration=0.5, sample_rate=20.0, std=2e-3, start=start)
    >>> found = plan_comparison(model, {"release": release}, [RayleighDamping(0.5), QuadraticDamping(eta2=1.0)])
    >>> found.right["release"] < 0.9
    True
    """
    laws = instances(laws, "laws", DampingLaw)
    if len(laws) < 2:
        raise InputError("needs two laws at least", "laws")
    check_candidates(candidates)
    check_instance(counts, "counts", Mapping, NoneType)
    numbers = {name: 1 for name in candidates} if counts is None else dict(counts)
    for name, count in numbers.items():
        choice(name, tuple(candidates), "counts")
        whole(count, f"counts: {name}", 0)
    lists = {name: {name: 1} for name in candidates}
    if numbers not in lists.values():
        lists[TOGETHER] = numbers
    tasks = [partial(_expect_choices, model, candidates, laws, k, lists, settings) for k in range(len(laws))]
    expectations = run_all(tasks, executor=executor, jobs=jobs, progress=progress, title="laws")
    ordered = {
        key: expected_choice
        for name in lists
        for choices in expectations
        for key, expected_choice in choices.items()
        if key[0] == name
    }
    return PlannedComparison(tuple(law_name(law) for law in laws), ordered)


def _expect_choices(
    model: Model,
    candidates: Mapping[str, PlannedRecord],
    laws: Sequence[DampingLaw],
    truth: int,
    lists: Mapping[str, Mapping[str, int]],
    settings: Mapping[str, Any],
) -> dict[tuple[str, int, int], Expectation]:
    """Return the expected choice between a true law and each other law for each list of records."""
    planned = plan(model, candidates, laws[truth], **settings)
    exact = dict(zip(planned.names, planned.records, strict=True))
    terms, expectations = [[parameter.name for parameter in law.parameters] for law in laws], {}
    for name, counts in lists.items():
        records: list[Any] = [exact[candidate] for candidate, count in counts.items() for _ in range(count)]
        problem = beam_problem(model, records, laws[truth], FitSettings(**settings))[0]
        true_fit = fitted_once(problem)
        for k, law in enumerate(laws):
            if k != truth:
                rival_fit = fit_beam(model, records, law, **settings).fit
                pair = (true_fit, rival_fit), (terms[truth], terms[k])
                expectations[name, truth, k] = expectation(*pair, rival_fit.residuals, problem.scale, 1.0)
    return expectations
