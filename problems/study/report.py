"""Results of the study as plain data, and its tables, figures and data as files."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path
from typing import Any

from ancf_casadi.support.files import write_files
from ancf_casadi.support.tables import to_json
from ancf_casadi.version import __version__
from problems.study import paper
from problems.study.reproduction import Study
from problems.study.tables import MODES, SYNTHETIC, tables
from problems.study.transients import LAW_NAMES, TransientResult


def results(study: Study) -> dict[str, Any]:
    """Return the results as plain data: SI units, ratios as fractions, lists in the order of the modes."""
    match = study.match
    return {
        "data": SYNTHETIC,
        "versions": {"ancf-casadi": __version__, "casadi": version("casadi")},
        "modal_identification": [
            {
                "mode": mode,
                "frequency_hz": fit.frequency,
                "frequency_stderr_hz": fit.standard_errors["frequency"],
                "damping_ratio": fit.damping_ratio,
                "damping_ratio_stderr": fit.standard_errors["damping_ratio"],
            }
            for mode, fit in zip(MODES, study.identification, strict=True)
        ],
        "proportional": {"alpha": study.rayleigh.alpha, "beta": study.rayleigh.beta},
        "quadratic": [
            {
                "mode": mode,
                "eta1": fit.eta1,
                "eta1_stderr": fit.standard_errors["eta1"],
                "eta2_per_m": fit.eta2,
                "eta2_stderr_per_m": fit.standard_errors["eta2"],
                "correlation": fit.correlation,
                "amplitude_m": fit.amplitude,
                "equivalent_damping_ratio": fit.damping_ratio,
                "warnings": list(fit.warnings),
            }
            for mode, fit in zip(MODES, study.quadratic, strict=True)
        ],
        "frequency_matching": {
            **match.to_dict(),
            "elastic_modulus": match.beam.elastic_modulus[0],
            "density": match.beam.density[0],
        },
        "damping_comparison": {
            "experiment": list(paper.DAMPING_RATIOS),
            **{law: list(study.ratios(law)) for law in LAW_NAMES},
        },
        "transients": [_transient(result) for result in (*study.transients, *study.undamped)],
        "timing": study.timing,
    }


def write_study(study: Study, folder: Path) -> list[Path]:
    """Write tables, figures and ``results.json``, all or none, and return the paths.

    Raises
    ------
    InputError
        If the folder cannot be written.
    """
    from problems.study import figures  # matplotlib is slow to import

    contents: list[tuple[str, str | bytes]] = [(f"{table.name}.csv", table.csv()) for table in tables(study)]
    contents += figures.figures(study)
    contents.append(("results.json", to_json(results(study))))
    write_files({folder / name: content for name, content in contents})
    return [folder / name for name, _ in contents]


def _transient(result: TransientResult) -> dict[str, Any]:
    return {
        "mode": result.mode + 1,
        "law": result.name,
        "base_amplitude_m": result.base_amplitude,
        "amplitude_m": result.amplitude,
        "frequency_hz": result.frequency,
        "damping_ratio": result.damping_ratio,
        "expected_damping_ratio": result.expected_ratio,
        "steps": result.steps,
        "seconds": result.seconds,
    }
