"""Count failed fits of seeded synthetic decays, and the coverage of their 95 % intervals.

    .venv/bin/python -m benchmarks.decay_robustness --runs 1000                     law="quadratic"
    .venv/bin/python -m benchmarks.decay_robustness --runs 250 --law friction       also: linear
    .venv/bin/python -m benchmarks.decay_robustness --long --runs 1000              long decays, all laws in turn
    .venv/bin/python -m benchmarks.decay_robustness --long --runs 100 --law auto    long decays, all laws each

Record k depends on seed k only: linear, quadratic and mixed damping in turn (with ``--law friction`` also friction), 5
to 2500 periods, 5 to 50 samples per period and at most 40 000 in all, noise of 1e-5 to 0.1 of the amplitude, and a
decay to between 0.9 and exp(-12) of the amplitude.  The study lists each estimate that is off by more than 2.5 times
the half width of its interval: these are five standard errors, so that with normal noise there should be none.

Long decays have 200 to 2000 periods, damping ratios of 1e-4 to 0.05 at the release, noise of 0 to 5 % of the first
amplitude, and a frequency that is constant, linear or quadratic in the amplitude, with a change of 0.1 to 10 %.  Each
is fitted with one of the twelve combinations of laws in turn, right or wrong, and only failures count.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass
from itertools import product

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from ancf_casadi.decay.closed_forms import friction_decay, friction_envelope
from ancf_casadi.decay.phase import FrequencyLaw, integral
from ancf_casadi.exceptions import AncfError
from problems import fit_decay
from problems.decay.comparison import FREQUENCY_LAWS_COMPARED, LAWS_COMPARED, compare_decay_laws
from problems.decay.laws import Law

WEIGHTS = {
    "linear": (0.0, 1.0, 0.0),
    "quadratic": (0.0, 0.0, 1.0),
    "mixed": (0.0, 0.5, 0.5),
    "friction": (0.3, 0.4, 0.3),
}
MOST_SAMPLES = 40_000
STRONG = 0.02  # largest damping ratio; beyond it, Eq. (27) deviates too far from Eq. (26)
LONG_SAMPLES = 10_000
FAR = 2.5  # in half widths of an interval


@dataclass(frozen=True, eq=False)
class Decay:
    """Synthetic record with its true values."""

    kind: str
    periods: float
    noise: float
    time: NDArray[np.float64]
    displacement: NDArray[np.float64]
    truth: dict[str, float]


def decay(seed: int, law: Law) -> Decay:
    """Return the record of a seed, for a fit with the given law."""
    rng = np.random.default_rng(seed)
    kinds = {"linear": ("linear",), "friction": tuple(WEIGHTS)}.get(law, ("linear", "quadratic", "mixed"))
    kind = kinds[seed % len(kinds)]
    periods, frequency = _between(rng, 5.0, 2500.0), _between(rng, 0.5, 500.0)
    samples = min(round(periods * _between(rng, 5.0, 50.0)), MOST_SAMPLES)
    omega, amplitude = 2 * math.pi * frequency, _between(rng, 1e-4, 0.1)
    instants = np.linspace(0.0, periods / frequency, samples)
    ratio = min(_between(rng, 0.1, 12.0) / (2 * math.pi * periods), STRONG)
    friction, linear, quadratic = (ratio * weight for weight in WEIGHTS[kind])
    eta0, eta1 = friction * math.pi * omega**2 * amplitude / 2, 2 * linear * omega
    eta2 = quadratic * 3 * math.pi / (4 * amplitude)
    phase, offset = rng.uniform(-math.pi, math.pi), amplitude * rng.uniform(-1.0, 1.0)
    motion = friction_decay(cs.DM(instants), *map(cs.DM, (omega, eta0, eta1, eta2, amplitude, phase)))
    noise = _between(rng, 1e-5, 0.1)
    y = np.asarray(motion).ravel() + offset + noise * amplitude * rng.standard_normal(samples)
    natural = frequency / math.sqrt(1 - ratio**2) if law == "linear" else frequency
    truth = {"frequency": natural, "damping_ratio": ratio, "amplitude": amplitude, "offset": offset}
    return Decay(kind, periods, noise, instants, y, truth)


def long_decay(seed: int) -> Decay:
    """Return the long record of a seed."""
    rng = np.random.default_rng(seed)
    kind = list(WEIGHTS)[seed % 4]
    periods, rate = _between(rng, 200.0, 2000.0), _between(rng, 4.0, 40.0)
    samples = min(round(periods * rate), LONG_SAMPLES)
    frequency, amplitude = _between(rng, 0.5, 500.0), _between(rng, 1e-4, 0.1)
    omega, instants = 2 * math.pi * frequency, np.linspace(0.0, periods / frequency, samples)
    ratio, change = _between(rng, 1e-4, 0.05), _between(rng, 1e-3, 0.1) * rng.choice([-1.0, 1.0])
    friction, linear, quadratic = (ratio * weight for weight in WEIGHTS[kind])
    eta0, eta1 = friction * math.pi * omega**2 * amplitude / 2, 2 * linear * omega
    eta2 = quadratic * 3 * math.pi / (4 * amplitude)
    given = [cs.MX(value) for value in (omega, eta0, eta1, eta2, amplitude)]
    power = seed // 4 % 3

    def relative(time: cs.MX) -> cs.MX:
        return friction_envelope(time, *given) / amplitude

    turned = integral(lambda time: relative(time) ** power, instants) if power else 0
    phase = omega * (cs.DM(instants) + change * turned) + rng.uniform(-math.pi, math.pi)
    motion = amplitude * np.asarray(cs.evalf(relative(cs.MX(cs.DM(instants))) * cs.cos(phase))).ravel()
    noise = 0.0 if seed % 10 == 9 else _between(rng, 1e-5, 0.05)
    y = motion + amplitude * (rng.uniform(-1.0, 1.0) + noise * rng.standard_normal(samples))
    about = f"{kind}, {FREQUENCY_LAWS_COMPARED[power]} frequency {change:+.1%}, ratio {ratio:.1e}"
    return Decay(about, periods, noise, instants, y, {})


def _between(rng: np.random.Generator, least: float, most: float) -> float:
    return float(math.exp(rng.uniform(math.log(least), math.log(most))))


def main() -> None:
    """Run the study and print the result."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--law", default="quadratic", choices=("linear", "quadratic", "friction", "auto"))
    parser.add_argument("--long", action="store_true")
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0, help="seed of the first record")
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.runs)
    if arguments.long:
        run_long(seeds, all_laws=arguments.law == "auto")
    else:
        run(seeds, arguments.law)


