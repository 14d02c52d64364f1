"""Motions and mode shapes as moving pictures.

Picture k shows the instant

    begin + k / (slower frame_rate),

linearly interpolated between the samples.  If ``slower`` is not given, it is the least of 1, 2, 5, 10, ... for which
the pictures last 2 s or more, and a period has 12 or more of them.  This period is 2 pi times the rms of the positions,
less their means, over that of their rates.
"""

from __future__ import annotations

import base64
import contextlib
import io
import itertools
import math
import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rcParams
from matplotlib.colors import to_rgb
from numpy.typing import ArrayLike
from PIL import Image

from ancf_casadi.animation.drawing import DrawnBeam, Film, pictures
from ancf_casadi.animation.footage import Footage
from ancf_casadi.dynamics.trajectory import Motion
from ancf_casadi.exceptions import InputError
from ancf_casadi.figures.modes import SHAPE_SHARE, scaled_shape
from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.figures import COMPUTED, MEASURED, SERIES
from ancf_casadi.support.files import fill_template
from ancf_casadi.support.inputs import (
    array,
    check_instance,
    flag,
    instances,
    number,
    numbers,
    physical,
    positive,
    whole,
)
from ancf_casadi.support.progress import counter
from ancf_casadi.vibration.modes import Modes

MAX_PICTURES = 3000  # all of a GIF file are in memory, 0.3 MB each
MIN_PER_PERIOD = 12  # test_a_period_has_twelve_pictures_by_default
MIN_DURATION = 2.0  # s that pictures last at least, if slower is not given
CYCLE = 2.0  # s that a period of a mode lasts
TRAIL = 1.0  # s of pictures over which a trace lasts
MAX_MODES = 6  # panels of modes, if no modes are given
SUFFIXES = (".gif", ".mp4", ".html")
TRANSPARENT = 255  # colour that stands for the one below


def moving_pictures(
    runs: Mapping[str, Motion],
    path: str | Path,
    *,
    slower: float | None = None,
    frame_rate: float = 25.0,
    begin: float | None = None,
    end: float | None = None,
    beside: bool = False,
    points: Sequence[float] | None = None,
    markers: tuple[ArrayLike, ArrayLike] | None = None,
    background: Footage | None = None,
    periodic: bool = False,
) -> bytes:
    """Return the content of a file, whose path tells its format, with motions by label (``Motion.animate``).

    Motions that are ``periodic`` are shown for one period of the first.
    """
    suffix, delay = check_animation(path), _delay(frame_rate)
    if not all(len(run.time) > 1 for run in runs.values()):
        raise InputError("the motion has too few samples", "animate")
    if flag(beside, "beside") and background is not None:
        raise InputError("cannot be beside each other over a background", "beside")
    first, last = min(float(run.time[0]) for run in runs.values()), max(float(run.time[-1]) for run in runs.values())
    if background is not None:
        check_instance(background, "background", Footage)
        video_time = array(background.time, "background")
        first, last = max(first, float(video_time[0])), min(last, float(video_time[-1]))
    begin = first if begin is None else max(first, number(begin, "begin"))
    end = last if end is None else min(last, number(end, "end"))
    if begin >= end:
        raise InputError(f"must be before the end, within {first:g} to {last:g} s", "begin")
    slower = _slower(runs.values(), end - begin, delay) if slower is None else physical(slower, "slower")
    count = (end - begin) * slower / delay + (0.5 if periodic else 1.0 + 1e-9)  # the first picture ends a period
    if not 2.0 <= count < MAX_PICTURES + 1:
        raise InputError(f"{slower:g} makes {count:.3g} pictures, not 2 to {MAX_PICTURES}; give another, or begin "
                         "and end of a part", "slower")  # fmt: skip
    count = int(count)
    slower = count * delay / (end - begin) if periodic else slower
    times: Array = np.asarray(begin + np.arange(count) * delay / slower)
    frames = [] if background is None else [int(np.abs(video_time - time).argmin()) for time in times]
    times = times if background is None else video_time[frames]
    before = times[:, None] - np.linspace(0.0, TRAIL / slower, 4 * round(TRAIL / delay) + 1)

    def draw_beam(run: Motion) -> DrawnBeam:
        places = [run.model.beam.length] if points is None else numbers(points, "points")
        paths = [run.position(place) for place in places]
        if periodic:
            times_in_period = run.time[0] + np.mod(times - run.time[0], np.ptp(run.time))
            trails = [np.broadcast_to(path, (count, *path.shape)) for path in paths]
            return DrawnBeam(run.model, _interpolate(times_in_period, run.time, run.coordinates), trails)
        trails = [_interpolate(np.maximum(before, begin), run.time, path) for path in paths]
        return DrawnBeam(run.model, _interpolate(times, run.time, run.coordinates), trails)

    beams = {label: draw_beam(run) for label, run in runs.items()}
    panels = [(label, {label: beam}) for label, beam in beams.items()] if beside else [("", beams)]
    digits = max(0, math.ceil(-math.log10(delay / slower)))
    width = len(f"{times[-1]:.{digits}f}")  # in figure spaces, so that the text keeps its place
    clock = [f"{time:.{digits}f}".rjust(width, "\u2007") + f" s, {_tempo(slower)}" for time in times]
    film = Film(panels, clock, _marker_positions(markers, times), background, frames)
    sample_picture = None if background is None else Image.fromarray(background.image(frames[-1])).convert("RGB")
    with counter("animation"):
        return encode_pictures(pictures(film), suffix, delay, sample_picture)


