"""Blocks of force and response records: one per hit of a hammer, or overlapping ones under a shaker.

Kind of excitation.  The force of a hammer is near its mean most of the time: it is a hammer's if fewer than 5 % of the
samples deviate from their median by more than a tenth of the largest deviation.

Hits.  A hit begins when the force exceeds 5 % of its largest value, and eight standard deviations of its noise.  If the
next hit follows within a fifth of the usual time between hits (their upper quartile), the hammer bounced.  All blocks
have the length of the shortest time from one usable hit to the next; they begin just before the force rises.  The force
window sets the force to zero after the pulse.

A block is left out if a sample of its force or responses is at the limit of the range (overload): three or more equal
samples in succession at its largest or smallest value, and few just below.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ancf_casadi.estimation.solver.gauss_newton import robust_deviation
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.processing import has_flat_top
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.tables import plural

PULSE_LEVEL, NOISE_LEVEL = 0.05, 8.0  # of a hit, relative to the largest force, and to the noise of the force
QUIET_LEVEL, MOST_LOUD = 0.1, 0.05  # deviation from the median, relative to the largest, and share of samples beyond it
BOUNCE_SHARE = 0.2  # of the usual time between hits, within which a second hit is a bounce
LEAST_SHARE = 0.5  # of the usual time between hits, that a last block needs
LEAST_MARGIN = 2  # samples of a block before the force rises
DEFAULT_BLOCKS = 20  # half-overlapping blocks in a record of a shaker
LEAST_BLOCK = 32  # samples


@dataclass(frozen=True, eq=False)
class Take:
    """Force and responses, (1 + outputs, n), at even times, without their means."""

    name: str
    channels: Array
    begin: float  # s
    step: float  # s

    def is_impulsive(self) -> bool:
        """Return whether the force is that of a hammer."""
        deviations = np.abs(self.channels[0] - np.median(self.channels[0]))
        return bool(np.mean(deviations > QUIET_LEVEL * deviations.max()) < MOST_LOUD)


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks of equal length, (blocks, 1 + outputs, n), and notes on those that are left out.

    Under a shaker, ``places`` are the number of the take of each block, from 0, and its first sample in this take.
    """

    values: Array
    notes: tuple[str, ...]
    places: tuple[tuple[int, int], ...] = ()


@dataclass(frozen=True)
class _Hit:
    """First and last sample of a pulse, first sample of its block, and samples up to the block of the next hit."""

    take: Take
    rise: int
    fall: int
    begin: int
    span: int

    @property
    def time(self) -> float:
        return self.take.begin + self.rise * self.take.step

    def block(self, size: int) -> Array:
        """Return the block, with the force window."""
        values = self.take.channels[:, self.begin : self.begin + size].copy()
        force = values[0]
        force -= np.median(self.take.channels[0])
        force[2 * self.fall - self.rise + LEAST_MARGIN - self.begin :] = 0.0
        return values


def hammer_blocks(takes: Sequence[Take], duration: float | None) -> Blocks:
    """Return one block for each usable hit; the shortest time to the next hit gives the duration, if not given, s."""
    hits: list[_Hit] = []
    left_out: dict[str, list[str]] = {"double hit": [], "overload": [], "short time after the hit": []}
    for take in takes:
        several = f" of {take.name}" if len(takes) > 1 else ""
        for hit, fault in _find_hits(take, duration):
            if fault:
                left_out[fault].append(f"{hit.time:.4g} s{several}")
            else:
                hits.append(hit)
    notes = tuple(f"left out: {fault} at {', '.join(places)}" for fault, places in left_out.items() if places)
    if not hits:
        raise InputError(f"has no usable hit ({'; '.join(notes)}); measure again, or give the block", "force")
    size = min(hit.span for hit in hits)
    if duration is not None:
        size = min(size, round(duration / takes[0].step))
    if size < LEAST_BLOCK:
        raise InputError(f"has blocks of {size} samples after a hit; needs {LEAST_BLOCK}", "force")
    return Blocks(np.array([hit.block(size) for hit in hits]), notes)


