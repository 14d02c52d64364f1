"""The paper's study, end to end: decays to modal parameters, to damping laws, to a matched beam, to its large motion.

1. Table 2.  Free decays of five modes, Eq. (9), are identified.  No raw record was published, so they are synthetic,
   with seeded noise.
2. Table 3.  Proportional damping from the first two modes, Eq. (17).
3. Table 4.  Quadratic damping of each mode from decays after Eq. (27), synthetic as well.
4. Tables 9 and 10.  The hanging beam of Table 1 is matched to the frequencies of Table 2.
5. Table 11.  The matched beam is driven at each mode in turn, stopped, and left to decay, under each of the three laws.
   The motion is projected on the mode, phi^T M (e - e_rest), as several markers would allow, because the others are
   excited too; Eq. (9) is fitted to what is left.

Each drive is as strong as linear theory asks for a chosen tip amplitude at the stop: at resonance a mode of damping
ratio zeta and participation Gamma = phi_tip phi^T M u grows like Gamma A/(2 zeta) (1 - exp(-zeta omega t)).  The
amplitudes are small enough for the frequency of the higher modes, which falls with the square of the amplitude, to stay
within the resonance.
Steps 2 to 5 start from the numbers the paper prints, not from step 1, which tells whether its method finds them.

References
----------
"Comparison of external damping models in a large deformation problem", Sections 3 to 5.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import casadi as cs
import numpy as np

from ancf_casadi.damping import DampingLaw, ModalDamping, QuadraticDamping, RayleighDamping
from ancf_casadi.decay.closed_forms import linear_decay, quadratic_decay
from ancf_casadi.decay.measurement import Measurement
from ancf_casadi.dynamics.base_motion import HarmonicBase
from ancf_casadi.dynamics.simulation import simulate
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.parallel import run_all
from ancf_casadi.vibration.modes import Modes, natural_modes
from problems.decay.fitting import fit_decay
from problems.decay.proportional import RayleighFit, fit_rayleigh
from problems.decay.result import DecayFit
from problems.matching.frequency_matching import match_frequencies
from problems.matching.result import FrequencyMatch
from problems.study import paper

SEED = 20
FRAME_RATE = 500.0  # frames a second, not given in the paper
RECORD = 5.0  # s
NOISE = 0.2e-3  # m, standard deviation
START_AMPLITUDES = (0.050, 0.015, 0.008, 0.005, 0.005)  # m, of the decays of Table 2

TIP_AMPLITUDES = (0.076, 0.004, 0.0015, 0.0007, 0.00045)  # m, asked for at the stop
WINDOWS = (6.0, 4.0, 2.0, 1.2, 0.8)  # s, longest decay fitted
LARGE = 0.005  # of the length: an amplitude whose motion needs no looser tolerance
SETTLING = 2  # periods between the stop and the fit
SAMPLES = 40  # a period
LAWS = ("generic", "proportional", "quadratic")
UNDAMPED = "undamped"
UNDAMPED_DRIVING = 0.1  # of the excitations in the paper


@dataclass(frozen=True)
class Effort:
    """How much work goes into the transients.

    Parameters
    ----------
    accuracy : float
        Tolerance of the simulation, relative to the tip amplitude; amplitudes above 0.5 % of the length count as that.
    driving : float
        Length of the excitations, as a fraction of those in the paper.
    window : float
        Length of the fitted decays, as a fraction of ``WINDOWS``.
    """

    accuracy: float
    driving: float
    window: float


FULL = Effort(accuracy=4e-6, driving=1.0, window=1.0)
QUICK = Effort(accuracy=2e-5, driving=0.1, window=0.4)


@dataclass(frozen=True)
class Transient:
    """One simulated experiment: a mode driven, stopped, and left to decay.

    Parameters
    ----------
    modes : Modes
        Modes of the beam.
    mode : int
        Which of them is driven, from 0.
    name : str
        What the damping law is called.
    law : DampingLaw or None
        The damping law.
    base : HarmonicBase
        The drive.
    window : float
        How long a decay is fitted, s.
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
    """What a simulated experiment shows.

    Parameters
    ----------
    mode : int
        The mode driven, from 0.
    name : str
        What the damping law is called.
    base_amplitude : float
        Amplitude of the drive, m.
    amplitude : float
        Tip amplitude of the mode half-way through the fitted decay, m.
    frequency, damping_ratio : float
        What the fit finds; Hz, and a fraction.
    expected_ratio : float
        What the law predicts for this mode and amplitude.
    motion : Measurement
        Displacement of the tip relative to the clamp, across the beam.
    decay : Measurement
        Tip displacement in the mode, over the fitted decay.
    steps : int
        Steps of the integrator.
    seconds : float
        Time the simulation took, s.
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


@dataclass(frozen=True)
class Study:
    """All results of the paper's study, in the order of its tables."""

    decays: tuple[Measurement, ...]
    identification: tuple[DecayFit, ...]
    rayleigh: RayleighFit
    quadratic_decays: tuple[Measurement, ...]
    quadratic: tuple[DecayFit, ...]
    match: FrequencyMatch
    transients: tuple[TransientResult, ...]
    undamped: tuple[TransientResult, ...]
    timing: dict[str, float]

    def ratios(self, name: str) -> tuple[float, ...]:
        """Return the damping ratios found under a law, mode by mode."""
        return tuple(result.damping_ratio for result in self.of(name))

    def of(self, name: str) -> tuple[TransientResult, ...]:
        """Return the transients under a law, mode by mode."""
        return tuple(result for result in self.transients if result.name == name)


