"""Measure how often ``fit_modes`` tells modes apart: seeded records with a known number of modes.

    .venv/bin/python -m benchmarks.modes_apart --runs 200 --jobs 2

Each record is of one kind: a mode whose frequency and damping depend on the amplitude, by laws drawn at random; two
close modes that beat; or such a moving mode with harmonics, whose phases are multiples of that of the mode and whose
amplitudes go as its powers.  The mode has 1 Hz and an amplitude of 1.  Lengths of 30 to 200 periods, 8 to 60 samples
per period, noise of 0.01 to 2 % of the amplitude, its colour (white, or AR(1) with 0.5 or 0.9), and phases are drawn
too.  A record is told apart if the number of modes and, within 2 %, their frequencies are right.
"""

from __future__ import annotations

import argparse
import math
from functools import partial
from itertools import islice
from typing import Any, Literal, get_args

import casadi as cs
import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from ancf_casadi.decay.phase import FrequencyLaw
from ancf_casadi.exceptions import AncfError
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.parallel import run_all
from problems import fit_modes
from problems.decay.laws import DecayModel, Law

Kind = Literal["moving", "close", "harmonic"]
Numbers = NDArray[np.float64]
KINDS: tuple[Kind, ...] = get_args(Kind)
TERMS = {"linear": 1, "quadratic": 2, "friction": 3}  # of the damping
UNITS = (2 * 2 * math.pi, 3 * math.pi / 4, math.pi * (2 * math.pi) ** 2 / 2)  # of eta1, eta2, eta0 with a ratio of 1


def record(kind: Kind, seed: int) -> tuple[Measurement, list[float]]:
    """Return a record, and the frequencies of its modes, Hz."""
    rng = np.random.default_rng([KINDS.index(kind), seed])
    periods = _between(rng, 30.0, 200.0)
    time = np.arange(0.0, periods, 1 / _between(rng, 8.0, 60.0))
    if kind == "close":
        exact, frequencies = _beat(rng, time)
    else:
        exact, frequencies = _moving(rng, time, kind == "harmonic"), [1.0]
    ρ = rng.choice([0.0, 0.5, 0.9])
    noise = lfilter([math.sqrt(1 - ρ**2)], [1.0, -ρ], rng.standard_normal(len(time) + 100))[100:]
    return Measurement(time, exact + _between(rng, 1e-4, 0.02) * noise), frequencies


def _moving(rng: np.random.Generator, time: Numbers, harmonics: bool) -> Numbers:
    """Return a mode of 1 Hz with random laws, and its harmonics."""
    law: Law = rng.choice(list(TERMS))
    frequency_law: FrequencyLaw = rng.choice(["constant", "linear", "quadratic", "power", "logarithmic"])
    model = DecayModel(law, "zero", frequency_law)
    ratio = _between(rng, 0.7, 4.0) / (2 * math.pi * time[-1])
    shares = rng.dirichlet(np.ones(TERMS[law])) * ratio
    damping = [ratio] if law == "linear" else [share * unit for share, unit in zip(shares, UNITS, strict=False)]
    ends = {"power": (0.3, 3.0), "logarithmic": (-9.0, -1.0)}.get(frequency_law, (0.0, 1.0))
    size = _between(rng, 5e-4, 6e-3) if frequency_law == "logarithmic" else _between(rng, 1e-3, 0.02)
    change = [rng.choice([-1.0, 1.0]) * size, rng.uniform(*ends)][: len(model.frequency_terms)]
    phase = rng.uniform(-math.pi, math.pi)

    def curve(φ: float) -> Numbers:
        symbols = map(cs.MX, (2 * math.pi, *damping, *change, 1.0, φ))
        return np.asarray(cs.evalf(model.curve(time, *symbols))).ravel()

    real = curve(phase)
    if not harmonics:
        return real
    turning = real + 1j * curve(phase - math.pi / 2)  # A exp(i phi)
    count = rng.choice([1, 2])
    for n in rng.permutation([2, 3])[:count]:
        real = real + np.real(_between(rng, 3e-3, 0.1) * np.exp(1j * rng.uniform(-math.pi, math.pi)) * turning**n)
    return real


def _beat(rng: np.random.Generator, time: Numbers) -> tuple[Numbers, list[float]]:
    """Return two modes that beat at least once while both last, and their frequencies."""
    ratios = rng.uniform(0.7, 3.0, 2) / (2 * math.pi * time[-1])
    lasts = min(time[-1], 1 / (2 * math.pi * ratios.max()))
    frequencies = [1.0, 1.0 + _between(rng, 1.0, 6.0) / lasts]
    sizes, phases = (1.0, _between(rng, 0.1, 1.0)), rng.uniform(-math.pi, math.pi, 2)
    parts = [
        size * np.exp(-2 * math.pi * ζ * f * time) * np.cos(2 * math.pi * f * time + φ)
        for f, ζ, size, φ in zip(frequencies, ratios, sizes, phases, strict=True)
    ]
    return sum(parts, np.zeros(len(time))), frequencies


def _between(rng: np.random.Generator, least: float, most: float) -> float:
    return float(math.exp(rng.uniform(math.log(least), math.log(most))))


def told_apart(kind: Kind, seed: int) -> tuple[bool, str]:
    """Return whether the modes of a record are told apart, and those found."""
    measured, truth = record(kind, seed)
    try:
        found = [fit.frequency for fit in fit_modes(measured)]
    except AncfError as error:
        return False, str(error)
    right = len(found) == len(truth) and np.allclose(found, truth, rtol=0.02)
    return right, ", ".join(f"{f:.4g}" for f in found)


def main() -> None:
    """Run the study and print a line for each kind of record."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=200, help="records of each kind")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    for kind in KINDS:
        tasks: list[Any] = [
            partial(told_apart, kind, seed) for seed in range(options.first, options.first + options.runs)
        ]
        found = run_all(tasks, jobs=options.jobs)
        wrong = [f"{seed}: {text}" for seed, (right, text) in enumerate(found, options.first) if not right]
        print(f"{kind:10} told apart {1 - len(wrong) / options.runs:6.1%}", flush=True)
        for line in islice(wrong, 20):
            print(f"    {line}")


if __name__ == "__main__":
    main()
