"""Tracks of marks through a video.

Each mark is expected where its last two places lead at constant velocity, and refined there (``marks``).  If it is not
found, it is sought around this place by normalised correlation, within its reach: half the distance to the nearest
other mark, and to whatever looks like it in the first picture.  A mark that was lost is expected beside the two nearest
marks that are seen: it moves from where it was seen last by the similarity transformation that moves these two.
Without them it is expected at constant velocity, for n frames as long as a n^2/2 stays within its reach, where a is its
largest acceleration so far (px/frame^2).  Where nothing is found, or another mark is seen, there is a gap.

The std of a place has two parts: what the residual of its picture says (``marks``), and the scatter of the track, which
shows the errors of compression that a picture alone does not.  The n-th difference of white noise has binomial(2n, n)
times its variance, and that of a motion with ten or more frames per period vanishes with n.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import islice
from typing import Any

import numpy as np

from ancf_casadi.records.video.frames import Picture
from ancf_casadi.records.video.marks import Mark, Pose, correlations, point_of, refined, sought
from ancf_casadi.support.arrays import Array, root_mean_square
from ancf_casadi.support.progress import step

MOST_STD = 2.0  # std of a place, relative to the median of its mark, above which the mark is covered in part
ORDERS = (3, 4, 5, 6)  # of the differences that show the scatter of a track
ALIKE = 0.8  # correlation from which a place may be taken for a mark
Track = dict[int, Pose]  # frames in which a mark is seen, in order


def tracked(cv2: Any, marks: Sequence[Mark], first: Picture, pictures: Iterable[Picture]) -> tuple[Array, Array]:
    """Return columns and rows (k, m, 2) of the marks, px, and their std (k, m); nan where a mark is not seen."""
    tracks: list[Track] = [{0: Pose(mark.place)} for mark in marks]
    reaches, accelerations = _reaches(cv2, marks, first), np.zeros(len(marks))
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
                others = [other[number].centre for other in tracks if number in other]
                for find in (refined, sought)[again:]:
                    pose = find(cv2, mark, picture, guess, reaches[i])
                    if pose and _free(pose, guess, others, reaches[i], mark.radius):
                        track[number] = pose
                        break
        accelerations = np.maximum(accelerations, [_acceleration(track, number) for track in tracks])
        step()
    points, std = np.full((number + 1, len(marks), 2), np.nan), np.full((number + 1, len(marks)), np.nan)
    for i, track in enumerate(tracks):
        for k, pose in track.items():
            points[k, i], std[k, i] = point_of(marks[i], pose), pose.std
    median = np.array([np.median(one[np.isfinite(one)]) if np.isfinite(one).any() else 0.0 for one in std.T])
    points[std > MOST_STD * median] = np.nan
    std[0] = median  # its template is of this frame
    std = np.hypot(std, [_scatter(points[:, i]) for i in range(len(marks))])
    return points, np.where(np.isnan(points[..., 0]), np.nan, std)


def _scatter(points: Array) -> float:
    """Return the rms of the part of a track that no smooth motion explains, px."""
    differences = [np.diff(points, n, axis=0) / math.sqrt(math.comb(2 * n, n)) for n in ORDERS]
    return min((root_mean_square(one) for one in differences if np.isfinite(one).any()), default=0.0)


def _reaches(cv2: Any, marks: Sequence[Mark], picture: Picture) -> Array:
    """Return how far each mark is sought, px."""
    places = np.array([mark.place for mark in marks])
    reaches = []
    for mark in marks:
        rows, columns = np.nonzero(correlations(cv2, mark, picture) > ALIKE)
        alike = np.concatenate([np.stack([columns, rows], axis=1) + mark.radius, places]) - mark.place
        distances = np.hypot(*alike.T)
        reaches.append(distances.min(where=distances > mark.radius, initial=max(picture.shape)) / 2)
    return np.array(reaches)


def _free(pose: Pose, guess: Pose, others: Sequence[Array], reach: float, radius: int) -> bool:
    """Return whether a pose is near its guess, and no other mark is seen there."""
    near = np.hypot(*(pose.centre - guess.centre)) <= reach
    return bool(near) and all(np.hypot(*(pose.centre - other)) > radius for other in others)


def _steady(track: Track, number: int) -> Pose:
    """Return where a mark is expected at constant velocity."""
    (late, now), (early, before) = [*islice(reversed(track.items()), 2), (0, track[0])][:2]
    ratio = (number - late) / max(late - early, 1)
    return Pose(now.centre + ratio * (now.centre - before.centre), now.angle + ratio * (now.angle - before.angle))


def _acceleration(track: Track, number: int) -> float:
    """Return the size of the second difference of the last three places, if they belong together, px/frame^2."""
    last = [track[k].centre for k in (number, number - 1, number - 2) if k in track]
    return float(np.hypot(*(last[0] - 2 * last[1] + last[2]))) if len(last) == 3 else 0.0


def _near(track: Track, number: int, acceleration: float, reach: float) -> bool:
    """Return whether constant velocity still says where a mark is."""
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
