"""Where markers may be in a picture: dark convex things of the right size on something light.

The search works on the picture at half its resolution, which costs a third of a full one and
finds the same markers; everything precise is left to the outline's fit on the full picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.tracking.families import MarkerFamily

CANDIDATE = np.dtype([("x_px", "f8"), ("y_px", "f8"), ("ahead_x", "f8"), ("ahead_y", "f8")])
"""A dark thing: its centroid in full-resolution pixels, and in the picture the direction (not
normalised) in which it tapers."""

_ROUNDEST, _SLIMMEST = 1.2, 2.9
"""Ratio of the variances along and across; the arrow's is 1.87, seen through the lens 2.2."""
_LEAST_POINT = 0.12
"""How much a thing must taper; an arrow has 0.24 to 0.6, a rectangle or an ellipse 0."""


@dataclass(frozen=True, slots=True)
class CandidateSearch:
    """Finds candidates for one family's arrows by a local threshold and their contours.

    Attributes:
        family: The marker family.
        darkness: A pixel is dark below this share of its surroundings' mean (0.87),
        least_step: less this many grey values, which keeps the noise of a black floor out (6).
        least_area: Smallest accepted share of the arrow's expected area (0.4).
        most_area: Largest accepted share of it (1.5).
        convexity: Smallest accepted share of the convex hull that is filled (0.6: blur lets
            white cells break through the arrow's edge, its hull stays).
    """

    family: MarkerFamily
    darkness: float = 0.87
    least_step: int = 6
    least_area: float = 0.4
    most_area: float = 1.5
    convexity: float = 0.6

    def find(self, image: NDArray[np.uint8], px_per_mm: float) -> NDArray[np.void]:
        """Returns the picture's candidates.

        Args:
            image: (height, width) uint8.
            px_per_mm: About how large a millimetre of a marker is in the picture.

        Returns:
            (n,) CANDIDATE.
        """
        half = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        window = 2 * max(round(0.2 * self.family.disc_diameter_mm * px_per_mm), 2) - 1
        mean = cv2.boxFilter(half, -1, (window, window))
        level = cv2.addWeighted(mean, self.darkness, mean, 0.0, -self.least_step)
        dark = cv2.compare(half, level, cv2.CMP_LT)
        contours, tree = cv2.findContours(dark, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
        expected = self.family.outline_area_mm2 * px_per_mm**2 / 4.0
        low, high = self.least_area * expected, self.most_area * expected
        rows = []
        for place, contour in enumerate(contours):
            if len(contour) < 4 or tree[0, place, 3] >= 0:
                continue
            area = cv2.contourArea(contour)
            if not self.convexity * low < area < high:
                continue
            moments = cv2.moments(cv2.convexHull(contour))
            if low < moments["m00"] < high and area > self.convexity * moments["m00"]:
                row = _describe(moments)
                if row is not None:
                    rows.append(row)
        return np.array(rows, dtype=CANDIDATE)


def _describe(moments: dict[str, float]) -> tuple[float, float, float, float] | None:
    """Returns a CANDIDATE row from a hull's moments at half resolution; None if no arrow.

    The longest axis carries the heading. Its sense comes from the third moments: an arrow is
    skewed towards its tip along its axis, and is narrower there.
    """
    area = moments["m00"]
    xx, xy, yy = moments["mu20"] / area, moments["mu11"] / area, moments["mu02"] / area
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    c, s = math.cos(angle), math.sin(angle)
    along = xx * c * c + 2.0 * xy * c * s + yy * s * s
    across = max(xx + yy - along, 1e-9)
    m30, m21 = moments["mu30"] / area, moments["mu21"] / area
    m12, m03 = moments["mu12"] / area, moments["mu03"] / area
    skew = c**3 * m30 + 3 * c * c * s * m21 + 3 * c * s * s * m12 + s**3 * m03
    taper = c * s * s * m30 + (s**3 - 2 * c * c * s) * m21 + (c**3 - 2 * c * s * s) * m12
    taper += c * c * s * m03
    point = skew / along**1.5 - 2.0 * taper / (across * along**0.5)
    if abs(point) < _LEAST_POINT or not _ROUNDEST < along / across < _SLIMMEST:
        return None
    x, y = 2.0 * moments["m10"] / area + 0.5, 2.0 * moments["m01"] / area + 0.5
    sense = math.copysign(1.0, point)
    return x, y, sense * c, sense * s
