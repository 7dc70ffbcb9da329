"""Drives of one car: whether the configurations of several recordings describe the same one.

In: recordings. Out: the difference in words, or `ConfigError`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.inference.recording import Recording

SAME_LENGTH_M = 1e-4
"""Configured lengths that differ by less are the same: a file's rounding."""


def check_same_car(recordings: Sequence[Recording]) -> None:
    """Raise ConfigError unless all recordings are configured as one car."""
    for other in recordings[1:]:
        difference = car_difference(recordings[0], other)
        if difference:
            raise ConfigError(
                f"{recordings[0].name} and {other.name} are drives of different cars: {difference}"
            )


def car_difference(one: Recording, other: Recording, teeth: bool = True) -> str:
    """Return in words the first difference of two recordings' cars; empty if there is none."""
    a, b = one.car, other.car
    for name in ("wheelbase_m", "track_front_m", "track_rear_m"):
        left, right = getattr(a.geometry, name), getattr(b.geometry, name)
        if abs(left - right) > SAME_LENGTH_M:
            return f"{name} = {left:g} and {right:g}"
    if teeth and a.teeth_per_rev != b.teeth_per_rev:
        return f"teeth_per_rev = {a.teeth_per_rev:g} and {b.teeth_per_rev:g}"
    if not np.array_equal(a.driven, b.driven):
        names = [" ".join(w for k, w in enumerate(WHEELS) if car.driven[k]) for car in (a, b)]
        return f"driven wheels {names[0]} and {names[1]}"
    return ""