def reproduce(
    *, effort: Effort = FULL, jobs: int = 1, executor: Executor | None = None, progress: bool = False
) -> Study:
    """Run the paper's study.

    Parameters
    ----------
    effort : Effort
        ``FULL``, or ``QUICK`` for a look.
    jobs : int
        Processes for the transients, where no executor is given; with more than 1 a script must call this under
        ``if __name__ == "__main__":``.
    executor : Executor, optional
        What runs the transients.
    progress : bool
        Whether to show a progress bar.

    Raises
    ------
    FitError, SimulationError
        If a step does not reach its answer.
    """
    timing: dict[str, float] = {}
    with _timed(timing, "modal_identification"):
        decays = linear_decays()
        identification = tuple(fit_decay(decay, offset=False, release_time=0.0) for decay in decays)
    with _timed(timing, "proportional"):
        rayleigh = fit_rayleigh(paper.FREQUENCIES[:2], paper.DAMPING_RATIOS[:2])
    with _timed(timing, "quadratic"):
        quadratic_records = quadratic_decays()
        quadratic = tuple(fit_decay(d, law="quadratic", offset=False, release_time=0.0) for d in quadratic_records)
    with _timed(timing, "frequency_matching"):
        match = match_frequencies(paper.standard_beam(), targets=paper.FREQUENCIES)
    with _timed(timing, "transients"):
        modes = natural_modes(Model(match.beam))
        tasks = plan(modes, damping_laws(modes, rayleigh), effort)
        results = _run(tasks, jobs, executor, progress)
    return Study(
        decays=decays,
        identification=identification,
        rayleigh=rayleigh,
        quadratic_decays=quadratic_records,
        quadratic=quadratic,
        match=match,
        transients=tuple(result for result in results if result.name != UNDAMPED),
        undamped=tuple(result for result in results if result.name == UNDAMPED),
        timing=timing,
    )


def damping_laws(modes: Modes, rayleigh: RayleighFit) -> dict[str, DampingLaw]:
    """Return the three laws of Table 11, by name: all modes' ratios, two modes' ratios, mode 1's coefficients."""
    laws = (
        ModalDamping(modes, paper.DAMPING_RATIOS, frequencies=paper.FREQUENCIES),
        RayleighDamping(alpha=rayleigh.alpha, beta=rayleigh.beta, stiffness="tangent"),
        QuadraticDamping(eta1=paper.ETA1[0], eta2=paper.ETA2[0]),
    )
    return dict(zip(LAWS, laws, strict=True))


def linear_decays() -> tuple[Measurement, ...]:
    """Return noisy decays after Eq. (9) with the parameters of Table 2, released at rest."""
    parameters = zip(paper.FREQUENCIES, paper.DAMPING_RATIOS, START_AMPLITUDES, strict=True)
    return _noisy([(linear_decay, (2 * math.pi * f, zeta, r0, 0.0)) for f, zeta, r0 in parameters], SEED)


