"""Figure of Rayleigh damping."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from ancf_casadi.support.figures import COMPUTED, MEASURED, literal_text
from problems.modal_damping.rayleigh import RayleighFit, rayleigh_ratio


@literal_text
def rayleigh_figure(fits: Mapping[str, RayleighFit]) -> Figure:
    """Draw measured damping ratios with their errors, and the fitted laws, Eq. (16), against frequency."""
    figure = Figure(figsize=(6, 3.6), layout="constrained")
    axes = figure.subplots()
    for k, (label, fit) in enumerate(fits.items()):
        colours = (COMPUTED, MEASURED) if not k else (f"C{k}", f"C{k}")
        frequencies = np.geomspace(0.8 * fit.frequencies[0], 1.25 * fit.frequencies[-1], 200)
        ratios = rayleigh_ratio(frequencies, fit.alpha, fit.beta)
        axes.plot(frequencies, 100 * ratios, lw=1, color=colours[0], label=f"{label} fit".strip())
        errors = None if fit.ratio_std is None else 100 * np.array(fit.ratio_std)
        measured = 100 * np.array(fit.measured)
        axes.errorbar(fit.frequencies, measured, errors, fmt="o", color=colours[1], label=f"{label} measured".strip())
    axes.set(xscale="log", xlabel="frequency, Hz", ylabel="damping ratio, %")
    ticks = sorted({frequency for fit in fits.values() for frequency in fit.frequencies})
    axes.set_xticks(ticks, [f"{frequency:.4g}" for frequency in ticks])
    axes.minorticks_off()
    axes.legend(frameon=False)
    return figure
