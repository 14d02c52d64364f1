"""A whole study: from a TOML file to its document.

    from problems import run_study

    if __name__ == "__main__":
        report = run_study("STUDY.toml", "results", jobs=2)
        print(report.page)

The folder then holds ``report.html``, ``results.json`` with its schema, and the tables and figures as files.
"""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from types import NoneType
from typing import Any

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.files import check_folder, check_path, write_files
from ancf_casadi.support.inputs import check_instance, flag, instances, whole
from ancf_casadi.support.interrupts import lasting_interrupts
from ancf_casadi.support.tables import Displayed, plural, to_json
from ancf_casadi.version import __version__
from problems.spec.schema import file_schema, object_schema
from problems.study.formatting import formatted_table, numeric_table
from problems.study.kinds.decays import DecayRecord
from problems.study.kinds.experiment import RequestedRun
from problems.study.reading import KINDS, read_study
from problems.study.results import file_name, label_findings, page, results, schema
from problems.study.runner import run_steps
from problems.study.step import Finding, LawChoice, Study

NUMBERED = re.compile(r"(table|figure)_a?\d+\.(csv|svg|png|gif)")  # names of files of tables and figures
FEW_STEPS = 3  # that run in the process of the command
PAGE, NUMBERS_FILE, SCHEMA_FILE = "report.html", "results.json", "results.schema.json"