def run_long(seeds: range, *, all_laws: bool) -> None:
    """Fit long decays, each with one combination of laws or with all of them, and print the failures."""
    failed, seconds = 0, []
    combinations: list[tuple[Law, FrequencyLaw]] = list(product(LAWS_COMPARED, FREQUENCY_LAWS_COMPARED))
    for seed in seeds:
        record, (law, frequency_law) = long_decay(seed), combinations[seed // 3 * 5 % len(combinations)]
        began = time.process_time()
        try:
            if all_laws:
                reasons = compare_decay_laws(record.time, record.displacement, release_time=0.0).failed
            else:
                fit_decay(record.time, record.displacement, law=law, frequency_law=frequency_law, release_time=0.0)
                reasons = {}
        except AncfError as error:
            reasons = {f"{law}, {frequency_law} frequency": str(error)}
        seconds.append(time.process_time() - began)
        failed += len(reasons)
        for name, reason in reasons.items():
            print(f"seed {seed}: {record.kind}, {record.periods:.0f} periods, {len(record.time)} samples, noise "
                  f"{record.noise:.1e}; {name}: {reason}", flush=True)  # fmt: skip
    print(f"{failed} of {len(seeds) * (12 if all_laws else 1)} fits failed; processor time {np.median(seconds):.3f} s "
          f"in the median, {np.quantile(seconds, 0.99):.2f} s at 99 %, {max(seconds):.2f} s at most")  # fmt: skip


def run(seeds: range, law: Law) -> None:
    """Fit decays with one law, and print failures and coverage."""
    failed, held, seconds, iterations = 0, [], [], []
    for seed in seeds:
        record = decay(seed, law)
        about = f"seed {seed}, {record.kind}, {record.periods:.0f} periods, noise {record.noise:.1e}"
        began = time.process_time()
        try:
            fit = fit_decay(record.time, record.displacement, law=law, release_time=0.0)
        except AncfError as error:
            failed += 1
            print(f"{about}: {error}")
            continue
        seconds.append(time.process_time() - began)
        iterations.append(fit.fit.iterations)
        off = {name: _distance(fit.intervals()[name], value) for name, value in record.truth.items()}
        held.append([distance <= 1.0 for distance in off.values()])
        far = ", ".join(f"{name} by {distance:.1f}" for name, distance in off.items() if distance > FAR)
        if far:
            print(f"{about}: off in {far} half widths")
    print(f"{failed} of {len(seeds)} fits failed; processor time {np.median(seconds):.3f} s in the median, "
          f"{np.quantile(seconds, 0.99):.2f} s at 99 %, {max(seconds):.2f} s at most; iterations "
          f"{np.median(iterations):.0f}, at most {max(iterations)}")  # fmt: skip
    coverage = zip(record.truth, np.mean(held, axis=0), strict=True)
    print("coverage of the intervals:", ", ".join(f"{name} {fraction:.1%}" for name, fraction in coverage))


def _distance(interval: tuple[float, float], value: float) -> float:
    """Return the distance of a value from the middle of an interval, in half widths."""
    low, high = interval
    return abs(value - (low + high) / 2) / ((high - low) / 2)


if __name__ == "__main__":
    main()
