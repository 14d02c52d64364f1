"""Coverage of the 95 % intervals of what is attached to a beam, over many seeds of noise.

    python benchmarks/set_up_coverage.py [--seeds 200] [--case mass curvature suspension ends]

Cases: mass and stiffness of a spring at mid-span from frequencies of two configurations; natural curvature and elastic
modulus from two sags; modulus and suspension of a free strip from six frequencies; stiffness of an end and prestress of
a strip between two clamps from six frequencies, whose noise the fit estimates.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.stats import binomtest

from ancf_casadi import Beam, Clamp, Model, PointLoad, PointMass, Sensor, Spring, natural_modes, static_equilibrium
from problems import FrequencyRecord, StaticRecord, fit_beam

STRIP: dict[str, Any] = {"length": 0.5, "width": 20e-3, "thickness": 1e-3, "density": 2700.0, "elements": 10}
Random = np.random.Generator


def strip(modulus: float = 70e9, **options: Any) -> Beam:
    """Return a strip of aluminium, by default lying without gravity."""
    given = {"axis": (1.0, 0.0), "gravity": (0.0, 0.0)} | options
    return Beam.uniform(**STRIP, elastic_modulus=modulus, **given)


def noisy(beam: Beam, first: Beam, count: int, relative: float, random: Random) -> FrequencyRecord:
    """Return noisy frequencies of a beam as a record of another one."""
    true = natural_modes(Model(beam), count=count).frequencies
    true = true[true > 0.0]
    measured = true * (1 + relative * random.standard_normal(true.size))
    return FrequencyRecord(Model(first), measured, std=relative * measured)


def mass(random: Random) -> tuple[dict[str, float], Any]:
    """Fit mass and spring at mid-span from four frequencies each of the strip and of the strip turned round a clamp."""
    truth = {"mass": 12e-3, "spring_y": 900.0}

    def beams(m: float, k: float) -> tuple[Beam, Beam]:
        parts = [PointMass(0.25, m), Spring(0.25, (0.0, k))]
        return strip(attachments=parts), strip(attachments=parts, tip_mass=8e-3)

    true, first = beams(*truth.values()), beams(9e-3, 1200.0)
    records = [noisy(own, start, 4, 2e-3, random) for own, start in zip(true, first, strict=True)]
    return truth, fit_beam(Model(first[0]), records, unknowns=[*truth])


def curvature(random: Random) -> tuple[dict[str, float], Any]:
    """Fit natural curvature and modulus from the rest position of the tip under two weights."""
    truth = {"natural_curvature": 0.4, "elastic_modulus": 70e9}
    beam = strip(gravity=(0.0, -9.81), natural_curvature=0.4)
    first = strip(80e9, gravity=(0.0, -9.81), natural_curvature=0.3)
    cases = [[], [PointLoad.hung(20e-3)], [PointLoad.hung(40e-3)], [PointLoad.hung(60e-3)]]
    sags = [static_equilibrium(Model(beam), loads=loads).tip[1] for loads in cases]
    values = np.array(sags) + 0.2e-3 * random.standard_normal(4)
    loads = [case or [PointLoad()] for case in cases]
    record = StaticRecord(Model(first), loads, values, Sensor("position", direction=(0.0, 1.0)), std=0.2e-3)
    return truth, fit_beam(Model(first), record, unknowns=[*truth])


def suspension(random: Random) -> tuple[dict[str, float], Any]:
    """Fit modulus and suspension of a free strip from six frequencies."""
    truth = {"elastic_modulus": 70e9, "spring_stiffness": 20.0}

    def free(modulus: float, k: float) -> Beam:
        return strip(modulus, supports=[], attachments=[Spring(s, (k, k)) for s in (0.112, 0.388)])

    first = free(60e9, 40.0)
    return truth, fit_beam(Model(first), noisy(free(*truth.values()), first, 6, 2e-3, random), unknowns=[*truth])


def ends(random: Random) -> tuple[dict[str, float], Any]:
    """Fit the stiffness of one end and the prestress from six frequencies of a strip between two clamps."""
    truth = {"clamp_stiffness": 2.0, "prestress": 2e6}

    def clamped(k: float, prestress: float) -> Beam:
        return strip(supports=[Clamp(0.0), Clamp(0.5, k)], prestress=prestress)

    first = clamped(4.0, 1e6)
    record = replace(noisy(clamped(*truth.values()), first, 6, 5e-4, random), std=None)
    return truth, fit_beam(Model(first), record, unknowns=[*truth])


CASES: dict[str, Callable[[Random], tuple[dict[str, float], Any]]] = {
    "mass": mass,
    "curvature": curvature,
    "suspension": suspension,
    "ends": ends,
}


def main() -> None:
    """Print how many intervals contain the true values."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--case", nargs="+", choices=[*CASES], default=[*CASES])
    options = parser.parse_args()
    for name in options.case:
        inside: dict[str, list[bool]] = {}
        for seed in range(options.seeds):
            truth, fit = CASES[name](np.random.default_rng(seed))
            for unknown, (lower, upper) in fit.intervals().items():
                inside.setdefault(unknown, []).append(lower <= truth[unknown] <= upper)
        for unknown, hits in inside.items():
            limits = binomtest(sum(hits), len(hits)).proportion_ci()
            share = f"{100 * sum(hits) / len(hits):.1f} %"
            print(f"{name:<12}{unknown:<20}{sum(hits)}/{len(hits)} = {share} "
                  f"({100 * limits.low:.1f} to {100 * limits.high:.1f})", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