def _find_hits(take: Take, duration: float | None) -> list[tuple[_Hit, str]]:
    """Return the hits of a take, each with the reason to leave it out, or an empty text."""
    force = take.channels[0] - np.median(take.channels[0])
    force = force * np.sign(force[np.argmax(np.abs(force))])
    threshold = max(PULSE_LEVEL * force.max(), NOISE_LEVEL * robust_deviation(force))
    marks = np.where(force > threshold, 1, np.where(force < threshold / 2, 0, -1))
    marks[0] = max(marks[0], 0)
    last_mark = np.maximum.accumulate(np.where(marks >= 0, np.arange(len(marks)), 0))
    edges = np.diff(np.concatenate([[0], marks[last_mark], [0]]))
    rises, falls = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    if not len(rises):
        return []
    # a filter rings after a pulse; it is no second hit
    width = int(np.median(falls - rises))
    is_new = np.diff(rises, prepend=-len(force)) > 3 * width + 2 * LEAST_MARGIN
    starts = np.flatnonzero(is_new)
    rises, falls = rises[starts], falls[np.append(starts[1:], len(falls)) - 1]
    spans = np.diff(rises, append=len(force))
    usual = float(np.quantile(spans, 0.75))
    bounce = BOUNCE_SHARE * usual if duration is None else duration / take.step
    margin = max(width // 4, LEAST_MARGIN)
    is_next_close = np.append(spans[:-1] < bounce, False)
    hits = list[tuple[_Hit, str]]()
    for k in np.flatnonzero(~np.append(False, is_next_close[:-1])).tolist():  # without the second of two hits
        rise, fall, is_last = int(rises[k]), int(falls[k]), k == len(rises) - 1
        begin = max(rise - margin, 0)
        span = int(spans[k]) + rise - begin - (0 if is_last else margin)
        hit = _Hit(take, rise, fall, begin, span)
        end = begin + span
        if is_next_close[k]:
            fault = "double hit"
        elif is_last and span < (LEAST_SHARE * usual if duration is None else bounce):
            fault = "short time after the hit"
        elif has_flat_top(force[begin:end]) or any(map(_has_clip, take.channels[1:, begin:end])):
            fault = "overload"
        else:
            fault = ""
        hits.append((hit, fault))
    return hits


def _has_clip(values: Array) -> bool:
    """Return whether values are clipped at either end."""
    return has_flat_top(values) or has_flat_top(-values)


def shaker_blocks(takes: Sequence[Take], duration: float | None, overlap: float) -> Blocks:
    """Return overlapping blocks; the takes give a default of the duration, s, by the number of blocks."""
    samples = sum(take.channels.shape[1] for take in takes)
    shortest = min(take.channels.shape[1] for take in takes)
    size = min(shortest, 2 * samples // (DEFAULT_BLOCKS + 1))
    if duration is not None:
        size = round(duration / takes[0].step)
    if not LEAST_BLOCK <= size <= shortest:
        raise InputError(f"must have {LEAST_BLOCK} samples or more, and {shortest} of the record, got {size}", "block")
    stride = max(1, round(size * (1 - overlap)))
    blocks, places, overloads = [], list[tuple[int, int]](), list[str]()
    for number, take in enumerate(takes):
        for begin in range(0, take.channels.shape[1] - size + 1, stride):
            values = take.channels[:, begin : begin + size]
            if any(map(_has_clip, values)):
                overloads.append(f"{take.begin + begin * take.step:.4g} s")
            else:
                blocks.append(values)
                places.append((number, begin))
    if not blocks:
        raise InputError("is clipped in all blocks; measure again with a larger range", "force or response")
    shown = ", ".join(overloads[:4]) + (", ..." if len(overloads) > 4 else "")
    total = plural(len(blocks) + len(overloads), "block")
    notes = [f"left out: overload in {len(overloads)} of {total}, from {shown}"] if overloads else []
    return Blocks(np.array(blocks), tuple(notes), tuple(places))
