"""Tracks of marks through a video.

Each mark is expected where its last two places lead at constant velocity, and refined there (``marks``).  If it is not
found, it is sought around this place by normalised correlation, within its reach: half the distance to the nearest
other mark, and to whatever looks like it in the first picture.  A mark that was lost is expected beside the two nearest
marks that are seen: it moves from where it was seen last by the similarity transformation that moves these two.
Without them it is expected at constant velocity, for n frames as long as a n^2/2 stays within its reach, where a is its
largest acceleration so far (px/frame^2).  What is found is refused where another mark is seen, and where the distance
to the nearest mark differs from that in the first picture by more than the reach, as a mark taken for its neighbour
does.  Then there is a gap.

The std of a place has two parts: what the residual of its picture says (``marks``), and the scatter of the track, which
shows the errors of compression that a picture alone does not.  Noise of the pixels is in both, slow errors are in none.
The longest part of a track without a gap has, at high frequencies, the spectrum of its noise and lines of its motion.
There the median of |X|^2 is ln(2) times the variance of white noise, and lines hardly change it.  The window
sin(pi t/T)^4 over the part, of the length T, keeps slow motions out of these frequencies.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import islice
from typing import Any

import numpy as np

from ancf_casadi.records.video.frames import Picture
from ancf_casadi.records.video.marks import Mark, Pose, correlations, point_of, refined, sought
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.progress import count_step

MOST_STD = 3.2  # std of a place, relative to the median of its mark, above which the mark is covered in part
HIGH = 0.7  # of half the frame rate, above which the spectrum of a track is that of its noise
FEWEST_IN_SPECTRUM = 10  # frames
ALIKE = 0.8  # correlation from which a place may be taken for a mark
Track = dict[int, Pose]  # frames in which a mark is seen, in order


def tracked(cv2: Any, marks: Sequence[Mark], first: Picture, pictures: Iterable[Picture]) -> tuple[Array, Array]:
    """Return columns and rows (k, m, 2) of the marks, px, and their std (k, m); nan where a mark is not seen."""
    tracks: list[Track] = [{0: Pose(mark.place)} for mark in marks]
    places = np.array([mark.place for mark in marks])
    apart = np.hypot(*(places[:, None] - places[None]).T)
    order = [[j for j in np.argsort(own) if j != i] for i, own in enumerate(apart)]
    reaches, accelerations = _reaches(cv2, marks, apart, first), np.full(len(marks), np.nan)
    number = 0
    for number, picture in enumerate(pictures, start=1):
        for again in (False, True):
            for i, (mark, track) in enumerate(zip(marks, tracks, strict=True)):
                if number in track or not (again or number - 1 in track):
                    continue
                guess = _beside(tracks, i, number) if again else None
                if guess is None and _near(track, number, accelerations[i], reaches[i]):
                    guess = _steady(track, number)
                if guess is None:
                    continue
                others = [tracks[j] for j in order[i] if number in tracks[j]]
                for wide in (False, True)[again:]:
                    pose = sought(cv2, mark, picture, guess, reaches[i]) if wide else refined(mark, picture, guess)
                    if pose and _is_own(mark, pose, guess, reaches[i], number, others):
                        track[number] = pose
                        break
        accelerations = np.fmax(accelerations, [_acceleration(track, number) for track in tracks])
        count_step()
    points, std = np.full((number + 1, len(marks), 2), np.nan), np.full((number + 1, len(marks)), np.nan)
    for i, track in enumerate(tracks):
        for k, pose in track.items():
            points[k, i], std[k, i] = point_of(marks[i], pose), pose.std
    median = np.array([np.median(one[np.isfinite(one)]) if np.isfinite(one).any() else 0.0 for one in std.T])
    points[std > MOST_STD * median] = np.nan
    std[0] = median  # its template is of this frame
    std = np.hypot(std, np.nan_to_num([_scatter(points[:, i]) for i in range(len(marks))]))
    return points, np.where(np.isnan(points[..., 0]), np.nan, std)


def _scatter(points: Array) -> float:
    """Return the std of the noise of a track, px; nan if it has no part that is long enough."""
    edges = np.flatnonzero(np.diff(np.isfinite(points[:, 0]), prepend=False, append=False))
    begin, end = max(edges.reshape(-1, 2).tolist(), key=lambda part: part[1] - part[0])
    count = end - begin
    if count < FEWEST_IN_SPECTRUM:
        return math.nan
    window = np.sin(np.pi * (np.arange(count) + 0.5) / count)[:, None] ** 4
    motion = window * (points[begin:end] - points[begin:end].mean(axis=0))
    spectrum = np.abs(np.fft.rfft(motion, axis=0)) ** 2 / np.sum(window**2)
    return math.sqrt(float(np.median(spectrum[round(HIGH * len(spectrum)) :])) / math.log(2))


def _reaches(cv2: Any, marks: Sequence[Mark], apart: Array, picture: Picture) -> list[float]:
    """Return how far each mark is sought, px."""
    reaches = []
    for mark, own in zip(marks, apart, strict=True):
        rows, columns = np.nonzero(correlations(cv2, mark, picture) > ALIKE)
        alike = np.hypot(columns + mark.radius - mark.place[0], rows + mark.radius - mark.place[1])
        distances = np.concatenate([alike, own])
        reaches.append(float(distances.min(where=distances > mark.radius, initial=max(picture.shape)) / 2))
    return reaches


def _is_own(mark: Mark, pose: Pose, guess: Pose, reach: float, number: int, others: Sequence[Track]) -> bool:
    """Return whether a mark can be where something like it is found; the other marks that are seen come by distance."""
    if np.hypot(*(pose.centre - guess.centre)) > reach:
        return False
    if any(np.hypot(*(pose.centre - other[number].centre)) <= mark.radius for other in others):
        return False
    return (
        not others
        or abs(np.hypot(*(pose.centre - others[0][number].centre)) - np.hypot(*(mark.place - others[0][0].centre)))
        < reach
    )


def _steady(track: Track, number: int) -> Pose:
    """Return where a mark is expected at constant velocity."""
    (late, now), (early, before) = [*islice(reversed(track.items()), 2), (0, track[0])][:2]
    ratio = (number - late) / max(late - early, 1)
    return Pose(now.centre + ratio * (now.centre - before.centre), now.angle + ratio * (now.angle - before.angle))


def _acceleration(track: Track, number: int) -> float:
    """Return the size of the second difference of the last three places, if they belong together, px/frame^2."""
    last = [track[k].centre for k in (number, number - 1, number - 2) if k in track]
    return float(np.hypot(*(last[0] - 2 * last[1] + last[2]))) if len(last) == 3 else math.nan


def _near(track: Track, number: int, acceleration: float, reach: float) -> bool:
    """Return whether constant velocity still says where a mark is; not without a known acceleration."""
    frames = number - next(reversed(track))
    return frames == 1 or 0.5 * acceleration * frames**2 <= reach


def _beside(tracks: Sequence[Track], i: int, number: int) -> Pose | None:
    """Return where a mark is expected from the two nearest marks that are seen; None if there are no two."""
    last, pose = next(reversed(tracks[i].items()))
    seen = [other for other in tracks if last in other and number in other]
    if len(seen) < 2:
        return None
    first, second = sorted(seen, key=lambda other: float(np.hypot(*(other[last].centre - pose.centre))))[:2]
    before, old, own = (complex(*one.centre) for one in (first[last], second[last], pose))
    now, new = (complex(*one.centre) for one in (first[number], second[number]))
    turn = (new - now) / (old - before)
    place = now + turn * (own - before)
    return Pose(np.array([place.real, place.imag]), pose.angle + float(np.angle(turn)))
