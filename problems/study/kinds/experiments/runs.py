"""The runs of simulated experiments, which several kinds of parts show: one excitation each, under several laws."""

from __future__ import annotations

import math
from abc import ABC
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ancf_casadi.dynamics.base_motion import HarmonicBase
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.inputs import check_keys, is_sequence, located, number, physical, shown, whole
from problems.study.kinds.experiments.experiment import Experiment, ExperimentResult, run_experiment
from problems.study.part import Effort, Outcome, Part, Task
from problems.study.source import BeamChoice, LawChoice, Source

RUN = {"mode", "amplitude", "stop"}
OPTIONAL = {"frequency", "window", "laws", "measured_ratio", "ramp"}
SECONDS_PER_PERIOD = 0.01  # computing time


@dataclass(frozen=True)
class Run:
    """An excitation, and the laws under which it is simulated.

    Parameters
    ----------
    mode : int
        Number of the driven mode, from 1.
    amplitude : float
        Requested tip amplitude at the stop, m.
    stop : float
        End of the excitation, s.
    frequency : float
        Frequency of the excitation, Hz; that of the mode if 0.
    window : float
        Length of the fitted decay, s; the default if 0.
    laws : tuple of LawChoice
        The laws.
    measured_ratio : float
        Measured damping ratio to draw; nan for none.
    ramp : float
        Cycles in which the amplitude of the excitation grows.
    """

    mode: int
    amplitude: float
    stop: float
    frequency: float
    window: float
    laws: tuple[LawChoice, ...]
    measured_ratio: float
    ramp: float

    def experiment(
        self, law: LawChoice, choice: BeamChoice, found: Mapping[str, Outcome], effort: Effort, method: str = "radau"
    ) -> Experiment:
        """Return the experiment under a law."""
        return Experiment(
            beam=choice.beam(found),
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

    def under_first_law(self) -> Run:
        """Return the run under the first of its laws alone."""
        return replace(self, laws=self.laws[:1])


def task_of(experiment: Experiment) -> Task:
    """Return an experiment as a task."""
    periods = max(experiment.frequency, 2.0) * (experiment.stop + max(experiment.window, 1.0))
    return Task(run_experiment, (experiment,), SECONDS_PER_PERIOD * periods)


@dataclass(frozen=True)
class ExperimentPart(Part, ABC):
    """Base class of the parts with simulated experiments.

    Parameters
    ----------
    choice : BeamChoice
        The beam.
    runs : tuple of Run
        The excitations.
    """

    choice: BeamChoice
    runs: tuple[Run, ...]

    @property
    def needs(self) -> tuple[str, ...]:
        """The parts that find the beam and the laws."""
        laws = [name for run in self.runs for law in run.laws for name in law.needs]
        return tuple(dict.fromkeys((*self.choice.needs, *laws)))

    def tasks(self, found: Mapping[str, Outcome], effort: Effort) -> tuple[Task, ...]:
        """Return the simulations, run by run and law by law."""
        return tuple(task_of(run.experiment(law, self.choice, found, effort)) for run in self.runs for law in run.laws)


def results_of(runs: Sequence[Run], results: Sequence[ExperimentResult]) -> list[list[ExperimentResult]]:
    """Return the results of the tasks of a part run by run."""
    own = iter(results)
    return [[next(own) for _ in run.laws] for run in runs]


def read_runs(source: Source, given: dict[str, Any], where: str) -> tuple[Run, ...]:
    """Return the runs that the keys ``runs`` and ``laws`` of a table describe.

    Raises
    ------
    InputError
        If a key or value cannot be used.
    """
    if not is_sequence(given["runs"]) or not given["runs"]:
        raise InputError(f"must be a list of tables, got {shown(given['runs'])}", f"{where}: runs")
    runs = []
    for k, table in enumerate(given["runs"], start=1):
        place = f"{where}: runs: {k}"
        check_keys(table, RUN, OPTIONAL, place)
        names = table.get("laws", given.get("laws", []))
        if not is_sequence(names) or not names:
            raise InputError("name at least one of [[laws]]", f"{place}: laws")
        laws = tuple(source.law_choice(name, f"{place}: laws") for name in names)
        with located(place):
            if {"ramp", "frequency"} <= table.keys():
                HarmonicBase(1.0, table["frequency"], table["stop"], ramp=table["ramp"])  # check
            runs.append(
                Run(
                    mode=whole(table["mode"], "mode", 1, source.most_modes),
                    amplitude=physical(table["amplitude"], "amplitude"),
                    stop=physical(table["stop"], "stop"),
                    frequency=physical(table["frequency"], "frequency") if "frequency" in table else 0.0,
                    window=physical(table["window"], "window") if "window" in table else 0.0,
                    laws=laws,
                    measured_ratio=number(table["measured_ratio"], "measured_ratio")
                    if "measured_ratio" in table
                    else math.nan,
                    ramp=physical(table["ramp"], "ramp") if "ramp" in table else 0.0,
                )
            )
    return tuple(runs)
