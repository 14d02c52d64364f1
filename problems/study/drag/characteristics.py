"""Characteristics of eta1 and eta2 in words, Table 6, from computed decays.

The mean decay rate over the first seconds is ln(A(0)/A(t))/t at t = ``HORIZON``.  Of two laws, the gross motion decays
rapidly under the one whose rate is larger at every frequency.  A law is independent of the frequency if its rates
differ by less than ``ALIKE``, and controls the residual motion if less than ``GONE`` of the amplitude is left at t, at
every frequency.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ancf_casadi.exceptions import InputError
from problems.study.drag.effects import Envelope

HORIZON = 5.0  # s, after which the paper finds the vibration under eta1 to have disappeared
ALIKE = 0.1  # relative difference of decay rates
GONE = 0.02  # of the amplitude at the start


@dataclass(frozen=True)
class Characteristics:
    """A row of Table 6.

    Parameters
    ----------
    gross_motion : str
        Rapid decay, slow decay, or undecided if neither law is faster at every frequency.
    frequency : str
        Independent or dependent.
    residual_motion : str
        Controllable or uncontrollable.
    rates : tuple of float
        Mean decay rate over the first 5 s at each frequency, 1/s.
    left : tuple of float
        Part of the amplitude that is left after 5 s at each frequency.
    """

    gross_motion: str
    frequency: str
    residual_motion: str
    rates: tuple[float, ...]
    left: tuple[float, ...]


def characteristics(
    first: Sequence[Envelope], second: Sequence[Envelope], horizon: float = HORIZON
) -> tuple[Characteristics, Characteristics]:
    """Return the rows of Table 6 for two laws.

    Parameters
    ----------
    first, second : sequence of Envelope
        Decays under either law, at the same frequencies.
    horizon : float
        Time t at which the decays are compared, s.

    Raises
    ------
    InputError
        If the numbers of decays differ, there are fewer than two frequencies, or a decay ends before t.
    """
    if len(first) != len(second) or len(first) < 2:
        raise InputError(f"needs two or more frequencies under both laws, got {len(first)} and {len(second)}", "decays")
    left = [tuple(one.at(horizon) / float(one.amplitude[0]) for one in decays) for decays in (first, second)]
    if any(math.isnan(part) for parts in left for part in parts):
        raise InputError(f"a decay ends before {horizon:g} s", "decays")
    rates = [tuple(-math.log(part) / horizon for part in parts) for parts in left]
    signs = {math.copysign(1.0, a - b) for a, b in zip(*rates, strict=True)}
    faster = signs.pop() if len(signs) == 1 else 0.0
    return _words(rates[0], left[0], faster), _words(rates[1], left[1], -faster)


def _words(rates: tuple[float, ...], left: tuple[float, ...], faster: float) -> Characteristics:
    return Characteristics(
        gross_motion={1.0: "rapid decay", -1.0: "slow decay"}.get(faster, "undecided"),
        frequency="independent" if max(rates) < (1 + ALIKE) * min(rates) else "dependent",
        residual_motion="controllable" if max(left) < GONE else "uncontrollable",
        rates=rates,
        left=left,
    )
