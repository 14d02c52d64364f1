"""Comparison of damping laws on measured motions and response curves: each law is fitted to all records."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from functools import partial
from typing import Any

from ancf_casadi.damping import DampingLaw
from ancf_casadi.estimation.comparison import LawComparison
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.inputs import instances
from ancf_casadi.support.parallel import run_all
from problems.beam.fitting import fit_beam
from problems.beam.result import BeamFit, law_name


def compare_laws(
    model: Model,
    records: Any,
    laws: Sequence[DampingLaw],
    *,
    executor: Executor | None = None,
    jobs: int = 1,
    progress: bool = False,
    **settings: Any,
) -> LawComparison[BeamFit]:
    """Fit several damping laws to any mix of measurements, and select one by information criteria.

    Parameters
    ----------
    model, records
        As in ``fit_beam``.
    laws : sequence of DampingLaw
        Laws with guesses of their parameters, the simplest first.
    executor, jobs, progress
        As in ``run_all``; the laws are fitted in parallel.  With ``jobs`` above 1 a script must call this under
        ``if __name__ == "__main__":``.
    **settings
        Further settings of ``fit_beam``.

    Raises
    ------
    InputError
        If there is no law, or as in ``fit_beam``.
    FitError
        If a fit does not converge.

    Examples
    --------
    >>> from ancf_casadi import Beam, HarmonicBase, Model, QuadraticDamping, RayleighDamping, simulate
    >>> from problems import MarkerRecord, compare_laws
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> model, base = Model(beam), HarmonicBase(amplitude=5e-3, frequency=1.9)
    >>> true, laws = QuadraticDamping(eta2=2.0), [RayleighDamping(alpha=0.2), QuadraticDamping(eta2=1.0)]
    >>> run = simulate(model, damping=true, base=base, duration=0.25, sample_rate=50.0)
    >>> comparison = compare_laws(model, MarkerRecord(run.time, run.tip, base=base), laws)
    >>> type(comparison.best.law).__name__, round(comparison.best.estimates["eta2"], 2)
    ('QuadraticDamping', 2.0)
    """
    laws = instances(laws, "laws", DampingLaw)
    tasks = [partial(fit_beam, model, records, law, **settings) for law in laws]
    fits: list[Any] = run_all(tasks, executor=executor, jobs=jobs, progress=progress, title="laws")
    terms = tuple(tuple(own.name for own in law.parameters) for law in laws)
    return LawComparison(tuple(law_name(law) for law in laws), tuple(fits), terms)