def moving_modes(
    results: Mapping[str, Modes], path: str | Path, *, modes: Sequence[int] | None = None, frame_rate: float = 25.0
) -> bytes:
    """Return the content of a file, whose path tells its format, with mode shapes by label (``Modes.animate``)."""
    suffix, delay = check_animation(path), _delay(frame_rate)
    mode_count = min(result.count for result in results.values())
    numbers = range(1, min(mode_count, MAX_MODES) + 1) if modes is None else instances(modes, "modes", object)
    mode_indices = [whole(k, "modes", 1, mode_count) - 1 for k in numbers]
    count = round(CYCLE / delay)
    swing = np.sin(2 * np.pi * np.arange(count) / count)
    panels = []
    for k in mode_indices:
        beams = {}
        for label, result in results.items():
            coordinates = result.equilibrium.coordinates + swing[:, None] * scaled_shape(result, k)
            tip = coordinates @ result.model.interpolation(result.reference_points[k]).T
            beams[label] = DrawnBeam(result.model, coordinates, [np.broadcast_to(tip, (count, *tip.shape))])
        values = [float(result.frequencies[k]) for result in results.values()]
        tempo = f"\n{_tempo(count * delay * values[0])}" if len(values) == 1 and values[0] > 1e-3 else ""
        panels.append((f"mode {k + 1}: {', '.join(f'{value:.4g}' for value in values)} Hz{tempo}", beams))
    clock = [f"exaggerated to {100 * SHAPE_SHARE:g} % of the length"] * count
    with counter("animation"):
        return encode_pictures(pictures(Film(panels, clock)), suffix, delay)


def _delay(frame_rate: float) -> float:
    """Return the time between pictures, s, in whole hundredths, as in GIF files."""
    if not 1.0 <= positive(frame_rate, "frame_rate") <= 50.0:
        raise InputError(f"must be from 1 to 50 pictures per second, got {frame_rate:g}", "frame_rate")
    return round(100 / frame_rate) / 100


def _slower(runs: Iterable[Motion], length: float, delay: float) -> float:
    """Return the factor by which motions of a length (s) are slowed by default."""
    factor = MIN_DURATION / length
    for run in runs:
        swing = run.relative_coordinates.reshape(len(run.time), -1, NODE)[:, :, :2]
        size = math.sqrt(((swing - swing.mean(axis=0)) ** 2).sum())
        rate = math.sqrt((np.gradient(swing, run.time, axis=0) ** 2).sum())
        factor = max(factor, MIN_PER_PERIOD * delay * rate / (2 * math.pi * size) if size else 0.0)
    power = 10.0 ** math.floor(math.log10(max(factor, 1.0)))
    return float(next(m * power for m in (1, 2, 5, 10) if m * power >= (1 - 1e-9) * factor))


def _tempo(slower: float) -> str:
    if abs(slower - 1.0) < 5e-3:
        return "in real time"
    return f"{slower:.3g} times slower" if slower > 1.0 else f"{1 / slower:.3g} times faster"


def _interpolate(times: Array, sample_times: Array, values: Array) -> Array:
    """Return values, (k, ...), interpolated linearly at times, and nan before the first and after the last."""
    k = np.clip(np.searchsorted(sample_times, times, side="right"), 1, len(sample_times) - 1)
    fraction = (times - sample_times[k - 1]) / (sample_times[k] - sample_times[k - 1])
    fraction = np.where(np.abs(fraction - 0.5) <= 0.5 + 1e-6, fraction, np.nan)[(...,) + (None,) * (values.ndim - 1)]
    return np.asarray((1.0 - fraction) * values[k - 1] + fraction * values[k])


def _marker_positions(markers: Any, times: Array) -> Array:
    """Return the positions of measured markers at the instants of the pictures."""
    if markers is None:
        return np.empty((len(times), 0, 2))
    if not isinstance(markers, tuple | list) or len(markers) != 2:
        raise InputError("must be a pair, times (k,) and positions (k, m, 2)", "markers")
    time, positions = array(markers[0], "markers"), array(markers[1], "markers", finite=False)
    positions = positions[:, None] if positions.ndim == 2 else positions
    if time.ndim != 1 or time.size < 2 or positions.shape[:1] + positions.shape[2:] != (time.size, 2):
        raise InputError(f"have shapes {time.shape}, {positions.shape} instead of (k,), (k, m, 2)", "markers")
    if (time[1:] <= time[:-1]).any():
        raise InputError("must have times that increase", "markers")
    return _interpolate(times, time, positions)


