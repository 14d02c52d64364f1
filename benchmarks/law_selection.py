"""Measure how often the true damping law is selected: seeded records of each law, each fitted with all laws.

    .venv/bin/python benchmarks/law_selection.py combined --runs 100     decays with omega(A), all terms significant
    .venv/bin/python benchmarks/law_selection.py decays --runs 200       closed-form decays, compare_decay_laws
    .venv/bin/python benchmarks/law_selection.py motions --runs 20       large motion of a beam, compare_laws
    .venv/bin/python benchmarks/law_selection.py motions --runs 20 --weak    the same, too short and noisy to decide

A run is right if the true law has the lowest BIC, and settled if the verdict says so.  ``combined`` draws decays under
each damping law with each frequency law, of 30 to 150 periods with noise of 0.1 to 3 % of the amplitude, and keeps
those in which each term of the truth, fitted with the true law, is at least five standard errors large.  The exponent
of the power law must differ by as much from 0, 1 and 2, where it is another law.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Callable
from functools import partial
from itertools import product
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi import (
    Beam,
    DampingLaw,
    ModalDamping,
    Model,
    QuadraticDamping,
    RayleighDamping,
    natural_modes,
    run_all,
    simulate,
    static_equilibrium,
)
from ancf_casadi.decay.closed_forms import friction_decay
from ancf_casadi.decay.phase import FrequencyLaw
from ancf_casadi.exceptions import AncfError
from problems import DecayFit, MarkerRecord, compare_decay_laws, compare_laws, fit_decay
from problems.decay.comparison import FREQUENCY_LAWS_COMPARED, LAWS_COMPARED
from problems.decay.laws import DecayModel, Law

DECAYS = {"linear": (0.0, 0.25, 0.0), "quadratic": (0.0, 0.15, 0.5), "friction": (0.1, 0.15, 0.5)}  # eta0, eta1, eta2
LAWS = ("mass-proportional", "quadratic", "modal")
NOISE = 0.5e-3  # m
SIGNIFICANT = 5.0  # least size of each term, standard errors


def decay(law: str, seed: int, *, weak: bool) -> tuple[bool, bool]:
    """Return whether the true law of a decay is selected, and whether the verdict is settled."""
    time = np.arange(0.0, 0.8 if weak else 5.0, 1 / 500)
    eta0, eta1, eta2 = DECAYS[law]
    y = np.asarray(friction_decay(cs.DM(time), 2 * math.pi * 1.85, eta0, eta1, eta2, 0.076, 0.2)).ravel()
    y += (4e-3 if weak else 2e-4) * np.random.default_rng(seed).standard_normal(len(time))
    comparison = compare_decay_laws(time, y, laws=tuple(DECAYS), frequency_laws=("constant",))
    return comparison.best.law == law, comparison.verdict.settled


def combined(law: Law, frequency_law: FrequencyLaw, seed: int) -> tuple[str, bool]:
    """Return the law selected for a decay with significant terms, and whether the verdict is settled."""
    rng = np.random.default_rng([LAWS_COMPARED.index(law), FREQUENCY_LAWS_COMPARED.index(frequency_law), seed])
    while True:
        time, y = _draw(rng, law, frequency_law)
        try:
            fit = fit_decay(time, y, law=law, frequency_law=frequency_law, release_time=0.0)
        except AncfError:
            continue
        if _least_term(fit) >= SIGNIFICANT:
            break
    comparison = compare_decay_laws(time, y, release_time=0.0)
    return f"{comparison.best.law}, {comparison.best.frequency_law}", comparison.verdict.settled


def _draw(rng: np.random.Generator, law: Law, frequency_law: FrequencyLaw) -> tuple[Any, Any]:
    """Return a random decay of 1 Hz with an amplitude of 1 under two laws."""

    def between(least: float, most: float) -> float:
        return float(math.exp(rng.uniform(math.log(least), math.log(most))))

    model, omega = DecayModel(law, "constant", frequency_law), 2 * math.pi
    periods = between(30.0, 150.0)
    time = np.arange(0.0, periods, 1 / between(8.0, 16.0))
    ratio = between(0.7, 4.0) / (omega * periods)
    shares = rng.dirichlet(np.ones({"linear": 1, "quadratic": 2, "friction": 3, "power": 1}[law])) * ratio
    units = (2 * omega, 3 * math.pi / 4, math.pi * omega**2 / 2)  # of eta1, eta2, eta0 with a ratio of 1
    terms = [share * unit for share, unit in zip(shares, units, strict=False)]
    damping = {"linear": [ratio], "power": [ratio, rng.uniform(0.0, 4.0)]}.get(law, terms)
    change = [rng.choice([-1.0, 1.0]) * between(1e-3, 0.1), rng.uniform(-6.0, -1.0)][: len(model.frequency_terms)]
    phase = rng.uniform(-math.pi, math.pi)
    values = (omega, *damping, *change, 1.0, phase, 0.0)
    y = np.asarray(cs.evalf(model.curve(time, *map(cs.MX, values)))).ravel()
    return time, y + between(1e-3, 0.03) * rng.standard_normal(len(time))


def _least_term(fit: DecayFit) -> float:
    """Return the size of the smallest term of a fit, in standard errors; 0 if one is at its bound."""
    names = [name for name in fit.model.terms if name not in ("eta_p", "exponent")] or ["damping_ratio"]
    sizes = [abs(getattr(fit, name)) / fit.standard_errors[name] for name in (*names, "damping_ratio")]
    if fit.law == "power":
        sizes += [abs(fit.exponent - p) / fit.standard_errors["exponent"] for p in (0.0, 1.0, 2.0)]
    return min((0.0 if math.isnan(size) else size) for size in sizes)


def strip() -> Model:
    """Return a soft, hanging silicone strip."""
    return Model(
        Beam.uniform(length=0.2, width=0.01, thickness=2e-3, density=1070.0, elastic_modulus=264e3, elements=3)
    )


def laws(model: Model, guess: float) -> list[DampingLaw]:
    """Return the three laws with scaled parameters, each with strain-rate damping for the modes of the mesh."""
    modes, calm = natural_modes(model, count=2), RayleighDamping(beta=3e-4)
    return [
        RayleighDamping(alpha=1.5 * guess) + calm,
        QuadraticDamping(eta1=0.6 * guess, eta2=6.0 * guess) + calm,
        ModalDamping(modes, (0.05 * guess, 0.05 * guess)) + calm,
    ]


def motion(law: str, seed: int, *, weak: bool) -> tuple[bool, bool]:
    """Return the same for a release from a load that bends the strip in its first two modes."""
    model = strip()
    start = static_equilibrium(model, tip_force=(0.005, 0.0), tip_moment=-8e-6)
    which = LAWS.index(law)
    duration = 0.25 if weak else 1.0
    truth = laws(model, 1.0)[which]
    run = simulate(
        model, damping=truth, start=start, duration=duration, sample_rate=60.0, method="radau", tolerance=1e-7
    )
    noise = (8.0 if weak else 1.0) * NOISE * np.random.default_rng(seed).normal(size=run.tip.shape)
    record = MarkerRecord(run.time, run.tip + noise, start=start)
    comparison = compare_laws(model, record, laws(model, 0.7), fixed=("beta",), tolerance=1e-5)
    return comparison.verdict.best == which, comparison.verdict.settled


def main() -> None:
    """Run the study and print a line for each law."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("combined", "decays", "motions"))
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--weak", action="store_true")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    if options.what == "combined":
        for law, frequency_law in product(LAWS_COMPARED, FREQUENCY_LAWS_COMPARED):
            _print_combined(law, frequency_law, options.runs, options.jobs)
        return
    one: Callable[..., tuple[bool, bool]] = decay if options.what == "decays" else motion
    for law in DECAYS if options.what == "decays" else LAWS:
        tasks: list[Any] = [partial(one, law, seed, weak=options.weak) for seed in range(options.runs)]
        right, settled = np.array(run_all(tasks, jobs=options.jobs)).T
        print(
            f"{law:18} right {right.mean():6.1%}, settled {settled.mean():6.1%}, "
            f"settled on a wrong law {(settled & ~right).mean():6.1%}",
            flush=True,
        )


def _print_combined(law: Law, frequency_law: FrequencyLaw, runs: int, jobs: int) -> None:
    tasks: list[Any] = [partial(combined, law, frequency_law, seed) for seed in range(runs)]
    selected, settled = zip(*run_all(tasks, jobs=jobs), strict=True)
    truth = f"{law}, {frequency_law}"
    right = np.array([name == truth for name in selected])
    wrong = Counter(name for name in selected if name != truth)
    print(
        f"{truth:22} right {right.mean():6.1%}, settled {np.mean(settled):6.1%}, settled on a wrong law "
        f"{(np.array(settled) & ~right).mean():6.1%}; instead: "
        + (", ".join(f"{name} ({count})" for name, count in wrong.most_common()) or "none"),
        flush=True,
    )


if __name__ == "__main__":
    main()
