"""A simulated experiment: a mode of a beam is driven at the clamp, stopped, and decays.

The excitation and its stop move other modes too.  The motion is therefore projected on the driven mode,
phi^T M (e - e_rest), as several markers would allow, and Eq. (9) is fitted to this part; the frequency may depend on
the square of the amplitude.

Linear theory gives the base amplitude A for the requested tip amplitude at the stop.  At resonance, a mode of damping
ratio zeta and participation Gamma = phi_tip phi^T M u, with u the unit horizontal motion of the beam, grows as

    Gamma A/(2 zeta) (1 - exp(-zeta omega t)).

While the amplitude of the base grows from 0 to A, over a ramp of some cycles, t counts from the middle of the ramp.

The frequency of the higher modes falls with the square of the amplitude, so that a drive of constant frequency loses
the resonance where the relative change of frequency exceeds the damping ratio.  The motion then stays below the
requested amplitude: the amplitude that is reached is a result.

References
----------
"Comparison of external damping models in a large deformation problem", Section 5.2.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from ancf_casadi.decay.envelope import DampingCurve, damping_curve
from ancf_casadi.dynamics.base_motion import HarmonicBase
from ancf_casadi.dynamics.simulation import Method, simulate
from ancf_casadi.dynamics.trajectory import Trajectory
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.model import Model
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import error_prefix, whole
from ancf_casadi.support.specs import UNLISTED, Positive
from ancf_casadi.vibration.modes import Modes, natural_modes
from problems.decay.fitting import fit_decay
from problems.spec.beam import make_law
from problems.study.drawing import band
from problems.study.step import LawChoice, Study, Terms

EXPERIMENT_TOLERANCE = 1e-4  # of the integrator, over the tip amplitude relative to the length
IDAS_RATIO = 0.04  # tolerance of IDAS_RATIO relative to that of Radau, for errors of the same size
PERIOD_SAMPLES = 40  # per period
FEWEST_MODES = 5
EXPERIMENT_STEPS, QUICK_STEPS = 24, 12  # least number of integrator steps per period of the excitation
QUICK_DRIVING = 0.03  # time of excitation in a quick look relative to the given one
QUICK_WINDOW = 0.3  # length of a fitted decay in a quick look relative to the full one


@dataclass(frozen=True)
class RequestedRun:
    """An excitation, and the laws under which it is simulated; 0 or nan for what is not given."""

    mode: Annotated[int, Meta(ge=1)]
    amplitude: Annotated[Positive, Meta(description="m, at the tip when it stops")]
    stop: Annotated[Positive, Meta(description="s")]
    frequency: Annotated[Positive, Meta(description="Hz, if not that of the mode")] = 0.0
    ramp: Annotated[Positive, Meta(description="cycles in which the amplitude grows")] = 0.0
    window: Annotated[Positive, Meta(description="s, of the fitted decay")] = 0.0
    laws: tuple[LawChoice, ...] = ()
    measured_ratio: float = math.nan
    relative_window: Annotated[float, UNLISTED] = 1.0  # length of the fitted decay relative to the full one
    steps_per_period: Annotated[int, UNLISTED] = EXPERIMENT_STEPS

    def shorten(self) -> RequestedRun:
        """Return the run of a quick look."""
        return replace(self, stop=QUICK_DRIVING * self.stop, ramp=QUICK_DRIVING * self.ramp,
                       relative_window=QUICK_WINDOW, steps_per_period=QUICK_STEPS)  # fmt: skip

    def check(self, study: Study, where: str) -> None:
        """Check the run."""
        whole(self.mode, f"{where}: mode", 1, study.model.freedoms)
        if not self.laws:
            raise InputError("name at least one of [[laws]]", f"{where}: laws")
        with error_prefix(where):
            if self.ramp and self.frequency:
                HarmonicBase(1.0, self.frequency, self.stop, ramp=self.ramp)


@dataclass(frozen=True)
class ExperimentResult:
    """The result of a simulated experiment, as plain data."""

    numbers: dict[str, Any]  # as in ``results.json``
    motion: Array  # (3, k): times, s, and extremes of the tip displacement relative to the clamp, m, of the whole run
    stop_time: Array  # times around the stop, relative to it, s
    stop_motion: Array  # tip displacement relative to the clamp at these times, m
    decay_time: Array  # times after the stop, s
    decay: Array  # tip displacement in the mode at these times, m
    shapes: Array  # (13, 41, 2): positions of points along the beam, m, over the last period before the stop


def run_experiment(beam: Beam, terms: Terms, run: RequestedRun, method: Method = "radau") -> ExperimentResult:
    """Simulate the experiment of a run under a law, and fit its decay."""
    modes = natural_modes(Model(beam), count=max(FEWEST_MODES, run.mode))
    law = make_law(terms, modes.model, "damping")
    mode = run.mode - 1

    def ratio(amplitude: float) -> float:
        return 0.0 if law is None else float(law.damping_ratios(modes, [amplitude] * modes.count)[mode])

    base, window = _excitation(run, modes, ratio(run.amplitude))
    size = run.amplitude / beam.length
    tolerance = min(EXPERIMENT_TOLERANCE * size, 1e-5) * (IDAS_RATIO if method == "idas" else 1.0)  # largest tolerance
    trajectory = simulate(
        modes.model,
        duration=base.stop_time + 2 / base.frequency + window,  # two periods between the stop and the fit
        damping=law,
        base=base,
        sample_rate=PERIOD_SAMPLES * base.frequency,
        method=method,
        tolerance=tolerance,
        largest_step=1 / (run.steps_per_period * base.frequency),
    )
    motion = modes.modal_coordinate(trajectory.relative_coordinates, mode)
    after = trajectory.time >= trajectory.time[-1] - window
    decay = Measurement(trajectory.time[after], motion[after])
    fit = fit_decay(
        decay,
        release_time=float(decay.time[0]),
        ratio_bounds=(-0.1, 0.9),
        frequency_law="constant" if law is None else "quadratic",
    )
    half_way = (decay.time[-1] - decay.time[0]) / 2
    amplitude = fit.amplitude * math.exp(-fit.damping_ratio * 2 * math.pi * fit.frequency * half_way)
    end = int(np.searchsorted(trajectory.time, base.stop_time))
    across = (trajectory.tip - trajectory.base)[:, 0]
    across = across - across[0]
    # six periods before and after the stop are drawn in detail
    near = np.abs(trajectory.time - base.stop_time) <= 6 / base.frequency
    numbers = {
        "mode": run.mode,
        "requested_amplitude_m": run.amplitude,
        # tip amplitude of the mode at the stop
        "reached_amplitude_m": float(np.abs(motion[max(0, end - PERIOD_SAMPLES) : end]).max()),
        "base_amplitude_m": base.amplitude,
        "drive_hz": run.frequency or float(modes.frequencies[mode]),
        "natural_frequency_hz": float(modes.frequencies[mode]),
        "stop_s": base.stop_time,
        "amplitude_m": amplitude,  # half-way through the fitted decay, for frequency and damping ratios
        "frequency_hz": fit.frequency * (1 + fit.frequency_curvature * amplitude**2),
        "damping_ratio": fit.damping_ratio,
        "damping_ratio_stderr": fit.standard_errors["damping_ratio"],
        "expected_damping_ratio": ratio(amplitude),
        "steps": trajectory.steps,
    }
    return ExperimentResult(
        numbers=numbers,
        motion=band(trajectory.time, across, base.frequency),
        stop_time=trajectory.time[near] - base.stop_time,
        stop_motion=across[near],
        decay_time=decay.time,
        decay=decay.values,
        shapes=_shapes(trajectory, end),
    )


def decay_curve(result: ExperimentResult) -> DampingCurve:
    """Return damping ratio and frequency in windows of the decay of an experiment."""
    decay = Measurement(result.decay_time, result.decay)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return damping_curve(decay, release_time=float(decay.time[0]))


def _excitation(run: RequestedRun, modes: Modes, ratio: float) -> tuple[HarmonicBase, float]:
    """Return the base motion and the length of the fitted decay, given the damping ratio at the requested amplitude."""
    mode = run.mode - 1
    ω = float(modes.angular_frequencies[mode])
    frequency = run.frequency or ω / (2 * math.pi)
    unit = HarmonicBase(amplitude=1.0, frequency=frequency, stop=run.stop, ramp=run.ramp)
    driven = unit.stop_time - unit.ramp / (2 * frequency)  # until the first instant of zero velocity after the stop
    growth = -math.expm1(-ratio * ω * driven) / (2 * ratio) if ratio else ω * driven / 2
    base = replace(unit, amplitude=run.amplitude / (participation(modes, mode) * growth))
    halving = math.log(2) * base.frequency / (ratio * ω) if ratio else math.inf  # periods
    periods = run.window * base.frequency or min(halving, 70)  # periods of a fitted decay
    return base, max(run.relative_window * periods, 8) / base.frequency


def participation(modes: Modes, mode: int) -> float:
    """Return Gamma = phi_tip phi^T M u, the tip amplitude of the mode per unit horizontal base motion."""
    model = modes.model
    mass = model.mass(model.properties).sparse()
    horizontal = np.tile([1.0, 0.0, 0.0, 0.0], model.size // 4)
    return float(abs(modes.shapes[:, mode] @ (mass @ horizontal)) * modes.tip_amplitudes()[mode])


def _shapes(run: Trajectory, end: int) -> Array:
    """Return points along the beam at 13 instants of the period that ends at a sample."""
    rows = np.linspace(max(0, end - PERIOD_SAMPLES), end, 13).astype(int)
    snapshots = run.at(run.time[rows])
    arcs = np.linspace(0.0, run.model.beam.length, 41).tolist()
    return np.stack([snapshots.position(arc) for arc in arcs], axis=1)
