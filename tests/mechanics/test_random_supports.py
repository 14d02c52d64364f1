"""Random beams give the same frequencies if the laboratory turns, or if the beam is described from its other end."""

import math

import numpy as np
import pytest

from ancf_casadi import (
    Beam,
    Clamp,
    EquilibriumError,
    Guide,
    Model,
    Pin,
    PointMass,
    Roller,
    RotationalSpring,
    Spring,
    natural_modes,
)

LENGTH = 0.5
STRIP = {"length": LENGTH, "width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elastic_modulus": 210e9}
SEEDS = [*range(5), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(5, 60))]


def turned(angle, vector):
    (x, y), c, s = vector, math.cos(angle), math.sin(angle)
    return c * x - s * y, s * x + c * y


class Description:
    """Up to three supports and three attachments at random points, in random directions, with and without weight."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        inner = np.round(rng.uniform(0.02, 0.48, 4), 3)
        self.points = rng.permutation([0.0, LENGTH, *inner])[: rng.integers(0, 4)]
        self.kinds = rng.integers(0, 5, 3)
        self.directions = rng.standard_normal((3, 2))
        self.elastic = 10 ** rng.uniform(-3, 1)
        self.attached = rng.choice([0.0, LENGTH, *inner], rng.integers(0, 4))
        self.sizes = rng.uniform(0.0, 1.0, 3)
        self.curvature = rng.choice([0.0, 0.0, 2.0, -5.0])
        self.angle, self.weight = rng.uniform(-math.pi, math.pi), rng.choice([0.0, 0.0, 9.81])

    def frequencies(self, turn=0.0, *, reverse=False):
        """Return six frequencies after a turn of the laboratory, or of the beam described from its other end."""

        def at(point):
            return LENGTH - point if reverse else point

        def support(kind, point, direction):
            along = turned(turn, direction)
            made = Clamp(point), Clamp(point, self.elastic), Pin(point), Roller(point, along), Guide(point, along)
            return made[kind]

        def attachment(kind, point, size):
            stiffness = 1000.0**size
            made = PointMass(point, 1e-2 * size, 1e-6 * size), Spring(point, (stiffness, stiffness))
            return (*made, RotationalSpring(point, size))[kind]

        angle = self.angle + turn + (self.curvature * LENGTH + math.pi if reverse else 0.0)
        beam = Beam.uniform(
            **STRIP,
            elements=40,
            axis=(math.cos(angle), math.sin(angle)),
            gravity=turned(turn, (0.0, -self.weight)),
            natural_curvature=-self.curvature if reverse else self.curvature,
            supports=[support(*held) for held in zip(self.kinds, map(at, self.points), self.directions, strict=False)],
            attachments=[attachment(k, at(point), self.sizes[k]) for k, point in enumerate(self.attached)],
        )
        try:
            return natural_modes(Model(beam), count=6).frequencies
        except EquilibriumError as error:
            assert not Model(beam).is_held or "unstable" in str(error)
            return None


@pytest.mark.parametrize("seed", SEEDS)
def test_frequencies_depend_neither_on_the_laboratory_nor_on_the_end_where_a_beam_begins(seed):
    """Nodes sit elsewhere after the exchange of the ends, so that the errors of the elements differ."""
    description = Description(seed)
    plain, rotated = description.frequencies(), description.frequencies(2.0)
    reverse = description.frequencies(reverse=True)
    if plain is None:
        assert rotated is None and reverse is None
    else:
        size = np.maximum(plain, 1e-3 * plain.max())
        assert abs(rotated - plain).max() <= 1e-5 * size.min()
        assert (abs(reverse - plain) <= 3e-3 * size).all()
