"""Response curves of a known beam, swept up or down, from steady motions that the reduced model computes."""

import math

import numpy as np

from ancf_casadi import Model, NumericsError
from problems import ResponseRecord
from problems.beam.curves.block import curve_block
from problems.beam.curves.points import Measured, closest, motion_from_rest

ONLY_LEVEL = np.array([1e6, 1e6, 1e-6])  # standard deviations by which the closest motion is that with the level


def swept(model: Model, law, record: ResponseRecord, *, modes: int, harmonics: int = 5, **values: float) -> np.ndarray:
    """Return amplitude and phase at the points of a record (m, 2), on the branch that its sweep reaches."""
    first = {"elastic_modulus": 1.0} if "elastic_modulus" in values else {}  # values are factors
    block = curve_block(model, [(1, record)], law, tuple(first), first, modes=modes, harmonics=harmonics)
    driven, s = block.driven_beams({})[0], block.system_unknowns(values)
    motion, found = None, []
    for f, level in zip(record.f, record.a, strict=True):
        wanted = [Measured(2 * math.pi * f, np.array([size, math.nan, level]), ONLY_LEVEL) for size in SIZES]
        starts = [] if motion is None else [(wanted[0], motion)]
        for point, near in [*starts, *((one, None) for one in wanted)]:
            try:
                motion = closest(driven, point, s, near or motion_from_rest(driven, point, s))
            except NumericsError:
                continue
            if abs(motion.level / level - 1) < 1e-6 and motion.slopes[2] > 0.0:
                break
        else:
            raise AssertionError(f"no motion at {f} Hz")
        found.append(motion.values[:2])
    return np.array(found)


SIZES = (1e-3, 3e-2, 6e-2)  # amplitudes from which the other branch is sought after a jump, m


def noisy(record: ResponseRecord, curve: np.ndarray, rng: np.random.Generator, *, noise: float = 0.01, **settings):
    """Return a record of a curve with white noise of amplitude (relative) and phase (rad)."""
    errors = noise * rng.standard_normal(curve.shape)
    amplitudes, phases = curve[:, 0] * (1 + errors[:, 0]), curve[:, 1] + errors[:, 1]
    return ResponseRecord(
        record.frequencies, amplitudes, phases, sensor=record.sensor, base=record.base, load=record.load,
        levels=record.levels, sweep=record.sweep, **settings,
    )  # fmt: skip
