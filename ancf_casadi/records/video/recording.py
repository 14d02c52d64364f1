"""``track_video``: a recording of the positions of marks in a video."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.channel import RecordedChannel, Recording
from ancf_casadi.records.units import parse_unit
from ancf_casadi.records.video.detection import find_marks
from ancf_casadi.records.video.frames import Picture, Video, open_video
from ancf_casadi.records.video.marks import Mark
from ancf_casadi.records.video.tracking import track_marks
from ancf_casadi.records.video.view import View
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.files import check_file, write_file
from ancf_casadi.support.inputs import (
    array,
    error_prefix,
    flag,
    not_negative,
    numbers,
    physical,
    positive_or_infinite,
    whole,
)
from ancf_casadi.support.optional import library
from ancf_casadi.support.progress import counter
from ancf_casadi.support.tables import Table

SMOOTHING = 1.0  # px; edges that are sharper than a pixel are interpolated with errors that follow the motion
MIN_PICTURES = 10
LOST_SHARE = 0.1  # of the frames; with so many at the end without any marker, the tracks are refused
STILL = 10.0  # range of a track, relative to its std, below which it is still
EVEN = 6e-4  # rounding of the times in a file, s; at most half a frame
SLACK = 1e-3  # of a frame, by which times are rounded


def track_video(
    path: str | Path,
    *,
    markers: ArrayLike | None = None,
    region: Sequence[float] | None = None,
    radius: int | None = None,
    ruler: Sequence[float] | None = None,
    clamp: Sequence[float] | None = None,
    vertical: Sequence[float] | None = None,
    lens: Sequence[float] | None = None,
    sample_rate: float | None = None,
    begin: float = 0.0,
    end: float = math.inf,
    preview: str | Path | None = None,
    progress: bool = False,
) -> Recording:
    """Track marks on a beam through a video.

    Places in the picture are columns and rows, px, from the centre of the first pixel.  A mark is the texture within a
    radius of its place, such as a dot or a checker patch.  Frames in which it is partly or fully covered, outside the
    picture, or confused with another mark are gaps (nan).

    Parameters
    ----------
    path : str or Path
        The video.
    markers : array_like (m, 2), optional
        Columns and rows of the markers in the first tracked frame, px; if not given, dots are detected, or else
        corners, numbered by their distance from the clamp, or from the middle of the upper edge.
    region : sequence of 4 numbers, optional
        Left, top, right and bottom of the area of the picture in which markers are detected, px.
    radius : int, optional
        Radius of a marker, px; by default that of its dot and 3 px more, or 10 px.
    ruler : sequence of 5 numbers, optional
        Columns and rows of two points, px, and their distance, m, in the plane of the motion.  Without it, positions
        are in px.
    clamp : pair of numbers, optional
        Column and row of the origin, px; by default the first pixel.
    vertical : sequence of 4 numbers, optional
        Columns and rows of two points on a vertical line, px; by default the columns of the picture are vertical.
    lens : sequence of 8 or 9 numbers, optional
        Focal lengths and centre, px, and coefficients of distortion: fx, fy, cx, cy, k1, k2, p1, p2 and perhaps k3, as
        ``cv2.calibrateCamera`` gives them.
    sample_rate : float, optional
        Frames per second of the recording; by default that of the file, which is wrong for slow motion.
    begin, end : float
        Interval of the video that is tracked, s.
    preview : str or Path, optional
        Picture of the first frame with the numbers of the markers, ``.png``.
    progress : bool
        Whether to count frames on a terminal.

    Returns
    -------
    Recording
        Channels ``x1_m``, ``y1_m`` and ``std1_m`` (or ``_px``) of marker 1, and so on: x to the right, y up, and the
        standard deviation of each coordinate.

    Raises
    ------
    InputError
        If the file is no video, breaks off, shows no markers, loses all of them for good, or nothing moves in it; or if
        ``opencv-python-headless`` is not installed.

    Examples
    --------
    >>> import cv2
    >>> import numpy as np
    >>> from ancf_casadi import track_video
    >>> video = cv2.VideoWriter("dot.avi", cv2.VideoWriter_fourcc(*"MJPG"), 240.0, (160, 120), isColor=False)
    >>> for angle in np.arange(40) / 20:
    ...     centre = (round(16 * (80 + 30 * np.cos(angle))), 16 * 60)  # in sixteenths of a pixel
    ...     picture = np.full((120, 160), 200, np.uint8)
    ...     _ = video.write(cv2.circle(picture, centre, 16 * 6, 30, -1, cv2.LINE_AA, 4))
    >>> video.release()
    >>> recording = track_video("dot.avi", ruler=(0, 60, 100, 60, 0.05), clamp=(80, 60))
    >>> x = recording.channel("x1_m").values
    >>> bool(np.abs(x - 0.015 * np.cos(np.arange(40) / 20)).max() < 1e-4)
    True
    """
    cv2, sought = _opencv(), _sought(markers, region, radius)
    view = View.of(ruler=ruler, clamp=clamp, vertical=vertical, lens=lens)
    rate = None if sample_rate is None else physical(sample_rate, "sample_rate")
    interval = not_negative(begin, "begin"), positive_or_infinite(end, "end")
    picture = None if preview is None else check_file(preview)
    if picture and picture.suffix.lower() != ".png":
        raise InputError("must end in .png", str(picture))
    flag(progress, "progress")
    times: list[float] = []
    with open_video(path) as video, error_prefix(str(path)), counter("track", shown=progress):
        pictures = _pictures(cv2, video, rate, interval, times)
        try:
            first = next(pictures)
            marks = find_marks(cv2, first, *sought, view.clamp)
            if picture is not None:
                write_file(picture, _preview(cv2, first, marks))
            points, std = track_marks(cv2, marks, first, pictures)
            positions, scale = view.positions(cv2, points)
        except cv2.error as error:
            raise InputError(f"cannot be tracked ({' '.join(str(error).split())[:80]})") from None
        notes = _check_tracks(np.array(times), points, std)
        stamps = np.array(times)
        time, time_note = _time(stamps, rate or video.frame_rate)
    channels = []
    columns = np.concatenate([positions, scale * std[..., None]], axis=2).reshape(len(time), -1).T
    for k, values in enumerate(columns):
        name = f"{('x', 'y', 'std')[k % 3]}{k // 3 + 1}_{view.unit}"
        channels.append(RecordedChannel(k + 1, name, values, view.unit, parse_unit(view.unit), time))
    if rate is None:
        time_note += "; if it plays in slow motion, give the rate of the recording with --sample-rate"
    stated = () if rate and time is not stamps else (time_note,)
    return Recording(str(path), tuple(channels), stated + notes)


def first_picture(
    path: str | Path,
    *,
    markers: ArrayLike | None = None,
    region: Sequence[float] | None = None,
    radius: int | None = None,
    clamp: Sequence[float] | None = None,
    sample_rate: float | None = None,
    begin: float = 0.0,
    numbered: bool = True,
) -> bytes:
    """Return the picture of a video in which ``track_video`` finds the markers, as PNG.

    Parameters
    ----------
    path, markers, region, radius, clamp, sample_rate, begin
        As in ``track_video``.
    numbered : bool
        Whether to find the markers and draw their numbers.

    Raises
    ------
    InputError
        As in ``track_video``.
    """
    cv2, sought = _opencv(), _sought(markers, region, radius)
    rate = None if sample_rate is None else physical(sample_rate, "sample_rate")
    origin = View.of(clamp=clamp).clamp
    with open_video(path) as video, error_prefix(str(path)):
        first = next(_pictures(cv2, video, rate, (not_negative(begin, "begin"), math.inf), []))
        return _preview(cv2, first, find_marks(cv2, first, *sought, origin) if numbered else [])


def read_pictures(
    path: str | Path, *, sample_rate: float | None, begin: float, end: float, every: int
) -> tuple[Array, list[Picture]]:
    """Return the times of pictures of a video, s, as ``track_video`` has them, and the pictures."""
    _opencv()
    rate = None if sample_rate is None else physical(sample_rate, "sample_rate")
    interval, step = (not_negative(begin, "begin"), positive_or_infinite(end, "end")), whole(every, "every", 1)
    times: list[float] = []
    with open_video(path) as video, error_prefix(str(path)):
        pictures = list(itertools.islice(_frames(video, rate, interval, times), 0, None, step))
        time, _ = _time(np.array(times), rate or video.frame_rate)
    return time[::step], pictures


def _opencv() -> Any:
    return library("cv2", "video files need it", "opencv-python-headless")


def _sought(
    markers: ArrayLike | None, region: Sequence[float] | None, radius: int | None
) -> tuple[Array | None, tuple[float, ...] | None, int | None]:
    """Return places (m, 2), area and radius of the marks, px, as far as they are given."""
    places = None if markers is None else array(markers, "markers")
    if places is not None and (places.ndim != 2 or places.shape[1] != 2 or not len(places)):
        raise InputError(f"must have the shape (m, 2), got {places.shape}", "markers")
    area = None if region is None else numbers(region, "region")
    if area is not None and (len(area) != 4 or area[0] >= area[2] or area[1] >= area[3]):
        raise InputError("must be left, top, right and bottom", "region")
    return places, area, None if radius is None else whole(radius, "radius", 3, 200)


def _pictures(
    cv2: Any, video: Video, rate: float | None, interval: tuple[float, float], times: list[float]
) -> Iterator[Picture]:
    """Yield the smoothed pictures of ``_frames``."""
    for picture in _frames(video, rate, interval, times):
        yield cv2.GaussianBlur(picture.astype(np.float32), (0, 0), SMOOTHING)


def _frames(video: Video, rate: float | None, interval: tuple[float, float], times: list[float]) -> Iterator[Picture]:
    """Yield the pictures of an interval of a video, at least one, and append their times to ``times``."""
    begin, end = interval
    if begin >= end:
        raise InputError(f"must be after begin, {begin:g} s, got {end:g} s", "end")
    if not rate and not video.frame_rate > 0.0:
        raise InputError("states no frame rate; give --sample-rate")
    slack = SLACK / (rate or video.frame_rate)
    slower = video.frame_rate / rate if rate and video.frame_rate > 0.0 else 1.0
    count, start = 0, 0.0
    for count, (stamp, picture) in enumerate(video.frames, start=1):
        start = stamp if count == 1 else start
        time = slower * (stamp - start)
        if count > 1 and times and time <= times[-1]:
            time = times[-1] + 1 / (rate or video.frame_rate)
        if time > end + slack:
            break
        if time >= begin - slack:
            times.append(time)
            yield picture
    else:
        # some files state a frame or two more than they hold
        if count < 0.98 * video.count:
            last = f"{times[-1]:.6g}" if times else "0"
            raise InputError(f"breaks off after {count} of {video.count} frames; give --end {last} to use these")
    if not times:
        raise InputError(f"ends before {begin:g} s")


def _time(stamps: Array, rate: float) -> tuple[Array, str]:
    """Return the times of the frames, evenly spaced if those of the file are, and a note."""
    even = stamps[0] + np.arange(len(stamps)) / rate
    if np.abs(stamps - even).max() < min(max(EVEN, 0.02 / rate), 0.5 / rate):
        return even, f"times from the frame rate of the file, {rate:g} 1/s"
    return stamps, "times of the frames from the file, which are not even"


def _check_tracks(times: Array, points: Array, std: Array) -> tuple[str, ...]:
    """Check that tracks last to the end of the video and move; return notes on gaps."""
    visible = np.isfinite(points[..., 0])
    count = len(points)
    if count < MIN_PICTURES:
        raise InputError(f"has {count} frames; needs at least {MIN_PICTURES}")
    last = int(np.flatnonzero(visible.any(axis=1))[-1])
    if count - 1 - last >= LOST_SHARE * count:
        raise InputError(
            f"no marker is seen after {times[last]:.4g} s, as behind a cut or if all are covered for long; "
            f"give --end {times[last]:.4g}, or name other markers"
        )
    travel = np.nanmax(points, axis=0) - np.nanmin(points, axis=0)
    if (travel.max(axis=1) <= STILL * np.nanmedian(std, axis=0)).all():
        raise InputError(f"nothing moves: no marker by more than {travel.max():.2g} px")
    gaps = count - visible.sum(axis=0)
    return tuple(f"marker {k} is not seen in {n} of {count} frames" for k, n in enumerate(gaps, start=1) if n)


def marker_table(recording: Recording) -> Table:
    """Return the positions of markers and their std over time, as a table for a file."""
    columns = ("time_s", *(channel.name for channel in recording.channels))
    values = np.column_stack([recording.time, *(channel.values for channel in recording.channels)])
    rows: list[list[Any]] = [[None if math.isnan(cell) else cell for cell in row] for row in values.tolist()]
    return Table("markers", "Positions of markers", columns, rows)


def _preview(cv2: Any, picture: Picture, marks: Sequence[Mark]) -> bytes:
    """Return a picture with the numbers of the marks, as PNG."""
    image = cv2.cvtColor(cv2.convertScaleAbs(picture), cv2.COLOR_GRAY2BGR)
    for number, mark in enumerate(marks, start=1):
        x, y = np.rint(mark.place + mark.offset).astype(int).tolist()
        corner = (x + mark.radius + 3, y + 5)
        cv2.circle(image, (x, y), mark.radius, (0, 160, 255), 1, cv2.LINE_AA)
        for colour, width in (((0, 0, 0), 4), ((0, 200, 255), 1)):
            cv2.putText(image, str(number), corner, cv2.FONT_HERSHEY_SIMPLEX, 0.6, colour, width, cv2.LINE_AA)
    return bytes(cv2.imencode(".png", image)[1])
