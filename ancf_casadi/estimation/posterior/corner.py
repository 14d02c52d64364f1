"""The corner plot of samples of a posterior distribution."""

from __future__ import annotations

from typing import Any

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import Figure

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

    Examples
    --------
    >>> import numpy as np
    >>> from ancf_casadi import Measurement
    >>> from problems import corner_figure, fit_decay
    >>> time = np.linspace(0.0, 10.0, 1001)
    >>> noise = np.random.default_rng(0).normal(scale=1e-4, size=time.size)
    >>> fit = fit_decay(Measurement(time, 0.02 * np.exp(-0.1 * time) * np.cos(12.0 * time) + noise))
    >>> figure = corner_figure(fit.sample(draws=50, chains=1))
    >>> figure.axes[-1].get_xlabel()
    'offset, m'
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
