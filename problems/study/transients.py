"""The simulated experiments of Table 11: each mode of the matched beam is driven, stopped, and decays.

The base drives the beam at the natural frequency of a mode until the stop time of the paper, and the beam then decays
under one of the three damping laws.  The excitation and its stop move other modes too.  The motion is therefore
projected on the driven mode, phi^T M (e - e_rest), as several markers would allow, and Eq. (9) is fitted to this part.

Linear theory gives the base amplitude A for a chosen tip amplitude at the stop.  At resonance, a mode of damping ratio
zeta and participation Gamma = phi_tip phi^T M u, with u the unit horizontal motion of the beam, grows as

    Gamma A/(2 zeta) (1 - exp(-zeta omega t)).

The frequencies of the higher modes fall with the square of the amplitude.  The tip amplitudes are small enough to keep
the modes at resonance.

References
----------
"Comparison of external damping models in a large deformation problem", Section 5.2.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import numpy as np

from ancf_casadi.damping import DampingLaw, ModalDamping, QuadraticDamping, RayleighDamping
from ancf_casadi.dynamics.base_motion import HarmonicBase
from ancf_casadi.dynamics.simulation import simulate
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.support.parallel import run_all
from ancf_casadi.vibration.modes import Modes
from problems.decay.fitting import fit_decay
from problems.decay.proportional import RayleighFit
from problems.study import paper

TIP_AMPLITUDES = (0.076, 0.004, 0.0015, 0.0007, 0.00045)  # m, intended at the stop
WINDOWS = (6.0, 4.0, 2.0, 1.2, 0.8)  # s, longest decay fitted
LARGE = 0.005  # tip amplitude, relative to the length, above which the tolerance grows no further
SETTLING = 2  # periods between the stop and the fit
SAMPLES = 40  # per period
LAW_NAMES = {"generic": "modal (generic)", "proportional": "Rayleigh (proportional)", "quadratic": "quadratic"}
UNDAMPED = "undamped"
UNDAMPED_DRIVING = 0.1  # longest excitation without damping, relative to that in the paper


@dataclass(frozen=True)
class Effort:
    """Accuracy and length of the simulated experiments.

    Parameters
    ----------
    accuracy : float
        Tolerance of the simulation over the tip amplitude relative to the length (at most ``LARGE``).
    driving : float
        Excitation time relative to that in the paper.
    window : float
        Length of the fitted decays relative to ``WINDOWS``.
    """

    accuracy: float
    driving: float
    window: float


FULL = Effort(accuracy=4e-6, driving=1.0, window=1.0)
QUICK = Effort(accuracy=2e-5, driving=0.1, window=0.4)


@dataclass(frozen=True)
class Transient:
    """One experiment to simulate: a mode under a damping law.

    Parameters
    ----------
    modes : Modes
        Modes of the beam.
    mode : int
        Index of the driven mode, from 0.
    name : str
        Key of the damping law in ``LAW_NAMES``, or ``UNDAMPED``.
    law : DampingLaw or None
        The damping law.
    base : HarmonicBase
        The excitation.
    window : float
        Length of the fitted decay, s.
    tolerance : float
        Tolerance of the simulation.
    """

    modes: Modes
    mode: int
    name: str
    law: DampingLaw | None
    base: HarmonicBase
    window: float
    tolerance: float

    @property
    def duration(self) -> float:
        """Simulated time, s."""
        return self.base.stop_time + SETTLING / self.base.frequency + self.window


@dataclass(frozen=True)
class TransientResult:
    """The result of one simulated experiment.

    Parameters
    ----------
    mode : int
        Index of the driven mode, from 0.
    name : str
        Key of the damping law in ``LAW_NAMES``, or ``UNDAMPED``.
    base_amplitude : float
        Amplitude of the excitation, m.
    amplitude : float
        Tip amplitude of the mode half-way through the fitted decay, m.
    frequency, damping_ratio : float
        Fitted frequency, Hz, and damping ratio.
    expected_ratio : float
        Damping ratio that the law predicts at this amplitude.
    motion : Measurement
        Displacement of the tip relative to the clamp, across the beam.
    decay : Measurement
        Tip displacement in the mode, over the fitted decay.
    steps : int
        Number of integrator steps.
    seconds : float
        Computing time of the simulation, s.
    """

    mode: int
    name: str
    base_amplitude: float
    amplitude: float
    frequency: float
    damping_ratio: float
    expected_ratio: float
    motion: Measurement
    decay: Measurement
    steps: int
    seconds: float


def damping_laws(modes: Modes, rayleigh: RayleighFit) -> dict[str, DampingLaw]:
    """Return the laws of Table 11, from the ratios of all modes, of modes 1 and 2, and eta1 and eta2 of mode 1."""
    laws = (
        ModalDamping(modes, paper.DAMPING_RATIOS, frequencies=paper.FREQUENCIES),
        RayleighDamping(alpha=rayleigh.alpha, beta=rayleigh.beta, stiffness="tangent"),
        QuadraticDamping(eta1=paper.ETA1[0], eta2=paper.ETA2[0]),
    )
    return dict(zip(LAW_NAMES, laws, strict=True))


def plan(modes: Modes, laws: Mapping[str, DampingLaw], effort: Effort) -> list[Transient]:
    """Return the experiments: each mode under each law, and undamped to show the numerical damping."""
    return [
        _experiment(modes, mode, name, law, effort)
        for mode in range(modes.count)
        for name, law in {**laws, UNDAMPED: None}.items()
    ]


def run_transients(
    transients: list[Transient], jobs: int, executor: Executor | None, progress: bool
) -> list[TransientResult]:
    """Run the experiments, the longest first, and return their results in the given order."""
    calls = [partial(run_transient, transient) for transient in transients]
    periods = [transient.duration * transient.base.frequency for transient in transients]
    return run_all(calls, executor=executor, jobs=jobs, sizes=periods, progress=progress, title="transients")


def run_transient(transient: Transient) -> TransientResult:
    """Simulate one experiment and fit its decay.

    Raises
    ------
    SimulationError, FitError
        If the integration or the fit fails.
    """
    modes, mode, base = transient.modes, transient.mode, transient.base
    run = simulate(
        modes.model,
        duration=transient.duration,
        damping=transient.law,
        base=base,
        sample_rate=SAMPLES * base.frequency,
        method="idas",
        tolerance=transient.tolerance,
    )
    if run.interrupted:
        raise KeyboardInterrupt
    after = run.time >= run.time[-1] - transient.window
    decay = Measurement(run.time[after], modes.modal_coordinate(run.relative_coordinates[after], mode))
    fit = fit_decay(decay, release_time=float(decay.time[0]), ratio_bounds=(-0.1, 0.9))
    omega = 2 * math.pi * fit.frequency
    half_way = (decay.time[-1] - decay.time[0]) / 2
    amplitude = fit.amplitude * math.exp(-fit.damping_ratio * omega * half_way)
    expected = 0.0
    if transient.law is not None:
        expected = float(transient.law.damping_ratios(modes, [amplitude] * modes.count)[mode])
    return TransientResult(
        mode=mode,
        name=transient.name,
        base_amplitude=base.amplitude,
        amplitude=amplitude,
        frequency=fit.frequency,
        damping_ratio=fit.damping_ratio,
        expected_ratio=expected,
        motion=Measurement(run.time, (run.tip - run.base)[:, 0]),
        decay=decay,
        steps=run.steps,
        seconds=run.wall_seconds,
    )


def _experiment(modes: Modes, mode: int, name: str, law: DampingLaw | None, effort: Effort) -> Transient:
    frequency, omega = float(modes.frequencies[mode]), float(modes.angular_frequencies[mode])
    tip_amplitude = TIP_AMPLITUDES[mode]
    ratio = 0.0 if law is None else float(law.damping_ratios(modes, TIP_AMPLITUDES)[mode])
    driving = paper.STOPS[mode] * (effort.driving if law is not None else min(effort.driving, UNDAMPED_DRIVING))
    growth = -math.expm1(-ratio * omega * driving) / (2 * ratio) if ratio else omega * driving / 2
    base_amplitude = tip_amplitude / (_participation(modes, mode) * growth)
    window = WINDOWS[mode] * effort.window
    if ratio:
        window = min(window, math.log(2) / (ratio * omega))
    return Transient(
        modes=modes,
        mode=mode,
        name=name,
        law=law,
        base=HarmonicBase(amplitude=base_amplitude, frequency=frequency, stop=driving),
        window=window,
        tolerance=effort.accuracy * min(tip_amplitude / modes.model.beam.length, LARGE),
    )


def _participation(modes: Modes, mode: int) -> float:
    """Return Gamma = phi_tip phi^T M u, the tip amplitude of the mode per unit horizontal base motion."""
    model = modes.model
    mass = model.mass(model.properties).sparse()
    horizontal = np.tile([1.0, 0.0, 0.0, 0.0], model.beam.elements + 1)
    return float(abs(modes.shapes[:, mode] @ (mass @ horizontal)) * modes.tip_amplitudes()[mode])
