"""Measure the error of the reduced model relative to the full beam, and print the tables of ``reduction.md``."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import casadi as cs
import numpy as np
from accuracy import BEAM, DAMPED, LENGTH, WEIGHTLESS, bent, row, rule
from scipy.optimize import root

from ancf_casadi import (
    Beam,
    Clamp,
    HarmonicBase,
    Model,
    Pin,
    ReducedModel,
    backbone,
    natural_modes,
    reduce_model,
    simulate,
    simulate_reduced,
)
from ancf_casadi.support.arrays import Array

KEPT = (1, 3, 5, 8)
EXACT = {0.1: 1.000194484, 0.2: 1.000785941}  # spectral Galerkin with harmonic balance, no ANCF
RATIO = r"$\omega/\omega_{\mathrm{linear}}$"
HARDENED = {  # boundary_references.md, backbone_pp and backbone_cc
    "pinned": {1: 1.089158179, 3: 1.625676615},
    "clamped": {1: 1.02217196, 1.5: 1.049077959},
}
PERIODS = 5
AMPLITUDES = {
    0: (0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4),
    1: (0.005, 0.01, 0.02, 0.05, 0.1),
    4: (0.001, 0.002, 0.005, 0.01, 0.02),
}
QUARTER = 100  # steps per quarter period


def frequency(reduced: ReducedModel, amplitude: float) -> float:
    """Return omega/omega_linear of the periodic motion of mode 1 at a tip amplitude (m), without gravity.

    If the beam is released at rest in the right shape, all modal coordinates are zero after a quarter period.  The
    unknowns are the shape and the period.
    """
    m, base, p = reduced.count, np.zeros(9), reduced.values
    x, h = cs.MX.sym("x", 2 * m), cs.MX.sym("h")
    step = cs.Function("step", [x, h], [cs.vertcat(*reduced.step(x[:m], x[m:], np.zeros((9, 3)), p, h))])
    quarter = step.mapaccum("quarter", QUARTER)
    scale = amplitude / reduced.modes.tip_amplitudes()
    period = 1 / reduced.modes.frequencies[0]
    across = np.array([-reduced.model.beam.axis[1], reduced.model.beam.axis[0]])

    def residual(z: Array) -> Array:
        q = z[:m] * scale
        length = np.full((1, QUARTER), z[m] * period / 4 / QUARTER)
        last = quarter(np.concatenate([q, np.zeros(m)]), length).full()[:m, -1]
        return np.append(last / scale, float(across @ reduced.tip(q, base).full().ravel()) / amplitude - 1)

    found = root(residual, np.eye(m + 1)[0] + np.eye(m + 1)[m], options={"xtol": 1e-12})
    assert np.abs(found.fun).max() < 1e-9
    return float(1 / found.x[m])


def weightless() -> Model:
    """Return the beam of the tables."""
    return Model(Beam.uniform(**BEAM, **WEIGHTLESS, elements=20))


def plural(modes: int) -> str:
    """Return the heading of a column."""
    return f"{modes} mode" + "s" * (modes > 1)


def mode_1() -> Iterator[str]:
    """Frequency of mode 1 as a function of its amplitude, minus the exact value, without gravity."""
    yield row("tip amplitude / $L$", f"exact {RATIO}", *(plural(m) for m in KEPT))
    yield rule(2 + len(KEPT))
    models = [reduce_model(weightless(), modes=m) for m in KEPT]
    for amplitude, exact in EXACT.items():
        errors = [frequency(reduced, amplitude * LENGTH) - exact for reduced in models]
        yield row(amplitude, exact, *(f"{error:.1e}" for error in errors))


def release() -> Iterator[str]:
    """Error of the tip after a release, over five periods, relative to the amplitude."""
    yield row("mode", "tip amplitude / $L$", *(plural(m) for m in KEPT), "12 modes, 41 slope points")
    yield rule(3 + len(KEPT))
    model = weightless()
    modes = natural_modes(model)
    models = {m: reduce_model(model, modes=m, damping=DAMPED) for m in KEPT}
    fine = reduce_model(model, modes=12, damping=DAMPED, slope_points=41)
    for mode, amplitudes in AMPLITUDES.items():
        for amplitude in amplitudes:
            settings: dict[str, Any] = {
                "start": bent(modes, mode, amplitude * LENGTH),
                "duration": PERIODS / float(modes.frequencies[mode]),
                "sample_rate": 40 * float(modes.frequencies[mode]),
            }
            full = simulate(model, damping=DAMPED, method="radau", tolerance=1e-9, **settings).tip
            cells = []
            for reduced in (*models.values(), fine):
                if reduced.count <= mode:
                    cells.append("")
                    continue
                run = simulate_reduced(reduced, **settings)
                cells.append(f"{np.linalg.norm(run.tip - full, axis=1).max() / (amplitude * LENGTH):.1e}")
            yield row(mode + 1, amplitude, *cells)


def shaken() -> Iterator[str]:
    """Error of the tip of the hanging beam relative to L: mode 1 is driven for 1.5 s and then decays for 1.5 s."""
    model = Model(Beam.uniform(**BEAM, elements=20))
    yield row("base amplitude, mm", "tip amplitude / $L$", *(plural(m) for m in KEPT))
    yield rule(2 + len(KEPT))
    for amplitude in (1e-3, 5e-3, 20e-3):
        settings: dict[str, Any] = {
            "base": HarmonicBase(amplitude=amplitude, frequency=1.85, stop=1.5),
            "duration": 3.0,
            "sample_rate": 200.0,
        }
        full = simulate(model, damping=DAMPED, method="radau", tolerance=1e-9, **settings).tip
        cells = []
        for m in KEPT:
            run = simulate_reduced(reduce_model(model, modes=m, damping=DAMPED), **settings)
            cells.append(f"{np.linalg.norm(run.tip - full, axis=1).max() / LENGTH:.1e}")
        yield row(f"{1e3 * amplitude:g}", f"{np.abs(full[:, 0]).max() / LENGTH:.3f}", *cells)


def hardened() -> Iterator[str]:
    """Error of the frequency ratio of mode 1 between ends that do not move; A is the amplitude in the middle."""
    yield row("ends", "$A/r$", RATIO, *(plural(m) for m in KEPT[:3]))
    yield rule(3 + len(KEPT[:3]))
    radius = LENGTH / 1000  # of gyration
    for name, support in (("pinned", Pin), ("clamped", Clamp)):
        thick = {**BEAM, **WEIGHTLESS, "thickness": 12**0.5 * radius}
        model = Model(Beam.uniform(**thick, elements=20, supports=(support(0.0), support(LENGTH))))
        models = [reduce_model(model, modes=m) for m in KEPT[:3]]
        curves = [backbone(reduced, amplitude=1.02 * max(HARDENED[name]) * radius, points=10) for reduced in models]
        for amplitude, exact in HARDENED[name].items():
            ratios = [curve.frequency(amplitude * radius) / curve.natural_frequency for curve in curves]
            yield row(name, amplitude, exact, *(f"{ratio / exact - 1:.1e}" for ratio in ratios))


def slope_points() -> Iterator[str]:
    """Error with 5 modes and different numbers of slope points: frequency at 0.2 L, and release from 0.3 L."""
    choices = (8, 10, 12, 16, 24, 41)
    yield row("slope points", *choices)
    yield rule(1 + len(choices))
    model = weightless()
    modes = natural_modes(model)
    settings: dict[str, Any] = {"start": bent(modes, 0, 0.3 * LENGTH), "duration": 3.0, "sample_rate": 60.0}
    full = simulate(model, damping=DAMPED, method="radau", tolerance=1e-9, **settings).tip
    models = [reduce_model(model, modes=modes, damping=DAMPED, slope_points=k) for k in choices]
    backbones = [
        frequency(reduce_model(model, modes=modes, slope_points=k), 0.2 * LENGTH) - EXACT[0.2] for k in choices
    ]
    runs = [simulate_reduced(reduced, **settings).tip for reduced in models]
    yield row(f"{RATIO}, minus the exact", *(f"{error:.1e}" for error in backbones))
    yield row("tip error / 0.3 $L$", *(f"{np.abs(run - full).max() / (0.3 * LENGTH):.1e}" for run in runs))
    yield row("operations in `rhs`", *(reduced.rhs.n_instructions() for reduced in models))


if __name__ == "__main__":
    for table in (mode_1, release, shaken, hardened, slope_points):
        print(f"\n{(table.__doc__ or '').splitlines()[0]}\n")
        for line in table():
            print(line, flush=True)
