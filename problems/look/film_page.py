"""The part of the page for a film: its first picture with what the user clicks there, and the tracks of its markers."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from nicegui import events, ui
from PIL import Image

from ancf_casadi.exceptions import AncfError
from problems.look.charts import FIT, RECORD
from problems.look.choices import beside
from problems.look.film import (
    POINTS,
    FilmChoices,
    MotionOverFilm,
    Point,
    film_picture,
    motion_over_film,
    track_film,
)
from problems.look.record_page import RecordPanel
from problems.look.widgets import ComputingPanel, Fields, show_notes
from problems.look.worker import work

COLOURS = {"clamp": "#2b8a3e", "ruler": "#d9480f", "vertical": "#1971c2"}


class FilmPanel(ComputingPanel):
    """The part of the page that belongs to a film, with the tracks of its markers below."""

    def __init__(self, files: Sequence[str], folder: Path) -> None:
        super().__init__()
        self.choices, self._folder = FilmChoices(files[0]), folder
        self._tracked: tuple[FilmChoices, RecordPanel] | None = None  # what was tracked, and the panel of the tracks
        self._points: list[Point] = []  # that were clicked of one with two
        self._fields = Fields(self.choose)
        self.build()
        self._tracks = ui.column().classes("w-full")

    def _build_choices(self) -> None:
        ui.label(Path(self.choices.file).name).classes("text-subtitle1 break-all")
        ui.label("Click in the picture to place").classes("text-subtitle2")
        self._place = ui.toggle({name: name for name in POINTS}, value="ruler", on_change=self._forget_points)
        self._place.props("dense no-caps").mark("place")
        ui.label("markers to track, the origin, two points at a known distance, or two points on a vertical line")
        self._fields.entry("ruler_length", "length of the ruler, m", "without it, positions are in pixels", kind=float)
        nothing = dict.fromkeys(("ruler", "clamp", "vertical", "markers"))
        ui.button("remove all", on_click=lambda: self.choose(**nothing)).props("flat dense")
        ui.label("Film").classes("text-subtitle2")
        self._fields.entry("sample_rate", "frames per second", "of the recording; for slow motion", kind=float)
        self._fields.entry("begin", "begin, s", kind=float)
        self._fields.entry("end", "end, s", kind=float)
        self._fields.entry("radius", "radius of a marker, px", "default: of its dot, or 10", int)

    def _build_results(self) -> None:
        self._error = ui.label().classes("text-negative").mark("film-error")
        self._picture = ui.interactive_image(on_mouse=self._click, events=["click"], cross="#d9480f", sanitize=False)
        self._picture.classes("max-w-full").mark("picture")
        self.build_progress(self.track, self.show_motion_over_film)
        self._over_film = ui.column().classes("w-full")
        self._notes = ui.column().classes("w-full gap-1").mark("film-notes")
        ui.label("The command that tracks the same").classes("text-subtitle2")
        self._command = ui.code("", language="bash").classes("w-full").mark("track-command")

    async def update(self) -> None:
        """Show the picture with its markers, or why there are none, and what is placed in it."""
        choices = self.choices
        self._fields.show(choices)
        self._command.content = replace(choices, file=beside(choices.file, self._folder)).command()
        self._draw()
        try:
            picture, self._error.text = await work(film_picture, choices)
        except AncfError as error:
            self._error.text = str(error)
            return
        self._picture.set_source(f"data:image/png;base64,{base64.b64encode(picture).decode()}")

    def _click(self, event: events.MouseEventArguments) -> None:
        """Place what the user has chosen at a point of the picture, whose first pixel has its centre at 0."""
        name, point = str(self._place.value), (round(event.image_x - 0.5, 1), round(event.image_y - 0.5, 1))
        if name == "marker":
            self.choose(**self.choices.with_marker(point))
            return
        self._points.append(point)
        if len(self._points) == POINTS[name]:
            self.choose(**{name: tuple(number for place in self._points for number in place)})
            self._points.clear()
        self._draw()

    def _forget_points(self) -> None:
        """Forget the first click of two."""
        self._points.clear()
        self._draw()

    def _draw(self) -> None:
        """Draw what is placed in the picture."""
        shapes = [_dot(point, "#d9480f") for point in self._points]
        for name, colour in COLOURS.items():
            if numbers := getattr(self.choices, name):
                points = [numbers[k : k + 2] for k in range(0, len(numbers), 2)]
                shapes += [_dot(point, colour) for point in points]
                ends = " ".join(f"{x + 0.5},{y + 0.5}" for x, y in points)
                shapes.append(f'<polyline points="{ends}" stroke="{colour}" stroke-width="2" />')
        self._picture.content = "".join(shapes)

    async def track(self) -> None:
        """Track the markers, and show their motion."""
        film = self.choices
        if (tracked := await self.attempt(self._error, track_film, film, self._folder, title="track")) is None:
            return
        tracks, notes = tracked
        show_notes(self._notes, notes)
        self._over_film.clear()
        self._tracks.clear()
        with self._tracks:
            ui.button("save the positions", on_click=lambda: ui.download.file(tracks.file))
            decay = RecordPanel((tracks,), Path(tracks.file).parent)
        self._tracked = film, decay
        decay.start()

    async def show_motion_over_film(self) -> None:
        """Show tracks and computed motion over the film, at any time."""
        film, decay = self._tracked or (self.choices, None)
        if decay and (motion := await self.attempt(self._error, motion_over_film, film, decay.take, title="film")):
            self._over_film.clear()
            with self._over_film:
                _show_over_film(motion)

    def can_act(self, name: str) -> bool:
        """Return whether nothing is being computed, and for motion over the film, whether it was tracked."""
        return super().can_act(name) and (name == "track" or self._tracked is not None)


def _show_over_film(motion: MotionOverFilm) -> None:
    """Build a picture of the film, and a slider for its time."""

    def show(k: int) -> None:
        picture.set_source(Image.fromarray(motion.footage.image(k)))
        tracked = [_dot(point, RECORD) for point in motion.tracked[k].tolist()]
        picture.content = "".join([*tracked, _dot(motion.computed[k].tolist(), FIT, 9.0)])
        label.text = f"{motion.time[k]:.4g} s: markers as tracked (blue), and as computed (red)"

    label = ui.label()
    slider = ui.slider(min=0, max=len(motion.tracked) - 1, value=0, on_change=lambda event: show(event.value))
    slider.classes("w-full").mark("film-time")
    picture = ui.interactive_image(sanitize=False).classes("max-w-full").mark("over-film")
    show(0)


def _dot(point: Sequence[float], colour: str, radius: float = 5.0) -> str:
    """Return a point of the picture as SVG, which counts from the corner of the first pixel; none if it is nan."""
    x, y = point
    dot = f'<circle cx="{x + 0.5}" cy="{y + 0.5}" r="{radius:g}" fill="none" stroke="{colour}" stroke-width="2" />'
    return dot if math.isfinite(x + y) else ""
