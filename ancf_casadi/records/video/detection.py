"""Marks in the first picture: at given points, or at detected dots, or else at corners such as those of checkers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.video.frames import Picture
from ancf_casadi.records.video.marks import Mark, mark_at
from ancf_casadi.support.arrays import Array

RING = 3  # width of the surroundings of a dot in its template, px
DEFAULT_RADIUS = 10  # of the template of a mark other than a dot, px
MAX_MARKS = 40
MAX_CORNERS = 8


def find_marks(
    cv2: Any,
    picture: Picture,
    points: Array | None,
    region: tuple[float, ...] | None,
    radius: int | None,
    clamp: tuple[float, ...] | None,
) -> list[Mark]:
    """Return the marks at points, or those in a region, numbered from the clamp, or from the top."""
    grey = cv2.convertScaleAbs(picture)  # whole numbers
    dots = _dots(cv2, grey)
    if points is None:
        area = region or (0.0, 0.0, *picture.shape[::-1])
        inside = ((dots[:, :2] >= area[:2]) & (dots[:, :2] <= area[2:])).all(axis=1)
        points = dots[inside, :2] if inside.any() else _corners(cv2, grey, area, radius or DEFAULT_RADIUS)
        start = np.array(clamp or (picture.shape[1] / 2, 0.0))
        points = points[np.argsort(np.hypot(*(points - start).T))]
        if not len(points):
            raise InputError("no marks are found in the first frame; name them with --marker")
        if len(points) > MAX_MARKS:
            raise InputError(
                f"{len(points)} marks are found; give the --region of the beam, or name them with --marker"
            )
    marks = []
    for number, point in enumerate(points, start=1):
        mark_radius = radius or _radius(dots, point)
        mark = mark_at(picture, point, mark_radius)
        if mark is None:
            raise InputError(
                f"marker {number} at ({point[0]:g}, {point[1]:g}): there is no dot, corner or texture within "
                f"{mark_radius} px, or the picture ends there"
            )
        marks.append(mark)
    return marks


def _dots(cv2: Any, picture: Picture) -> Array:
    """Return columns, rows and radii (n, 3) of round dots, dark or bright."""
    blobs: list[Sequence[float]] = []
    for colour in (0, 255):
        settings = cv2.SimpleBlobDetector_Params()
        settings.filterByColor, settings.blobColor = True, colour
        settings.filterByArea, settings.minArea, settings.maxArea = True, 12.0, 5000.0
        settings.filterByCircularity, settings.minCircularity = True, 0.7
        detected = cv2.SimpleBlobDetector_create(settings).detect(picture)
        blobs += [(*blob.pt, blob.size / 2) for blob in detected]
    return np.array(blobs).reshape(-1, 3)


def _corners(cv2: Any, picture: Picture, area: tuple[float, ...], radius: int) -> Array:
    """Return corners with a distance from one another and from the edges, the strongest first."""
    first_column, first_row, last_column, last_row = area
    mask = np.zeros_like(picture)
    edge = 2 * radius
    mask[
        max(round(first_row), edge) : max(round(last_row), 0),
        max(round(first_column), edge) : max(round(last_column), 0),
    ] = 255
    mask[picture.shape[0] - edge :], mask[:, picture.shape[1] - edge :] = 0, 0
    corners = cv2.goodFeaturesToTrack(picture, MAX_CORNERS, 0.3, 3.0 * radius, mask=mask, blockSize=radius)
    return np.array([] if corners is None else corners, dtype=float).reshape(-1, 2)


def _radius(dots: Array, point: Array) -> int:
    """Return the radius of the template of a mark."""
    for x, y, r in dots:
        if np.hypot(x - point[0], y - point[1]) <= r:
            return round(float(r)) + RING
    return DEFAULT_RADIUS
