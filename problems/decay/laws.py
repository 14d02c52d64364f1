"""Laws of a free decay as estimation problems: unknowns, starting values, scales, and reported quantities.

    linear      Eq. (9)     omega, zeta; r0, v0                       zeta within its bounds
    quadratic   Eq. (27)    omega, eta1, eta2; e0, phi                eta1, eta2, e0 >= 0
    friction    with eta0   omega, eta1, eta2, eta0; e0, phi          also eta0 >= 0 (``friction``)
    one-mode    Eq. (26)    omega, eta1, eta2; r0, v0                 integrated; eta1, eta2 >= 0

The unknowns before the semicolon belong to the mode, those after it to each release.  The scale of an unknown is the
change that moves the curve by about as much as its amplitude within the decay: 1/T for omega, 1/(omega T) for zeta and
so on, with T the length of the record or of the decay, whichever is less.  All damping terms start with equal parts of
the guessed damping.  The one-mode law starts from the fit of the quadratic law, its closed form.

References
----------
"Comparison of external damping models in a large deformation problem", Sections 3 and 4.2, with eta2 in 1/mm.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import casadi as cs

from ancf_casadi.decay.closed_forms import equivalent_damping_ratio, linear_decay, quadratic_decay
from ancf_casadi.decay.first_guess import DecayGuess
from ancf_casadi.decay.friction import friction_decay
from ancf_casadi.decay.one_mode import one_mode_decay
from ancf_casadi.estimation.least_squares import Unknown
from ancf_casadi.support.arrays import Array

Law = Literal["linear", "quadratic", "friction", "one-mode"]
Symbols = Sequence[cs.MX]
Interval = tuple[float, float]


@dataclass(frozen=True)
class Quantity:
    """A quantity that a decay fit reports.

    Parameters
    ----------
    unit : str
        SI unit.
    suffix : str
        Suffix of the keys in JSON.
    lower : float
        Lower bound, unless the law has another one.
    """

    unit: str = ""
    suffix: str = ""
    lower: float = 0.0


QUANTITIES: Mapping[str, Quantity] = {
    "frequency": Quantity("Hz", "_hz"),
    "damping_ratio": Quantity(),
    "eta1": Quantity("1/s"),
    "eta2": Quantity("1/m", "_per_m"),
    "eta0": Quantity("m/s^2", "_m_per_s2"),
    "amplitude": Quantity("m", "_m"),
    "offset": Quantity("m", "_m", -math.inf),
    "drift": Quantity("m/s", "_m_per_s", -math.inf),
}


@dataclass(frozen=True)
class DecayLaw:
    """A law of free decay.

    Parameters
    ----------
    terms : tuple of str
        Names of the damping coefficients; empty for the linear law, whose damping is the ratio zeta.
    shared : callable
        First guess and bounds of the damping ratio -> unknowns of the mode.
    own : callable
        First guess -> unknowns of the release.
    curve : callable
        Time after the release (s), unknowns -> displacement from the equilibrium (m); None if it is integrated.
    quantities : callable
        Unknowns -> frequency (Hz), damping ratio at the release, eta1, eta2, eta0, amplitude at the release.
    """

    terms: tuple[str, ...]
    shared: Callable[[DecayGuess, tuple[float, float]], list[Unknown]]
    own: Callable[[DecayGuess], list[Unknown]]
    curve: Callable[..., cs.MX] | None
    quantities: Callable[..., cs.MX]

    @property
    def integrated(self) -> bool:
        """True if the curve is integrated; exact second derivatives would then cost more than they save."""
        return self.curve is None


def _linear_shared(guess: DecayGuess, ratio_bounds: tuple[float, float]) -> list[Unknown]:
    lower, upper = ratio_bounds
    ω, T = guess.ω, guess.duration
    return [
        Unknown("omega", ω, 1 / T, lower=0.0, unit="rad/s"),
        Unknown("zeta", min(max(guess.ζ, lower), upper), 1 / (ω * T), lower=lower, upper=upper),
    ]


def _linear_own(guess: DecayGuess) -> list[Unknown]:
    A = guess.amplitude
    return [Unknown("r0", guess.r0, A, unit="m"), Unknown("v0", guess.v0, A * guess.ω, unit="m/s")]


def _linear_quantities(ω: cs.MX, ζ: cs.MX, r0: cs.MX, v0: cs.MX) -> cs.MX:
    amplitude = cs.sqrt(r0**2 + ((v0 + ζ * ω * r0) / (ω * cs.sqrt(1 - ζ**2))) ** 2)
    return cs.vertcat(ω / (2 * math.pi), ζ, 2 * ζ * ω, 0, 0, amplitude)


def _quadratic_shared(guess: DecayGuess, _: tuple[float, float]) -> list[Unknown]:
    return _terms(guess)[:3]


def _friction_shared(guess: DecayGuess, _: tuple[float, float]) -> list[Unknown]:
    return _terms(guess, 3)


def _terms(guess: DecayGuess, parts: int = 2) -> list[Unknown]:
    """Return omega and the coefficients of all three terms, each with one of ``parts`` of the guessed damping."""
    ω, A, T = guess.ω, guess.amplitude, guess.duration
    ζ = guess.ζ / parts
    drag = 3 * math.pi / (4 * A)  # eta2 with an equivalent damping ratio of 1
    friction = math.pi * ω**2 * A / 2  # eta0 with the same
    return [
        Unknown("omega", ω, 1 / T, lower=0.0, unit="rad/s"),
        Unknown("eta1", 2 * ζ * ω, 1 / T, lower=0.0, unit="1/s"),
        Unknown("eta2", ζ * drag, drag / (ω * T), lower=0.0, unit="1/m"),
        Unknown("eta0", ζ * friction, friction / (ω * T), lower=0.0, unit="m/s^2"),
    ]


def _envelope_own(guess: DecayGuess) -> list[Unknown]:
    A = guess.amplitude
    return [Unknown("e0", A, A, lower=0.0, unit="m"), Unknown("phase", guess.phase, unit="rad")]


def _quadratic_quantities(ω: cs.MX, η1: cs.MX, η2: cs.MX, e0: cs.MX, φ: cs.MX) -> cs.MX:
    return cs.vertcat(ω / (2 * math.pi), equivalent_damping_ratio(η1, η2, ω, e0), η1, η2, 0, e0)


def _one_mode_quantities(ω: cs.MX, η1: cs.MX, η2: cs.MX, r0: cs.MX, v0: cs.MX) -> cs.MX:
    return _quadratic_quantities(ω, η1, η2, cs.sqrt(r0**2 + (v0 / ω) ** 2), cs.MX(0))


def _friction_curve(t: cs.MX, ω: cs.MX, η1: cs.MX, η2: cs.MX, η0: cs.MX, e0: cs.MX, φ: cs.MX) -> cs.MX:
    return friction_decay(t, ω, η0, η1, η2, e0, φ)


def _friction_quantities(ω: cs.MX, η1: cs.MX, η2: cs.MX, η0: cs.MX, e0: cs.MX, φ: cs.MX) -> cs.MX:
    return cs.vertcat(ω / (2 * math.pi), equivalent_damping_ratio(η1, η2, ω, e0, η0), η1, η2, η0, e0)


LAWS: Mapping[Law, DecayLaw] = {
    "linear": DecayLaw((), _linear_shared, _linear_own, linear_decay, _linear_quantities),
    "quadratic": DecayLaw(("eta1", "eta2"), _quadratic_shared, _envelope_own, quadratic_decay, _quadratic_quantities),
    "friction": DecayLaw(
        ("eta1", "eta2", "eta0"), _friction_shared, _envelope_own, _friction_curve, _friction_quantities
    ),
    "one-mode": DecayLaw(("eta1", "eta2"), _quadratic_shared, _linear_own, None, _one_mode_quantities),
}


@dataclass(frozen=True)
class DecayModel:
    """A law about an equilibrium.

    Parameters
    ----------
    law : {"linear", "quadratic", "friction", "one-mode"}
        The law.
    offset : bool
        Whether the equilibrium may differ from 0.
    drift : bool
        Whether the equilibrium may move at a constant velocity.
    longest_step : float
        Longest integration step of an integrated law, s.
    """

    law: Law
    offset: bool
    drift: bool
    longest_step: float = math.inf

    def shared(self, guess: DecayGuess, ratio_bounds: tuple[float, float]) -> list[Unknown]:
        """Return the unknowns of the mode."""
        return LAWS[self.law].shared(guess, ratio_bounds)

    def own(self, guess: DecayGuess) -> list[Unknown]:
        """Return the unknowns of a release and its record."""
        A = guess.amplitude
        baseline = [
            Unknown("offset", guess.offset, A, unit="m"),
            Unknown("drift", guess.drift, A / guess.length, unit="m/s"),
        ]
        return LAWS[self.law].own(guess) + baseline[:1] * self.offset + baseline[1:] * self.drift

    def curve(self, time: Array, *x: cs.MX) -> cs.MX:
        """Return the displacement (m) at times (s) after the release."""
        law, offset, drift = self._split(x)
        t, curve = cs.MX(cs.DM(time)), LAWS[self.law].curve
        motion = curve(t, *law) if curve else one_mode_decay(time, *law, longest_step=self.longest_step)
        return motion + offset + drift * t

    def quantities(self, *x: cs.MX) -> cs.MX:
        """Return the quantities of the decay, in the order of ``QUANTITIES``."""
        law, offset, drift = self._split(x)
        return cs.vertcat(LAWS[self.law].quantities(*law), offset, drift)

    def values(self, x: Array) -> dict[str, float]:
        """Return the quantities by name, for values of the unknowns."""
        found = cs.evalf(self.quantities(*cs.vertsplit(cs.MX(cs.DM(x)))))
        return dict(zip(QUANTITIES, found.full().ravel().tolist(), strict=True))

    def _split(self, x: Symbols) -> tuple[Symbols, cs.MX, cs.MX]:
        count = len(x) - self.offset - self.drift
        zero = cs.MX(0)
        return x[:count], x[count] if self.offset else zero, x[-1] if self.drift else zero