def check_animation(path: str | Path) -> str:
    """Return the suffix of a file with moving pictures that can be made here."""
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"must end in {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}", str(path))
    if suffix == ".mp4":
        _ffmpeg()
    return suffix


def encode_pictures(
    pictures: Iterator[Image.Image], suffix: str, delay: float, background: Image.Image | None = None
) -> bytes:
    """Return the content of a file with pictures of one size, each shown for a time (s).

    Pictures over a background also have the colours of the background, of which one picture is given.
    """
    if suffix == ".mp4":
        return _mp4(pictures, delay)
    if suffix == ".gif" or background is None:
        pictures = _in_few_colours(pictures, background)
    first = next(pictures)
    if suffix == ".html":
        return _html_page(first, pictures, delay)
    out = io.BytesIO()
    first.save(out, "GIF", save_all=True, append_images=pictures, duration=round(1e3 * delay), loop=0)
    return out.getvalue()


def _in_few_colours(pictures: Iterator[Image.Image], background: Image.Image | None) -> Iterator[Image.Image]:
    """Yield pictures in the colours of the lines, each on white, and those of the background."""
    inks = np.array([to_rgb(ink) for ink in ("black", MEASURED, COMPUTED, *(ink for ink, *_ in SERIES))])
    shades = 1.0 - np.linspace(0.0, 1.0, 12)[:, None, None] * (1.0 - inks)
    colours = np.unique(np.round(255 * shades).astype(np.uint8).reshape(-1, 3), axis=0)
    background_colours = b""
    if background is not None:
        reduced = background.quantize(TRANSPARENT - len(colours))
        background_colours = bytes(reduced.getpalette() or [])
    palette = Image.new("P", (1, 1))
    colour_bytes = colours.tobytes() + background_colours
    palette.putpalette(colour_bytes.ljust(3 * (TRANSPARENT + 1), b"\xff"))  # PNG files need all
    for picture in pictures:
        yield picture.quantize(palette=palette, dither=Image.Dither.NONE)


def _html_page(first: Image.Image, pictures: Iterator[Image.Image], delay: float) -> bytes:
    """Return an HTML page that holds all pictures; those of few colours as their differences from the first."""
    kind = "PNG" if first.mode == "P" else "JPEG"
    texts: list[str] = []
    for picture in itertools.chain([first], pictures):
        if texts and kind == "PNG":
            picture.paste(TRANSPARENT, mask=Image.fromarray(np.asarray(picture) == np.asarray(first)))
        out = io.BytesIO()
        picture.save(out, kind, **({"transparency": TRANSPARENT} if kind == "PNG" else {}))
        texts.append(base64.b64encode(out.getvalue()).decode())
    values = {
        "width": first.width,
        "last": len(texts) - 1,
        "delay": round(1e3 * delay),
        "kind": f"image/{kind.lower()}",
    }
    contents = ",".join(f'"{text}"' for text in texts)
    return fill_template("ancf_casadi.animation", "player.html.jinja", values | {"pictures": contents}).encode()


def _ffmpeg() -> str:
    """Return the path of ffmpeg: that of matplotlib's settings, or of imageio-ffmpeg."""
    program: str | None = shutil.which(rcParams["animation.ffmpeg_path"])
    with contextlib.suppress(ImportError, RuntimeError):
        program = program or import_module("imageio_ffmpeg").get_ffmpeg_exe()
    if not program:
        raise InputError("needs ffmpeg, or the package imageio-ffmpeg; or write .gif or .html", ".mp4")
    return program


def _mp4(pictures: Iterator[Image.Image], delay: float) -> bytes:
    first = next(pictures)
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as messages:
        path = Path(folder) / "motion.mp4"
        input_format = [
            "-f",
            "rawvideo",
            "-pix_fmt",
            "rgb24",
            "-s",
            f"{first.width}x{first.height}",
            "-r",
            f"{1 / delay:.9f}",
        ]
        command = [_ffmpeg(), "-loglevel", "error", *input_format, "-i", "-", "-an", "-pix_fmt", "yuv420p", str(path)]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=messages, stderr=messages) as process:
            assert process.stdin is not None
            with contextlib.suppress(BrokenPipeError):  # the message below tells why
                for picture in itertools.chain([first], pictures):
                    process.stdin.write(picture.tobytes())
        if process.returncode or not path.exists():
            messages.seek(0)
            *_, message = ["no message", *messages.read().decode(errors="replace").strip().splitlines()]
            raise InputError(f"ffmpeg failed: {message}", ".mp4")
        return path.read_bytes()
