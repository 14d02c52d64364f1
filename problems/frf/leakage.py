"""Removal of leakage from frequency response functions under a shaker.

The response in a block depends also on the force before it, and on the force of the block in other shares than the
window has.  ``window`` states the mean effect on H1 under a Hann window.  The error beside it does not average out as
noise does: it is the larger one, unless the noise is strong, and successive blocks that overlap share it with a
correlation of their own, positive for frequencies and negative for damping ratios.

But it follows from the measured force f.  The fitted modes h have the response h * f, plus free vibrations at their
poles, which begin before the record and are fitted to the measured response.  The H1 of this response, less its mean
under the window, is the error due to leakage.  The same holds for the deviations of the blocks; what is left of them is
noise.  Its variance is fitted as A/G_ff + B |h|^2 (``refinement``): weights from the scatter of few blocks at each line
would follow the errors, and the blocks would then state smaller errors than the estimates have.  Removal and fit
alternate until the modes stay the same; if they do not, leakage remains, with the errors that the blocks show.

References
----------
R. Pintelon, J. Schoukens, System Identification: A Frequency Domain Approach, Wiley (2012), Sections 2.2 and 6.3.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ancf_casadi.estimation.noise.proportional import proportional_variance
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.tall import tall_times, tall_triangle
from problems.frf.blocks import Take
from problems.frf.estimators import h1_functions
from problems.frf.modal_sum import TrialFit, quick_fit
from problems.frf.record import BlockScatter, FrfRecord, least_std
from problems.frf.refinement import stated_deviations
from problems.frf.window import BlockWindow, hann_window

MOST_REMOVALS, SAME_MODES = 15, 1e-5  # rounds, and changes of poles, relative to their half-power half-widths


def remove_leakage(record: FrfRecord, trial: TrialFit) -> tuple[FrfRecord, TrialFit]:
    """Return a record without leakage, and its fit; the same record and fit if there is none, or it remains."""
    scatter, window, start = record.scatter, record.window, trial
    if not (scatter and scatter.takes and window and window.leakage):
        return record, trial
    for _ in range(MOST_REMOVALS):
        record_without = _without_leakage(record, scatter, window, trial)
        weights = 1 / stated_deviations(record_without)
        refined = quick_fit(replace(trial, values=record_without.columns, weights=weights))
        if refined is None:
            break
        change = np.abs(refined.bounded - trial.bounded) / trial.scales
        if change.max() < SAME_MODES:
            return record_without, refined
        trial = refined
    return record, start


def _without_leakage(record: FrfRecord, scatter: BlockScatter, window: BlockWindow, trial: TrialFit) -> FrfRecord:
    """Return a record without the leakage of the modes of a fit."""
    size = round(window.duration / scatter.takes[0].step)
    lines = np.rint(record.frequencies * window.duration).astype(int)
    vibrations = [_vibration(take, trial) for take in scatter.takes]
    blocks = np.array([vibrations[number][:, begin : begin + size] for number, begin in scatter.places])
    spectra = np.fft.rfft(hann_window(size) * blocks)[:, :, lines]
    functions, deviations = h1_functions(spectra[:, :1], spectra[:, 1:])
    noise = BlockScatter(scatter.deviations - deviations, scatter.averages)
    terms = 2 * len(trial.frequencies)  # of the modes; residual terms follow
    mean_functions = tall_times(trial.columns[:, :terms], trial.coefficients[:terms]).T
    values = record.values - (functions - mean_functions)[:, None]
    force_power = np.mean(np.abs(spectra[:, 0]) ** 2, axis=0)
    scaled = noise.variance * force_power, np.abs(trial.fitted.T) ** 2 * force_power
    variances = np.array([*map(proportional_variance, *scaled)]) / force_power
    std = np.maximum(np.sqrt(variances), least_std(values[:, 0]))
    return replace(record, values=values, std=std, scatter=noise)


def _vibration(take: Take, trial: TrialFit) -> Array:
    """Return the force of a take and the response of the modes of a fit to it, (1 + outputs, n)."""
    force, count = take.channels[:1], take.channels.shape[1]
    f, ζ, terms = trial.frequencies, trial.ratios, 2 * len(trial.frequencies)
    model = replace(trial.model, frequencies=np.arange(count // 2 + 1) / (count * take.step), window=None)
    functions = tall_times(model.modal(f, ζ), trial.coefficients[:terms])
    forced = np.fft.irfft(functions.T * np.fft.rfft(force), count)
    poles = 2 * np.pi * f * (-ζ + 1j * np.sqrt(1 - ζ**2))
    decays = np.exp(np.outer(take.step * np.arange(count), poles))
    free = np.hstack([decays.real, decays.imag])
    triangle = tall_triangle(np.hstack([free, (take.channels[1:] - forced).T]))
    amplitudes = np.array(np.linalg.lstsq(triangle[:terms, :terms], triangle[:terms, terms:])[0], dtype=float)
    return np.vstack([force, forced + tall_times(free, amplitudes).T])
