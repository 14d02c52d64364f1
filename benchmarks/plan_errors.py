"""Standard errors that ``plan`` expects, and those of simulated and fitted records.

    .venv/bin/python -m benchmarks.plan_errors --case mixture --seeds 200 --jobs 2

    decay        release of a strip; a laser with an unknown zero
    motions      the strip on a moving base, three times, with an accelerometer whose clock is unknown and a marker
    response     three response curves about a resonance with a common unknown factor on the levels
    statics      sag of a steel strip under weights, with a soft clamp
    mixture      a release, two static tests, natural frequencies with a tip mass

Each seed adds noise to the values that the plan computed, which are fitted again.  A line has the expected standard
error of an unknown, and the scatter of its estimates over the expected one with its 95 % interval (chi-squared).  Where
the noise adds to the residuals, there is also the scatter over that of linear estimates from the same noise, which
have the expected standard error: this ratio needs fewer seeds.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
from scipy.stats import chi2

from ancf_casadi import (
    DampingLaw,
    HarmonicBase,
    Model,
    PointLoad,
    QuadraticDamping,
    Sensor,
    natural_modes,
    run_all,
    static_equilibrium,
)
from benchmarks.beams import silicone, steel
from problems import BeamFit, Plan, PlannedRecord, ResponseRecord, fit_beam, plan

TOLERANCE = 1e-5  # of the motions in fits, whose error is far below the noise
DOWN = Sensor("displacement", direction=(0.0, -1.0))


@dataclass(frozen=True)
class Rehearsal:
    """A plan, the list of its records that is measured, and the settings of plan and fit."""

    plan: Plan
    law: DampingLaw | None
    counts: Mapping[str, int]
    settings: Mapping[str, Any] = field(default_factory=dict)


@lru_cache
def case(name: str) -> Rehearsal:
    """Return a case by name; the guesses of the plan are the truth."""
    beam = silicone(3 if name == "response" else 2)
    model, laser = Model(beam), Sensor("displacement")
    tone = float(natural_modes(model, count=1).frequencies[0])
    law, base = QuadraticDamping(0.6, 4.0), HarmonicBase(0.02, tone, stop=0.4)
    around = tone * np.array([0.9, 0.95, 0.98, 1.0, 1.02, 1.05, 1.1])
    start = static_equilibrium(model, tip_force=(5e-3, 0.0))
    release = PlannedRecord.motion(laser, duration=0.6, sample_rate=50.0, std=5e-4, start=start)
    pulls = [PointLoad(force=(force, 0.0), point=0.15) for force in (2e-3, 4e-3, 8e-3)]
    pull = PlannedRecord.static(model, pulls, laser, std=5e-4)
    curve = partial(PlannedRecord.response, around)
    if name == "decay":
        return rehearsed(model, {"release": release}, law, {"release": 1}, unknowns=["elastic_modulus"])
    if name == "motions":
        sensors = [Sensor("acceleration", 0.1, frame="body", direction=(0.0, 1.0)), Sensor("position")]
        driven = PlannedRecord.motion(
            sensors, duration=0.6, sample_rate=50.0, std=[0.01, 1e-4], base=base, offset=(-4e-3, 4e-3)
        )
        return rehearsed(model, {"driven": driven}, law, {"driven": 2},
                         unknowns=["elastic_modulus", "base_amplitude"])  # fmt: skip
    if name == "response":
        levels = {f"{1e3 * a:g} mm": curve(base=HarmonicBase(a, 1.0)) for a in (1e-3, 3e-3)}
        return rehearsed(
            model, levels, law, {"1 mm": 2, "3 mm": 1}, modes=2, harmonics=3,
            unknowns=["natural_frequencies", "excitation"],
        )  # fmt: skip
    if name == "statics":
        soft = Model(steel(2, axis=(1.0, 0.0), clamp_stiffness=0.4))
        weights = [PointLoad.hung(mass, point=0.4) for mass in (1e-3, 2e-3, 4e-3)]  # kg
        sensors = [Sensor("displacement", direction=(0.0, -1.0)), Sensor("slope", 0.05)]
        sags = PlannedRecord.static(soft, weights, sensors, std=[1e-4, 5e-4])
        return rehearsed(soft, {"sag": sags}, None, {"sag": 3}, unknowns=["elastic_modulus", "clamp_stiffness"])
    loaded = Model(beam.with_(tip_mass=0.5e-3))
    tones = PlannedRecord.natural_frequencies(loaded, [1, 2, 3], std=[3e-3, 2e-2, 5e-2])
    candidates = {"release": release, "pull": pull, "tones": tones}
    counts = {"release": 1, "pull": 2, "tones": 1}
    return rehearsed(model, candidates, law, counts, unknowns=["elastic_modulus", "tip_mass"], modes=2,
                     harmonics=3)  # fmt: skip


def rehearsed(
    model: Model, candidates: Mapping[str, PlannedRecord], law: DampingLaw | None, counts: Mapping[str, int],
    **settings: Any,
) -> Rehearsal:  # fmt: skip
    """Return a case with its plan."""
    return Rehearsal(plan(model, candidates, law, **settings), law, counts, settings | {"tolerance": TOLERANCE})


@lru_cache
def fitted(name: str) -> BeamFit:
    """Return the fit of a case to its records without noise."""
    return fit_beam(case(name).plan.model, records(name), case(name).law, **case(name).settings)


def records(name: str) -> list[Any]:
    """Return the records of a case without noise."""
    one = case(name)
    pairs = zip(one.plan.names, one.plan.records, strict=True)
    return [record for own, record in pairs for _ in range(one.counts[own])]


def noisy(record: ResponseRecord, rng: np.random.Generator) -> ResponseRecord:
    """Return a response curve with noise of its standard deviations in amplitudes, phases and levels."""
    amplitude, phase, level = rng.standard_normal((3, record.f.size)) * record.stds
    return replace(record, values=record.amplitudes + amplitude, phases=record.measured_phases + phase,
                   levels=record.a + level, amplitude_std=record.stds[0], phase_std=record.stds[1],
                   level_std=record.stds[2])  # fmt: skip


def study(name: str, seed: int) -> np.ndarray:
    """Return the estimate of each unknown of the plan from records with noise, and a linear estimate, (n, 2)."""
    one, rng = case(name), np.random.default_rng(seed)
    if name == "response":
        fit = fit_beam(one.plan.model, [noisy(own, rng) for own in records(name)], one.law, **one.settings)
        return np.array([(fit.estimates[own], np.nan) for own in one.plan.guess])
    fit = fitted(name)  # noise that adds to the values adds to the residuals
    noise = fit.solution.problem.scale * rng.standard_normal(len(fit.fit.residuals))
    found = fit.resampled(noise)
    # a step of the coordinates of the solver, in units of their scales, and then of the unknowns
    step = np.linalg.lstsq(fit.fit.jacobian * fit.fit.scale, noise)[0] * fit.fit.scale
    linear = step * fit.fit.coordinates.slopes(fit.fit.values)
    places = [list(fit.estimates).index(own) for own in one.plan.guess]
    return np.array([found, linear]).T[places]


def summary(name: str, found: np.ndarray) -> Sequence[str]:
    """Return a line for each unknown."""
    lines, freedom = [], len(found) - 1
    ends = np.sqrt(freedom / chi2.ppf([0.975, 0.025], freedom))
    for k, (unknown, error) in enumerate(case(name).plan.errors_of(case(name).counts).items()):
        scatter, linear = found[:, k].std(axis=0, ddof=1)
        limits = " to ".join(f"{end * scatter / error:.3f}" for end in ends)
        lines.append(
            f"{name}, {unknown}: expected {error:.4g}, scatter over it {scatter / error:.3f} ({limits}), over that of "
            f"linear estimates {scatter / linear:.3f}"
        )
    return lines


CASES = ("decay", "motions", "response", "statics", "mixture")


def main() -> None:
    """Run the cases, and print a line for each unknown."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--case", choices=CASES, action="append", help="all if not given")
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    for name in options.case or CASES:
        found = run_all([partial(study, name, seed) for seed in range(options.seeds)], jobs=options.jobs)
        print("\n".join(summary(name, np.array(found))), flush=True)


if __name__ == "__main__":
    main()
