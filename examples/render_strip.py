"""Renders a video of a strip with marks, as a camera would see it, from its computed motion.

Every pixel of a mark holds the share of its area that is covered, averaged over the exposure, so that the marks are
where the motion has them to two thousandths of a pixel.  Places count from 0 at the centre of the first pixel,
columns to the right and rows downwards.  Needs only numpy, scipy and opencv-python-headless (the extra ``video``).
"""

from collections.abc import Iterable, Iterator
from pathlib import Path

import cv2
import numpy as np
from scipy.interpolate import CubicSpline

BACKGROUND, STRIP, DARK, BLIND = 70.0, 205.0, 30.0, 120.0  # grey levels
PARTS = 3  # of a pixel of a mark, along each axis, whose mean it is


def frames(
    time: np.ndarray,
    shapes: np.ndarray,
    marks: list[int],
    *,
    pattern: str = "dots",
    size: tuple[int, int] = (640, 480),
    width: float = 26.0,
    radius: float = 6.0,
    exposure: float = 0.25,
    noise: float = 2.0,
    drift: float = 0.0,
    covered: Iterable[tuple[int, int, int]] = (),
    seed: int = 0,
) -> Iterator[np.ndarray]:
    """Yield the frames.

    Parameters
    ----------
    time : array (k,)
        Times of the middle of each exposure, s.
    shapes : array (k, n, 2)
        Columns and rows of n points along the strip, px.
    marks : list of int
        Those of the n points that carry a mark.
    pattern : str
        ``dots``, ``checkers`` (two dark quadrants) or ``texture`` (random, another for each mark).
    size : pair of int
        Width and height of the picture, px.
    width, radius : float
        Width of the strip and radius of the marks, px.
    exposure : float
        Share of the time between frames in which the shutter is open.
    noise : float
        Standard deviation of the noise of each pixel, grey levels of 255.
    drift : float
        Relative change of the light from the first to the last frame.
    covered : iterable of (mark, begin, end)
        A grey square passes over the mark from frame ``begin`` to ``end``.
    seed : int
        Of noise and texture.
    """
    rng = np.random.default_rng(seed)
    motion = CubicSpline(time, shapes)
    step = float(time[1] - time[0])
    waves = rng.normal(0.0, 0.6, (len(marks), 24, 2)), rng.uniform(0.0, 2 * np.pi, (len(marks), 24))
    bars = list(covered)
    for k, instant in enumerate(time):
        image = np.zeros(size[::-1], dtype=np.float32)
        instants = instant + step * exposure * ((np.arange(5) + 0.5) / 5 - 0.5)
        for shape in motion(instants):
            cv2.accumulate(_picture(shape, marks, pattern, size, width, radius, waves), image)
        image /= len(instants)
        for mark, begin, end in bars:
            if begin <= k < end:
                x, y = shapes[k, marks[mark]]
                x += 5 * radius * ((k - begin + 0.5) / (end - begin) - 0.5)
                left, right, top, bottom = (max(round(one), 0) for one in (
                    x - 2 * radius, x + 2 * radius, y - 2 * radius, y + 2 * radius
                ))  # fmt: skip
                image[top:bottom, left:right] = BLIND
        image *= 1.0 + drift * k / len(time)
        image += noise * rng.standard_normal(image.shape, dtype=np.float32)
        yield cv2.convertScaleAbs(np.maximum(image, 0))


def _picture(shape, marks, pattern, size, width, radius, waves) -> np.ndarray:
    """Return one picture without noise."""
    image = np.full(size[::-1], BACKGROUND, dtype=np.uint8)
    fine = np.rint(shape * 16).astype(np.int32).reshape(-1, 1, 2)
    cv2.polylines(image, [fine], False, STRIP, round(width), cv2.LINE_AA, shift=4)
    tangents = np.gradient(shape, axis=0)
    reach = int(radius + 4)
    for number, mark in enumerate(marks):
        (x, y), (a, b) = shape[mark], tangents[mark] / np.hypot(*tangents[mark])
        left, top = round(x) - reach, round(y) - reach
        if not (0 <= left < size[0] - 2 * reach and 0 <= top < size[1] - 2 * reach):
            continue
        place = np.s_[top : top + 2 * reach + 1, left : left + 2 * reach + 1]
        parts = (np.arange(PARTS * (2 * reach + 1)) + 0.5) / PARTS - 0.5
        u, v = np.meshgrid(left - x + parts, top - y + parts)
        u, v = a * u + b * v, a * v - b * u  # px along and across the strip
        inside = np.clip(PARTS * (radius - np.hypot(u, v)) + 0.5, 0.0, 1.0)
        if pattern == "checkers":
            sides = np.clip(PARTS * u + 0.5, 0.0, 1.0), np.clip(PARTS * v + 0.5, 0.0, 1.0)
            dark = sides[0] * sides[1] + (1 - sides[0]) * (1 - sides[1])
        elif pattern == "texture":
            phases = waves[0][number] @ np.stack([u.ravel(), v.ravel()]) + waves[1][number][:, None]
            dark = np.clip(0.5 + 0.15 * np.cos(phases).sum(0).reshape(u.shape), 0.0, 1.0)
        else:
            dark = np.ones_like(u)
        share = cv2.resize(inside * dark, None, fx=1 / PARTS, fy=1 / PARTS, interpolation=cv2.INTER_AREA)
        image[place] = np.rint(image[place] + share * (DARK - image[place]))
    return image


def write_video(path: str | Path, pictures: Iterable[np.ndarray], frame_rate: float, codec: str = "MJPG") -> None:
    """Write grey frames as a video: MJPG as AVI, mp4v as MP4."""
    writer = None
    for picture in pictures:
        if writer is None:
            code = cv2.VideoWriter_fourcc(*codec)
            writer = cv2.VideoWriter(str(path), code, frame_rate, picture.shape[::-1], isColor=False)
        writer.write(picture)
    writer.release()


def bending_strip(time: np.ndarray, frequency: float, largest: float, length: float, clamp: tuple[float, float]):
    """Return shapes of a strip that bends as a circular arc, with a slope of its end of ``largest`` rad, px."""
    slope = largest * np.exp(-0.01 * 2 * np.pi * frequency * time) * np.cos(2 * np.pi * frequency * time)
    s = np.linspace(0.0, 1.0, 61)
    angle = slope[:, None] * (s[None, 1:] + s[None, :-1]) / 2
    steps = length * np.diff(s) * np.stack([np.sin(angle), np.cos(angle)])
    return np.array(clamp) + np.concatenate(
        [np.zeros((len(time), 1, 2)), np.cumsum(steps, axis=2).transpose(1, 2, 0)], 1
    )
