"""Effect of eta1 and eta2 on a free decay, on the beam and by Eq. (27): Figures 12 to 16, Tables 5 to 7.

The beam is weightless, and its elastic modulus is scaled to a given first frequency f.  Point loads at its nodes,
proportional to the inertia forces of mode 1, bend it until the tip is displaced by e0, and then disappear.  For small
e0 the start is mode 1 itself; being an equilibrium, it does not stretch the beam (a linear mode shape of finite
amplitude would).  At e0 = 76 mm on 500 mm the tip displacement of mode 2 is 0.1 % of that of mode 1; after a uniform
load it would be 1.5 %, after a force at the tip 2.4 %.

Radau integrates the motion: the sudden release moves the mesh too, and the default integrator changes to Radau within
the first millisecond.  With ``EFFECTS_TOLERANCE`` and ``LEAST_STEPS``, amplitudes are within 0.05 % of those at a 300
times smaller tolerance, down to ``LEAST_AMPLITUDE``.

The envelope on the beam consists of the peaks of the tip displacement across the beam, that by the formula is a(t) of
Eq. (27) with f and e0.  The motion by the formula starts at rest, unlike Eq. (27) as printed:

    e(t) = a(t) cos(omega t + phi)/cos phi,    tan phi = -(eta1/2 + 4 omega eta2 e0/(3 pi))/omega.

The characteristics in words of Table 6 follow from the mean decay rates over the first seconds, ln(A(0)/A(t))/t at
t = ``HORIZON``.  Of two laws, the gross motion decays rapidly under the one whose rate is larger at every frequency.  A
law is independent of the frequency if its rates differ by less than ``EQUAL_RATES``, and controls the residual motion
if less than ``SETTLED_AMPLITUDE`` of the amplitude is left at t, at every frequency.

References
----------
"Comparison of external damping models in a large deformation problem", Section 4.2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as cs
import numpy as np
import scipy  # its packages are imported on first use

from ancf_casadi.damping import QuadraticDamping
from ancf_casadi.decay.closed_forms import equivalent_damping_ratio, quadratic_envelope
from ancf_casadi.decay.envelope import damping_curve
from ancf_casadi.dynamics.simulation import simulate
from ancf_casadi.exceptions import EquilibriumError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.loads import PointLoad
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Array, maxima
from ancf_casadi.support.tables import finite_or_none
from ancf_casadi.vibration.equilibrium import Equilibrium
from ancf_casadi.vibration.modes import Modes, natural_modes
from ancf_casadi.vibration.statics import static_equilibrium
from problems.paper.inputs import STANDARD_BEAM
from problems.study.compute import Compute
from problems.study.kinds.experiment import QUICK_STEPS, QUICK_WINDOW

EFFECTS_TOLERANCE, LEAST_STEPS = 1e-5, 24  # tolerance of the integrator, and its least number of steps per period
HORIZON = 5.0  # s, after which the paper finds the vibration under eta1 to have disappeared
EQUAL_RATES = 0.1  # relative difference of decay rates
SETTLED_AMPLITUDE = 0.02  # of the amplitude at the start
LEAST_AMPLITUDE = 1e-5  # m, least amplitude that the simulation resolves on a beam of half a metre


class QuadraticLaw(NamedTuple):
    """A quadratic law with its names in results and in figures."""

    name: str
    title: str
    eta1: float  # 1/s
    eta2: float  # 1/m

    @property
    def about(self) -> str:
        """Title and coefficients, for a caption."""
        return f"{self.title} (η1 = {self.eta1:.3g} 1/s, η2 = {self.eta2:.3g} 1/m)"


@dataclass(frozen=True, eq=False)
class Envelope:
    """Amplitude of a decay over time."""

    time: Array  # (k,), s
    amplitude: Array  # (k,), m, positive

    def at(self, time: Any) -> Any:
        """Return the amplitude at times (s), m; nan after the end.  Between samples the decay is exponential."""
        return np.exp(np.interp(time, self.time, np.log(self.amplitude), right=math.nan))

    def time_to(self, fraction: float) -> float:
        """Return the first time (s) at which a fraction of the first amplitude is left; nan if more is left."""
        decrease = math.log(self.amplitude[0]) - np.minimum.accumulate(np.log(self.amplitude))
        return float(np.interp(-math.log(fraction), decrease, self.time, right=math.nan))


@dataclass(frozen=True, eq=False)
class SimulatedDecay:
    """A simulated free decay beside Eq. (27)."""

    law: QuadraticDamping
    frequency: float  # first natural frequency f, Hz
    time: Array  # (k,), s
    tip: Array  # displacement of the tip across the beam, (k,), m
    formula_tip: Array  # the same by the formula
    envelope: Envelope  # amplitude on the beam
    formula: Envelope  # amplitude by the formula
    other_modes: float  # tip displacement of mode 2 at the start, relative to that of mode 1
    steps: int  # of the integrator


def decay_duration(compute: Compute, duration: float) -> float:
    """Return the duration of a decay, s, which is shorter in a quick look."""
    return QUICK_WINDOW * duration if compute.quick else duration


def simulate_decays(
    compute: Compute, laws: Sequence[QuadraticLaw], frequencies: Sequence[float], amplitude: float, duration: float
) -> list[list[SimulatedDecay]]:
    """Simulate the decay of the standard beam under each law at each frequency; return the decays law by law."""
    steps, duration = QUICK_STEPS if compute.quick else LEAST_STEPS, decay_duration(compute, duration)
    inputs = []
    for law in laws:
        damping = QuadraticDamping(law.eta1, law.eta2)
        inputs += [(STANDARD_BEAM, damping, frequency, amplitude, duration, steps) for frequency in frequencies]
    results = iter(compute.all(simulate_decay, inputs))
    return [[next(results) for _ in frequencies] for _ in laws]


def decay_numbers(law: QuadraticLaw, decay: SimulatedDecay, times: Sequence[float]) -> dict[str, Any]:
    """Return the numbers of a decay for ``results.json``: None for what the decay does not reach."""
    return {
        "law": law.name,
        "frequency_hz": decay.frequency,
        "eta1": law.eta1,
        "eta2_per_m": law.eta2,
        "start_amplitude_m": float(decay.tip[0]),
        "mode_2_at_the_start": decay.other_modes,
        "time_to_a_tenth_s": finite_or_none(decay.envelope.time_to(0.1)),
        "time_to_a_tenth_by_formula_s": finite_or_none(decay.formula.time_to(0.1)),
        "times_s": list(times),
        "amplitude_m": list(map(finite_or_none, decay.envelope.at(times))),
        "amplitude_by_formula_m": list(map(finite_or_none, decay.formula.at(times))),
        "steps": decay.steps,
    }


def simulate_decay(
    beam: Beam,
    law: QuadraticDamping,
    frequency: float,
    amplitude: float = 0.076,
    duration: float = 15.0,
    steps_per_period: int = LEAST_STEPS,
) -> SimulatedDecay:
    """Simulate the free decay of a beam in its first mode, and compute it by Eq. (27).

    Gravity is left out, and the elastic modulus scaled to the first natural frequency, Hz.  The tip starts at an
    amplitude, m, across the beam; the motion lasts one period longer than the duration, s, of the envelopes.
    """
    modes = natural_modes(Model(tune_beam(beam, frequency)), count=2)
    start = displace_tip(modes, amplitude)
    run = simulate(
        modes.model,
        damping=law,
        start=start,
        duration=duration + 1 / frequency,  # so that the last peak lies beyond the end
        sample_rate=40 * frequency,  # samples per period
        tolerance=EFFECTS_TOLERANCE,
        largest_step=1 / (steps_per_period * frequency),
    )
    tip, ω = run.tip @ _across(modes), 2 * math.pi * frequency
    first, second = (abs(float(modes.modal_coordinate(start.coordinates, mode))) for mode in range(2))
    φ = -math.atan(float(equivalent_damping_ratio(*map(cs.DM, (law.eta1, law.eta2, ω, amplitude)))))
    amplitudes = quadratic_envelope(cs.DM(run.time), *map(cs.DM, (ω, law.eta1, law.eta2, amplitude))).full().ravel()
    return SimulatedDecay(
        law=law,
        frequency=frequency,
        time=run.time,
        tip=tip,
        formula_tip=amplitudes * np.cos(ω * run.time + φ) / math.cos(φ),
        envelope=peaks(run.time, tip),
        formula=Envelope(run.time, amplitudes),
        other_modes=second / first,
        steps=run.steps,
    )


def tune_beam(beam: Beam, frequency: float) -> Beam:
    """Return the weightless beam with the elastic modulus that gives it a first natural frequency, Hz."""
    weightless = beam.with_(gravity=(0.0, 0.0))
    natural = float(natural_modes(Model(weightless), count=1).frequencies[0])
    return weightless.with_(elastic_modulus=tuple(np.array(beam.elastic_modulus) * (frequency / natural) ** 2))


def displace_tip(modes: Modes, amplitude: float) -> Equilibrium:
    """Return the weightless beam at rest under loads like the inertia of mode 1, its tip displaced across (m)."""
    model = modes.model
    nodes = model.mass(model.properties).sparse() @ modes.shapes[:, 0] / modes.tip_amplitudes()[0]
    forces = nodes.reshape(-1, NODE)[1:, :2] * modes.angular_frequencies[0] ** 2  # per tip displacement
    points = np.linspace(0.0, model.beam.length, model.beam.elements + 1)[1:]

    def bend(factor: float) -> Equilibrium:
        loads = zip((factor * forces).tolist(), points.tolist(), strict=True)
        return static_equilibrium(model, loads=[PointLoad((fx, fy), point=s) for (fx, fy), s in loads])

    solution = scipy.optimize.root_scalar(
        lambda factor: float(bend(factor).tip @ _across(modes)) - amplitude,
        method="secant", x0=amplitude, x1=1.02 * amplitude, xtol=1e-7 * amplitude,
    )  # fmt: skip
    if not solution.converged:
        raise EquilibriumError(f"no load was found that displaces the tip by {amplitude:g} m; start with less")
    return bend(float(solution.root))


def peaks(time: Array, displacement: Array) -> Envelope:
    """Return the envelope through the turning points of an oscillation about 0, from its start at a turning point."""
    size = np.abs(displacement)
    at = maxima(size)
    before, sample, after = size[at - 1], size[at], size[at + 1]
    shift = (before - after) / (2 * (before - 2 * sample + after))  # of a parabola through three samples
    top = sample - (before - after) * shift / 4
    return Envelope(np.append(time[0], time[at] + shift * (time[1] - time[0])), np.append(size[0], top))


def ratios_over_time(decay: SimulatedDecay) -> tuple[Array, Array, Array]:
    """Return times (s), and the damping ratio then: in windows of the simulated motion, and by the formula."""
    curve = damping_curve(Measurement(decay.time, decay.tip), release_time=float(decay.time[0]))
    inputs = decay.law.eta1, decay.law.eta2, 2 * math.pi * decay.frequency, decay.formula.at(curve.time)
    return curve.time, curve.damping_ratio, equivalent_damping_ratio(*map(cs.DM, inputs)).full().ravel()


def crossing(first: Envelope, second: Envelope) -> float:
    """Return the time (s) after the start at which two envelopes cross; nan if they do not."""

    def difference(time: Any) -> Any:
        return np.log(first.at(time) / second.at(time))

    grid = np.linspace(first.time[0], min(first.time[-1], second.time[-1]), 1000)[1:]
    changes = np.flatnonzero(np.diff(np.sign(difference(grid))))
    if not len(changes):
        return math.nan
    return float(scipy.optimize.brentq(difference, *grid[changes[0] : changes[0] + 2]))


def _across(modes: Modes) -> Array:
    """Return the unit vector across the beam, in the direction of mode 1 at the tip, (2,)."""
    across = np.array(modes.model.beam.across)
    tip = modes.model.interpolation(modes.model.beam.length) @ modes.shapes[:, 0]
    return across * np.sign(across @ tip)


def characteristics(
    first: Sequence[Envelope], second: Sequence[Envelope], horizon: float = HORIZON
) -> tuple[dict[str, Any], ...]:
    """Return the rows of Table 6 for two laws, from decays at the same frequencies that last until t, s.

    A row has the words, the mean decay rates (1/s), and the parts of the amplitude that are left, at each frequency.
    The gross motion is undecided if neither law is faster at every frequency.
    """
    amplitudes_left = [tuple(float(e.at(horizon) / e.amplitude[0]) for e in envelopes) for envelopes in (first, second)]
    rates = [tuple(-math.log(left) / horizon for left in lefts) for lefts in amplitudes_left]
    faster = {a >= b for a, b in zip(*rates, strict=True)}  # first law, at each frequency
    motions = {(True,): ("rapid decay", "slow decay"), (False,): ("slow decay", "rapid decay")}
    gross_motions = motions.get(tuple(faster), ("undecided", "undecided"))
    return tuple(
        {
            "gross_motion": gross_motion,
            "frequency": "independent" if max(law_rates) < (1 + EQUAL_RATES) * min(law_rates) else "dependent",
            "residual_motion": "controllable" if max(lefts) < SETTLED_AMPLITUDE else "uncontrollable",
            "decay_rates": list(law_rates),
            "left": list(lefts),
        }
        for gross_motion, law_rates, lefts in zip(gross_motions, rates, amplitudes_left, strict=True)
    )
