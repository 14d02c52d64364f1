"""Pictures of a video, and where they show a point.

A camera shows a point r of the beam, turned by the rotation R of the picture, at

    column + (R r)_x / scale,        row - (R r)_y / scale.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.exceptions import InputError
from ancf_casadi.records.video.recording import read_pictures
from ancf_casadi.records.video.view import View
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import array, number, physical, vector
from ancf_casadi.support.tables import Displayed, plural, spread


@dataclass(frozen=True, eq=False)
class Footage(Displayed):
    """Pictures of a video, over which computed motion is drawn.

    Parameters
    ----------
    time : array_like (k,)
        Time of each picture on the clock of the motion, s, increasing.
    images : sequence (k,) of array
        Pictures of bytes: (rows, columns), grey, or (rows, columns, 3), red, green and blue.
    scale : float
        Length of a pixel, m.
    origin : (float, float)
        Column and row of the origin of the laboratory frame, the clamp at rest.
    rotation : float
        Rotation of the picture, counterclockwise, rad.

    Raises
    ------
    InputError
        If the times do not increase or are not as many as the pictures, a picture has another form, or a number cannot
        be used.

    Examples
    --------
    >>> import numpy as np
    >>> from ancf_casadi import Footage
    >>> images = np.full((25, 480, 640), 200, dtype=np.uint8)
    >>> footage = Footage(np.arange(25) / 25, images, scale=1e-3, origin=(320.0, 20.0))
    >>> footage.pixels((0.05, -0.4))
    array([370., 420.])
    """

    time: ArrayLike
    images: Sequence[Any]
    scale: float
    origin: tuple[float, float]
    rotation: float = 0.0

    def __post_init__(self) -> None:
        """Validate."""
        time = array(self.time, "time")
        if time.ndim != 1 or not time.size or (time[1:] <= time[:-1]).any():
            raise InputError("must be numbers that increase", "time")
        listed = all(hasattr(self.images, name) for name in ("__getitem__", "__len__"))
        single = getattr(self.images, "ndim", 1) == 0  # an array without a length
        if not listed or single or isinstance(self.images, Mapping) or len(self.images) != time.size:
            raise InputError(f"must be a sequence of {time.size} pictures, one for each time", "images")
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "scale", physical(self.scale, "scale"))
        object.__setattr__(self, "origin", vector(self.origin, "origin"))
        object.__setattr__(self, "rotation", number(self.rotation, "rotation"))
        self.image(0)

    @classmethod
    def from_video(
        cls,
        path: str | Path,
        *,
        ruler: Sequence[float] | None = None,
        clamp: Sequence[float] | None = None,
        vertical: Sequence[float] | None = None,
        sample_rate: float | None = None,
        begin: float = 0.0,
        end: float = math.inf,
        every: int = 1,
    ) -> Footage:
        """Return the pictures of a video file, grey, with the view and the times of ``track_video``.

        Parameters
        ----------
        path, ruler, clamp, vertical, sample_rate, begin, end
            As in ``track_video``; without a ruler, lengths are in px.
        every : int
            Number of frames from one picture to the next.

        Raises
        ------
        InputError
            If the file is no video or has no pictures in the interval, a value cannot be used, or
            ``opencv-python-headless`` is not installed.

        Examples
        --------
        >>> import cv2
        >>> import numpy as np
        >>> from ancf_casadi import Footage
        >>> video = cv2.VideoWriter("grey.avi", cv2.VideoWriter_fourcc(*"MJPG"), 240.0, (160, 120), isColor=False)
        >>> for k in range(12):
        ...     _ = video.write(np.full((120, 160), 200, np.uint8))
        >>> video.release()
        >>> footage = Footage.from_video("grey.avi", ruler=(0, 60, 100, 60, 0.05), clamp=(80, 60), every=4)
        >>> footage.time
        array([0.        , 0.01666667, 0.03333333])
        >>> footage.pixels((0.01, 0.0))
        array([100.,  60.])
        """
        view = View.of(ruler=ruler, clamp=clamp, vertical=vertical)
        time, pictures = read_pictures(path, sample_rate=sample_rate, begin=begin, end=end, every=every)
        across, down = view.down(None).tolist()  # without a lens, OpenCV has nothing to do
        _, scale = view.positions(None, np.zeros(2))
        column, row = view.clamp or (0.0, 0.0)
        return cls(time, pictures, float(scale), (column, row), math.atan2(across, down))

    def image(self, index: int) -> Array:
        """Return a picture by its number, from 0."""
        picture = np.asarray(self.images[index])
        if (
            picture.dtype != np.uint8
            or picture.ndim not in (2, 3)
            or picture.shape[2:] not in ((), (3,))
            or not picture.size
        ):
            raise InputError(f"picture {index} is no array of bytes, (rows, columns) or (rows, columns, 3)", "images")
        return picture

    def pixels(self, positions: ArrayLike) -> Array:
        """Return column and row of positions in the laboratory frame, (..., 2), m, likewise (..., 2)."""
        c, s = math.cos(self.rotation) / self.scale, math.sin(self.rotation) / self.scale
        return np.asarray(self.origin + array(positions, "positions", finite=False) @ np.array([[c, -s], [-s, -c]]))

    def _summary(self) -> str:
        return f"{plural(len(self.images), 'picture')}, {spread(np.asarray(self.time), 's')}, {self.scale:.4g} m/pixel"
