"""Laws of a free decay as estimation problems: unknowns, starting values, scales, and reported quantities.

A damping law and a frequency law are combined.  Damping laws (``ancf_casadi.decay.closed_forms``), with the
unknowns of the mode and their bounds:

    linear      Eq. (9)     omega, zeta                     zeta within its bounds
    quadratic   Eq. (27)    omega, eta1, eta2               eta1, eta2 >= 0
    friction    with eta0   omega, eta1, eta2, eta0         also eta0 >= 0
    power       |r'|^p      omega, zeta, exponent           zeta > 0, 0 <= p <= 4
    smooth      no law      omega, zeta at A_2, and the relative changes from there at six other amplitudes A_k

Frequency laws (``ancf_casadi.decay.phase``), with omega the frequency at zero amplitude, under the logarithmic law
at the amplitude R of reference, and without a law at A_2:

    constant      omega
    linear        omega (1 + k A)               frequency_slope k
    quadratic     omega (1 + k A^2)             frequency_curvature k
    power         omega (1 + k (A/R)^q)         frequency_change, k at the release, and frequency_exponent q
    logarithmic   omega (1 + k ln((A + A_s)/(R + A_s)))
                                                frequency_log_slope of f (1 + k ln(1 + A/A_s)), and corner_amplitude A_s
    smooth        without a law, through values at seven amplitudes A_k
                                                frequency_change at the release, relative to the smallest amplitude

The reported ``frequency`` and ``damping_ratio`` are those at the release, under every law: no fit reports a value at an
amplitude that was not measured.

Each release has its own amplitude e0 of the envelope and phase phi, under every law.  With Eq. (9) these are
r0 = e0 cos(phi) and (v0 + zeta omega r0)/omega_d = -e0 sin(phi).  The ratio zeta of the power law refers to the
amplitude of reference, so that it hardly correlates with the exponent.

The scale of an unknown is the change that moves the curve by about as much as its amplitude within the decay: 1/T for
omega, 1/(omega T) for zeta and so on, with T the length of the record or of the decay, whichever is less.
``starting_values`` has better values where the record permits.

References
----------
"Comparison of external damping models in a large deformation problem", Sections 3 and 4.2, with eta2 in 1/mm.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import casadi as cs
import numpy as np

from ancf_casadi.decay.closed_forms import (
    equivalent_damping_ratio,
    friction_envelope,
    power_coefficient,
    power_envelope,
    power_ratio,
    quadratic_envelope,
)
from ancf_casadi.decay.first_guess import DecayGuess
from ancf_casadi.decay.phase import FREQUENCY_TERMS, FrequencyLaw, frequency_change, integral
from ancf_casadi.decay.rest_position import REST_TERMS, Rest, rest_position
from ancf_casadi.decay.smooth import (
    AMPLITUDE_SPAN,
    MIDDLE,
    SMOOTH_DAMPING,
    SMOOTH_FREQUENCY,
    SmoothTerms,
    flow_amplitude,
    smooth_change,
)
from ancf_casadi.estimation.solver.unknown import Priors, Reported, Unknown, with_prior
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.sensor import Sensor
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_keys, choice, vector

Law = Literal["linear", "quadratic", "friction", "power", "smooth"]
Symbols = Sequence[cs.MX]

EXPONENTS = (0.0, 4.0)  # bounds of the exponent
FREQUENCY_EXPONENTS = (0.05, 4.0)  # below, a power is a logarithm
LOG_CORNERS = (-9.0, 2.0)  # bounds of ln(A_s/R): below, every record is logarithmic, and above, linear in the amplitude


@dataclass(frozen=True)
class Quantity:
    """A quantity that a decay fit reports: its SI unit and its bounds, unless the law has others."""

    unit: str = ""
    suffix: str = ""  # of the keys in JSON
    lower: float = 0.0
    upper: float = math.inf


DECAY_QUANTITIES: Mapping[str, Quantity] = {
    "frequency": Quantity("Hz", "_hz"),
    "frequency_slope": Quantity("1/m", "_per_m", -math.inf),
    "frequency_curvature": Quantity("1/m^2", "_per_m2", -math.inf),
    "frequency_change": Quantity("", "", -math.inf),
    "frequency_exponent": Quantity("", "", *FREQUENCY_EXPONENTS),
    "frequency_log_slope": Quantity("", "", -math.inf),
    "corner_amplitude": Quantity("m", "_m"),
    "damping_ratio": Quantity(),
    "eta1": Quantity("1/s"),
    "eta2": Quantity("1/m", "_per_m"),
    "eta0": Quantity("m/s^2", "_m_per_s2"),
    "eta_p": Quantity("m^(1-p) s^(p-2)"),
    "exponent": Quantity(lower=EXPONENTS[0], upper=EXPONENTS[1]),
    "amplitude": Quantity("m", "_m"),
    "offset": Quantity("m", "_m", -math.inf),
    "drift": Quantity("m/s", "_m_per_s", -math.inf),
    "creep": Quantity("1/s"),
}
DECAY_TERMS: Mapping[Law, tuple[str, ...]] = {  # reported damping coefficients, if the law has others than its ratio
    "linear": (),
    "quadratic": ("eta1", "eta2"),
    "friction": ("eta1", "eta2", "eta0"),
    "power": ("eta_p", "exponent"),
    "smooth": (),
}
DAMPING_TERMS: Mapping[Law, tuple[str, ...]] = {  # unknowns to which the rate of decay is proportional, one or a sum
    law: ("zeta",) if law in ("linear", "power", "smooth") else terms for law, terms in DECAY_TERMS.items()
}
FREQUENCY_REPORTED: Mapping[FrequencyLaw, tuple[str, ...]] = {  # where they are not the unknowns
    "logarithmic": ("frequency_log_slope", "corner_amplitude"),
    "smooth": ("frequency_change",),
}
FREQUENCY_AT: Mapping[FrequencyLaw, str] = {  # name of omega in Hz; else at zero amplitude
    "constant": "frequency",
    "logarithmic": "frequency_at_reference",
    "smooth": f"frequency_at_{MIDDLE}",
}
RATIO_AT: Mapping[Law, str] = {"smooth": f"damping_ratio_at_{MIDDLE}"}  # name of zeta, if not that of the decay
DISPLACEMENT = Sensor()
RATIO_BOUNDS = (0.0, 0.999)
# Amplitude over the one of reference, below which the damping ratio no longer changes the phase.  At 1e-12, a power
# below 1 lets test_a_decay_and_a_curve_state_the_same_natural_frequency fail.
LEAST_LAGGING = 1e-3


@dataclass(frozen=True)
class DecayModel:
    """A damping law and a frequency law about an equilibrium, as a sensor measures them.

    For a velocity or an acceleration, the curve is differentiated; the rest position belongs to the sensor.
    """

    law: Law
    rest: Rest = "constant"
    frequency_law: FrequencyLaw = "constant"
    ratio_bounds: tuple[float, float] = RATIO_BOUNDS  # of the linear law
    reference: float = 1.0  # amplitude R of the power laws and of the logarithmic law, m
    span: float = AMPLITUDE_SPAN  # largest amplitude over the smallest, of the smooth laws
    lowest: float | None = None  # smallest measured amplitude, m, where it is not that of the span
    sensor: Sensor = DISPLACEMENT
    lags: bool = False  # whether the phase lags in the second order of the damping, so that omega is natural

    def __post_init__(self) -> None:
        """Check the laws and the bounds."""
        choice(self.law, get_args(Law), "law")
        choice(self.rest, get_args(Rest), "rest")
        choice(self.frequency_law, get_args(FrequencyLaw), "frequency_law")
        lower, upper = vector(self.ratio_bounds, "ratio_bounds")
        if not -1.0 < lower < upper < 1.0:
            raise InputError(f"must be in order and between -1 and 1, got ({lower:g}, {upper:g})", "ratio_bounds")

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of the reported coefficients of both laws."""
        return (*FREQUENCY_REPORTED.get(self.frequency_law, self.frequency_terms), *DECAY_TERMS[self.law])

    @property
    def frequency_terms(self) -> tuple[str, ...]:
        """Names of the unknowns of the frequency law beside omega."""
        return FREQUENCY_TERMS[self.frequency_law]

    @property
    def smooth(self) -> tuple[SmoothTerms, ...]:
        """Unknowns of the smooth laws."""
        laws = (self.frequency_law, SMOOTH_FREQUENCY), (self.law, SMOOTH_DAMPING)
        return tuple(terms for law, terms in laws if law == "smooth")

    @property
    def frequency_varies(self) -> bool:
        """True if the frequency depends on the amplitude."""
        return self.frequency_law != "constant"

    @property
    def depends_on_amplitude(self) -> bool:
        """True if the frequency or the damping ratio depends on the amplitude."""
        return self.frequency_varies or self.law != "linear"

    @property
    def omega_in_hz(self) -> str:
        """Name of the unknown omega in Hz: the frequency, or that at the amplitude to which the law refers."""
        return FREQUENCY_AT.get(self.frequency_law, "frequency_at_zero")

    def mode_unknowns(self, guess: DecayGuess) -> list[Unknown]:
        """Return the unknowns of the mode."""
        ω, T = guess.ω, guess.duration
        reported = Reported("omega", self.omega_in_hz, "Hz", 1 / (2 * math.pi))
        return [
            Unknown("omega", ω, 1 / T, lower=0.0, unit="rad/s", reported=reported),
            *self._damping(guess),
            *self._bending(guess),
        ]

    def _bending(self, guess: DecayGuess) -> list[Unknown]:
        """Return the unknowns of the frequency law; k begins at 0, or at one turn where it has a second unknown."""
        turn = 1 / (guess.ω * guess.duration)  # relative change of the frequency that turns the phase by 1 rad
        unknowns = (
            Unknown("frequency_slope", 0.0, turn / guess.amplitude, unit=self.unit("frequency_slope")),
            Unknown("frequency_curvature", 0.0, turn / guess.amplitude**2, unit=self.unit("frequency_curvature")),
            Unknown("frequency_change", turn, turn),
            Unknown("frequency_exponent", 1.0, 1.0, *FREQUENCY_EXPONENTS),
            Unknown("frequency_log_slope", turn, turn),
            Unknown("log_corner", -2.0, 1.0, *LOG_CORNERS, curved=True),
            *(Unknown(name, 0.0, max(turn, SMOOTH_FREQUENCY.first_deviation)) for name in SMOOTH_FREQUENCY.names),
        )
        return [unknown for unknown in unknowns if unknown.name in self.frequency_terms]

    def _damping(self, guess: DecayGuess) -> list[Unknown]:
        """Return the unknowns of the damping; each of eta1, eta2, eta0 begins with an equal part of the guess."""
        ω, A, scale, names = guess.ω, guess.amplitude, 1 / (guess.ω * guess.duration), DAMPING_TERMS[self.law]
        if names == ("zeta",):
            # at a ratio of 0, no record would determine the exponent, or relative changes
            lower, upper = self.ratio_bounds if self.law == "linear" else (1e-9, math.inf)
            reported = Reported("zeta", RATIO_AT.get(self.law, "damping_ratio"), "")
            shape = [Unknown("exponent", 1.0, 1.0, *EXPONENTS)] if self.law == "power" else []
            if self.law == "smooth":
                shape = [Unknown(name, 0.0, SMOOTH_DAMPING.first_deviation) for name in SMOOTH_DAMPING.names]
            return [
                Unknown("zeta", min(max(guess.ζ, lower), upper), scale, lower, upper, reported=reported),
                *shape,
            ]
        unit = {"eta1": 2 * ω, "eta2": 3 * math.pi / (4 * A), "eta0": math.pi * ω**2 * A / 2}  # with a ratio of 1
        share = guess.ζ / len(names)
        return [Unknown(n, share * unit[n], scale * unit[n], 0.0, unit=self.unit(n)) for n in names]

    def release_unknowns(self, guess: DecayGuess) -> list[Unknown]:
        """Return the unknowns of a release and its record."""
        A, sensor_amplitude = guess.amplitude, guess.amplitude * guess.ω**self.sensor.derivatives
        unit = self.unit("amplitude")
        reported = Reported("e0", "amplitude", unit)
        release = [
            Unknown("e0", A, A, lower=0.0, unit=unit, reported=reported),
            Unknown("phase", guess.phase, unit="rad"),
        ]
        scales = sensor_amplitude, sensor_amplitude / guess.length, 1 / guess.length
        all_bounds = (-math.inf, math.inf), (-math.inf, math.inf), (0.0, guess.ω / (2 * math.pi))
        return release + [
            Unknown(name, value, scale, *bounds, unit=self.unit(name))
            for name, value, scale, bounds in zip(REST_TERMS[self.rest], guess.rest, scales, all_bounds, strict=False)
        ]

    def curve(self, time: Array, *x: cs.MX) -> cs.MX:
        """Return the record, in the unit of its sensor, at times (s) after the release."""
        ω, damping, frequency_terms, (e0, φ), rest_terms = self._split(x)
        t = phase_time = _column(time)

        def amplitude(instants: cs.MX) -> cs.MX:
            return self._amplitude(instants, e0, ω, damping)

        def change(instants: cs.MX) -> cs.MX:
            return self._phase_change(amplitude(instants), ω, damping, frequency_terms)

        if self.frequency_varies or self.lags:
            phase_time = t + integral(change, time)
        phase = self._damped(ω, damping) * phase_time + φ
        return self._swing(amplitude(t), phase, ω, damping, frequency_terms) + rest_position(t, rest_terms)

    def amplitude(self, time: Array, *x: cs.MX) -> cs.MX:
        """Return the amplitude (m) at times (s) after the release."""
        ω, damping, _, (e0, _), _ = self._split(x)
        return self._amplitude(_column(time), e0, ω, damping)

    def _amplitude(self, time: cs.MX, e0: cs.MX, ω: cs.MX, damping: Symbols) -> cs.MX:
        """Return the amplitude at times (s), which is ``e0`` at the release."""
        if self.law == "linear":
            return e0 * cs.exp(-damping[0] * ω * time)
        if self.law == "friction":
            η1, η2, η0 = damping
            return friction_envelope(time, ω, η0, η1, η2, e0)
        if self.law == "power":
            return power_envelope(time, ω, ω * self._ratio(e0, ω, damping), damping[1], e0)
        if self.law == "smooth":
            instants = time.to_DM().full().ravel()
            return flow_amplitude(lambda A, terms: self._ratio(A, ω, cs.vertsplit(terms)), instants, e0, ω, damping)
        η1, η2 = damping
        return quadratic_envelope(time, ω, η1, η2, e0)

    def unit_changes(self, amplitude: Array, *shape: float) -> list[Array]:
        """Return the relative changes of the frequency at amplitudes (m) for a value of 1 of each linear unknown.

        ``shape`` has the unknown on which the change depends in another way, the exponent or the corner, if any.
        """
        unit_terms = np.eye(len(self.frequency_terms) - len(shape)).tolist()
        columns = ([*map(cs.MX, (*terms, *shape))] for terms in unit_terms)
        return [evaluate(self._change(_column(amplitude), terms)) for terms in columns]

    def term_rates(self, amplitude: Array, ω: float, exponent: float = 1.0) -> list[Array]:
        """Return the rates of decay -A'/A (1/s) at amplitudes (m) for a value of 1 of each of ``DAMPING_TERMS``."""
        ones = np.ones(len(amplitude))
        rates = {
            "zeta": ω * ones * (amplitude / self.reference) ** (exponent - 1),
            "eta1": ones / 2,
            "eta2": 4 * ω * amplitude / (3 * math.pi),
            "eta0": 2 / (math.pi * ω * amplitude),
        }
        return [rates[name] for name in DAMPING_TERMS[self.law]]

    def _change(self, amplitude: cs.MX, frequency_terms: Symbols) -> cs.MX:
        """Return the relative change of the frequency at an amplitude (m)."""
        return frequency_change(self.frequency_law, amplitude, frequency_terms, self.reference, self.span)

    def _phase_change(self, amplitude: cs.MX, ω: cs.MX, damping: Symbols, frequency_terms: Symbols) -> cs.MX:
        """Return the relative change of the rate of the phase at an amplitude (m).

        To second order, damping reduces it by zeta (zeta - A zeta'(A))/2, apart from harmonics.  Friction is left out:
        it matters before the stop alone, where averages mean little.
        """
        change = self._change(amplitude, frequency_terms)
        if not self.lags or self.law == "linear":  # which has the damped frequency
            return change
        A, ones = cs.MX.sym("A", amplitude.shape[0]), cs.DM.ones(amplitude.shape[0])
        law, terms = (replace(self, law="quadratic"), damping[:2]) if self.law == "friction" else (self, damping)
        ratio = law._ratio(A, ω, terms)
        lag = ratio * (ratio - A * cs.jtimes(ratio, A, ones)) / 2
        visible = cs.fmax(amplitude, LEAST_LAGGING * self.reference)
        return change - cs.substitute([lag], [A], [visible])[0]

    def _ratio(self, amplitude: cs.MX, ω: cs.MX, damping: Symbols) -> cs.MX:
        """Return the equivalent damping ratio at an amplitude (m)."""
        if self.law == "linear":
            return damping[0] + 0 * amplitude
        if self.law == "power":
            ζ, p = damping
            return power_ratio(amplitude, ζ, p, self.reference)
        if self.law == "smooth":
            return damping[0] * (1 + smooth_change(amplitude, damping[1:], self.reference, self.span))
        η1, η2, *η0 = damping
        return equivalent_damping_ratio(η1, η2, ω, amplitude, *η0)

    def _coefficients(self, ω: cs.MX, damping: Symbols) -> dict[str, cs.MX]:
        """Return eta1, eta2, eta0, eta_p and the exponent by name; those that the law does not have are 0."""
        if self.law == "linear":
            return {"eta1": 2 * damping[0] * ω, "exponent": cs.MX(math.nan)}
        if self.law == "power":
            ζ, p = damping
            return {"eta_p": power_coefficient(ζ, p, ω, self.reference), "exponent": p}
        return dict(zip(DECAY_TERMS[self.law], damping, strict=False)) | {"exponent": cs.MX(math.nan)}

    def _swing(self, amplitude: cs.MX, phase: cs.MX, ω: cs.MX, damping: Symbols, frequency_terms: Symbols) -> cs.MX:
        """Return the derivative by time that the sensor measures, of A cos(phi).

        With A' = -zeta(A) omega A and phi' = omega (1 + delta(A)),

            velocity        A' cos(phi) - A phi' sin(phi)
            acceleration    (A'' - A phi'^2) cos(phi) - (2 A' phi' + A phi'') sin(phi).
        """
        if not self.sensor.derivatives:
            return amplitude * cs.cos(phase)
        A, ones = cs.MX.sym("A", amplitude.shape[0]), cs.DM.ones(amplitude.shape[0])
        rate = -self._ratio(A, ω, damping) * ω * A
        phase_rate = self._damped(ω, damping) * (1 + self._phase_change(A, ω, damping, frequency_terms))
        second_rate, turn_rate = cs.jtimes(rate, A, ones) * rate, cs.jtimes(phase_rate, A, ones) * rate
        # amplitude relative to the one of reference, below which rates are those of this amplitude
        positive = cs.fmax(amplitude, 1e-12 * self.reference)  # friction divides by the amplitude
        rate, phase_rate, second_rate, turn_rate = cs.substitute(
            [rate, phase_rate, second_rate, turn_rate], [A], [positive]
        )
        if self.sensor.derivatives == 1:
            return rate * cs.cos(phase) - amplitude * phase_rate * cs.sin(phase)
        tangential = 2 * rate * phase_rate + amplitude * turn_rate
        return (second_rate - amplitude * phase_rate**2) * cs.cos(phase) - tangential * cs.sin(phase)

    @property
    def bounds(self) -> dict[str, tuple[float, float]]:
        """Bounds of each quantity by name."""
        bounds = {name: (quantity.lower, quantity.upper) for name, quantity in DECAY_QUANTITIES.items()}
        if self.law == "linear":
            bounds["damping_ratio"] = lowest, _ = self.ratio_bounds
            bounds["eta1"] = (0.0 if lowest >= 0.0 else -math.inf, math.inf)
        return bounds

    def unit(self, name: str) -> str:
        """Return the unit of a quantity: a motion in m takes the unit of the sensor, and so does its rest position."""
        if name in ("offset", "drift"):
            return self.sensor.unit + "/s" * (name == "drift")
        return re.sub(r"\bm\b", self.sensor.motion_unit or "strain", DECAY_QUANTITIES[name].unit)

    def quantities(self, *x: cs.MX) -> cs.MX:
        """Return the quantities of the decay, in the order of ``DECAY_QUANTITIES``."""
        ω, damping, frequency_terms, (amplitude, _), rest_terms = self._split(x)
        at_release = 1 + self._change(amplitude, frequency_terms)  # relative to omega
        quantities = {
            "frequency": ω / (2 * math.pi) * at_release,
            "damping_ratio": self._ratio(amplitude, ω, damping),
            **dict(zip(self.frequency_terms, frequency_terms, strict=True)),
            **self._coefficients(ω, damping),
            "amplitude": amplitude,
            **dict(zip(REST_TERMS[self.rest], rest_terms, strict=True)),
        }
        if self.frequency_law == "power":
            quantities["frequency_change"] = at_release - 1
        if self.frequency_law == "smooth":  # within the measured amplitudes, beyond which it says nothing
            lowest = cs.MX(self.lowest or self.reference / self.span)
            quantities["frequency_change"] = at_release / (1 + self._change(lowest, frequency_terms)) - 1
        if self.frequency_law == "logarithmic":
            quantities["frequency_log_slope"] /= 1 + self._change(cs.MX(0), frequency_terms)
            quantities["corner_amplitude"] = self.reference * cs.exp(frequency_terms[1])
        return cs.vertcat(*(quantities.get(name, cs.MX(0)) for name in DECAY_QUANTITIES))

    def against_amplitude(self, amplitude: Array | cs.MX, *x: cs.MX) -> tuple[cs.MX, cs.MX]:
        """Return equivalent damping ratio and frequency (Hz) at amplitudes (m), which are positive."""
        ω, damping, frequency_terms, *_ = self._split(x)
        A = amplitude if isinstance(amplitude, cs.MX) else _column(amplitude)
        return self._ratio(A, ω, damping), ω / (2 * math.pi) * (1 + self._change(A, frequency_terms))

    def _damped(self, ω: cs.MX, damping: Symbols) -> cs.MX:
        """Return the frequency of the oscillation, rad/s: with linear damping the damped one, as in Eq. (9)."""
        return ω * cs.sqrt(1 - damping[0] ** 2) if self.law == "linear" else ω

    def _split(self, x: Symbols) -> tuple[cs.MX, Symbols, Symbols, Symbols, Symbols]:
        """Return omega, damping, bending, release and rest position."""
        release = len(x) - 2 - len(REST_TERMS[self.rest])
        damping_end = release - len(self.frequency_terms)
        return x[0], x[1:damping_end], x[damping_end:release], x[release : release + 2], x[release + 2 :]


def evaluate(expression: cs.MX) -> Array:
    """Return the values (m,) of an expression without symbols."""
    return np.asarray(cs.evalf(expression)).ravel()


def _column(values: Array) -> cs.MX:
    return cs.MX(cs.DM(values))


def with_priors(unknowns: Sequence[Unknown], priors: Priors, model: DecayModel) -> list[Unknown]:
    """Return the unknowns with their priors, which may also be stated of the frequency and the damping ratio."""
    factors = {unknown.name: (unknown.name, 1.0) for unknown in unknowns} | {"omega": (model.omega_in_hz, 2 * math.pi)}
    if model.law == "linear":
        factors["zeta"] = ("damping_ratio", 1.0)
    check_keys(dict(priors), set(), {*factors, *(name for name, _ in factors.values())} - {"omega", "zeta"}, "priors")
    stated = []
    for unknown in unknowns:
        name, factor = factors[unknown.name]
        if name in priors:
            scaled = with_prior(replace(unknown, name=name), priors[name])
            mean, std = scaled.prior or (0.0, 1.0)
            std = std if scaled.relative_prior else factor * std
            unknown = replace(unknown, prior=(factor * mean, std), relative_prior=scaled.relative_prior)
        stated.append(unknown)
    return stated
