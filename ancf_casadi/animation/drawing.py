"""Drawing of pictures: static artists are drawn once, and moving ones on copies of that, perhaps over a video."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.markers import MarkerStyle
from matplotlib.patheffects import withStroke
from PIL import Image

from ancf_casadi.animation.footage import Footage
from ancf_casadi.figures.beams import draw_plane, line_styles
from ancf_casadi.figures.symbols import draw_gravity, draw_symbols
from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import MEASURED, literal_text
from ancf_casadi.support.progress import count_step

ALL_PANELS = (640.0, 440.0)  # pixels for the panels together
MIN_PANEL = 130.0  # pixels of a side, for its title
MAX_COLUMNS = 960  # pixels of a picture over a background

Movements = list[tuple[Artist, Callable[[int], object]]]  # what moves, and how it takes its place in picture k


@dataclass(frozen=True)
class DrawnBeam:
    """A beam as the pictures show it."""

    model: Model
    coordinates: Array  # (pictures, 4 n + 4), nan while there is no motion
    trails: Sequence[Array]  # of some points, (pictures, m, 2), m

    @cached_property
    def positions(self) -> Array:
        """Positions of points along the beam, (pictures, m, 2), m."""
        length, elements = self.model.beam.length, self.model.beam.elements
        points = np.linspace(0.0, length, max(60, 3 * elements + 1)).tolist()
        rows = np.concatenate([self.model.interpolation(s) for s in points])
        return np.asarray((self.coordinates @ rows.T).reshape(len(self.coordinates), -1, 2))


@dataclass(frozen=True)
class Film:
    """Everything that the pictures show."""

    panels: Sequence[tuple[str, Mapping[str, DrawnBeam]]]  # titles, and beams by label; one panel over a background
    clock: Sequence[str]  # text above each picture
    markers: Array = field(default_factory=lambda: np.empty((1, 0, 2)))  # (pictures, m, 2), m
    background: Footage | None = None
    frames: Sequence[int] = ()  # numbers of the pictures of the background, from 0

    def view(self, positions: Array) -> Array:
        """Return positions in the coordinates of the panels: pixels of the background, or mm."""
        return self.background.pixels(positions) if self.background else 1e3 * positions


def pictures(film: Film) -> Iterator[Image.Image]:
    """Yield the pictures of a film, of even width and height."""
    moves: Movements = []
    figure = _draw(film, moves)
    figure.set_size_inches(*(0.02 * np.round(50.0 * figure.get_size_inches())))
    canvas: Any = FigureCanvasAgg(figure)
    artists = sorted(dict.fromkeys(artist for artist, _ in moves), key=lambda artist: artist.get_zorder())
    for artist in artists:
        artist.set_animated(True)
    canvas.draw()
    figure.set_layout_engine("none")
    static_background = canvas.copy_from_bbox(figure.bbox)
    for k in range(len(film.clock)):
        canvas.restore_region(static_background)
        for _, move in moves:
            move(k)
        for artist in artists:
            figure.draw_artist(artist)
        count_step()
        yield Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")


@literal_text
def _draw(film: Film, moves: Movements) -> Figure:
    """Return the figure of the first picture, and append the moving artists to ``moves``."""
    figure = Figure(dpi=100)
    plots = [_background(figure, film, moves)] if film.background else _panels(figure, film)
    for axes, (_, beams) in zip(plots, film.panels, strict=True):
        _draw_beams(axes, beams, film, moves)
    clock = figure.suptitle(film.clock[0], fontsize="medium")
    moves.append((clock, lambda k: clock.set_text(film.clock[k])))
    handles, labels = plots[0].get_legend_handles_labels()
    if len(labels) > 1:
        legend = figure.legend(handles, labels, ncols=4, fontsize="small", frameon=film.background is not None,
                               loc="lower center" if film.background else "outside lower center")  # fmt: skip
        moves.append((legend, lambda k: None))  # drawn over the background
    if film.background:
        clock.set_bbox({"color": "white", "pad": 2.0})
    return figure


def _panels(figure: Figure, film: Film) -> list[Axes]:
    """Return panels of one scale, in as many rows and columns as make them large, with titles and gravity."""
    drawn_beams = [beam for _, beams in film.panels for beam in beams.values()]
    shown = [*(beam.positions for beam in drawn_beams), film.markers]
    positions = 1e3 * np.concatenate([points.reshape(-1, 2) for points in shown])
    low, high = np.nanmin(positions, axis=0), np.nanmax(positions, axis=0)
    middle, size = (low + high) / 2, (high - low) + 0.2 * float((high - low).max())  # with room for symbols
    count = len(film.panels)
    scales = [
        min(ALL_PANELS[0] / (k * size[0]), ALL_PANELS[1] / (math.ceil(count / k) * size[1]))
        for k in range(1, count + 1)
    ]
    columns = int(np.argmax(scales)) + 1
    rows, panel = math.ceil(count / columns), np.maximum(max(scales) * size, MIN_PANEL)
    title_height = max(8 + 16 * (1 + title.count("\n")) if title else 0 for title, _ in film.panels)
    width, height = columns * (panel[0] + 20.0) + 70.0, rows * (panel[1] + 20.0 + title_height) + 80.0
    figure.set_size_inches(max(width, 300.0) / 100, max(height, 300.0) / 100)
    figure.set_layout_engine("constrained")
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, (title, beams) in zip(grid, film.panels, strict=False):
        draw_plane(axes)
        if count > 1:
            axes.set(xlabel="x, mm", ylabel="y, mm")
            axes.label_outer()
        axes.set_aspect("equal", adjustable="box")
        for name, centre, extent in zip("xy", middle, size, strict=True):
            axes.set(**{f"{name}lim": (centre - extent / 2, centre + extent / 2)})
        axes.set_title(title, fontsize="medium")
        corner = _free_corner((positions - middle) / size + 0.5, 26.0 / panel)
        draw_gravity(axes, next(iter(beams.values())).model, corner)
    for axes in grid[count:]:
        axes.set_visible(False)
    return list(grid[:count])


def _free_corner(positions: Array, inset: Array) -> tuple[float, float]:
    """Return the corner of a panel, inset for a symbol, that is farthest from the positions; all from 0 to 1."""
    corners = [(x, y) for x in (1.0 - inset[0], inset[0]) for y in (1.0 - inset[1], inset[1])]
    x, y = max(corners, key=lambda corner: np.nanmin(np.linalg.norm(positions - corner, axis=1)))
    return float(x), float(y)


def _background(figure: Figure, film: Film, moves: Movements) -> Axes:
    """Let the pictures of a video fill the figure."""
    footage = film.background
    assert footage is not None
    rows, columns = footage.image(film.frames[0]).shape[:2]
    figure.set_size_inches(np.array([columns, rows]) * min(1.0, MAX_COLUMNS / columns) / 100)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    image = axes.imshow(footage.image(film.frames[0]), cmap="gray", vmin=0, vmax=255, aspect="auto", zorder=0)
    moves.append((image, lambda k: image.set_data(footage.image(film.frames[k]))))
    return axes


def _draw_beams(axes: Axes, beams: Mapping[str, DrawnBeam], film: Film, moves: Movements) -> None:
    """Draw the beams of a panel with the traces of their points, supports, and measured markers."""
    halo: Any = {"path_effects": [withStroke(linewidth=4.0, foreground="white")]} if film.background else {}

    def draw(positions: Array, **style: Any) -> None:
        (line,) = axes.plot([], [], **style)
        _move(moves, line, film.view(positions))

    for (label, beam), (colour, dash) in zip(beams.items(), line_styles(beams), strict=False):
        for trail in beam.trails:
            draw(trail, color=colour, lw=0.8, alpha=0.6)
        draw(beam.positions, color=colour, ls=dash, lw=2.0, label=label if len(beams) > 1 else "computed", **halo)
        if film.background is None:
            _draw_symbols(axes, beam, moves)
    if film.markers.shape[1]:
        draw(film.markers, ls="none", marker="o", ms=6.0, mfc="none", mec=MEASURED, mew=1.2, label="measured", **halo)


def _move(moves: Movements, line: Line2D, data: Array) -> None:
    moves.append((line, lambda k: line.set_data(*data[k].T)))


def _draw_symbols(axes: Axes, beam: DrawnBeam, moves: Movements) -> None:
    """Draw supports and attachments, which move with their points, and turn with the base if they do not slide."""
    straight = beam.model.straight
    turn = np.nan_to_num(np.arctan2(*beam.coordinates[:, [3, 2]].T) - math.atan2(straight[3], straight[2]))
    for component, line, style in draw_symbols(axes, beam.model, straight):
        _move(moves, line, 1e3 * (beam.coordinates @ beam.model.interpolation(component.point).T)[:, None])
        if not getattr(component, "sliding", None):
            moves.append((line, partial(_turn, line, style, turn + getattr(component, "angle", 0.0))))


def _turn(line: Line2D, style: MarkerStyle, angles: Array, k: int) -> None:
    line.set_marker(style.rotated(rad=angles[k]))
