"""Limitations of modal parameters from frequency response functions, as warnings."""

from __future__ import annotations

import numpy as np

from ancf_casadi.estimation.solver.noise import MOST_CONCENTRATION, concentration
from problems.decay.limitations import IMPRECISE
from problems.frf.modal_sum import RESIDUAL_POWERS
from problems.frf.record import FrfRecord
from problems.frf.refinement import Refinement


def limitations(record: FrfRecord, refinement: Refinement) -> list[str]:
    """Return the limitations of a fit, one sentence each."""
    trial, fit, f = refinement.trial, refinement.corrected, record.frequencies
    notes = []
    for k, (own, ζ) in enumerate(zip(trial.frequencies.tolist(), trial.ratios.tolist(), strict=True), start=1):
        width = 2 * ζ * own
        place = int(np.clip(np.searchsorted(f, own), 1, len(f) - 1))
        spacing = float(f[place] - f[place - 1])
        if width < 3.0 * spacing:  # fewer than three lines in the half-power bandwidth
            notes.append(
                f"mode {k}: its half-power bandwidth of {width:.3g} Hz holds few frequencies, which are {spacing:.3g} "
                "Hz apart; leakage in the measurement may add to the damping, and a finer resolution would show it"
            )
        if own - width / 2 < f[0] or own + width / 2 > f[-1]:
            notes.append(f"mode {k}: its resonance at {own:.4g} Hz is at the end of the band; widen the band")
        error = fit.standard_errors[f"damping_ratio_{k}"]
        if error > IMPRECISE * ζ:
            notes.append(
                f"mode {k}: the damping ratio has a standard error of {100 * error / ζ:.2g} %; less noise, or a finer "
                "resolution, would help"
            )
    if trial.model.powers == RESIDUAL_POWERS[-1]:
        notes.append(
            "a mode close to the band, or one in it that was not found, shows in the functions, and many residual "
            "terms stand for it; widen the band to include it"
        )
    focus = concentration(fit.residuals, fit.series, fit.times)
    if focus > MOST_CONCENTRATION:
        notes.append(
            f"the residuals are not noise: their power is concentrated {focus:.2g} times as much; a mode may be "
            "missing, the motion may be nonlinear, or the measurement may leak, and the errors allow for it in part"
        )
    return notes