def quadratic_decays() -> tuple[Measurement, ...]:
    """Return noisy decays after Eq. (27) with the parameters of Table 4, from the amplitudes it implies."""
    parameters = zip(paper.FREQUENCIES, paper.ETA1, paper.ETA2, paper.EQUIVALENT_AMPLITUDES, strict=True)
    curves = [(quadratic_decay, (2 * math.pi * f, eta1, eta2, e0, 0.0)) for f, eta1, eta2, e0 in parameters]
    return _noisy(curves, SEED + 1)


def _noisy(curves: Iterable[tuple[Callable[..., cs.DM], tuple[float, ...]]], seed: int) -> tuple[Measurement, ...]:
    rng = np.random.default_rng(seed)
    instants = np.arange(0.0, RECORD, 1 / FRAME_RATE)
    exact = [curve(cs.DM(instants), *map(cs.DM, parameters)).full().ravel() for curve, parameters in curves]
    return tuple(
        Measurement(instants, displacement + NOISE * rng.standard_normal(instants.size), f"mode {k + 1}, synthetic")
        for k, displacement in enumerate(exact)
    )


def plan(modes: Modes, laws: Mapping[str, DampingLaw], effort: Effort) -> list[Transient]:
    """Return the experiments: each mode under each law, and undamped to show the numerical damping."""
    return [
        _experiment(modes, mode, name, law, effort)
        for mode in range(modes.count)
        for name, law in {**laws, UNDAMPED: None}.items()
    ]


def _experiment(modes: Modes, mode: int, name: str, law: DampingLaw | None, effort: Effort) -> Transient:
    frequency, omega = float(modes.frequencies[mode]), float(modes.angular_frequencies[mode])
    ratio = 0.0 if law is None else float(law.damping_ratios(modes, TIP_AMPLITUDES)[mode])
    driving = paper.STOPS[mode] * (effort.driving if law is not None else min(effort.driving, UNDAMPED_DRIVING))
    growth = -math.expm1(-ratio * omega * driving) / (2 * ratio) if ratio else omega * driving / 2
    base = HarmonicBase(
        amplitude=TIP_AMPLITUDES[mode] / (_participation(modes, mode) * growth), frequency=frequency, stop=driving
    )
    window = WINDOWS[mode] * effort.window
    if ratio:
        window = min(window, math.log(2) / (ratio * omega))
    tolerance = effort.accuracy * min(TIP_AMPLITUDES[mode] / modes.model.beam.length, LARGE)
    return Transient(modes, mode, name, law, base, window, tolerance)


def _participation(modes: Modes, mode: int) -> float:
    """Gamma: tip amplitude of the mode a unit of horizontal base motion, phi_tip phi^T M u."""
    model = modes.model
    mass = model.mass(model.properties).sparse()
    horizontal = np.tile([1.0, 0.0, 0.0, 0.0], model.beam.elements + 1)
    return float(abs(modes.shapes[:, mode] @ (mass @ horizontal)) * modes.tip_amplitudes()[mode])


def run_transient(transient: Transient) -> TransientResult:
    """Simulate one experiment and fit its decay.

    Raises
    ------
    SimulationError, FitError
        If the integration or the fit does not reach its answer.
    """
    modes, mode, base = transient.modes, transient.mode, transient.base
    sample_rate = SAMPLES * base.frequency
    run = simulate(
        modes.model,
        duration=transient.duration,
        damping=transient.law,
        base=base,
        sample_rate=sample_rate,
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


def _run(tasks: list[Transient], jobs: int, executor: Executor | None, progress: bool) -> list[TransientResult]:
    """Run the experiments, the costly ones first; the results come in the order of the tasks."""
    calls = [partial(run_transient, task) for task in tasks]
    periods = [task.duration * task.base.frequency for task in tasks]
    return run_all(calls, executor=executor, jobs=jobs, sizes=periods, progress=progress, title="transients")


@contextlib.contextmanager
def _timed(timing: dict[str, float], step: str) -> Iterator[None]:
    began = time.perf_counter()
    yield
    timing[step] = time.perf_counter() - began
