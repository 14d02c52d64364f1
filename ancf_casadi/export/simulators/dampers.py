"""Damping laws in the terms that other programs have.

    Rayleigh      alpha M + beta K: a rate alpha on all masses, dampers beta k at the joints
    quadratic     a rate eta1 and the drag (1183/876) eta2 |v| v, both per mass along the beam
    others        alpha and beta that meet the damping ratio of mode 1, and those of modes 2 and 3 as well as possible

A law that depends on the amplitude, and drag in a program without it, becomes a rate alpha, right at one amplitude.
Ratios of all modes are compared at one speed of the tip, that of mode 1 at the stated amplitude.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ancf_casadi.damping import DampingLaw, ModalDamping, QuadraticDamping, RayleighDamping, SumOfLaws
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array
from ancf_casadi.vibration.modes import Modes

COMPARED = 3  # modes


@dataclass(frozen=True)
class Dampers:
    """Coefficients: of all mass and of the mass along the beam (1/s), of stiffness (s), of drag (1/m)."""

    alpha: float = 0.0
    beta: float = 0.0
    eta1: float = 0.0
    eta2: float = 0.0
    warnings: tuple[str, ...] = ()


def same_speed(modes: Modes, amplitude: float) -> Array:
    """Return the tip amplitudes of the modes, m, at the speed of mode 1 with the amplitude."""
    return np.asarray(amplitude * modes.frequencies[0] / modes.frequencies)


def dampers(law: DampingLaw | None, modes: Modes, amplitude: float, *, drag: bool = True) -> Dampers:
    """Return the coefficients for a law; ``drag`` says whether the program has quadratic drag."""
    found = Dampers()
    for term in law.laws if isinstance(law, SumOfLaws) else [] if law is None else [law]:
        if any(getattr(term, "flow", ())):
            raise InputError("a flow of air cannot be written for a simulator", "damping")
        if isinstance(term, RayleighDamping):
            found = replace(found, alpha=found.alpha + term.alpha, beta=found.beta + term.beta)
        elif isinstance(term, QuadraticDamping) and (drag or not term.eta2):
            found = replace(found, eta1=found.eta1 + term.eta1, eta2=found.eta2 + term.eta2)
        else:
            alpha, beta = _equivalent(term, modes, same_speed(modes, amplitude))
            warning = (
                f"{type(term).__name__} becomes alpha = {alpha:.4g} 1/s and beta = {beta:.4g} s, which meet the "
                f"damping ratio of mode 1 at a tip amplitude of {amplitude:.4g} m alone"
            )
            found = replace(
                found, alpha=found.alpha + alpha, beta=found.beta + beta, warnings=(*found.warnings, warning)
            )
    return found


def _equivalent(term: DampingLaw, modes: Modes, amplitudes: Array) -> tuple[float, float]:
    """Return alpha and beta, 0 or more, that meet the first damping ratio, and the others by least squares."""
    ratios, of_alpha, of_beta = (
        law.damping_ratios(modes, amplitudes) for law in (term, RayleighDamping(1.0), RayleighDamping(beta=1.0))
    )
    beta = 0.0
    if isinstance(term, ModalDamping):
        gains = of_beta - of_beta[0] / of_alpha[0] * of_alpha
        missing = ratios - ratios[0] / of_alpha[0] * of_alpha
        beta = float(np.clip(gains @ missing / (gains @ gains), 0.0, ratios[0] / of_beta[0]))
    return float((ratios[0] - beta * of_beta[0]) / of_alpha[0]), beta
