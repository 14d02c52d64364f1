"""Synthetic free decays for Tables 2 and 4, because the paper publishes no raw record.

The decays follow Eq. (9) with the parameters of Table 2, and Eq. (27) with those of Table 4.  Seeded white noise stands
for the measurement error.

References
----------
"Comparison of external damping models in a large deformation problem", Section 3.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import casadi as cs
import numpy as np

from ancf_casadi.decay.closed_forms import linear_decay, quadratic_decay
from ancf_casadi.records.measurement import Measurement
from problems.study import paper

SEED = 20
FRAME_RATE = 500.0  # frames per second; the paper does not state it
RECORD = 5.0  # s
NOISE = 0.2e-3  # m, standard deviation
START_AMPLITUDES = (0.050, 0.015, 0.008, 0.005, 0.005)  # m, of the decays of Table 2


def linear_decays() -> tuple[Measurement, ...]:
    """Return noisy decays by Eq. (9) with the parameters of Table 2, released at rest."""
    parameters = zip(paper.FREQUENCIES, paper.DAMPING_RATIOS, START_AMPLITUDES, strict=True)
    return _noisy([(linear_decay, (2 * math.pi * f, zeta, r0, 0.0)) for f, zeta, r0 in parameters], SEED)


def quadratic_decays() -> tuple[Measurement, ...]:
    """Return noisy decays by Eq. (27) with the parameters of Table 4, from the amplitudes that Table 4 implies."""
    parameters = zip(paper.FREQUENCIES, paper.ETA1, paper.ETA2, paper.EQUIVALENT_AMPLITUDES, strict=True)
    curves = [(quadratic_decay, (2 * math.pi * f, eta1, eta2, e0, 0.0)) for f, eta1, eta2, e0 in parameters]
    return _noisy(curves, SEED + 1)


def _noisy(curves: Iterable[tuple[Callable[..., cs.DM], tuple[float, ...]]], seed: int) -> tuple[Measurement, ...]:
    rng = np.random.default_rng(seed)
    instants = np.arange(0.0, RECORD, 1 / FRAME_RATE)
    exact = [curve(cs.DM(instants), *map(cs.DM, parameters)).full().ravel() for curve, parameters in curves]
    return tuple(
        Measurement(instants, displacement + NOISE * rng.standard_normal(instants.size), f"mode {k + 1}, synthetic")
        for k, displacement in enumerate(exact)
    )
