"""The slope of the road, from the receiver's heights (effect `road_grade` of the catalogue).

In: distance rolled and heights of fixes. Out: the factor from distance along the road to that over the map.
Wheels roll along the slope, the receiver reports the horizontal: 6 % of grade are 0.18 % of the distance,
more than a third of a 20 % pressure loss.
"""

from __future__ import annotations

import math
from collections import deque

WINDOW_M = 200.0
MIN_SPAN_M = 60.0
MIN_FIXES = 4
MAX_GRADE = 0.25
REBASE_M = 2000.0
"""When the old origin is this far behind, the sums are formed again: so rounding cannot add up."""


class GradeTracker:
    """Least-squares slope of height over distance, over the last `WINDOW_M`."""

    def __init__(self) -> None:
        self._distance_m = 0.0
        self._points: deque[tuple[float, float]] = deque()
        self._origin = (0.0, 0.0)
        self._sums = (0.0, 0.0, 0.0, 0.0)
        """Sums of distance, height, their square and product over the points, both from the origin on."""
        self.sine = 0.0
        """Height gained per distance along the road."""

    def reset(self) -> None:
        """Start again (after a gap)."""
        self._points.clear()
        self._sums = (0.0, 0.0, 0.0, 0.0)
        self.sine = 0.0

    @property
    def horizontal(self) -> float:
        """Horizontal distance per distance along the road."""
        return math.sqrt(1.0 - self.sine**2)

    def move(self, distance_m: float) -> None:
        """Add a point, after the car has rolled on."""
        self._distance_m += distance_m

    def update(self, up_m: float) -> None:
        """Update by the height of a fix; NaN is left out."""
        if not math.isfinite(up_m):
            return
        points = self._points
        if points and self._distance_m - points[-1][0] < 2.0:
            return  # a standing car's heights would only weigh down one end
        points.append((self._distance_m, up_m))
        self._add_point(self._distance_m, up_m, 1.0)
        while self._distance_m - points[0][0] > WINDOW_M:
            self._add_point(*points.popleft(), -1.0)
        if len(points) == 1 or self._distance_m - self._origin[0] > REBASE_M:
            self._recompute_sums()
        if len(points) < MIN_FIXES or points[-1][0] - points[0][0] < MIN_SPAN_M:
            return
        count = len(points)
        along, up, square, product = self._sums
        slope = (product - along * up / count) / (square - along * along / count)
        self.sine = min(max(slope, -MAX_GRADE), MAX_GRADE)

    def _add_point(self, distance_m: float, up_m: float, sign: float) -> None:
        """Add a point to the sums (sign 1) or remove it (sign -1)."""
        along, up, square, product = self._sums
        x, y = distance_m - self._origin[0], up_m - self._origin[1]
        self._sums = (along + sign * x, up + sign * y, square + sign * x * x, product + sign * x * y)

    def _recompute_sums(self) -> None:
        """Recompute the sums about the newest point, against rounding."""
        self._origin, self._sums = self._points[-1], (0.0, 0.0, 0.0, 0.0)
        for point in self._points:
            self._add_point(*point, 1.0)
