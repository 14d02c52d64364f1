"""The study of the paper, ``paper.toml``: every table and figure, beside the numbers that the paper prints.

from problems import reproduce

if __name__ == "__main__":
    report = reproduce("results", jobs=2)
    print(report.page)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Self, final

from ancf_casadi.support.inputs import choice
from ancf_casadi.support.specs import UNLISTED, Positive
from problems.paper import combined_law, decays, drawings, experiments
from problems.study.kinds.experiment import EXPERIMENT_STEPS, QUICK_STEPS, QUICK_WINDOW, RequestedRun
from problems.study.kinds.transients import with_laws
from problems.study.part import Finding, Found, LawChoice, Part, Study, Task
from problems.study.study import KINDS, StudyReport, write_study

Tasks = Callable[["PaperPart", Found], tuple[Task, ...]]
Result = Callable[["PaperPart", Sequence[Any], Found], Finding]

PAPER_FILE = Path(str(files("problems.paper").joinpath("paper.toml")))

SCRIPTS: dict[str, tuple[Tasks, Result]] = {
    "amplitudes": (experiments.tasks, experiments.amplitudes),
    "shapes": (experiments.tasks, experiments.shapes),
    "integrators": (partial(experiments.tasks, methods=experiments.METHODS), experiments.integrators),
    "resonances": (experiments.resonance_tasks, experiments.resonances),
    "eta_effects": (decays.tasks, decays.eta_effects),
    "ratio_change": (decays.tasks, decays.ratio_change),
    "combined_law": (Part.tasks, combined_law.finding),
    "element": (Part.tasks, drawings.element),
    "uniform_load": (Part.tasks, drawings.uniform_load),
    "omitted": (Part.tasks, drawings.omitted),
}


@final
@dataclass(frozen=True, kw_only=True)
class PaperPart(Part):
    """A part that only the study of the paper has, made by a script of this folder."""

    kind, heading = "paper", ""
    naming = ("beam", "decays", "transients")

    script: str
    beam: str = ""
    decays: str = ""
    transients: str = ""
    laws: tuple[LawChoice, ...] = ()
    runs: tuple[RequestedRun, ...] = ()
    frequency: Positive = 1.85  # Hz
    amplitude: Positive = 0.076  # m, at the tip
    duration: Positive = 15.0  # s
    inputs: dict[str, Any] = field(default_factory=dict)  # of this script alone
    steps_per_period: Annotated[int, UNLISTED] = EXPERIMENT_STEPS

    def checked(self, study: Study, where: str) -> Self:
        """Return the part with the laws of its runs, once its script is known."""
        choice(self.script, tuple(SCRIPTS), f"{where}: script")
        return replace(self, runs=with_laws(self.runs, self.laws))

    def shortened(self) -> Self:
        """Return the part of a quick look, with short simulations."""
        return replace(self, runs=tuple(run.shortened() for run in self.runs), duration=QUICK_WINDOW * self.duration,
                       steps_per_period=QUICK_STEPS)  # fmt: skip

    @property
    def needs(self) -> tuple[str, ...]:
        """Names of the parts whose findings it needs, and always the beam of the file."""
        return tuple(dict.fromkeys((*super().needs, "")))

    def tasks(self, found: Found) -> tuple[Task, ...]:
        """Return the tasks of the script."""
        return SCRIPTS[self.script][0](self, found)

    def finding(self, results: Sequence[Any], found: Found) -> Finding:
        """Return the finding of the script."""
        return SCRIPTS[self.script][1](self, results, found)


ALL_KINDS: tuple[type[Part], ...] = (*KINDS, PaperPart)


def reproduce(
    out: str | Path = "results",
    *,
    quick: bool = False,
    executor: Executor | None = None,
    jobs: int = 1,
    progress: bool = False,
) -> StudyReport:
    r"""Compute every table and figure of the paper, and write them as a document.

    Finished computations are kept in the folder, so that a run that was stopped continues from there.

    Parameters
    ----------
    out, quick, executor, jobs, progress
        As in ``run_study``.

    Raises
    ------
    InputError
        If the folder cannot be written.
    FitError, SimulationError
        If a fit or a simulation fails.

    Examples
    --------
    >>> from problems import reproduce
    >>> report = reproduce("results", quick=True)
    >>> report.page.name, report.results["frequency_matching"]["max_relative_error"] < 1e-6
    ('report.html', True)
    """
    return write_study(
        PAPER_FILE, ALL_KINDS, out, quick=quick, executor=executor, jobs=jobs, progress=progress, command="reproduce"
    )
