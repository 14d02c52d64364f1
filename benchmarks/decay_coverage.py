"""Measure the coverage of the 95 % intervals of decay fits under noise of many kinds and bad sampling.

    .venv/bin/python -m benchmarks.decay_coverage --runs 400 --jobs 2

Each case has seeded records of a mode of 6.9 Hz with a damping ratio of 1 % at the release, an amplitude of 50 mm, 10 s
at 200 samples per second, and a random phase.  The noise has a standard deviation of 1 mm, or of 0.1 mm beside a second
mode; it is white unless the case says otherwise.  The table lists, for frequency and damping ratio at 50, 7 and 1 mm
(the last is about the smallest amplitude that the noise leaves visible), the percentage of intervals that cover the
truth, and for 7 mm the mean half width of the intervals over the half width that 95 % would have needed, the 95th
percentile of the errors.
"""

from __future__ import annotations

import argparse
import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import get_args

import casadi as cs
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from ancf_casadi.decay.phase import FrequencyLaw
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.parallel import run_all
from ancf_casadi.support.tables import Table
from problems import fit_decay, law_curve
from problems.decay.laws import DecayModel, Law

FREQUENCY, RATIO, AMPLITUDE, DURATION, RATE = 6.9, 0.01, 0.05, 10.0, 200.0
OMEGA = 2 * math.pi * FREQUENCY
NOISE, SMALL_NOISE = 1e-3, 1e-4
TIME = np.arange(0.0, DURATION, 1 / RATE)
AMPLITUDES = np.geomspace(AMPLITUDE, AMPLITUDE / 50, 3)

Values = NDArray[np.float64]
Disturbance = Callable[[np.random.Generator, Values], tuple[Values, Values]]


@dataclass(frozen=True)
class Case:
    """Kind of records: a name, the laws, and a function (generator, exact values) -> times and measured values."""

    name: str
    disturb: Disturbance
    law: Law = "linear"
    frequency_law: FrequencyLaw = "constant"


def white(rng: np.random.Generator, exact: Values) -> tuple[Values, Values]:
    return TIME, exact + NOISE * rng.standard_normal(len(exact))


def autoregressive(rho: float, rng: np.random.Generator, exact: Values) -> tuple[Values, Values]:
    drive = rng.standard_normal(len(exact) + 500)
    return TIME, exact + NOISE * lfilter([math.sqrt(1 - rho**2)], [1.0, -rho], drive)[500:]


def dropped(disturb: Disturbance, rng: np.random.Generator, exact: Values) -> tuple[Values, Values]:
    time, values = disturb(rng, exact)
    kept = rng.random(len(time)) >= 0.3
    return time[kept], values[kept]


def short(rho: float, rng: np.random.Generator, exact: Values) -> tuple[Values, Values]:
    """Sample 100 times in the first second, with autoregressive noise."""
    time, values = autoregressive(math.sqrt(rho), rng, exact)
    return time[:200:2], values[:200:2]


def interpolated(rng: np.random.Generator, exact: Values) -> tuple[Values, Values]:
    """Interpolate a record tenfold by cubic splines."""
    fine = np.arange(0.0, TIME[-1], 0.1 / RATE)
    return fine, CubicSpline(TIME, exact + NOISE * rng.standard_normal(len(exact)))(fine)


def second_mode(rng: np.random.Generator, exact: Values) -> tuple[Values, Values]:
    """Add a mode of 5 % at 6.27 times the frequency that the fit does not know."""
    other = 6.27 * OMEGA
    swing = 0.05 * AMPLITUDE * np.exp(-RATIO / 3 * other * TIME) * np.cos(other * TIME + rng.uniform(0, 2 * math.pi))
    return TIME, exact + swing + SMALL_NOISE * rng.standard_normal(len(exact))


def long(rng: np.random.Generator, exact: Values) -> tuple[Values, Values]:
    """Sample 63 000 times, beside a second mode and in slightly coloured noise; a fit reduces this record."""
    fine = np.linspace(0.0, TIME[-1], 63_000)
    other, phase = 6.27 * OMEGA, rng.uniform(0, 2 * math.pi)
    swing = 0.05 * AMPLITUDE * np.exp(-RATIO / 3 * other * fine) * np.cos(other * fine + phase)
    noise = lfilter([math.sqrt(1 - 0.3**2)], [1.0, -0.3], rng.standard_normal(len(fine)))
    return fine, CubicSpline(TIME, exact)(fine) + swing + NOISE * noise


def quantised(rng: np.random.Generator, exact: Values) -> tuple[Values, Values]:
    """Round to steps of half the final amplitude, from a random zero."""
    step = 0.5 * AMPLITUDE * math.exp(-RATIO * OMEGA * DURATION)
    return TIME, step * np.round(exact / step + rng.uniform())


