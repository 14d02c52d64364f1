"""A mark in a picture: its template, and its place in another picture to a fraction of a pixel.

A mark is a disc T(q) of the first picture, q from its centre.  In another picture I, the mark at p that is turned by
theta minimises the sum of |I(p + R(theta) q) - g T(q) - b|^2, where gain g and offset b are those of the light.  With
the pseudo-inverse G of the derivatives of g T + b, each Gauss-Newton step computes the displacement and rotation of T
from I, and applies their inverse to I (inverse compositional).  I is interpolated by cubic splines, since linear
interpolation has errors of up to 0.015 px that depend on the place within a pixel, and thus on the motion.

The angle of a round dot is not observable.  Its theta stays 0, and its centre is the point q that minimises
sum |(x - qx) Ty - (y - qy) Tx|^2, so that a rotation about it changes the template least.

With the residual r = I - g T - b, the place has, to first order, the covariance g^-2 G C G', where C is the
autocovariance of r and includes the spectrum of camera and compression noise.  The product with G is computed as a
product of spectra.

References
----------
S. Baker, I. Matthews, "Lucas-Kanade 20 years on: a unifying framework", International Journal of Computer Vision 56
(2004) 221-255.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy  # its packages are imported on first use

from ancf_casadi.records.video.frames import Picture
from ancf_casadi.support.arrays import Array, Mask

MIN_CORRELATION = 0.9  # of a visible mark; below, the mark is partly covered
MIN_SLOPES = 0.02  # squared slopes of a template in the weakest direction, relative to the strongest
MIN_LEVER = 1.2  # px; change of a template by rotation, relative to translation, for its angle to be estimated
MAX_ITERATIONS = 30
LAST_STEP = 1e-3  # px


@dataclass(frozen=True, eq=False)
class Mark:
    """A mark of the first picture."""

    place: Array  # centre of its template, px
    offset: Array  # from the centre to the tracked point, px
    template: Picture
    disc: Mask
    turns: bool  # whether its angle is observable
    inverse: Array  # G: rows of displacement right and down, offset, gain, and rotation if its angle is observable
    filters: Array  # squared spectrum of its first two rows, mean of x and y

    @property
    def radius(self) -> int:
        """Radius of the template, px."""
        return len(self.disc) // 2


@dataclass(frozen=True, eq=False)
class Pose:
    """Place of a mark in a picture."""

    centre: Array  # of the template, px
    angle: float = 0.0  # rad, from x to y, which points down
    std: float = math.nan  # of each coordinate, px


def mark_at(picture: Picture, point: Array, radius: int) -> Mark | None:
    """Return the mark about a point; None if the picture there is uniform, has one straight edge only, or ends."""
    place = np.rint(point)
    x, y = place.astype(int)
    if not _inside(radius, place, picture):
        return None
    template = picture[y - radius : y + radius + 1, x - radius : x + radius + 1].copy()
    rows, columns = np.mgrid[-radius : radius + 1, -radius : radius + 1].astype(float)
    disc = np.hypot(rows, columns) <= radius + 0.5
    down, right = np.gradient(template.astype(float))
    translation = np.stack([right[disc], down[disc]], axis=1)
    weaker, stronger = np.linalg.eigvalsh(translation.T @ translation)
    if weaker <= MIN_SLOPES * stronger:
        return None
    rotation = (columns * down - rows * right)[disc]
    brightness = np.stack([np.ones(len(rotation)), template[disc]], axis=1)
    lever = np.stack([translation[:, 1], -translation[:, 0]], axis=1)
    q = np.linalg.lstsq(lever, rotation, rcond=None)[0]
    residual = rotation - lever @ q
    turns = bool(residual @ residual > MIN_LEVER**2 * (translation**2).sum())
    derivatives = np.column_stack([translation, brightness, rotation] if turns else [translation, brightness])
    try:
        inverse = np.linalg.solve(derivatives.T @ derivatives, derivatives.T)
    except np.linalg.LinAlgError:
        return None
    filters = np.zeros((2, *disc.shape))
    filters[:, disc] = inverse[:2]
    return Mark(
        place,
        point - place if turns else q,
        template,
        disc,
        turns,
        inverse,
        (np.abs(np.fft.fft2(filters, s=(4 * radius,) * 2)) ** 2).mean(axis=0),
    )


def refine_pose(mark: Mark, picture: Picture, guess: Pose) -> Pose | None:
    """Return the pose near a guess; None if the mark is absent or partly covered."""
    r = mark.radius
    if not _inside(r, guess.centre, picture):
        return None
    low = np.maximum(np.rint(guess.centre).astype(int) - 2 * r, 0)
    window = picture[low[1] : low[1] + 4 * r + 1, low[0] : low[0] + 4 * r + 1]
    splines = scipy.ndimage.spline_filter(window.astype(float))
    q = np.argwhere(mark.disc).T[::-1] - float(r)
    centre, angle = guess.centre - low, guess.angle
    for _ in range(MAX_ITERATIONS):
        positions = _turn(angle) @ q + centre[:, None]
        samples = scipy.ndimage.map_coordinates(splines, positions[::-1], prefilter=False, mode="nearest")
        displacement, (_, gain, *rotation) = np.split(mark.inverse @ samples, [2])
        if not gain > 0.0:
            return None
        angle -= sum(rotation) / gain
        centre = centre - _turn(angle) @ displacement / gain
        if np.hypot(*displacement) < LAST_STEP * gain:
            break
    centre = centre + low
    template = mark.template[mark.disc] - mark.template[mark.disc].mean()
    samples = samples - samples.mean()
    gain = float(template @ samples / (template @ template))
    if not gain * np.linalg.norm(template) > MIN_CORRELATION * np.linalg.norm(samples):
        return None
    if not _inside(r, centre, picture):
        return None
    residual = np.zeros(mark.disc.shape)
    residual[mark.disc] = samples - gain * template
    spectrum = np.abs(np.fft.fft2(residual, s=(4 * r,) * 2)) ** 2
    # mean over the frequencies of the product of both spectra
    variance = float((mark.filters * spectrum).mean()) / len(template)
    return Pose(centre, angle, math.sqrt(variance) / gain)


def search_pose(cv2: Any, mark: Mark, picture: Picture, guess: Pose, reach: float) -> Pose | None:
    """Search the area within reach (px) of a guess by correlation at its angle, and return the refined pose."""
    r = mark.radius
    low = np.maximum(np.rint(guess.centre - reach).astype(int) - r, 0)
    high = np.rint(guess.centre + reach).astype(int) + r + 1
    window = picture[low[1] : max(high[1], 0), low[0] : max(high[0], 0)]
    if min(window.shape) <= 2 * r:
        return None
    score = correlations(cv2, mark, window, guess.angle)
    y, x = np.unravel_index(np.argmax(score), score.shape)
    return refine_pose(mark, picture, Pose(low + np.array([x, y]) + r, guess.angle))


def correlations(cv2: Any, mark: Mark, picture: Picture, angle: float = 0.0) -> Array:
    """Return the correlation of a mark with each place of a picture that is a radius from its edges."""
    r = mark.radius
    turn = cv2.getRotationMatrix2D((r, r), -math.degrees(angle), 1.0)
    template = cv2.warpAffine(mark.template, turn, mark.disc.shape, borderMode=cv2.BORDER_REPLICATE)
    score = cv2.matchTemplate(picture, template, cv2.TM_CCOEFF_NORMED, mask=mark.disc.astype(np.uint8))
    return np.where(np.isfinite(score), score, -1.0)  # not where the picture is uniform


def tracked_point(mark: Mark, pose: Pose) -> Array:
    """Return the tracked point of a mark, px."""
    return pose.centre + _turn(pose.angle) @ mark.offset


def _turn(angle: float) -> Array:
    """Return the matrix R of a turn from x to y."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


def _inside(radius: int, centre: Array, picture: Picture) -> bool:
    """Return whether the whole mark is in the picture."""
    rows, columns = picture.shape
    return bool(radius <= centre[0] < columns - radius and radius <= centre[1] < rows - radius)
