"""The assumed deflection of Figure 11: a cantilever under a uniform load, Eq. (21), beside its first mode.

The computed deflection is the static equilibrium of a beam under a small weight across its axis, divided by the
displacement of the tip.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ancf_casadi.damping.quadratic import ASSUMED_SHAPE
from ancf_casadi.mechanics.beam import Beam
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.vibration.equilibrium import static_equilibrium
from ancf_casadi.vibration.modes import natural_modes
from problems.study.drawing import line, new_figure, series

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SMALL = 1e-3  # deflection of the tip relative to the length
POINTS = 51


@dataclass(frozen=True, eq=False)
class Deflection:
    """Deflections along a cantilever, relative to that of the tip.

    Parameters
    ----------
    places : ndarray
        Arc length relative to the length of the beam (k,).
    uniform_load : ndarray
        Computed deflection under a uniform load (k,).
    assumed : ndarray
        The shape of Eq. (21) (k,).
    mode : ndarray
        Mode 1 (k,).
    """

    places: Array
    uniform_load: Array
    assumed: Array
    mode: Array


def deflections(beam: Beam) -> Deflection:
    """Return the deflections of a beam without gravity.

    Raises
    ------
    EquilibriumError
        If no equilibrium is found.
    """
    x, y = beam.axis
    across = np.array([-y, x])
    weightless = beam.with_(gravity=(0.0, 0.0))
    stiffness = min(np.array(beam.elastic_modulus) * np.array([s.second_moment for s in beam.sections]))
    acceleration = SMALL * 8 * stiffness / (beam.mass * beam.length**2)  # w = mu g L^4/(8 E I)
    loaded = static_equilibrium(Model(beam.with_(gravity=tuple(acceleration * across))))
    modes = natural_modes(Model(weightless), count=1)
    places = np.linspace(0.0, 1.0, POINTS)
    points = [modes.model.interpolation(float(s)) for s in places * beam.length]
    bent, mode = (np.array([point @ e for point in points]) @ across for e in (loaded.coordinates, modes.shapes[:, 0]))
    return Deflection(places, bent / bent[-1], ASSUMED_SHAPE(places), mode / mode[-1])


def deflection_figure(shapes: Deflection) -> Figure:
    """Draw the deflections, and below their differences from Eq. (21)."""
    figure, (deflection, difference) = new_figure(4.2, 2, sharex=True, height_ratios=(2, 1))
    deflection.plot(shapes.places, shapes.assumed, **line(0), label="Eq. (21)")
    computed = {**series(2), "linestyle": ""}
    deflection.plot(shapes.places[::5], shapes.uniform_load[::5], **computed, ms=5, label="computed, uniform load")
    deflection.plot(shapes.places, shapes.mode, **line(1), label="computed, mode 1")
    deflection.set(ylabel="deflection / deflection of the tip")
    deflection.legend()
    difference.plot(shapes.places[::5], 100 * (shapes.uniform_load - shapes.assumed)[::5], **computed, ms=5)
    difference.plot(shapes.places, 100 * (shapes.mode - shapes.assumed), **line(1))
    difference.set(xlabel="arc length / length of the beam", ylabel="difference\nfrom Eq. (21), %")
    figure.align_ylabels()
    return figure
