"""The runs of simulated experiments, which several kinds of parts show: one excitation each, under several laws."""

from __future__ import annotations

import math
from abc import ABC
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Self

from msgspec import Meta

from ancf_casadi.dynamics.base_motion import HarmonicBase
from ancf_casadi.exceptions import InputError
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.support.inputs import located, whole
from problems.schema.table import Positive, keys_of
from problems.study.kinds.experiments.experiment import Experiment, ExperimentResult, run_experiment
from problems.study.part import Effort, Found, Part, Task
from problems.study.source import LawChoice, Source


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

    def experiment(self, law: LawChoice, beam: Beam, found: Found, effort: Effort, method: str = "radau") -> Experiment:
        """Return the experiment under a law."""
        return Experiment(
            beam=beam,
            terms=law.of(found),
            mode=self.mode,
            frequency=self.frequency,
            amplitude=self.amplitude,
            stop=effort.driving * self.stop,
            window=self.window,
            shortening=effort.window,
            steps_per_period=effort.steps_per_period,
            method=method,
            ramp=effort.driving * self.ramp,
        )

    def checked(self, laws: tuple[LawChoice, ...], source: Source, where: str) -> RequestedRun:
        """Return the run with its laws: its own ones, or those of the part.

        Raises
        ------
        InputError
            If it has no laws, there is no such mode, or the ramp ends after the stop.
        """
        whole(self.mode, f"{where}: mode", 1, source.most_modes)
        if not (self.laws or laws):
            raise InputError("name at least one of [[laws]]", f"{where}: laws")
        with located(where):
            if self.ramp and self.frequency:
                HarmonicBase(1.0, self.frequency, self.stop, ramp=self.ramp)
        return replace(self, laws=self.laws or laws)


def task_of(experiment: Experiment) -> Task:
    """Return an experiment as a task."""
    periods = max(experiment.frequency, 2.0) * (experiment.stop + max(experiment.window, 1.0))
    return Task(run_experiment, (experiment,), 0.01 * periods)  # computing time


@dataclass(frozen=True, kw_only=True)
class ExperimentPart(Part, ABC):
    """Base class of the parts with simulated experiments."""

    naming = ("beam",)

    runs: Annotated[
        tuple[RequestedRun, ...], Meta(min_length=1, description=f"[{{{', '.join(keys_of(RequestedRun))}}}, ...]")
    ]
    laws: Annotated[tuple[LawChoice, ...], Meta(description="names of [[laws]]")] = ()
    beam: Annotated[str, Meta(description='"PART"')] = ""

    def checked(self, source: Source, where: str) -> Self:
        """Return the part with the laws of each run."""
        runs = [run.checked(self.laws, source, f"{where}: runs: {k}") for k, run in enumerate(self.runs, start=1)]
        laws = {law.name: law for run in runs for law in run.laws}
        return replace(self, runs=tuple(runs), laws=tuple(laws.values()))

    def tasks(self, found: Found, effort: Effort) -> tuple[Task, ...]:
        """Return the simulations, run by run and law by law."""
        beam = self.beam_in(found)
        return tuple(task_of(run.experiment(law, beam, found, effort)) for run in self.runs for law in run.laws)


def results_of(runs: Sequence[RequestedRun], results: Sequence[ExperimentResult]) -> list[list[ExperimentResult]]:
    """Return the results of the tasks of a part run by run."""
    own = iter(results)
    return [[next(own) for _ in run.laws] for run in runs]
