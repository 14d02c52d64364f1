"""Count failed fits of seeded synthetic decays, and the coverage of their 95 % intervals.

    .venv/bin/python benchmarks/decay_robustness.py --runs 1000                     law="quadratic"
    .venv/bin/python benchmarks/decay_robustness.py --runs 250 --law friction       also: linear, one-mode

Record k depends on seed k only: linear, quadratic and mixed damping in turn (with ``--law friction`` also friction), 5
to 2500 periods, 5 to 50 samples per period and at most 40 000 in all, noise of 1e-5 to 0.1 of the amplitude, and a
decay to between 0.9 and exp(-12) of the amplitude.  The study lists each estimate that is off by more than 2.5 times
the half width of its interval: these are five standard errors, so that with normal noise there should be none.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from ancf_casadi.decay.friction import friction_decay
from ancf_casadi.decay.one_mode import one_mode_decay
from ancf_casadi.exceptions import AncfError
from problems import fit_decay
from problems.decay.laws import Law

WEIGHTS = {
    "linear": (0.0, 1.0, 0.0),
    "quadratic": (0.0, 0.0, 1.0),
    "mixed": (0.0, 0.5, 0.5),
    "friction": (0.3, 0.4, 0.3),
}
MOST_SAMPLES = 40_000
STRONG = 0.02  # largest damping ratio; beyond it, Eq. (27) deviates too far from Eqs. (9) and (26)
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
    if law == "one-mode":
        start = (amplitude * math.cos(phase), -amplitude * omega * math.sin(phase))
        values = map(cs.MX, (omega, eta1, eta2, *start))
        motion = cs.evalf(one_mode_decay(instants, *values, longest_step=0.1 / omega))
    else:
        motion = friction_decay(cs.DM(instants), *map(cs.DM, (omega, eta0, eta1, eta2, amplitude, phase)))
    noise = _between(rng, 1e-5, 0.1)
    y = np.asarray(motion).ravel() + offset + noise * amplitude * rng.standard_normal(samples)
    natural = frequency / math.sqrt(1 - ratio**2) if law == "linear" else frequency
    truth = {"frequency": natural, "damping_ratio": ratio, "amplitude": amplitude, "offset": offset}
    return Decay(kind, periods, noise, instants, y, truth)


def _between(rng: np.random.Generator, least: float, most: float) -> float:
    return float(math.exp(rng.uniform(math.log(least), math.log(most))))


def main() -> None:
    """Run the study and print the result."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--law", default="quadratic", choices=("linear", "quadratic", "friction", "one-mode"))
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0, help="seed of the first record")
    arguments = parser.parse_args()
    failed, held, seconds, iterations = 0, [], [], []
    for seed in range(arguments.first, arguments.first + arguments.runs):
        record = decay(seed, arguments.law)
        about = f"seed {seed}, {record.kind}, {record.periods:.0f} periods, noise {record.noise:.1e}"
        began = time.process_time()
        try:
            fit = fit_decay(record.time, record.values, law=arguments.law, release_time=0.0)
        except AncfError as error:
            failed += 1
            print(f"{about}: {error}")
            continue
        seconds.append(time.process_time() - began)
        iterations.append(fit.fit.iterations)
        off = {name: _distance(fit.intervals[name], value) for name, value in record.truth.items()}
        held.append([distance <= 1.0 for distance in off.values()])
        far = ", ".join(f"{name} by {distance:.1f}" for name, distance in off.items() if distance > FAR)
        if far:
            print(f"{about}: off in {far} half widths")
    print(f"{failed} of {arguments.runs} fits failed; processor time {np.median(seconds):.3f} s in the median, "
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
