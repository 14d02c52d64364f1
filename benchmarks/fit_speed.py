"""Fits of large motion beside the lines of SciPy that a user would write instead.

    python -m benchmarks.fit_speed

Each motion of the steel strip is simulated, with noise of 0.2 mm at the tip.  ``fit_beam``, and
``scipy.optimize.least_squares`` with numerical derivatives of ``simulate(..., tolerance=1e-5)``, start from the same
guesses.  Printed are the processor times and their ratio, and the differences of the estimates in standard errors.
"""

from __future__ import annotations

import argparse
import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.optimize

from ancf_casadi import Clamp, HarmonicBase, Model, QuadraticDamping, simulate, static_equilibrium
from benchmarks.beams import BENDING_STIFFNESS, steel
from benchmarks.clock import processor_time
from problems import MarkerRecord, fit_beam

NOISE = 2e-4  # m
TRUE_DRAG = {"eta1": 0.148, "eta2": 0.1145}


@dataclass(frozen=True)
class Case:
    """Motions with their true values and guesses."""

    name: str
    beam: Callable[[Mapping[str, float]], Model]  # values of the unknown properties -> the model
    motions: Sequence[Callable[[Model], dict[str, Any]]]  # model -> settings of ``simulate``
    seconds: float
    truth: Mapping[str, float]
    guess: Mapping[str, float]

    def run(self, values: Mapping[str, float], tolerance: float) -> list[Any]:
        """Return the motions for values of the unknowns."""
        model, law = self.beam(values), QuadraticDamping(eta1=values["eta1"], eta2=values["eta2"])
        settings: Any = {"damping": law, "duration": self.seconds, "sample_rate": 200.0, "tolerance": tolerance}
        return [simulate(model, **settings, **motion(model)) for motion in self.motions]


def hanging(values: Mapping[str, float]) -> Model:
    """Return the strip with rigid or elastic clamp."""
    changes: dict[str, Any] = {}
    if "elastic_modulus" in values:
        changes["elastic_modulus"] = values["elastic_modulus"]
    if "clamp_stiffness" in values:
        changes["supports"] = (Clamp(0.0, stiffness=values["clamp_stiffness"]),)
    return Model(steel(axis=(0.0, -1.0), gravity=(0.0, -9.81), **changes))


def released(force: float) -> Callable[[Model], dict[str, Any]]:
    """Return the settings of a release from a force at the tip, N."""
    return lambda model: {"start": static_equilibrium(model, tip_force=(force, 0.0))}


def swung(model: Model) -> dict[str, Any]:
    """Return the settings of a motion of the base."""
    return {"base": HarmonicBase(amplitude=5e-3, frequency=1.85)}


def cases(scale: float) -> Iterator[Case]:
    """Yield the cases, with motions as long as ``scale`` says."""
    guess = {"eta1": 0.3, "eta2": 0.3}
    yield Case("release, 10 s, 2 unknowns", hanging, [released(0.02)], 10.0 * scale, TRUE_DRAG, guess)
    stiffness = 20 * BENDING_STIFFNESS / 0.5
    truth = TRUE_DRAG | {"elastic_modulus": 210e9, "clamp_stiffness": stiffness}
    first = guess | {"elastic_modulus": 205e9, "clamp_stiffness": 1.3 * stiffness}
    yield Case("base motion, 3 s, 4 unknowns", hanging, [swung], 3.0 * scale, truth, first)
    yield Case(
        "two releases, 5 s, 2 unknowns", hanging, [released(0.02), released(0.01)], 5.0 * scale, TRUE_DRAG, guess
    )


def by_scipy(case: Case, tips: Sequence[np.ndarray]) -> dict[str, float]:
    """Return the estimates by SciPy, with derivatives by differences."""
    names = [*case.guess]

    def residuals(x: np.ndarray) -> np.ndarray:
        runs = case.run(dict(zip(names, x * [case.guess[name] for name in names], strict=True)), 1e-5)
        return np.concatenate([(run.tip - tip).ravel() for run, tip in zip(runs, tips, strict=True)]) / NOISE

    options: Any = {"bounds": (0.0, math.inf), "diff_step": 1e-3}
    found = scipy.optimize.least_squares(residuals, np.ones(len(names)), **options)
    return {name: value * case.guess[name] for name, value in zip(names, found.x, strict=True)}


def main() -> None:
    """Print both times and the difference of the estimates for each case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scale", type=float, default=1.0, help="length of the motions relative to the full one")
    parser.add_argument("--case", default="", help="beginning of the names of the cases")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    random = np.random.default_rng(arguments.seed)
    warnings.simplefilter("ignore")
    for case in cases(arguments.scale):
        if not case.name.startswith(arguments.case):
            continue
        truth, model = case.run(case.truth, 1e-7), case.beam(case.guess)
        tips = [run.tip + NOISE * random.normal(size=run.tip.shape) for run in truth]
        records = [
            MarkerRecord(run.time, tip, **motion(model))
            for run, tip, motion in zip(truth, tips, case.motions, strict=True)
        ]
        began = processor_time()
        law = QuadraticDamping(eta1=case.guess["eta1"], eta2=case.guess["eta2"])
        fit = fit_beam(model, records, law, unknowns=[name for name in case.guess if not name.startswith("eta")])
        ours = processor_time() - began
        began = processor_time()
        other = by_scipy(case, tips)
        theirs = processor_time() - began
        print(f"{case.name}: fit_beam {ours:.1f} s, SciPy {theirs:.1f} s, ratio {ours / theirs:.3f}", flush=True)
        for name, value in fit.estimates.items():
            error = fit.standard_errors[name]
            apart = (value - other[name]) / error
            print(f"  {name}: {value:.6g} +- {error:.2g}, SciPy {other[name]:.6g}, {apart:+.3f} standard errors apart")


if __name__ == "__main__":
    main()
