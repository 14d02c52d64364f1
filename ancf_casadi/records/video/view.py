"""Conversion of places in a picture to positions: lens, vertical, scale and origin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import numbers, positive


@dataclass(frozen=True)
class View:
    """View of a camera: positions are x to the right and y up from the origin, in m with a ruler, else in px."""

    ruler: tuple[float, ...] | None = None  # columns and rows of two points, px, and their distance, m
    clamp: tuple[float, ...] | None = None  # column and row of the origin, px
    vertical: tuple[float, ...] | None = None  # columns and rows of two points on a vertical line, px
    lens: tuple[float, ...] | None = None  # focal lengths and centre, px, and coefficients of distortion, as in OpenCV

    @classmethod
    def of(cls, **values: Sequence[float] | None) -> View:
        """Return a view from the arguments of a user; None stands for a default."""
        sizes = {"ruler": (5,), "clamp": (2,), "vertical": (4,), "lens": (8, 9)}
        arguments: dict[str, tuple[float, ...]] = {}
        for name, value in values.items():
            if value is None:
                continue
            arguments[name] = numbers(value, name)
            if len(arguments[name]) not in sizes[name]:
                raise InputError(
                    f"must be {' or '.join(map(str, sizes[name]))} numbers, got {len(arguments[name])}", name
                )
            if name in ("ruler", "vertical") and arguments[name][:2] == arguments[name][2:4]:
                raise InputError("its two points must differ", name)
        if "ruler" in arguments:
            positive(arguments["ruler"][4], "ruler")
        if "lens" in arguments:
            for focal in arguments["lens"][:2]:
                positive(focal, "lens")
        return cls(**arguments)

    @property
    def unit(self) -> str:
        """Unit of the positions."""
        return "m" if self.ruler else "px"

    def positions(self, cv2: Any, points: Array) -> tuple[Array, Array]:
        """Return the positions (..., 2) of points, and the length of a pixel."""
        straight_points = self._undistort(cv2, points)
        ends = (
            self._undistort(cv2, np.reshape(self.ruler[:4], (2, 2)))
            if self.ruler
            else np.array([[0.0, 0.0], [1.0, 0.0]])
        )
        scale = (self.ruler[4] if self.ruler else 1.0) / np.hypot(*(ends[1] - ends[0]))
        if self.clamp:
            straight_points = straight_points - self._undistort(cv2, np.array([self.clamp]))[0]
        down = self.down(cv2)
        right = np.array([down[1], -down[0]])
        return scale * np.stack([straight_points @ right, -straight_points @ down], axis=-1), scale

    def down(self, cv2: Any) -> Array:
        """Return the direction (2,) in the picture that is vertical; rows count downwards."""
        if not self.vertical:
            return np.array([0.0, 1.0])
        line = self._undistort(cv2, np.reshape(self.vertical, (2, 2)))
        down = (line[1] - line[0]) / np.hypot(*(line[1] - line[0]))
        return np.asarray(down * (np.sign(down[1]) or 1.0))

    def _undistort(self, cv2: Any, points: Array) -> Array:
        """Return points (..., 2) as a camera without distortion would show them, px."""
        if self.lens is None:
            return points
        fx, fy, cx, cy, *distortion = self.lens
        camera = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        distorted = points.reshape(-1, 1, 2)
        finite = np.isfinite(distorted).all(axis=(1, 2))
        undistorted = np.full_like(distorted, np.nan)
        if finite.any():
            undistorted[finite] = cv2.undistortImagePoints(distorted[finite], camera, np.array(distortion))
        return undistorted.reshape(points.shape)
