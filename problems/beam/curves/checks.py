"""Checks of the phases and the levels of response curves before a fit, of a beam or of one mode.

Near a resonance, the response h per level of one mode, with the angular frequency W of the excitation, is

    h = C/(omega^2 + b A - W^2 + 2 i c W),    or    W^2 = omega^2 + b A + 2 i c W - C/h,

which is linear in omega^2, b, c and the complex constant C.  The regression of all points of a record, over 1/|h|,
gives C without any model.  The conjugate response satisfies the same equation with -c and the conjugate C: c > 0
decides the sign of the phases.  The phase of C, which sensor and excitation determine, decides the signal that the
phases count from, and its size the unit of the levels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ancf_casadi.support.arrays import Array, ComplexArray
from problems.beam.curves.record import ResponseRecord

SIGN_CERTAIN = 4.0  # standard errors of c that decide its sign
LARGEST_TILT = math.radians(30.0)  # of C from a quarter turn, with which the record counts as of one mode
LOCKED = math.radians(15.0)  # distance of the phases from that of the resonance, at which all points are there
LEVELS_APART = 5.0  # ratio of responses per level from which a unit is in doubt
EXCITATION_NAMES = {"N": "force", "V": "voltage", "m": "displacement", "m/s": "velocity", "m/s^2": "acceleration"}
UNIT_RATIOS = {9.80665: "g in place of m/s^2", 1000.0: "a unit that differs by a factor of 1000, such as mm"}


@dataclass(frozen=True)
class SeenMode:
    """The resonance that a record shows by itself."""

    mirrored: bool  # True if the phases have the wrong sign
    phase: float  # of C, rad, once the sign is right
    size: float  # of C
    omega: float  # rad/s


def seen_mode(record: ResponseRecord) -> SeenMode | None:
    """Return the resonance of a record with phases; None if the record does not decide its sign and its phase."""
    if record.measured_phases is None or record.f.size < 4:
        return None
    h, A = record.complex_values / record.a, record.amplitudes / record.amplitudes.max()
    W = 2 * math.pi * record.f
    middle, size = float(np.median(W)), float(np.median(np.abs(h)))
    t, g, ones, zeros = W / middle, size / h, np.ones(len(h)), np.zeros(len(h))
    real = np.array([ones, A, zeros, -g.real, g.imag])
    imaginary = np.array([zeros, zeros, 2 * t, -g.imag, -g.real])
    weights = np.tile(1 / np.abs(g), 2)
    rows = np.hstack([real, imaginary]).T * weights[:, None]
    scale = np.linalg.norm(rows, axis=0)
    target = np.append(t**2 - 1, zeros) * weights
    x, *_ = np.linalg.lstsq(rows / scale, target)
    residuals, inverse = target - rows / scale @ x, np.linalg.pinv(rows / scale)
    covariance = inverse @ inverse.T / np.outer(scale, scale) * float(residuals @ residuals) / (len(residuals) - 5)
    x = x / scale
    c, C = float(x[2]), complex(x[3], x[4])
    across = np.array([-C.imag, C.real]) / max(abs(C), 1e-300)
    certain = abs(c) > SIGN_CERTAIN * math.sqrt(covariance[2, 2])
    if not certain or float(across @ covariance[3:, 3:] @ across) > (abs(C) / 6) ** 2:  # ten degrees
        return None
    C = C.conjugate() if c < 0.0 else C
    return SeenMode(c < 0.0, math.atan2(C.imag, C.real), abs(C) * size * middle**2, middle * math.sqrt(abs(1 + x[0])))


def orient(record: ResponseRecord, expected: float) -> tuple[ResponseRecord, str | None]:
    """Return a record whose phases count from its excitation, and a note if they did not; ``expected`` is that of C."""
    if record.measured_phases is None:
        return record, None
    mode = seen_mode(record)
    if mode is None:
        if not phase_locked(record, expected + math.pi):
            return record, None
        mirrored, turn = False, 2  # a quarter turn ahead at all points: the resonance, reversed
    else:
        mirrored, turn = mode.mirrored, round(math.remainder(expected - mode.phase, 2 * math.pi) / (math.pi / 2))
        tilt = math.remainder(expected - mode.phase - turn * math.pi / 2, 2 * math.pi)
        if abs(tilt) > LARGEST_TILT or (not mirrored and turn == 0):
            return record, None
    phases = (-1.0 if mirrored else 1.0) * record.measured_phases + turn * math.pi / 2
    return replace(record, phases=phases), f"{record.label}: {_phase_note(record, mirrored, turn)}"


def phase_locked(record: ResponseRecord, expected: float) -> bool:
    """Return whether all points are at the resonance, a quarter turn behind the phase ``expected`` of C."""
    if record.measured_phases is None:
        return False
    return float(np.abs(np.angle(1j * np.exp(1j * (record.measured_phases - expected)))).max()) < LOCKED


def _phase_note(record: ResponseRecord, mirrored: bool, turn: int) -> str:
    """Return what the phases count from, and what was done."""
    unit = record.excitation_unit or ("m" if record.base else "N")
    name = EXCITATION_NAMES[unit]
    changes = ["the phases are lags; their sign was changed"] if mirrored else []
    if turn:
        source = {1: "rate of the ", -1: "integral of the "}.get(turn, "negative ") + name
        change = {1: "90 degrees were added", -1: "90 degrees were subtracted"}.get(turn, "180 degrees were added")
        changes.append(f"the phases count from the {source}; {change}")
    return "; ".join(changes)


def orient_from_model(record: ResponseRecord, model: ResponseRecord) -> tuple[ResponseRecord, list[str]]:
    """Return a record whose phases count from its excitation, and notes about its phases and its levels."""
    expected = seen_mode(model)
    if expected is None:
        return record, []
    turned, note = orient(record, expected.phase)
    notes, mode = [note] if note else [], seen_mode(turned)
    if mode is not None:
        ratio = mode.size / expected.size * (expected.omega / mode.omega) ** 2
        if max(ratio, 1 / ratio) > LEVELS_APART:
            notes.append(f"{record.label}: {_level_note(ratio, 'that of the model')}")
    return turned, notes


def level_notes(records: Sequence[ResponseRecord], factors: Sequence[ComplexArray | Array]) -> list[str]:
    """Return notes about records whose response per level differs by orders of magnitude from that of the others."""
    pairs = [(record, seen_mode(record), factor) for record, factor in zip(records, factors, strict=True)]
    sizes = [
        (record, mode.size / float(np.median(np.abs(factor)))) for record, mode, factor in pairs if mode is not None
    ]
    notes = []
    for unit in dict.fromkeys(record.excitation_unit for record, _ in sizes):
        of_unit = [(record, size) for record, size in sizes if record.excitation_unit == unit]
        middle = sorted(size for _, size in of_unit)[len(of_unit) // 2]
        for record, size in of_unit:
            ratio = max(size / middle, middle / size)
            if ratio > LEVELS_APART:
                notes.append(f"{record.label}: {_level_note(size / middle, 'that of the other records')}")
    return notes


def _level_note(ratio: float, reference: str) -> str:
    close = [text for value, text in UNIT_RATIOS.items() if abs(math.log(max(ratio, 1 / ratio) / value)) < 0.3]
    return f"its response per level is {ratio:.3g} times {reference}; check the unit of its levels" + "".join(
        f" ({text}?)" for text in close
    )