@dataclass(frozen=True)
class StudyReport(Displayed):
    r"""The results of a study.

    Parameters
    ----------
    page : Path or None
        The HTML document; None if none was written.
    results : dict
        The numbers, as in ``results.json``.
    steps : tuple of Finding
        The steps with their tables, figures and times.

    Examples
    --------
    >>> from pathlib import Path
    >>> from problems import run_study
    >>> lines = ["[beam]", "length = 0.5", "width = 5e-3", "thickness = 0.5e-3", "density = 8000.0",
    ...          "elastic_modulus = 210e9", "elements = 4", "[[steps]]", 'kind = "beam"']
    >>> _ = Path("strip.toml").write_text("\n".join(lines))
    >>> report = run_study("strip.toml", "results")
    >>> [table.name for step in report.steps for table in step.tables], report.warnings
    (['Table 1'], ())
    """

    page: Path | None
    results: Mapping[str, Any]
    steps: tuple[Finding, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Limitations of the results, with the name of the step."""
        return tuple(f"{finding.name}: {warning}" for finding in self.steps for warning in finding.warnings)

    def to_dict(self) -> dict[str, Any]:
        """Return the results for JSON."""
        return dict(self.results)

    def report(self) -> str:
        """Return the tables as text."""
        texts = []
        for finding in self.steps:
            if finding.text:
                texts.append(finding.text)
            else:
                texts += [f"{table.name}. {formatted_table(table).text()}" for table in finding.tables]
                texts += [f"note: {warning}" for warning in finding.warnings]
        return "\n\n".join(texts)

    def _summary(self) -> str:
        return f"{str(self.page or '')!r}, {plural(len(self.steps), 'step')}, {plural(len(self.warnings), 'warning')}"


def study_schema() -> dict[str, Any]:
    """Return the JSON Schema of a study file."""
    schema = file_schema(Study, {"laws": LawChoice, "decays": DecayRecord}, KINDS)
    schema["$defs"]["LawChoice"] = {"type": "string", "description": "name of a table [[laws]]"}  # as steps give it
    schema["$defs"]["RequestedRun"] = object_schema((RequestedRun,), {})
    return schema


@lasting_interrupts()
def run_study(
    path: str | Path | Study,
    out: str | Path | None = "results",
    *,
    steps: Sequence[str] = (),
    quick: bool = False,
    executor: Executor | None = None,
    jobs: int | None = 1,
    progress: bool = False,
    command: str = "run_study",
) -> StudyReport:
    r"""Run a study and write its document.

    Finished computations are kept in the folder, so that a study that was stopped continues from there.

    Parameters
    ----------
    path : str, Path or Study
        TOML file of the study; or a study that was read, such as ``problems.paper.reproduce.PAPER``.
    out : str or Path, optional
        Folder of the results; with None nothing is written or kept.
    steps : sequence of str
        Names or kinds of the steps of the file to run, with those that they need; all if empty.
    quick : bool
        Whether to shorten the simulations, for a first look.
    executor, jobs, progress
        As in ``run_all``; with None for ``jobs``, a few steps run in this process, which shows their progress, and more
        on all cores.
    command : str
        Command that the document names.

    Raises
    ------
    InputError
        If the file cannot be read, a table, key or value cannot be used, or the folder cannot be written.
    FitError, SimulationError
        If a fit or a simulation fails.

    Examples
    --------
    >>> from pathlib import Path
    >>> from problems import run_study
    >>> lines = ["[[steps]]", 'kind = "rayleigh"', "frequencies = [1.85, 10.19]", "ratios = [0.01, 0.0028]"]
    >>> _ = Path("study.toml").write_text("\n".join(lines))
    >>> report = run_study("study.toml", "results")
    >>> round(report.results["rayleigh"]["alpha"], 6), report.page.name
    (0.228181, 'report.html')
    """
    names = instances(steps, "steps", str, minimum=0)
    if isinstance(path, Study):
        if names:
            raise InputError("are chosen from a file; leave them out for a study that was read", "steps")
        whole_study = path
    else:
        check_path(path, "path")
        whole_study = read_study(path, names)
    check_instance(executor, "executor", Executor, NoneType)
    folder = None if out is None else check_folder(out)
    study = whole_study.shorten() if flag(quick, "quick") else whole_study
    if jobs is None:
        jobs = 1 if len(study.steps) <= FEW_STEPS else os.cpu_count() or 1
    formats: tuple[str, ...] = () if folder is None else ("svg",) if quick else ("svg", "png")
    with contextlib.ExitStack() as stack:
        findings = run_steps(
            study,
            folder or Path(stack.enter_context(TemporaryDirectory())),
            quick=quick,
            keep_others=bool(names) or quick,
            formats=formats,
            executor=executor,
            jobs=whole(jobs, "jobs", 1),
            progress=flag(progress, "progress"),
        )
    findings = label_findings(study, findings)
    left_out = [step.title for step in whole_study.steps if step.name not in {step.name for step in study.steps}]
    versions = {"ancf-casadi": __version__, **{name: version(name) for name in ("casadi", "numpy", "scipy")}}
    report = StudyReport(folder and folder / PAGE, results(study, findings, versions, quick=quick), findings)
    if folder is not None:
        page_html = page(study, findings, command=command, versions=versions, quick=quick, left_out=left_out)
        _write(report, folder, to_json(schema(study, report.results)), page_html)
    return report


def _write(report: StudyReport, folder: Path, schema_text: str, page_html: str) -> None:
    """Write all files of a study or none, then remove numbered tables and figures of earlier runs in the folder."""
    contents: dict[Path, str | bytes] = {}
    for finding in report.steps:
        for name, content in finding.files.items():
            contents[folder / (f"{finding.name}_{name}" if folder / name in contents else name)] = content
        for table in finding.tables:
            contents[folder / "tables" / f"{file_name(table.name)}.csv"] = numeric_table(table).csv()
        for figure in finding.figures:
            for suffix, picture in (("svg", figure.svg), ("png", figure.png), ("gif", figure.moving)):
                if picture:
                    contents[folder / "figures" / f"{file_name(figure.name)}.{suffix}"] = picture
    results_text = to_json(report.results)
    contents |= {folder / SCHEMA_FILE: schema_text, folder / NUMBERS_FILE: results_text, folder / PAGE: page_html}
    write_files(contents)
    for old_file in (*folder.glob("tables/*"), *folder.glob("figures/*")):
        if NUMBERED.fullmatch(old_file.name) and old_file not in contents:
            with contextlib.suppress(OSError):  # a file that is open elsewhere stays
                old_file.unlink()
