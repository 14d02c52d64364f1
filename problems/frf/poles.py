"""Candidates of poles, from the least-squares complex frequency-domain method (LSCF) of sdypy-EMA.

The method fits a common-denominator model in discrete time to equally spaced lines; its order grows step by step, as in
a stability chart.  All poles of all orders are candidates: ``selection`` chooses among them.
"""

from __future__ import annotations

import importlib
import warnings
from dataclasses import dataclass

import numpy as np

from ancf_casadi.exceptions import FitError, InputError
from ancf_casadi.support.arrays import Array, ComplexArray, Index
from ancf_casadi.support.banded import tall_triangle
from problems.frf.modal_sum import ModalSum, stacked

RATIO_RANGE = (1e-5, 0.6)  # least and largest damping ratio of a candidate
RATIO_GRID = (3e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1, 0.25)  # damping ratios to try at a given frequency
POLE_WIDTHS, POLE_DISTANCE = 0.3, 2e-3  # distance of equal poles, relative to their half-width, and to their frequency
MODULE, MISSING = "sdypy.EMA", "sdypy-EMA"


@dataclass(frozen=True, eq=False)
class Candidates:
    """Possible modes."""

    frequencies: Array  # natural frequencies, Hz, (c,)
    ratios: Array  # damping ratios, (c,)
    recurring: Index  # indices of the modes that recur in the chart, most often first


def candidate_poles(frequencies: Array, values: ComplexArray) -> Candidates:
    """Return the poles of all orders in the band, and those among them that recur."""
    try:
        ema = importlib.import_module(MODULE)
    except ModuleNotFoundError:
        raise InputError(
            "is not installed, but finds the poles; pip install sdypy-EMA, or give approximate frequencies", MISSING
        ) from None
    f, rows = _equally_spaced(frequencies, values.T)
    order = max(2, min(40, len(f) // 3))  # at least three lines per order
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            model = ema.Model(rows, f, lower=f[0], upper=2 * f[-1], pol_order_high=order)
            model.get_poles(method="lscf", show_progress=False)
        except np.linalg.LinAlgError:
            raise FitError("sdypy-EMA finds no poles; give approximate frequencies") from None
    found = np.concatenate([np.asarray(part, dtype=float) for part in model.pole_freq])
    ratios = np.concatenate([np.asarray(part, dtype=float) for part in model.pole_xi])
    orders = np.repeat(np.arange(len(model.pole_freq)), [len(part) for part in model.pole_freq])
    inside = (found >= f[0]) & (found <= f[-1]) & (ratios > RATIO_RANGE[0]) & (ratios < RATIO_RANGE[1])
    if not inside.any():
        raise FitError("sdypy-EMA finds no poles in the band; give approximate frequencies")
    return Candidates(found[inside], ratios[inside], _recurring(found[inside], ratios[inside], orders[inside]))


def _recurring(frequencies: Array, ratios: Array, orders: Index) -> Index:
    """Return the indices of poles that occur at many orders, most often first, one for each group of near ones."""
    poles = frequencies * (-ratios + 1j * np.sqrt(1 - ratios**2))
    width = frequencies * ratios
    distance = np.abs(poles[:, None] - poles)
    near = distance < POLE_WIDTHS * width[:, None] + POLE_DISTANCE * frequencies[:, None]
    times = np.array([len(np.unique(orders[row])) for row in near])
    found: list[int] = []
    for k in np.argsort(-times, kind="stable").tolist():
        # a recurring pole occurs at four orders, and at a quarter of all
        if times[k] < max(4, 0.25 * (orders.max() + 1)):
            break
        if all(distance[k, other] > width[k] + POLE_DISTANCE * frequencies[k] for other in found):
            found.append(k)
    return np.array(found, dtype=np.int64)


def poles_near(model: ModalSum, values: ComplexArray, frequencies: Array) -> Candidates:
    """Return one mode for each given frequency, Hz, with the damping ratio of a grid that explains the values best."""
    measured, ratios = stacked(values), np.full(len(frequencies), RATIO_GRID[len(RATIO_GRID) // 2])
    for k in list(range(len(frequencies))) * 2:  # two sweeps over the modes
        rests = []
        for ζ in RATIO_GRID:
            ratios[k] = ζ
            columns = stacked(model.columns(frequencies, ratios))
            triangle = tall_triangle(np.hstack([columns / np.linalg.norm(columns, axis=0), measured]))
            rests.append(np.sum(triangle[columns.shape[1] :] ** 2))
        ratios[k] = RATIO_GRID[int(np.argmin(rests))]
    return Candidates(frequencies, ratios, np.arange(len(frequencies)))


def _equally_spaced(frequencies: Array, rows: ComplexArray) -> tuple[Array, ComplexArray]:
    """Return equally spaced lines, interpolated if those given are not."""
    even = np.linspace(frequencies[0], frequencies[-1], len(frequencies))
    # largest deviation of lines from equal spacing, relative to the spacing
    if np.abs(frequencies - even).max() <= 1e-3 * (even[1] - even[0]):
        return frequencies, rows
    step = float(np.median(np.diff(frequencies)))
    even = np.linspace(frequencies[0], frequencies[-1], 1 + round((frequencies[-1] - frequencies[0]) / step))
    even = even[: 20 * len(frequencies)]
    return even, np.array([np.interp(even, frequencies, row) for row in rows])
