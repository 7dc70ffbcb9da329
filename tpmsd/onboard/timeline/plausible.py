"""Plausibility of wheel readings as rotations of the wheels of one car.

In: the rotations of one tick. Out: the wheels that are implausible. Pure.
"""

from __future__ import annotations

import math

PLAUSIBLE_RATIO = 2.0
"""A wheel that turns this much faster or slower than the median of the others is rejected in that
tick."""
PLAUSIBLE_FROM_RAD = 0.9
"""Rotation per tick (10 Hz: 3 m/s) from which ratios are judged: below, tight bends and single counts
rule."""


def implausible_wheels(rotation_rad: list[float], dt_s: float) -> list[int]:
    """Return the indices of the wheels that turn too unlike the median of all; all of two that disagree."""
    valid = sorted(turned for turned in rotation_rad if math.isfinite(turned))
    if not valid or valid[-1] < PLAUSIBLE_FROM_RAD * dt_s / 0.1:
        return []
    low, high = valid[(len(valid) - 1) // 2], valid[len(valid) // 2]
    least, most = (low + high) / 2 / PLAUSIBLE_RATIO, (low + high) / 2 * PLAUSIBLE_RATIO
    if len(valid) == 2 and valid[0] < valid[-1] / PLAUSIBLE_RATIO:
        least = most = math.nan  # of two that disagree, neither can be found right
    return [
        wheel
        for wheel, turned in enumerate(rotation_rad)
        if math.isfinite(turned) and not least <= turned <= most
    ]
