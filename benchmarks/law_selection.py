"""Measure how often the true damping law is selected: seeded records of each law, each fitted with all laws.

    .venv/bin/python -m benchmarks.law_selection combined --runs 100     decays with omega(A), all terms significant
    .venv/bin/python -m benchmarks.law_selection calibration --runs 100  how often laws are right, by their probability
    .venv/bin/python -m benchmarks.law_selection decays --runs 200       closed-form decays, compare_decay_laws
    .venv/bin/python -m benchmarks.law_selection motions --runs 20       large motion of a beam, compare_laws
    .venv/bin/python -m benchmarks.law_selection motions --runs 20 --weak    the same, too short and noisy to decide
    .venv/bin/python -m benchmarks.law_selection power --runs 200        the share of right choices that plans announce

A run is right if the true law is the most probable one, and settled if the verdict says so.  ``combined`` draws
decays under each damping law with each frequency law, of 30 to 150 periods with noise of 0.1 to 3 % of the amplitude,
and keeps those in which each term of the truth, fitted with the true law, is at least five standard errors large.  The
exponent of the power law must differ by as much from 0, 1 and 2, where it is another law.  ``calibration`` keeps all,
so that terms of all sizes occur, with as many records of each law, and with white and with AR(1) noise; ``--weak`` has
10 to 100 periods at constant frequency and noise of 0.1 to 10 %.
It lists the share of true laws among those with a probability from a class, for the probabilities of the comparison
and for weights of BIC and of AICc, and the share of records of each law on whose wrong law the verdict is settled.
``power`` fits two laws to the record of one of them, with noise of many seeds: decays by closed forms, and releases of
a strip as ``plan_comparison`` takes them.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import pairwise, product
from typing import Any

import casadi as cs
import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter
from scipy.stats import binom

from ancf_casadi import (
    DampingLaw,
    ModalDamping,
    Model,
    QuadraticDamping,
    RayleighDamping,
    Sensor,
    natural_modes,
    run_all,
    simulate,
    static_equilibrium,
)
from ancf_casadi.decay.closed_forms import friction_decay
from ancf_casadi.decay.phase import FrequencyLaw
from ancf_casadi.estimation.criteria import Candidate, expectation, judge
from ancf_casadi.estimation.fit import Fit
from ancf_casadi.exceptions import AncfError
from ancf_casadi.support.tables import Table
from benchmarks.beams import silicone
from problems import (
    DecayFit,
    MarkerRecord,
    PlannedRecord,
    compare_decay_laws,
    compare_laws,
    fit_beam,
    fit_decay,
    plan,
)
from problems.decay.comparison import FREQUENCY_LAWS_COMPARED, LAWS_COMPARED
from problems.decay.laws import DecayModel, Law

DECAYS: dict[Law, tuple[float, float, float]] = {  # eta0, eta1, eta2
    "linear": (0.0, 0.25, 0.0),
    "quadratic": (0.0, 0.15, 0.5),
    "friction": (0.1, 0.15, 0.5),
}
LAWS = ("mass-proportional", "quadratic", "modal")
NOISE = 0.5e-3  # m
CLASSES = (0.0, 0.01, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 0.99, 1.001)  # of probabilities
SIGNIFICANT = 5.0  # least size of each term, standard errors


def free_decay(law: Law, time: np.ndarray, amplitude: float) -> np.ndarray:
    """Return the displacement (m) of a mode of 1.85 Hz."""
    values = [cs.DM(value) for value in (2 * math.pi * 1.85, *DECAYS[law], amplitude, 0.2)]
    return np.asarray(friction_decay(cs.DM(time), *values)).ravel()


def decay(law: Law, seed: int, *, weak: bool) -> tuple[bool, bool]:
    """Return whether the true law of a decay is selected, and whether the verdict is settled."""
    time = np.arange(0.0, 0.8 if weak else 5.0, 1 / 500)
    y = free_decay(law, time, 0.076)
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


def weighed(
    law: Law, seed: int, rho: float, *, weak: bool
) -> tuple[list[tuple[bool, ...]], list[tuple[float, ...]], bool]:
    """Return for each law fitted to a decay if it is true and best, its probabilities, and if the choice is settled."""
    rng = np.random.default_rng([LAWS_COMPARED.index(law), round(100 * rho), seed])
    frequency_law: FrequencyLaw = "constant" if weak else FREQUENCY_LAWS_COMPARED[int(rng.integers(4))]
    time, y = _draw(rng, law, frequency_law, rho, weak=weak)
    constant: Any = {"frequency_laws": ("constant",), "rests": ("constant",)} if weak else {}
    found = compare_decay_laws(time, y, release_time=0.0, **constant)
    verdict = found.verdict
    weights = [np.exp((min(one) - np.array(one)) / 2) for one in (verdict.bic, verdict.aicc)]
    columns = (verdict.probabilities, *(own / own.sum() for own in weights))
    true = [
        fit.model == replace(fit.model, law=law, frequency_law=frequency_law, rest="constant") for fit in found.fits
    ]
    chosen = [k == verdict.best for k in range(len(true))]
    return (
        list(zip(true, chosen, strict=True)),
        list(zip(*map(np.ndarray.tolist, columns), strict=True)),
        verdict.settled,
    )


def _draw(
    rng: np.random.Generator, law: Law, frequency_law: FrequencyLaw, rho: float = 0.0, *, weak: bool = False
) -> tuple[Any, Any]:
    """Return a random decay of 1 Hz with an amplitude of 1 under two laws, in AR(1) noise."""

    def between(least: float, most: float) -> float:
        return float(math.exp(rng.uniform(math.log(least), math.log(most))))

    model, omega = DecayModel(law, "constant", frequency_law), 2 * math.pi
    periods = between(10.0, 100.0) if weak else between(30.0, 150.0)
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
    drive = rng.standard_normal(len(time) + 300)
    return time, y + between(1e-3, 0.1 if weak else 0.03) * lfilter([math.sqrt(1 - rho**2)], [1.0, -rho], drive)[300:]


def _least_term(fit: DecayFit) -> float:
    """Return the size of the smallest term of a fit, in standard errors; 0 if one is at its bound."""
    names = [name for name in fit.model.terms if name not in ("eta_p", "exponent")] or ["damping_ratio"]
    sizes = [abs(getattr(fit, name)) / fit.standard_errors[name] for name in (*names, "damping_ratio")]
    if fit.law == "power":
        sizes += [abs(fit.exponent - p) / fit.standard_errors["exponent"] for p in (0.0, 1.0, 2.0)]
    return min((0.0 if math.isnan(size) else size) for size in sizes)


def strip() -> Model:
    """Return a soft, hanging silicone strip."""
    return Model(silicone(3))


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
    parser.add_argument("what", choices=("combined", "calibration", "decays", "motions", "power"))
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--weak", action="store_true")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    if options.what == "combined":
        for law, frequency_law in product(LAWS_COMPARED, FREQUENCY_LAWS_COMPARED):
            _print_combined(law, frequency_law, options.runs, options.jobs)
        return
    if options.what == "calibration":
        for rho in (0.0, 0.7):
            _print_calibration(rho, options.runs, options.jobs, weak=options.weak)
        return
    if options.what == "power":
        _print_power(options.runs)
        return
    one: Callable[..., tuple[bool, bool]] = decay if options.what == "decays" else motion
    for name in DECAYS if options.what == "decays" else LAWS:
        tasks: list[Any] = [partial(one, name, seed, weak=options.weak) for seed in range(options.runs)]
        right, settled = np.array(run_all(tasks, jobs=options.jobs)).T
        print(
            f"{name:18} right {right.mean():6.1%}, settled {settled.mean():6.1%}, "
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


def _print_calibration(rho: float, runs: int, jobs: int, *, weak: bool) -> None:
    truths = [law for law in LAWS_COMPARED for _ in range(runs)]
    tasks: list[Any] = [partial(weighed, law, seed % runs, rho, weak=weak) for seed, law in enumerate(truths)]
    found = run_all(tasks, jobs=jobs)
    true, _ = np.array([flags for flags, _, _ in found for flags in flags]).T
    probabilities = np.array([row for _, rows, _ in found for row in rows])
    rows: list[list[str | float | None]] = []
    for low, high in pairwise(CLASSES):
        row: list[str | float | None] = [f"{low:g} to {high:g}"]
        for own in probabilities.T:
            inside = (own >= low) & (own < high)
            row += [int(inside.sum()), *(round(float(part[inside].mean()), 3) if inside.any() else None
                                         for part in (own, true))]  # fmt: skip
        rows.append(row)
    heads = [f"{name} {head}" for name in ("P", "BIC", "AICc") for head in ("count", "mean", "true")]
    print(Table("calibration", f"AR(1) noise with rho = {rho:g}", ("class", *heads), rows).text())
    for law in LAWS_COMPARED:
        own = [(flags, settled) for name, (flags, _, settled) in zip(truths, found, strict=True) if name == law]
        right = np.array([any(true and chosen for true, chosen in flags) for flags, _ in own])
        settled = np.array([settled for _, settled in own])
        print(f"{law:10} right {right.mean():.1%}, settled {settled.mean():.1%}, settled on a wrong law "
              f"{(settled & ~right).mean():.1%}", flush=True)  # fmt: skip


def noisy(fit: Fit, terms: list[str], noise: np.ndarray) -> Candidate:
    """Return the candidate of a fit to the record that was fitted, plus noise of each residual."""
    scale, ends = fit.scale, (fit.lower / fit.scale, fit.upper / fit.scale)
    start = np.clip(fit.values / scale, ends[0] + 1e-9, ends[1] - 1e-9)

    def residuals(z: np.ndarray) -> np.ndarray:
        values: np.ndarray = np.asarray(fit.model(z)[0]).ravel() - noise
        return values

    def jacobian(z: np.ndarray) -> np.ndarray:
        return np.asarray(fit.model(z)[1])

    found = least_squares(residuals, start, jacobian, ends, x_scale="jac")
    own = replace(fit, values=found.x * scale, residuals=found.fun, jacobian=np.asarray(found.jac) / scale)
    return replace(Candidate.of("", own, terms), effective_samples=float(len(noise)))


def _print_power(runs: int) -> None:
    """Print the announced probability of the right choice, and the share of right ones with its binomial limits."""
    cases: list[tuple[str, list[Fit], list[list[str]], int, float]] = []
    time = np.arange(0.0, 2.0, 1 / 100)
    decay_laws: tuple[Law, Law] = ("linear", "quadratic")
    for amplitude, (truth, decay_law) in product((0.02, 0.04), enumerate(decay_laws)):
        exact = free_decay(decay_law, time, amplitude)
        own = [fit_decay(time, exact, law=law, release_time=0.0).fit for law in decay_laws]
        cases.append((f"decay of {amplitude:g} m, {decay_law}", own, [["zeta"], ["eta1", "eta2"]], truth, 4e-4))
    model = Model(silicone(2))
    start = static_equilibrium(model, tip_force=(1e-3, 0.0))
    release = PlannedRecord.motion(Sensor("displacement"), duration=0.6, sample_rate=50.0, std=4e-4, start=start)
    beam_laws = [RayleighDamping(1.2), QuadraticDamping(eta2=8.0)]
    for truth, beam_law in enumerate(beam_laws):
        record: Any = plan(model, {"release": release}, beam_law).records[0]
        fits = [fit_beam(model, record, law).fit for law in beam_laws]
        cases.append((f"release, {type(beam_law).__name__}", fits, [["alpha"], ["eta1", "eta2"]], truth, 1.0))
    for name, fits, terms, truth, std in cases:
        order = [truth, 1 - truth]
        announced = expectation(
            [fits[k] for k in order], [terms[k] for k in order], fits[1 - truth].residuals, std, 1.0
        )
        right = 0
        for seed in range(runs):
            noise = std * np.random.default_rng(seed).standard_normal(len(fits[0].residuals))
            right += judge([noisy(fit, own, noise) for fit, own in zip(fits, terms, strict=True)]).best == truth
        low, high = (binom.ppf(level, runs, announced.right) / runs for level in (0.025, 0.975))
        print(f"{name:28} announced {announced.right:6.1%}, right {right / runs:6.1%}, 95 % of counts within "
              f"{low:.1%} to {high:.1%}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
