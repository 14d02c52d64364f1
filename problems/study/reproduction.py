"""The study of the paper from end to end.

1. Table 2.  Modal parameters of five modes from free decays, Eq. (9).  The decays are synthetic (``decays``).
2. Table 3.  Rayleigh (proportional) damping from the first two modes, Eq. (17).
3. Table 4.  Quadratic damping of each mode from free decays, Eq. (27), also synthetic.
4. Tables 9 and 10.  The hanging beam of Table 1 is matched to the frequencies of Table 2.
5. Table 11.  Damping ratios of the matched beam under each of the three laws, from simulated experiments
   (``transients``).

Steps 2, 4 and 5 start from the numbers printed in the paper, step 5 also from the results of steps 2 and 4.  Steps 1
and 3 show that the method recovers the printed parameters from decays made with them.

References
----------
"Comparison of external damping models in a large deformation problem", Sections 3 to 5.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass

from ancf_casadi.mechanics.model import Model
from ancf_casadi.records.measurement import Measurement
from ancf_casadi.vibration.modes import natural_modes
from problems.decay.fitting import fit_decay
from problems.decay.proportional import RayleighFit, fit_rayleigh
from problems.decay.result import DecayFit
from problems.matching.frequency_matching import match_frequencies
from problems.matching.result import FrequencyMatch
from problems.study import paper
from problems.study.decays import linear_decays, quadratic_decays
from problems.study.transients import FULL, UNDAMPED, Effort, TransientResult, damping_laws, plan, run_transients


@dataclass(frozen=True)
class Study:
    """All results of the study, in the order of the tables.

    Parameters
    ----------
    decays, identification : tuple
        The decays behind Table 2, and their fits, by mode.
    rayleigh : RayleighFit
        Table 3.
    quadratic_decays, quadratic : tuple
        The decays behind Table 4, and their fits, by mode.
    match : FrequencyMatch
        Tables 9 and 10.
    transients, undamped : tuple of TransientResult
        The experiments of Table 11, and those without damping.
    timing : dict
        Computing time of each step, s.
    """

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
        """Return the fitted damping ratios under a law, mode by mode."""
        return tuple(result.damping_ratio for result in self.under(name))

    def under(self, name: str) -> tuple[TransientResult, ...]:
        """Return the experiments under a law, mode by mode."""
        return tuple(result for result in self.transients if result.name == name)


def reproduce(
    *, effort: Effort = FULL, jobs: int = 1, executor: Executor | None = None, progress: bool = False
) -> Study:
    """Run the study.

    Parameters
    ----------
    effort : Effort
        ``FULL``, or ``QUICK`` for shorter and less accurate simulations.
    jobs : int
        Number of processes for the simulations, if no executor is given.  A script that asks for more than one must
        call this function under ``if __name__ == "__main__":``.
    executor : Executor, optional
        Executor of the simulations.
    progress : bool
        Whether to show a progress bar.

    Raises
    ------
    FitError, SimulationError
        If a fit or a simulation fails.
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
        experiments = plan(modes, damping_laws(modes, rayleigh), effort)
        results = run_transients(experiments, jobs, executor, progress)
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


@contextlib.contextmanager
def _timed(timing: dict[str, float], step: str) -> Iterator[None]:
    began = time.perf_counter()
    yield
    timing[step] = time.perf_counter() - began
