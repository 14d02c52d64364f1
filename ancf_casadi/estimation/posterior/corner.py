"""The corner plot of samples of a posterior distribution."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHARES = (0.95, 0.5)  # of the samples within the contours


def corner_figure(samples: Any) -> Figure:
    """Draw the distribution of each quantity, and of each pair with contours about 50 and 95 % of the samples.

    Dotted lines are the ends of the central 95 %.

    Parameters
    ----------
    samples : arviz.InferenceData
        What ``fit.sample()`` returns.

    Raises
    ------
    InputError
        If it has no group ``posterior`` with samples of at least one quantity.
    """
    from ancf_casadi.estimation.figures import drawn_corner  # matplotlib is slow to import

    posterior = getattr(samples, "posterior", None)
    variables = getattr(posterior, "data_vars", None)
    if not variables:
        raise InputError("must be the samples that fit.sample() returns", "samples")
    labels = [
        f"{name}, {own.attrs['units']}" if own.attrs.get("units") else str(name) for name, own in variables.items()
    ]
    columns: list[Array] = [np.asarray(own.values, dtype=float).ravel() for own in variables.values()]
    return drawn_corner([label.replace("_", " ") for label in labels], columns, SHARES)
