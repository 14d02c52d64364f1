"""Measure how often the true damping law is selected: seeded records of each law, each fitted with all laws.

    .venv/bin/python benchmarks/law_selection.py decays --runs 200       closed-form decays, compare_decay_laws
    .venv/bin/python benchmarks/law_selection.py motions --runs 20       large motion of a beam, compare_laws
    .venv/bin/python benchmarks/law_selection.py motions --runs 20 --weak    the same, too short and noisy to decide

A run is right if the true law has the lowest BIC, and settled if the verdict says so.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from functools import partial
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
from ancf_casadi.decay.friction import friction_decay
from problems import MarkerRecord, compare_decay_laws, compare_laws

DECAYS = {"linear": (0.0, 0.25, 0.0), "quadratic": (0.0, 0.15, 0.5), "friction": (0.1, 0.15, 0.5)}  # eta0, eta1, eta2
LAWS = ("mass-proportional", "quadratic", "modal")
NOISE = 0.5e-3  # m


def decay(law: str, seed: int, *, weak: bool) -> tuple[bool, bool]:
    """Return whether the true law of a decay is selected, and whether the verdict is settled."""
    time = np.arange(0.0, 0.8 if weak else 5.0, 1 / 500)
    eta0, eta1, eta2 = DECAYS[law]
    y = np.asarray(friction_decay(cs.DM(time), 2 * math.pi * 1.85, eta0, eta1, eta2, 0.076, 0.2)).ravel()
    y += (4e-3 if weak else 2e-4) * np.random.default_rng(seed).standard_normal(len(time))
    comparison = compare_decay_laws(time, y)
    return comparison.best.law == law, comparison.verdict.settled


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
    parser.add_argument("what", choices=("decays", "motions"))
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--weak", action="store_true")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    one: Callable[..., tuple[bool, bool]] = decay if options.what == "decays" else motion
    for law in DECAYS if options.what == "decays" else LAWS:
        tasks: list[Any] = [partial(one, law, seed, weak=options.weak) for seed in range(options.runs)]
        right, settled = np.array(run_all(tasks, jobs=options.jobs)).T
        print(
            f"{law:18} right {right.mean():6.1%}, settled {settled.mean():6.1%}, "
            f"settled on a wrong law {(settled & ~right).mean():6.1%}",
            flush=True,
        )


if __name__ == "__main__":
    main()
