"""The values that a fit of a beam starts from.

A motion whose frequency is off by too much slips by whole cycles against its record, and the fit ends in a wrong
minimum.  A record of a free decay shows its frequency without a beam (``decay.first_guess``).  If it is so far from
that of the nearest natural mode at the first values that the decay would slip, the properties are fitted to the
frequencies of the decays first, and the fit of the motions starts from there as well; the best optimum counts.

Along the beam, a large motion shows twice the frequency that it has across: a point comes nearer to the clamp by about
the square of its deflection.  A decay at twice the frequency of another one of its record is therefore left out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain, product

import numpy as np

from ancf_casadi.decay.first_guess import first_guess
from ancf_casadi.dynamics.base_motion import BaseMotion, FixedBase
from ancf_casadi.dynamics.tip_load import TipLoad
from ancf_casadi.estimation.solve import FitProblem, solve
from ancf_casadi.estimation.solver.unknown import Unknown
from ancf_casadi.exceptions import AncfError, InputError
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from problems.beam.motions.record import MotionRecord
from problems.beam.properties import CLAMP_STIFFNESS
from problems.beam.unknowns import nearest_mode, sought_frequencies
from problems.beam.values.block import ValueBlock
from problems.beam.values.records import FrequencyRecord

OTHER_START = 0.02  # second start of a tip mass, and of the compliance of a clamp, relative to the first
MOST_SLIP = 0.25  # cycles by which a decay may slip: from half a cycle on, the nearest minimum is a wrong one
FREQUENCY_ERROR = 0.01  # of a decay, relative to the natural frequency: large motion changes it
DOUBLED = 0.1  # largest relative distance from twice a frequency, for a doubled one that noise hides in part


def starts(
    unknowns: Sequence[Unknown],
    first: Mapping[str, float],
    motions: Sequence[tuple[Model, Sequence[tuple[int, MotionRecord]]]],
    *,
    only_values: bool,
) -> list[dict[str, float]]:
    """Return the starts of a fit, as guesses by name: one, and a second where a fit may end in another minimum.

    For values alone, a soft clamp and a tip mass have a second one; ``motions`` are those of each configuration.
    """
    listed = []
    for one in unknowns:
        second = {"tip_mass": OTHER_START * one.guess, CLAMP_STIFFNESS: one.guess / OTHER_START}.get(one.name)
        listed.append([{}] if second is None or not only_values else [{}, {one.name: second}])
    found = [{name: value for part in parts for name, value in part.items()} for parts in product(*listed)]
    try:
        nearer = _of_frequencies([one for one in unknowns if one.name in first], first, motions)
    except AncfError:  # no equilibrium, or no fit: the first values remain
        nearer = {}
    return [nearer, *found] if nearer else found


def _of_frequencies(
    properties: Sequence[Unknown],
    first: Mapping[str, float],
    motions: Sequence[tuple[Model, Sequence[tuple[int, MotionRecord]]]],
) -> dict[str, float]:
    """Return properties with the frequencies of the decays, near their first values; none if no decay would slip."""
    if not properties:
        return {}
    blocks, slip = [], 0.0
    for model, numbered in motions:
        decays = [decay for _, record in numbered for decay in _decays(record)]
        if not decays:
            continue
        frequencies = sought_frequencies(model)
        measured: dict[int, float] = {}
        for frequency, duration in decays:
            mode = nearest_mode(frequency, frequencies)
            measured.setdefault(mode, frequency)
            slip = max(slip, abs(float(frequencies[mode]) - frequency) * duration)
        modes = sorted(measured)
        values: Array = np.array([measured[mode] for mode in modes])
        record = FrequencyRecord(model, values, std=FREQUENCY_ERROR * values, modes=[mode + 1 for mode in modes])
        blocks.append(ValueBlock(record, first))
    if slip <= MOST_SLIP:
        return {}
    near = tuple(replace(one, prior=one.prior or (one.guess, abs(one.guess))) for one in properties)
    return dict(solve(FitProblem(tuple(blocks), near)).fit.estimates)


def _decays(record: MotionRecord) -> list[tuple[float, float]]:
    """Return frequency, Hz, and duration, s, of the free decay in each channel that shows one of its own."""
    driven: list[BaseMotion | TipLoad] = [record.own_base, *([record.load] if record.load else [])]
    ends = [[piece.end for piece in one.pieces() if math.isfinite(piece.end)] for one in driven]
    if not ends[0] and not isinstance(record.own_base, FixedBase):
        return []
    release = max([record.origin, *chain(*ends)]) - record.origin + sum(record.release_bounds) / 2
    found = []
    for channel in record.own_channels:
        try:
            guess = first_guess(channel.measurement, release_time=release)
        except InputError:  # no decay is long enough, or nothing oscillates
            continue
        found.append((guess.ω / (2 * math.pi), guess.duration))
    return [one for one in found if not any(abs(one[0] / (2.0 * other) - 1.0) < DOUBLED for other, _ in found)]
