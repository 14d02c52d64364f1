"""Options of ``track`` that the user has chosen on the page, the first picture of the film, and the tracks."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np

from ancf_casadi.animation.footage import Footage
from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import widest_channel
from ancf_casadi.records.video.recording import first_picture, marker_table, track_video
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.files import write_file
from problems.look.choices import Choices, CommandOptions, option_words
from problems.look.computation import fit_chosen, recording

MOST_PICTURES = 120  # over which motion is shown
TRACKS_NAME = "markers.csv"
POINTS = {"marker": 1, "clamp": 1, "ruler": 2, "vertical": 2}  # that the user clicks, and how many clicks each takes
FIRST_PICTURE = {"markers", "radius", "clamp", "sample_rate", "begin"}  # options that change it
SAME_MARKER = 10.0  # distance of a click from a marker that it takes away, px

Point = tuple[float, float]  # column and row, px


@dataclass(frozen=True)
class FilmChoices(CommandOptions):
    """Options of ``track`` by their names; None where the user has left the default."""

    file: str
    ruler: tuple[float, ...] | None = None  # columns and rows of two points, px
    ruler_length: float | None = None  # m
    clamp: tuple[float, ...] | None = None  # px
    vertical: tuple[float, ...] | None = None  # columns and rows of two points, px
    markers: tuple[Point, ...] | None = None  # px
    radius: int | None = None  # px
    sample_rate: float | None = None  # frames per second
    begin: float | None = None  # s
    end: float | None = None  # s

    def settings(self) -> dict[str, Any]:
        """Return the arguments of ``track_video``; a ruler counts once its length is known."""
        settings = self.options()
        ruler, length = settings.pop("ruler", None), settings.pop("ruler_length", None)
        return settings | ({"ruler": (*ruler, length)} if ruler and length is not None else {})

    def command(self) -> str:
        """Return the command line that tracks the same."""
        settings = self.settings()
        markers = [word for point in settings.pop("markers", ()) for word in option_words({"marker": point})]
        return shlex.join(["ancf-casadi", "track", self.file, *option_words(settings), *markers, "--out", TRACKS_NAME])

    def with_marker(self, point: Point) -> dict[str, Any]:
        """Return the change that adds a marker, or takes away one that is there."""
        others = tuple(marker for marker in self.markers or () if math.dist(marker, point) > SAME_MARKER)
        is_new = len(others) == len(self.markers or ())
        return {"markers": (*others, *([point] if is_new else [])) or None}


def film_picture(choices: FilmChoices) -> tuple[bytes, str]:
    """Return the first picture, as PNG, with the numbers of its markers; or without them, and why."""
    return _picture(FilmChoices(choices.file, **{name: getattr(choices, name) for name in FIRST_PICTURE}))


@lru_cache(2)
def _picture(choices: FilmChoices) -> tuple[bytes, str]:
    try:
        return first_picture(choices.file, **choices.options()), ""
    except InputError as error:
        return first_picture(choices.file, **choices.options(), numbered=False), str(error)


@dataclass(frozen=True, eq=False)
class MotionOverFilm:
    """Pictures of a film, and where they show the markers as tracked, and one of them as computed."""

    footage: Footage
    time: Array  # s
    tracked: Array  # (pictures, markers, 2), px
    computed: Array  # (pictures, 2), px; nan beyond the fit


def motion_over_film(film: FilmChoices, tracks: Choices) -> MotionOverFilm:
    """Return the pictures of a film with the tracks of its markers, and the fit of one of their coordinates."""
    track = recording(tracks)
    every = -(-len(track.time) // MOST_PICTURES)
    settings = {name: value for name, value in film.settings().items() if name not in ("markers", "radius")}
    footage = Footage.from_video(film.file, **settings, every=every)
    time = np.asarray(footage.time)
    tracked = np.column_stack([channel.values for channel in track.channels])[::every].reshape(len(time), -1, 3)
    marker, axis = divmod([channel.name for channel in track.channels].index(str(tracks.column)), 3)  # x, y, std
    fit, computed = fit_chosen(tracks).fit, tracked[:, marker].copy()
    is_fitted = (time >= fit.time[0]) & (time <= fit.time[-1])
    computed[:, axis] = np.where(is_fitted, fit.displacement(time), np.nan)
    return MotionOverFilm(footage, time, footage.pixels(tracked[..., :2]), footage.pixels(computed[:, :2]))


def track_film(choices: FilmChoices, folder: Path) -> tuple[Choices, Sequence[str]]:
    """Track the markers, and write their positions to a file in a new folder within one.

    Return the choices for this file, with the position that moves most, and notes.
    """
    recording = track_video(choices.file, **choices.settings())
    path = Path(mkdtemp(dir=folder)) / TRACKS_NAME
    write_file(path, marker_table(recording).csv().encode())
    moving = widest_channel(channel for channel in recording.channels if not channel.name.startswith("std"))
    return Choices(str(path), column=moving.name), recording.notes
