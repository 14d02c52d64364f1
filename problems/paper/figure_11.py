"""Figure 11: the assumed deflection of the quadratic model, Eq. (21), beside mode 1.

The computed deflection is the static equilibrium of a beam under a small weight across its axis, divided by the
displacement of the tip.
"""

from __future__ import annotations

import numpy as np

from ancf_casadi import Beam, Model, natural_modes, static_equilibrium
from ancf_casadi.damping.quadratic import ASSUMED_SHAPE
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import Figure
from problems.paper.inputs import STANDARD_BEAM
from problems.paper.step import paper_step
from problems.study.compute import Compute
from problems.study.drawing import line, new_figure, series
from problems.study.step import Finding


@paper_step(
    title="Assumed deflection of the quadratic model, Eq. (21)",
    text="""
Eq. (26) rests on one assumed shape, the deflection under a uniform load. Mode 1 differs from it by at most 1.5 % of \
the displacement of the tip, so that its constant in Eq. (25) is 0.739 instead of 0.740; those of modes 2 to 5 are \
0.647, 0.632, 0.623 and 0.618.""",
    figures=("Figure 11",),
)
def assumed_deflection(compute: Compute) -> Finding:
    """Return the largest differences of the computed deflections from Eq. (21), relative to that of the tip."""
    places, bent, mode = deflections(STANDARD_BEAM)
    caption = (
        "Deflection of the beam under a uniform load, relative to that of the tip: Eq. (21), the computed "
        "equilibrium, and mode 1 beside them.  Below: differences from Eq. (21)."
    )
    differences = {
        "uniform_load_difference": float(np.abs(bent - ASSUMED_SHAPE(places)).max()),
        "mode_1_difference": float(np.abs(mode - ASSUMED_SHAPE(places)).max()),
    }
    return Finding(differences, figures=compute.drawings((caption, deflection_figure, places, bent, mode)))


def deflections(beam: Beam) -> tuple[Array, Array, Array]:
    """Return places along a beam without gravity, its deflection there under a uniform load, and its mode 1."""
    across = np.array(beam.across)
    weightless = beam.with_(gravity=(0.0, 0.0))
    stiffness = min(np.array(beam.elastic_modulus) * np.array([s.second_moment for s in beam.sections]))
    # deflection of the tip relative to the length
    acceleration = 1e-3 * 8 * stiffness / (beam.mass * beam.length**2)  # w = mu g L^4/(8 E I)
    loaded = static_equilibrium(Model(beam.with_(gravity=tuple(acceleration * across))))
    modes = natural_modes(Model(weightless), count=1)
    places = np.linspace(0.0, 1.0, 51)
    points = [modes.model.interpolation(float(s)) for s in places * beam.length]
    bent, mode = (np.array([point @ e for point in points]) @ across for e in (loaded.coordinates, modes.shapes[:, 0]))
    return places, bent / bent[-1], mode / mode[-1]


def deflection_figure(places: Array, bent: Array, mode: Array) -> Figure:
    """Draw the deflections, and below their differences from Eq. (21)."""
    figure, (deflection, difference) = new_figure(4.2, 2, sharex=True, height_ratios=(2, 1))
    assumed, computed = ASSUMED_SHAPE(places), {**series(2), "linestyle": ""}
    deflection.plot(places, assumed, **line(0), label="Eq. (21)")
    deflection.plot(places[::5], bent[::5], **computed, ms=5, label="computed, uniform load")
    deflection.plot(places, mode, **line(1), label="computed, mode 1")
    deflection.set(ylabel="deflection / deflection of the tip")
    deflection.legend()
    difference.plot(places[::5], 100 * (bent - assumed)[::5], **computed, ms=5)
    difference.plot(places, 100 * (mode - assumed), **line(1))
    difference.set(xlabel="arc length / length of the beam", ylabel="difference\nfrom Eq. (21), %")
    figure.align_ylabels()
    return figure
