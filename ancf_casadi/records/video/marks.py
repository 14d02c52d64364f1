"""A mark in a picture: its template, and its place in another picture to a fraction of a pixel.

A mark is a disc T(q) of the first picture, q from its centre.  In another picture I, the mark at p that is turned by
theta maximises the correlation of T(q) with I(p + R(theta) q), which neither brightness nor contrast of the light
changes (enhanced correlation coefficient, ``cv2.findTransformECC``).  OpenCV takes the angle for an arc sine and allows
no more than 90 degrees; the template is therefore turned by whole right angles before, which needs no interpolation.

A round dot does not show its angle.  Its theta stays 0, and its centre is the point q that minimises
sum |(x - qx) Ty - (y - qy) Tx|^2, about which turning changes the template least.

With the residual r = I - g T - b, the place has, to first order, the covariance g^-2 G C G', where G is the
pseudo-inverse of the derivatives of T and C the autocovariance of r, which contains the noise of camera and compression
with its colour.  Its product with G is computed as a product of spectra.

References
----------
G. D. Evangelidis, E. Z. Psarakis, "Parametric image alignment using enhanced correlation coefficient maximization",
IEEE Transactions on Pattern Analysis and Machine Intelligence 30 (2008) 1858-1865.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ancf_casadi.records.video.frames import Picture
from ancf_casadi.support.arrays import Array, Mask

LEAST_CORRELATION = 0.9  # of a mark that is seen: below it, it is covered in part
LEAST_SLOPES = 0.02  # squared slopes of a template in their weakest direction, relative to the strongest
LEAST_LEVER = 1.2  # px; change of a template by turning, relative to moving, above which its angle is estimated


@dataclass(frozen=True, eq=False)
class Mark:
    """A mark of the first picture."""

    place: Array  # centre of its template, px
    offset: Array  # from there to the point that is tracked, px
    templates: tuple[Picture, ...]  # turned counterclockwise by 0, 90, 180 and 270 degrees
    disc: Mask
    turns: bool  # whether it shows its angle
    filters: Array  # squared spectrum of G, mean of x and y

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
    if not (radius <= x < picture.shape[1] - radius and radius <= y < picture.shape[0] - radius):
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
        inverse = np.linalg.solve(derivatives.T @ derivatives, derivatives.T)[:2]
    except np.linalg.LinAlgError:
        return None
    filters = np.zeros((2, *disc.shape))
    filters[:, disc] = inverse
    return Mark(
        place,
        point - place if turns else q,
        tuple(np.ascontiguousarray(np.rot90(template, k)) for k in range(4)),
        disc,
        turns,
        (np.abs(np.fft.fft2(filters, s=(4 * radius,) * 2)) ** 2).mean(axis=0),
    )


def refined(cv2: Any, mark: Mark, picture: Picture, guess: Pose, reach: float) -> Pose | None:
    """Return the pose near a guess; None if the mark is not seen there, or only in part."""
    r = mark.radius
    rows, columns = picture.shape
    if not (r <= guess.centre[0] < columns - r and r <= guess.centre[1] < rows - r):
        return None
    quarters = round(-guess.angle / (math.pi / 2))
    c, s = (f(guess.angle + quarters * math.pi / 2) for f in (math.cos, math.sin))
    corner = np.maximum(np.rint(guess.centre).astype(int) - 2 * r, 0)
    part = np.ascontiguousarray(picture[corner[1] : corner[1] + 4 * r + 1, corner[0] : corner[0] + 4 * r + 1])
    x, y = guess.centre - corner
    warp = np.array([[c, -s, x - r * (c - s)], [s, c, y - r * (s + c)]], dtype=np.float32)
    try:
        correlation, warp = cv2.findTransformECCWithMask(
            mark.templates[quarters % 4], part, 255 * mark.disc.astype(np.uint8), np.full_like(part, 255), warp,
            cv2.MOTION_EUCLIDEAN if mark.turns else cv2.MOTION_TRANSLATION,
            (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 20, 1e-4), 1,
        )  # fmt: skip
    except cv2.error:  # it diverges, or leaves the part
        return None
    if not correlation >= LEAST_CORRELATION:
        return None
    seen = cv2.warpAffine(part, warp, mark.disc.shape, flags=cv2.INTER_LINEAR + cv2.WARP_INVERSE_MAP)
    angle = math.atan2(warp[1, 0], warp[0, 0]) - quarters * math.pi / 2
    return Pose(warp @ np.array([r, r, 1.0]) + corner, angle, _std(mark, np.rot90(seen, -(quarters % 4))))


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
    return refined(cv2, mark, picture, Pose(low + np.array([x, y]) + r, guess.angle), reach)


def correlations(cv2: Any, mark: Mark, picture: Picture, angle: float = 0.0) -> Array:
    """Return the correlation of a mark with each place of a picture that is a radius from its edges."""
    r = mark.radius
    turn = cv2.getRotationMatrix2D((r, r), -math.degrees(angle), 1.0)
    template = cv2.warpAffine(mark.templates[0], turn, mark.disc.shape, borderMode=cv2.BORDER_REPLICATE)
    score = cv2.matchTemplate(picture, template, cv2.TM_CCOEFF_NORMED, mask=mark.disc.astype(np.uint8))
    return np.where(np.isfinite(score), score, -1.0)  # not where the picture is uniform


def point_of(mark: Mark, pose: Pose) -> Array:
    """Return the point of a mark that is tracked, px."""
    c, s = math.cos(pose.angle), math.sin(pose.angle)
    return pose.centre + np.array([[c, -s], [s, c]]) @ mark.offset


def _std(mark: Mark, seen: Picture) -> float:
    """Return the standard deviation of a coordinate, from what the template does not explain."""
    first, now = (picture[mark.disc].astype(float) for picture in (mark.templates[0], seen))
    first -= first.mean()
    gain = first @ now / (first @ first)
    rest = np.zeros(mark.disc.shape)
    rest[mark.disc] = now - now.mean() - gain * first
    spectrum = np.abs(np.fft.fft2(rest, s=(4 * mark.radius,) * 2)) ** 2
    # mean over the frequencies of the product of both spectra
    variance = float((mark.filters * spectrum).mean()) / len(first)
    return math.sqrt(variance) / abs(float(gain))
