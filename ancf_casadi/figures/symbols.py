"""Symbols of supports, attachments and forces in drawings of a beam.

    clamp       a wall across the beam            point mass          a disc
    pin         a triangle on hatched ground      spring              a zigzag to the ground
    roller      a triangle on two wheels          torsional spring    a spiral
    guide       a wall on two wheels              dashpot             a piston in its cylinder

The ground lies below the drawn beam; for a roller or a guide, it is parallel to the direction of sliding.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.markers import MarkerStyle
from matplotlib.path import Path
from matplotlib.transforms import Affine2D

from ancf_casadi.mechanics.attachments import Attachment, Dashpot, PointMass, RotationalSpring, Spring
from ancf_casadi.mechanics.loads import Load, PointLoad
from ancf_casadi.mechanics.model import Model
from ancf_casadi.mechanics.supports import Clamp, Support
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import MEASURED

Stroke = Sequence[tuple[float, float]]
Symbol = tuple[Support | Attachment, Line2D, MarkerStyle]

HATCH: list[Stroke] = [[(x, 0.0), (x - 0.35, -0.45)] for x in (-0.7, -0.15, 0.4, 0.95)]


def draw_symbols(axes: Axes, model: Model, coordinates: Array) -> list[Symbol]:
    """Draw supports and attachments of a beam with the given coordinates, in axes of mm, and return the symbols."""
    items: list[Support | Attachment] = [*model.beam.supports, *model.beam.attachments]
    symbols = []
    for item in items:
        x, y = 1e3 * (model.interpolation(item.point) @ coordinates)
        slope = model.slope_interpolation(item.point) @ coordinates
        path, direction, size = _symbol(item, math.atan2(slope[1], slope[0]))
        style = MarkerStyle(path, transform=Affine2D().rotate(direction))
        fill = MEASURED if isinstance(item, PointMass) else "none"
        (line,) = axes.plot(x, y, marker=style, ms=size, mec=MEASURED, mfc=fill, mew=1.0, ls="none", zorder=3,
                            label="_nolegend_")  # fmt: skip
        symbols.append((item, line, style))
    return symbols


def draw_gravity(axes: Axes, model: Model, corner: tuple[float, float]) -> None:
    """Draw an arrow in the direction of gravity, if there is any, at a place in the axes from (0, 0) to (1, 1)."""
    x, y = model.beam.gravity
    if x or y:
        style = MarkerStyle(_path(ARROW), transform=Affine2D().rotate(math.atan2(y, x)))
        axes.plot(*corner, marker=style, ms=24.0, mec=MEASURED, mfc="none", ls="none", transform=axes.transAxes)
        axes.annotate("g", corner, (7, 0), "axes fraction", "offset points", color=MEASURED, va="center")


def draw_loads(axes: Axes, model: Model, coordinates: Array, loads: Sequence[Load]) -> None:
    """Draw the directions of forces as arrows that end at their points on a beam, in axes of mm."""
    for load in loads:
        beam, force = model.beam, np.array(load.force)
        points = [load.place(beam)] if isinstance(load, PointLoad) else np.linspace(*load.places(beam), 7).tolist()
        for point in points if force.any() else ():
            x, y = model.slope_interpolation(point) @ coordinates
            direction = np.array([[x, -y], [y, x]]) @ force if load.follower else force
            dx, dy = (-22.0 * direction / np.linalg.norm(direction)).tolist()  # points of the page
            end, offset = tuple(1e3 * (model.interpolation(point) @ coordinates)), (dx, dy)
            axes.annotate(
                "", end, offset, textcoords="offset points", arrowprops={"arrowstyle": "->", "color": MEASURED}
            )


def _symbol(item: Support | Attachment, angle: float) -> tuple[Path, float, float]:
    """Return the path of a symbol, its rotation for a beam at an angle (rad), and its size in points."""
    if isinstance(item, PointMass):
        return Path.unit_circle(), 0.0, 7.0
    if isinstance(item, RotationalSpring):
        angles = np.linspace(0.0, 4 * math.pi, 60)
        radius = 0.15 + 0.85 * angles / angles[-1]
        return Path(np.column_stack([radius * np.cos(angles), radius * np.sin(angles)])), angle, 12.0
    if isinstance(item, Spring | Dashpot):
        pair = item.stiffness if isinstance(item, Spring) else item.coefficient
        strokes = ZIGZAG if isinstance(item, Spring) else PISTON
        return _path(strokes), 0.0 if pair[1] >= pair[0] else math.pi / 2, 26.0
    assert isinstance(item, Support)
    if isinstance(item, Clamp):
        ground = math.pi / 2 if item.point else -math.pi / 2  # the hatching points away from the beam
        return _path([[(-1.0, 0.0), (1.0, 0.0)], *HATCH]), angle + ground, 16.0
    if item.sliding is None:
        return _path([*TRIANGLE, *([(x, y - 1.0) for x, y in stroke] for stroke in HATCH)]), _ground(angle), 18.0
    sliding = math.atan2(item.sliding[1], item.sliding[0])
    body = TRIANGLE if item.turns else [[(-0.8, 0.0), (0.8, 0.0), (0.8, -1.0), (-0.8, -1.0), (-0.8, 0.0)]]
    return _path([*body, *WHEELS, [(-1.0, -1.5), (1.0, -1.5)]]), _ground(sliding), 22.0


def _ground(angle: float) -> float:
    """Return the rotation of ground along a direction, such that the ground is below."""
    return angle if math.cos(angle) >= -1e-9 else angle + math.pi


def _path(strokes: Sequence[Stroke]) -> Path:
    codes = [Path.MOVETO if k == 0 else Path.LINETO for stroke in strokes for k in range(len(stroke))]
    return Path([point for stroke in strokes for point in stroke], codes)


def _circle(x: float, y: float, radius: float) -> Stroke:
    return [(x + radius * math.cos(t), y + radius * math.sin(t)) for t in np.linspace(0.0, 2 * math.pi, 17).tolist()]


ARROW: list[Stroke] = [[(-1.0, 0.0), (1.0, 0.0)], [(0.5, 0.3), (1.0, 0.0), (0.5, -0.3)]]
TRIANGLE: list[Stroke] = [[(0.0, 0.0), (0.8, -1.0), (-0.8, -1.0), (0.0, 0.0)]]
WHEELS: list[Stroke] = [_circle(-0.45, -1.25, 0.25), _circle(0.45, -1.25, 0.25)]
GROUND: list[Stroke] = [[(-0.5, -2.0), (0.5, -2.0)], *([(x, -2.0), (x - 0.2, -2.25)] for x in (-0.3, 0.1, 0.5))]
ZIGZAG: list[Stroke] = [
    [(0.0, 0.0), (0.0, -0.5), (0.3, -0.65), (-0.3, -0.95), (0.3, -1.25), (-0.3, -1.55), (0.0, -1.7), (0.0, -2.0)],
    *GROUND,
]
PISTON: list[Stroke] = [
    [(0.0, 0.0), (0.0, -1.0)],
    [(-0.3, -1.0), (0.3, -1.0)],
    [(-0.4, -0.7), (-0.4, -1.5), (0.4, -1.5), (0.4, -0.7)],
    [(0.0, -1.5), (0.0, -2.0)],
    *GROUND,
]