CASES = [
    Case("white", white),
    *(Case(f"AR(1), {rho}", partial(autoregressive, rho)) for rho in (0.3, 0.5, 0.9)),
    Case("30 % dropped", partial(dropped, white)),
    Case("30 % dropped, AR(1) 0.9", partial(dropped, partial(autoregressive, 0.9))),
    Case("interpolated tenfold", interpolated),
    *(Case(f"100 samples, AR(1) {rho}", partial(short, rho)) for rho in (0.0, 0.3, 0.5, 0.9)),
    *(
        Case(f"{law}, {frequency_law} frequency{colour}", disturb, law, frequency_law)
        for law in get_args(Law)
        for frequency_law in get_args(FrequencyLaw)
        for colour, disturb in (("", white), (", AR(1) 0.5", partial(autoregressive, 0.5)))
    ),
    Case("second mode of 5 %", second_mode),
    Case("63 000 samples, second mode, AR(1) 0.3", long),
    Case("half the final amplitude", quantised),
]
# Unknowns of the damping, with an equivalent ratio of 1 % at the release.
DRAG, FRICTION = 3 * math.pi / (4 * AMPLITUDE), math.pi * OMEGA**2 * AMPLITUDE / 2
DAMPING: dict[Law, tuple[float, ...]] = {
    "linear": (RATIO,),
    "quadratic": (RATIO * OMEGA, 0.5 * RATIO * DRAG),
    "friction": (RATIO * OMEGA, 0.4 * RATIO * DRAG, 0.1 * RATIO * FRICTION),
    "power": (RATIO, 1.5),
    "smooth": (0.9 * RATIO, 0.15, 0.05, -0.05, -0.1, -0.15, -0.2),
}
BENDING: dict[FrequencyLaw, tuple[float, ...]] = {
    "constant": (),
    "linear": (-0.01 / AMPLITUDE,),
    "quadratic": (-0.01 / AMPLITUDE**2,),
    "power": (-0.01, 0.6),
    "logarithmic": (-0.004, -3.0),
    "smooth": (-0.006, -0.003, 0.002, 0.003, 0.0035, 0.004),
}


def half_widths(case: Case, seed: int) -> list[tuple[float, float, float]]:
    """Return the error of frequencies and ratios, and the distances of the ends of their intervals from the values."""
    rng = np.random.default_rng([zlib.crc32(case.name.encode()), seed])  # the cases do not deviate together
    phase = rng.uniform(0.0, 2 * math.pi)
    model = DecayModel(case.law, "zero", case.frequency_law, reference=AMPLITUDE)
    x = [*map(cs.MX, [OMEGA, *DAMPING[case.law], *BENDING[case.frequency_law], AMPLITUDE, phase])]
    exact = np.asarray(cs.evalf(model.curve(TIME, *x))).ravel()
    ratio, frequency = (cs.evalf(part).full().ravel() for part in model.against_amplitude(AMPLITUDES, *x))
    record = Measurement(*case.disturb(rng, exact))
    fit = fit_decay(record, law=case.law, frequency_law=case.frequency_law, release_time=0.0)
    curve = law_curve(fit, AMPLITUDES)
    values = np.concatenate([curve.frequency, curve.damping_ratio])
    low, high = np.concatenate([curve.frequency_band, curve.damping_ratio_band]).T
    errors = values - np.concatenate([frequency, ratio])
    return list(zip(errors.tolist(), (values - low).tolist(), (high - values).tolist(), strict=True))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--case", help="only the cases whose name contains this")
    arguments = parser.parse_args()
    cases = [case for case in CASES if arguments.case is None or arguments.case in case.name]
    seeds = range(arguments.first, arguments.first + arguments.runs)
    tasks = [partial(half_widths, case, seed) for case in cases for seed in seeds]
    results = np.array(run_all(tasks, jobs=arguments.jobs, progress=True)).reshape(len(cases), len(seeds), -1, 3)
    rows: list[list[str | float]] = []
    for case, own in zip(cases, results, strict=True):
        error, below, above = np.moveaxis(own, -1, 0)
        row: list[str | float] = [case.name]
        covered = 100 * np.mean((error <= below) & (-error <= above), axis=0)
        width = np.mean(below + above, axis=0) / 2 / np.quantile(np.abs(error), 0.95, axis=0)
        for part in (slice(0, 3), slice(3, 6)):
            row += [", ".join(f"{value:.1f}" for value in covered[part]), round(float(width[part][1]), 2)]
        rows.append(row)
    columns = ("case", "frequency at 50, 7, 1 mm: covered, %", "width", "damping ratio: covered, %", "width")
    print(Table("coverage", f"Coverage of 95 % intervals over {len(seeds)} records", columns, rows).text())


if __name__ == "__main__":
    main()
