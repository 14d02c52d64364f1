"""Tracks of marks through a video.

The place of each mark is predicted from its last two places at constant velocity, and refined (``marks``).  If this
fails, the mark is searched by normalised correlation within its reach: half the distance to the nearest other mark or
similar texture in the first picture.  The place of a lost mark is predicted from the two nearest visible marks: from
its last visible place, it moves by the similarity transformation of these two.  Without them it is predicted at
constant velocity, for n frames as long as a n^2/2 stays within its reach, where a is its largest acceleration so far
(px/frame^2).  A place is refused if it coincides with another mark, or if the distance to the nearest mark differs from
that in the first picture by more than the reach, as for a mark confused with its neighbour.  Then there is a gap.

The std of a place combines two estimates: one from the residual of its picture (``marks``), and the scatter of the
track, which includes the errors of compression that one picture cannot show.  Pixel noise is in both, slow errors in
neither.  At high frequencies, the spectrum of the longest stretch of a track without a gap consists of noise and lines
of the motion.  The median of |X|^2 is there ln(2) times the variance of white noise, and lines hardly change it.  The
window sin(pi t/T)^4 over the stretch, of the length T, keeps slow motions out of these frequencies.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import islice
from typing import Any

import numpy as np

from ancf_casadi.records.video.frames import Picture
from ancf_casadi.records.video.marks import Mark, Pose, correlations, refine_pose, search_pose, tracked_point
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.interrupts import has_interrupt
from ancf_casadi.support.progress import count_step

MAX_STD = 3.2  # of a visible mark, relative to the median of its track; above, the mark is partly covered
NOISE_BAND = 0.7  # lower end of the band of noise, relative to half the frame rate
MIN_SPECTRUM_FRAMES = 10
SIMILAR = 0.8  # correlation of a place that may be confused with a mark
Track = dict[int, Pose]  # poses of a mark by the number of the frame, in order


def track_marks(cv2: Any, marks: Sequence[Mark], first: Picture, pictures: Iterable[Picture]) -> tuple[Array, Array]:
    """Return columns and rows (k, m, 2) of the marks, px, and their std (k, m); nan in frames without the mark."""
    tracks: list[Track] = [{0: Pose(mark.place)} for mark in marks]
    places = np.array([mark.place for mark in marks])
    distances = np.hypot(*(places[:, None] - places[None]).T)
    order = [[j for j in np.argsort(row) if j != i] for i, row in enumerate(distances)]
    reaches, accelerations = _reaches(cv2, marks, distances, first), np.full(len(marks), np.nan)
    number = 0
    for number, picture in enumerate(pictures, start=1):
        for again in (False, True):
            for i, (mark, track) in enumerate(zip(marks, tracks, strict=True)):
                if number in track or not (again or number - 1 in track):
                    continue
                guess = _predict_from_neighbours(tracks, i, number) if again else None
                if guess is None and _is_predictable(track, number, accelerations[i], reaches[i]):
                    guess = _predict_steady(track, number)
                if guess is None:
                    continue
                neighbours = [tracks[j] for j in order[i] if number in tracks[j]]
                for wide in (False, True)[again:]:
                    pose = (
                        search_pose(cv2, mark, picture, guess, reaches[i])
                        if wide
                        else refine_pose(mark, picture, guess)
                    )
                    if pose and _is_plausible(mark, pose, guess, reaches[i], number, neighbours):
                        track[number] = pose
                        break
        accelerations = np.fmax(accelerations, [_acceleration(track, number) for track in tracks])
        count_step()
        if has_interrupt():  # of another thread
            raise KeyboardInterrupt
    points, std = np.full((number + 1, len(marks), 2), np.nan), np.full((number + 1, len(marks)), np.nan)
    for i, track in enumerate(tracks):
        for k, pose in track.items():
            points[k, i], std[k, i] = tracked_point(marks[i], pose), pose.std
    finite = [column[np.isfinite(column)] for column in std.T]
    median = np.array([np.median(column) if len(column) else 0.0 for column in finite])
    points[std > MAX_STD * median] = np.nan
    std[0] = median  # its template is of this frame
    std = np.hypot(std, np.nan_to_num([_scatter(points[:, i]) for i in range(len(marks))]))
    return points, np.where(np.isnan(points[..., 0]), np.nan, std)


def _scatter(points: Array) -> float:
    """Return the std of the noise of a track, px; nan if it has no sufficiently long stretch without gaps."""
    edges = np.flatnonzero(np.diff(np.isfinite(points[:, 0]), prepend=False, append=False))
    begin, end = max(edges.reshape(-1, 2).tolist(), key=lambda span: span[1] - span[0])
    count = end - begin
    if count < MIN_SPECTRUM_FRAMES:
        return math.nan
    window = np.sin(np.pi * (np.arange(count) + 0.5) / count)[:, None] ** 4
    motion = window * (points[begin:end] - points[begin:end].mean(axis=0))
    spectrum = np.abs(np.fft.rfft(motion, axis=0)) ** 2 / np.sum(window**2)
    return math.sqrt(float(np.median(spectrum[round(NOISE_BAND * len(spectrum)) :])) / math.log(2))


def _reaches(cv2: Any, marks: Sequence[Mark], distances: Array, picture: Picture) -> list[float]:
    """Return the radius of the search for each mark, px."""
    reaches = []
    for mark, mark_distances in zip(marks, distances, strict=True):
        rows, columns = np.nonzero(correlations(cv2, mark, picture) > SIMILAR)
        similar_places = np.hypot(columns + mark.radius - mark.place[0], rows + mark.radius - mark.place[1])
        candidates = np.concatenate([similar_places, mark_distances])
        reaches.append(float(candidates.min(where=candidates > mark.radius, initial=max(picture.shape)) / 2))
    return reaches


def _is_plausible(mark: Mark, pose: Pose, guess: Pose, reach: float, number: int, neighbours: Sequence[Track]) -> bool:
    """Return whether a pose can be that of the mark; the visible neighbours come in the order of their distance."""
    if np.hypot(*(pose.centre - guess.centre)) > reach:
        return False
    if any(np.hypot(*(pose.centre - neighbour[number].centre)) <= mark.radius for neighbour in neighbours):
        return False
    if not neighbours:
        return True
    nearest = neighbours[0]
    distance, initial_distance = pose.centre - nearest[number].centre, mark.place - nearest[0].centre
    return bool(abs(np.hypot(*distance) - np.hypot(*initial_distance)) < reach)


def _predict_steady(track: Track, number: int) -> Pose:
    """Return the pose of a mark at constant velocity."""
    (late, now), (early, before) = [*islice(reversed(track.items()), 2), (0, track[0])][:2]
    ratio = (number - late) / max(late - early, 1)
    return Pose(now.centre + ratio * (now.centre - before.centre), now.angle + ratio * (now.angle - before.angle))


def _acceleration(track: Track, number: int) -> float:
    """Return the acceleration in the last three frames, px/frame^2; nan if the mark is absent in one of them."""
    last = [track[k].centre for k in (number, number - 1, number - 2) if k in track]
    return float(np.hypot(*(last[0] - 2 * last[1] + last[2]))) if len(last) == 3 else math.nan


def _is_predictable(track: Track, number: int, acceleration: float, reach: float) -> bool:
    """Return whether constant velocity predicts a mark within its reach; False if the acceleration is nan."""
    frames = number - next(reversed(track))
    return frames == 1 or 0.5 * acceleration * frames**2 <= reach


def _predict_from_neighbours(tracks: Sequence[Track], i: int, number: int) -> Pose | None:
    """Return the pose of a mark relative to the two nearest visible marks; None if there are fewer than two."""
    last, pose = next(reversed(tracks[i].items()))
    visible = [track for track in tracks if last in track and number in track]
    if len(visible) < 2:
        return None
    a, b, *_ = sorted(visible, key=lambda track: float(np.hypot(*(track[last].centre - pose.centre))))
    a_last, b_last, last_place = (complex(*p.centre) for p in (a[last], b[last], pose))
    a_now, b_now = (complex(*p.centre) for p in (a[number], b[number]))
    turn = (b_now - a_now) / (b_last - a_last)
    place = a_now + turn * (last_place - a_last)
    return Pose(np.array([place.real, place.imag]), pose.angle + float(np.angle(turn)))
