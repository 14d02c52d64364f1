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

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import widest
from ancf_casadi.records.video.recording import first_picture, marker_table, track_video
from ancf_casadi.support.files import write_file
from problems.look.choices import Choices, CommandOptions, option_words

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


def track_film(choices: FilmChoices, folder: Path) -> tuple[Choices, Sequence[str]]:
    """Track the markers, and write their positions to a file in a new folder within one.

    Return the choices for this file, with the position that moves most, and notes.
    """
    recording = track_video(choices.file, **choices.settings())
    path = Path(mkdtemp(dir=folder)) / TRACKS_NAME
    write_file(path, marker_table(recording).csv().encode())
    moving = widest(channel for channel in recording.channels if not channel.name.startswith("std"))
    return Choices(str(path), column=moving.name), recording.notes
