"""Inputs that several tables of the paper share: the beam, its measured modes, experiments, and damping laws.

Frequencies are in Hz, damping ratios are fractions, all other numbers are in SI units.  The paper prints eta2 in 1/mm;
here it is in 1/m.
"""

from __future__ import annotations

from dataclasses import replace

from ancf_casadi.mechanics.beam import Beam
from problems.modal_damping.rayleigh import fit_rayleigh
from problems.spec.file import NO_FILE
from problems.spec.match import MatchTable
from problems.study.compute import Compute
from problems.study.drawing import FORMATS
from problems.study.kinds.beam import match_finding
from problems.study.kinds.experiment import RequestedRun
from problems.study.step import Finding, LawChoice

SEED = 20  # of all random numbers

STANDARD_BEAM = Beam.uniform(  # Table 1; Section 5.1
    length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9, elements=20
)

FREQUENCIES = (1.85, 10.19, 26.84, 53.20, 88.60)  # Table 2
RATIOS = (0.0100, 0.0028, 0.0028, 0.0023, 0.0030)  # Table 2
PRINTED_RATIOS = tuple(round(100 * ratio, 2) for ratio in RATIOS)  # Tables 2, 4, 11 and 12, %
ETA1 = (0.15, 0.31, 0.89, 1.46, 3.00)  # Table 4
ETA2 = (0.11, 0.060, 0.050, 0.050, 0.050)  # Table 4
AMPLITUDES = (0.076, 0.0149, 0.0076, 0.0055, 0.0144)  # of the tip, at which Eq. (26) gives the ratios of Table 4
STOPS = (15.0, 20.0, 12.0, 10.0, 6.0)  # of the excitation of each mode, Section 5.2

EXPERIMENTS = tuple(
    RequestedRun(mode=mode, amplitude=amplitude, stop=stop, frequency=frequency, measured_ratio=ratio)
    for mode, (amplitude, stop, frequency, ratio) in enumerate(
        zip(AMPLITUDES, STOPS, FREQUENCIES, RATIOS, strict=True), start=1
    )
)

GENERIC = LawChoice("generic", ({"law": "modal", "ratios": RATIOS, "frequencies": FREQUENCIES},), "modal (generic)")
QUADRATIC = LawChoice(
    "quadratic", ({"law": "quadratic", "eta1": ETA1[0], "eta2": ETA2[0]},), "quadratic, η1 = 0.15, η2 = 0.11"
)


def three_laws() -> tuple[LawChoice, LawChoice, LawChoice]:
    """Return the laws of Section 4: generic, proportional, fitted to modes 1 and 2, and quadratic, as in mode 1."""
    fit = fit_rayleigh(FREQUENCIES[:2], RATIOS[:2])
    terms = ({"law": "rayleigh", "alpha": fit.alpha, "beta": fit.beta, "stiffness": "tangent"},)
    return GENERIC, LawChoice("proportional", terms, "Rayleigh (proportional)"), QUADRATIC


def match_standard_beam(compute: Compute) -> Finding:
    """Change the standard beam by at most 10 %, to have the measured frequencies: Tables 9 and 10."""
    table = MatchTable(targets=FREQUENCIES, bounds=0.10)
    return compute(match_finding, STANDARD_BEAM, table, NO_FILE, FORMATS)  # also for steps without figures


def matched_beam(compute: Compute) -> Beam:
    """Return the matched beam of Tables 9 and 10, on which all experiments are simulated."""
    beam = match_standard_beam(compute).beam
    assert beam
    return beam.beam()


def experiments(*laws: LawChoice, modes: tuple[int, ...] = (1, 2, 3, 4, 5)) -> list[RequestedRun]:
    """Return the experiments of modes, each under the same laws."""
    return [replace(EXPERIMENTS[mode - 1], laws=laws) for mode in modes]
