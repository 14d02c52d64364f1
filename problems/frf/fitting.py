"""Fit of modal parameters to measured frequency response functions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance, flag, is_sequence, physical, shown, vector, whole
from ancf_casadi.support.interrupts import lasting_interrupts
from ancf_casadi.support.progress import counter
from problems.frf.delay import remaining_delay, remove_delay
from problems.frf.leakage import remove_leakage
from problems.frf.modal_sum import RESIDUAL_POWERS, ModalSum, TrialFit
from problems.frf.record import FrfRecord
from problems.frf.refinement import FRF_ADVICE, stated_deviations
from problems.frf.result import FrfFit, refine_result
from problems.frf.selection import (
    MOST_FRF_MODES,
    Candidates,
    Selection,
    bins,
    poles_near,
    select_modes,
    stability_chart,
)

MOST_DELAYS = 4  # largest number of corrections of the delay


@lasting_interrupts()
def fit_frf(
    record: FrfRecord,
    *,
    modes: int | None = None,
    frequencies: Sequence[float] | None = None,
    band: tuple[float, float] | None = None,
    progress: bool = False,
) -> FrfFit:
    """Identify natural frequencies, damping ratios and mode shapes from frequency response functions.

    sdypy-EMA gives the poles to start from; then all parameters are refined together by weighted least squares.  The
    weights are those of the coherence or the standard deviations of the record, or follow from the residuals.  From a
    record of ``frf_of`` under a shaker, the leakage that the measured force explains is removed; the weights are then
    those of the noise that is left.

    Parameters
    ----------
    record : FrfRecord
        Measured functions.
    modes : int, optional
        Number of modes in the band; as many as the record clearly shows if not given.
    frequencies : sequence of float, optional
        Approximate natural frequencies of the modes, Hz; sdypy-EMA is then not needed.
    band : (float, float), optional
        Lowest and highest frequency to fit, Hz; the whole record if not given.
    progress : bool
        Whether to count the trial fits on a terminal.

    Raises
    ------
    InputError
        If an argument is out of range, the record is too short for the modes, or sdypy-EMA is missing.
    FitError
        If there is no mode, or the fit does not converge.

    Examples
    --------
    >>> import numpy as np
    >>> from problems import FrfRecord, fit_frf
    >>> f, rng = np.linspace(1.0, 30.0, 1161), np.random.default_rng(0)
    >>> terms = [a / (f0**2 - f**2 + 2j * z * f0 * f) for a, f0, z in ((3.0, 10.0, 0.01), (-2.0, 20.0, 0.005))]
    >>> noise = rng.normal(0.0, 0.01, (2, f.size)).T @ [1, 1j]
    >>> fit = fit_frf(FrfRecord(f, terms[0] + terms[1] + noise, "receptance"), frequencies=[10.1, 19.8])
    >>> for k, (frequency, ratio) in enumerate(zip(fit.frequencies, fit.damping_ratios), start=1):
    ...     print(f"{frequency:.2f} Hz, {ratio:.5f} +- {fit.standard_errors[f'damping_ratio_{k}']:.5f}")
    10.00 Hz, 0.00996 +- 0.00004
    20.00 Hz, 0.00503 +- 0.00006
    """
    check_instance(record, "record", FrfRecord)
    if band is not None:
        low, high = vector(band, "band")
        if not low < high:
            raise InputError(f"must be two frequencies, Hz, the lower one first, got {shown(band)}", "band")
        record = record.between(low, high)
    mode_count = None if modes is None else whole(modes, "modes", 1, MOST_FRF_MODES)
    guesses = None if frequencies is None else _check_frequencies(frequencies, record)
    if guesses is not None:
        if mode_count not in (None, len(guesses)):
            raise InputError(f"is {shown(modes)}, but {len(guesses)} frequencies are given; leave it out", "modes")
        mode_count = len(guesses)
    delay, undelayed = 0.0, record
    with counter("fit", shown=flag(progress, "progress")):
        for _ in range(MOST_DELAYS):
            trial, selection_notes = _fit_modes(undelayed, guesses, mode_count)
            further_delay = remaining_delay(trial, required=delay != 0.0)
            if not further_delay:
                break
            delay += further_delay
            undelay = partial(remove_delay, frequencies=record.frequencies, delay=delay)
            scatter = record.scatter and record.scatter.map(undelay)
            undelayed = replace(record, values=undelay(record.values), scatter=scatter)
    count, lines = len(trial.frequencies), record.frequencies
    notes = [*record.notes, *selection_notes]
    if delay:
        notes.append(
            f"a delay of {1e3 * delay:.3g} ms, as of a late trigger or a filter, shifts the phase of all functions; it "
            "was removed, and the standard errors take it as known"
        )
    if mode_count is not None and count != mode_count:
        notes.append(f"the record supports {count} of {mode_count} modes")
    order = np.argsort(trial.frequencies)
    trial = replace(trial, frequencies=trial.frequencies[order], ratios=trial.ratios[order])
    refit = partial(fit_frf, modes=modes, frequencies=frequencies, band=band)
    fit = refine_result(*remove_leakage(undelayed, trial), tuple(notes), refit)
    if not ((fit.frequencies >= lines[0]) & (fit.frequencies <= lines[-1])).all():
        raise FitError(f"a mode left the band; {FRF_ADVICE}")
    return fit


def _fit_modes(record: FrfRecord, guesses: Array | None, mode_count: int | None) -> tuple[TrialFit, list[str]]:
    """Select and fit the modes of a record until the weights settle; return the fit and notes of the selection."""
    values = record.columns
    model = ModalSum.of(record.frequencies, record.kind, RESIDUAL_POWERS[0], record.window)
    modes = mode_count or 0
    if 2 * modes + values.shape[1] * (2 * modes + len(RESIDUAL_POWERS[0])) > values.size:
        raise InputError(f"has too few frequencies, {len(record.frequencies)}, for {mode_count} modes", "record")

    deviations = stated_deviations(record)
    candidates: Candidates
    if guesses is None:
        candidates = stability_chart(record)
    else:
        candidates = poles_near(model, values / np.sqrt(np.median(deviations**2, axis=0)), guesses)
    estimated = record.std is None and record.coherence is None
    coarse = replace(model, starts=bins(record.frequencies, candidates))
    means = coarse.bin_means(values), np.sqrt(coarse.bin_means(deviations**2) / np.sqrt(coarse.bin_sizes)[:, None])
    trial, notes = select_modes(Selection(*means, estimated, candidates, mode_count), coarse)
    if guesses is not None and len(trial.frequencies) < len(guesses):
        raise FitError(f"only {len(trial.frequencies)} of the {mode_count} modes were found; {FRF_ADVICE}")
    selection = Selection(values, deviations, estimated, candidates, len(trial.frequencies))
    binned = trial.model.starts is not None
    if binned:  # the same modes at all lines
        trial = replace(trial, model=replace(trial.model, starts=None), values=values, weights=1 / deviations)
    for turn in range(3):  # rounds in which weights and estimates settle; with those from the bins, one fit is enough
        if turn == 0 or not binned:
            trial = selection.reweight(trial)
        else:
            trial = replace(trial, weights=1 / selection.estimate_deviations(trial))
    return trial, notes


def _check_frequencies(frequencies: Any, record: FrfRecord) -> Array:
    """Return approximate natural frequencies within the record."""
    if not is_sequence(frequencies) or not len(frequencies):
        raise InputError(f"must be one or more frequencies, got {shown(frequencies)}", "frequencies")
    checked = np.sort([physical(f, "frequencies") for f in frequencies])
    low, high = record.frequencies[0], record.frequencies[-1]
    for f in checked.tolist():
        if not low <= f <= high:
            raise InputError(f"{f:g} Hz is outside the band, {low:g} to {high:g} Hz", "frequencies")
    if not np.diff(checked).all():
        raise InputError("has a frequency twice; for two close modes, give two different ones", "frequencies")
    return checked
