"""The paper as a study: every table and figure in its order, beside the numbers that the paper prints.

    from problems import reproduce

    if __name__ == "__main__":
        report = reproduce("results", jobs=2)
        print(report.page)

Each step is a function in the module of its table or figures, which also names the printed numbers.
"""

from __future__ import annotations

from concurrent.futures import Executor
from pathlib import Path

from problems.paper.against_amplitude import against_amplitude
from problems.paper.combined_law import combined_law
from problems.paper.figure_01 import element
from problems.paper.figure_11 import assumed_deflection
from problems.paper.figures_02_to_04 import photographs
from problems.paper.inputs import SEED
from problems.paper.integrators import integrators
from problems.paper.numerical_damping import numerical_damping
from problems.paper.shapes import shapes
from problems.paper.steady_vibration import steady_vibration
from problems.paper.table_01 import standard_beam
from problems.paper.table_02 import modal_identification
from problems.paper.table_03 import proportional
from problems.paper.table_04 import quadratic
from problems.paper.table_07 import ratio_change
from problems.paper.table_08 import independence
from problems.paper.table_11 import damping_comparison
from problems.paper.table_12 import individual_quadratic
from problems.paper.tables_05_06 import eta_effects
from problems.paper.tables_09_10 import frequency_matching
from problems.paper.uniform_beam import uniform_beam
from problems.study.step import Study
from problems.study.study import StudyReport, run_study

PAPER = Study(
    title="Comparison of external damping models in a large deformation problem",
    source="""
J. W. Lee, H. W. Kim, H. C. Ku, W. S. Yoo, "Comparison of external damping models in a large deformation problem", \
Journal of Sound and Vibration 325 (2009) 722-741""",
    printed_by="paper",
    seed=SEED,
    text="""
A thin strip of spring steel hangs from a clamp. The clamp shakes it in one of its five lowest modes and stops, and \
the beam decays. The paper identifies frequency and damping ratio of each mode from these decays, changes the \
properties of a finite element model until it has the measured frequencies, and compares three damping laws with the \
experiment.

This document computes every table and every figure of the paper anew, beside the numbers that the paper prints. Where \
they differ, the reason is given if it is known. The paper publishes no raw record: the free decays here are \
synthetic, made from the numbers of the paper with seeded noise, and every table and figure made from them says so.""",
    steps=(
        element, standard_beam, photographs, modal_identification, proportional, assumed_deflection, quadratic,
        eta_effects, ratio_change, independence, frequency_matching, damping_comparison, steady_vibration,
        individual_quadratic,
        # beyond the paper
        combined_law, against_amplitude, shapes, uniform_beam, integrators, numerical_damping,
    ),
)  # fmt: skip


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
    return run_study(PAPER, out, quick=quick, executor=executor, jobs=jobs, progress=progress, command="reproduce")
