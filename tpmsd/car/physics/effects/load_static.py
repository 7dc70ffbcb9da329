"""The load of an axle from one start to the next: people and luggage come and go at a stop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Kind, NoiseResemblance, Parameter, Prior
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import IS_FRONT, WHEELS, FloatArray

STANDSTILL_MPS = 0.2
SHORTEST_S = 20.0
"""In less nobody gets in."""


@dataclass(frozen=True)
class LoadStatic(Effect):
    """delta_r = front_m on the front axle and rear_m on the rear one, from the drive's longest stop on (of at
    least 20 s); more load, smaller radius.

    Before the stop the load is that of the calibration, so that a drive without one shows nothing.

    Source: 0.25 mm per 500 N and wheel by the Magic Formula 6.1 ([Besselink 2010]): two people in the back,
    1500 N, are -0.35 mm at the rear, a trailer's 750 N on the hook -0.25 mm and +0.05 mm in front.
    """

    name = "load_static"
    wording = Wording(
        formula="delta_r = front_m (front) or rear_m (rear) after the longest stop",
        sentence="the load of an axle changed at a stop",
        noun="a load taken up at a stop",
        answers=(
            "at a stop the rear axle was {rear_m:relieved|loaded}: its radii changed by {rear_m:mm}",
            "at a stop the front axle was {front_m:relieved|loaded}: its radii changed by {front_m:mm}",
        ),
        distinguished_by="drive the same road with the load and without, a stop of a minute between",
    )
    identification = Identification(shows_in=("wheel_ratio", "time"))
    confounding = Confounding(resembles=NoiseResemblance.WHEEL)
    own_per_drive = True
    kind = Kind.PHYSICS
    stays = "it belongs to the drive on which it was found"
    parameters = (
        Parameter(
            "rear_m",
            "m",
            -3e-4,
            -5e-3,
            5e-3,
            "change of the rear radii",
            probe=1e-5,
            prior=Prior(0.0, 3e-4, "two people in the back: -0.35 mm"),
            fitted=(-1.5e-3, 1.5e-3),
        ),
        Parameter(
            "front_m",
            "m",
            -1e-4,
            -5e-3,
            5e-3,
            "change of the front radii",
            probe=1e-5,
            prior=Prior(0.0, 1e-4, "one person in front: -0.1 mm"),
            fitted=(-1.5e-3, 1.5e-3),
        ),
    )
    rear_m: float = 0.0
    front_m: float = 0.0

    @classmethod
    def observable(cls, motion: Motion, car: Car) -> bool:
        """Return whether there is a stop with driving on both sides."""
        return longest_stop_end_s(motion) is not None

    @classmethod
    def acting_wheels(cls, car: Car, fitted: tuple[str, ...]) -> tuple[str, ...]:
        """Return the wheels of the axles whose parameters were fitted."""
        axle = ("front_m", "front_m", "rear_m", "rear_m")
        return tuple(wheel for wheel, name in zip(WHEELS, axle, strict=True) if name in fitted)

    def radius_change_m(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) the change on each axle, zero before the stop's end."""
        end_s = longest_stop_end_s(motion)
        after = np.zeros(len(motion)) if end_s is None else (motion.time_s >= end_s).astype(np.float64)
        return after[:, None] * np.where(IS_FRONT, self.front_m, self.rear_m)


def longest_stop_end_s(motion: Motion) -> float | None:
    """Return the end of the longest stop amid driving, s; None if none lasts long enough."""
    moving = np.flatnonzero(motion.speed_mps > STANDSTILL_MPS)
    if len(moving) < 2:
        return None
    gaps = np.diff(motion.time_s[moving])
    longest = int(np.argmax(gaps))
    return float(motion.time_s[moving[longest + 1]]) if gaps[longest] >= SHORTEST_S else None
