"""A mark in a picture: its template, and its place in another picture to a fraction of a pixel.

A mark is a disc T(q) of the first picture, q from its centre.  In another picture I, the mark at p that is turned by
theta minimises the sum of |I(p + R(theta) q) - g T(q) - b|^2, where gain g and offset b are those of the light.  With
the pseudo-inverse G of the derivatives of g T + b, each Gauss-Newton step finds from I how far T is to be moved and
turned, and moves I back (inverse compositional).  I is interpolated by cubic splines, since linear interpolation has
errors of up to 0.015 px that follow the place within a pixel, and thus the motion.

A round dot does not show its angle.  Its theta stays 0, and its centre is the point q that minimises
sum |(x - qx) Ty - (y - qy) Tx|^2, about which turning changes the template least.

With the residual r = I - g T - b, the place has, to first order, the covariance g^-2 G C G', where C is the
autocovariance of r, which contains the noise of camera and compression with its colour.  Its product with G is computed
as a product of spectra.

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

LEAST_CORRELATION = 0.9  # of a mark that is seen: below it, it is covered in part
LEAST_SLOPES = 0.02  # squared slopes of a template in their weakest direction, relative to the strongest
LEAST_LEVER = 1.2  # px; change of a template by turning, relative to moving, above which its angle is estimated
MOST_MOVES = 30  # of a mark, until it is refined
LAST_STEP = 1e-3  # px


@dataclass(frozen=True, eq=False)
class Mark:
    """A mark of the first picture."""

    place: Array  # centre of its template, px
    offset: Array  # from there to the point that is tracked, px
    template: Picture
    disc: Mask
    turns: bool  # whether it shows its angle
    inverse: Array  # G: of moving right and down, offset, gain, and turning if it shows its angle
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
    """Return the mark about a point; None where the picture is uniform, shows one straight edge, or ends."""
    place = np.rint(point)
    x, y = place.astype(int)
    if not _inside(radius, place, picture):
        return None
    template = picture[y - radius : y + radius + 1, x - radius : x + radius + 1].copy()
    rows, columns = np.mgrid[-radius : radius + 1, -radius : radius + 1].astype(float)
    disc = np.hypot(rows, columns) <= radius + 0.5
    down, right = np.gradient(template.astype(float))
    moved = np.stack([right[disc], down[disc]], axis=1)
    along, across_edges = np.linalg.eigvalsh(moved.T @ moved)
    if along <= LEAST_SLOPES * across_edges:
        return None
    turned = (columns * down - rows * right)[disc]
    light = np.stack([np.ones(len(turned)), template[disc]], axis=1)
    across = np.stack([moved[:, 1], -moved[:, 0]], axis=1)
    q = np.linalg.lstsq(across, turned, rcond=None)[0]
    rest = turned - across @ q
    turns = bool(rest @ rest > LEAST_LEVER**2 * (moved**2).sum())
    derivatives = np.column_stack([moved, light, turned] if turns else [moved, light])
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


def refined(mark: Mark, picture: Picture, guess: Pose) -> Pose | None:
    """Return the pose near a guess; None if the mark is not seen there, or only in part."""
    r = mark.radius
    if not _inside(r, guess.centre, picture):
        return None
    low = np.maximum(np.rint(guess.centre).astype(int) - 2 * r, 0)
    part = picture[low[1] : low[1] + 4 * r + 1, low[0] : low[0] + 4 * r + 1]
    splines = scipy.ndimage.spline_filter(part.astype(float))
    q = np.argwhere(mark.disc).T[::-1] - float(r)
    centre, angle = guess.centre - low, guess.angle
    for _ in range(MOST_MOVES):
        at = _turn(angle) @ q + centre[:, None]
        seen = scipy.ndimage.map_coordinates(splines, at[::-1], prefilter=False, mode="nearest")
        moved, (_, gain, *turned) = np.split(mark.inverse @ seen, [2])
        if not gain > 0.0:
            return None
        angle -= sum(turned) / gain
        centre = centre - _turn(angle) @ moved / gain
        if np.hypot(*moved) < LAST_STEP * gain:
            break
    centre = centre + low
    template = mark.template[mark.disc] - mark.template[mark.disc].mean()
    seen = seen - seen.mean()
    gain = float(template @ seen / (template @ template))
    if not gain * np.linalg.norm(template) > LEAST_CORRELATION * np.linalg.norm(seen):
        return None
    if not _inside(r, centre, picture):
        return None
    rest = np.zeros(mark.disc.shape)
    rest[mark.disc] = seen - gain * template
    spectrum = np.abs(np.fft.fft2(rest, s=(4 * r,) * 2)) ** 2
    # mean over the frequencies of the product of both spectra
    variance = float((mark.filters * spectrum).mean()) / len(template)
    return Pose(centre, angle, math.sqrt(variance) / gain)


def sought(cv2: Any, mark: Mark, picture: Picture, guess: Pose, reach: float) -> Pose | None:
    """Return the pose within reach (px) of a guess, which its angle must match."""
    r = mark.radius
    low = np.maximum(np.rint(guess.centre - reach).astype(int) - r, 0)
    high = np.rint(guess.centre + reach).astype(int) + r + 1
    part = picture[low[1] : max(high[1], 0), low[0] : max(high[0], 0)]
    if min(part.shape) <= 2 * r:
        return None
    score = correlations(cv2, mark, part, guess.angle)
    y, x = np.unravel_index(np.argmax(score), score.shape)
    return refined(mark, picture, Pose(low + np.array([x, y]) + r, guess.angle))


def correlations(cv2: Any, mark: Mark, picture: Picture, angle: float = 0.0) -> Array:
    """Return the correlation of a mark with each place of a picture that is a radius from its edges."""
    r = mark.radius
    turn = cv2.getRotationMatrix2D((r, r), -math.degrees(angle), 1.0)
    template = cv2.warpAffine(mark.template, turn, mark.disc.shape, borderMode=cv2.BORDER_REPLICATE)
    score = cv2.matchTemplate(picture, template, cv2.TM_CCOEFF_NORMED, mask=mark.disc.astype(np.uint8))
    return np.where(np.isfinite(score), score, -1.0)  # not where the picture is uniform


def point_of(mark: Mark, pose: Pose) -> Array:
    """Return the point of a mark that is tracked, px."""
    return pose.centre + _turn(pose.angle) @ mark.offset


def _turn(angle: float) -> Array:
    """Return the matrix R of a turn from x to y."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


def _inside(radius: int, centre: Array, picture: Picture) -> bool:
    """Return whether the whole mark is in the picture."""
    rows, columns = picture.shape
    return bool(radius <= centre[0] < columns - radius and radius <= centre[1] < rows - radius)
