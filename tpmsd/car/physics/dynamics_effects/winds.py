"""Wind from the side and from ahead, over a span of time.

In: speed, onset, duration. Out: `SideWind`, `DynamicsHeadWind`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import EVENT, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior
from tpmsd.foundation.wheels import FloatArray

SIDE_AREA_M2 = 4.5
"""Side force area dC_y/dbeta * A of a passenger car: 2 to 2.5 per rad of 2 m2 ([Gillespie 1992], ch. 4)."""
SIDE_AREA_STD = 0.2
"""Relative standard deviation of the side force area over bodies: 3 m2 of a low car to 7 m2 of a van."""
LEVER_M = 0.25
"""Its centre of pressure ahead of the centre of gravity ([Gillespie 1992], ch. 4: a tenth of the
wheelbase)."""
TYPICAL_DRAG_M2 = 0.65
"""Drag area where the car has none configured."""


def _time_parameter(name: str, typical: float, low: float, description: str) -> Parameter:
    """Return a parameter in seconds, at most 1e6."""
    return Parameter(name, "s", typical, low, 1e6, description)


_SPEED = Parameter(
    "speed_mps",
    "m/s",
    8.0,
    -60.0,
    60.0,
    "of the wind, positive to the left or against the car",
    probe=1e-2,
    prior=Prior(0.0, 6.0, "4 to 12 m/s: Beaufort 3 to 6"),
)


@dataclass(frozen=True)
class SideWind(DynamicsEffect):
    """F_y = rho / 2 * A * u * speed, M_z = 0.25 m * F_y, A = 4.5 m2, from onset_s for duration_s.

    A wind to the left, at a small angle to the path. The speed is known as well as the area: to 20 %. Source:
    [Gillespie 1992], ch. 4.
    """

    name = "side_wind"
    kind = EVENT
    wording = Wording(
        formula="F_y = rho/2 * 4.5 m2 * u * speed, M_z = 0.25 m * F_y, in a span of time",
        sentence="a wind blows from the side",
        distinguished_by="drive the same road there and back at a constant speed",
    )
    channel = "accel_lat"
    confounded_with = ("road_bank", "steering_offset")
    relative_std = SIDE_AREA_STD
    parameters = (
        _SPEED,
        _time_parameter("onset_s", 60.0, 0.0, "begin"),
        _time_parameter("duration_s", 10.0, 0.1, "length"),
    )
    speed_mps: float = 0.0
    onset_s: float = 0.0
    duration_s: float = 1e6

    def add_forces(self, frame: Frame) -> None:
        """Add the lateral force of the side wind, and its yaw moment about the centre of gravity."""
        force = 0.5 * frame.air_kgpm3 * SIDE_AREA_M2 * frame.u * self.speed_mps * _blowing_mask(self, frame)
        frame.force_y = frame.force_y + force
        frame.moment = frame.moment + LEVER_M * force


@dataclass(frozen=True)
class DynamicsHeadWind(DynamicsEffect):
    """F_x = -rho / 2 * A * ((u + speed)^2 - u^2), from onset_s for duration_s; A is the car's drag area.

    Source: dynamic pressure of the relative wind.
    """

    name = "head_wind"
    kind = EVENT
    wording = Wording(
        formula="F_x = -rho/2 * A * ((u + speed)^2 - u^2) in a span of time",
        sentence="a wind blows from ahead",
        distinguished_by="drive the same road there and back at a constant speed",
    )
    channel = "speed"
    needs_forces = True
    confounded_with = ("road_grade",)
    parameters = (
        _SPEED,
        _time_parameter("onset_s", 60.0, 0.0, "begin"),
        _time_parameter("duration_s", 10.0, 0.1, "length"),
    )
    speed_mps: float = 0.0
    onset_s: float = 0.0
    duration_s: float = 1e6

    def add_forces(self, frame: Frame) -> None:
        """Subtract the drag that the head wind adds from the longitudinal force."""
        area = np.where(np.asarray(frame.drag_area) > 0.0, frame.drag_area, TYPICAL_DRAG_M2)
        press = (frame.u + self.speed_mps) ** 2 - frame.u**2
        frame.force_x = frame.force_x - 0.5 * frame.air_kgpm3 * area * press * _blowing_mask(self, frame)


def _blowing_mask(wind: SideWind | DynamicsHeadWind, frame: Frame) -> FloatArray:
    """Return 1 while the wind blows, else 0."""
    since = frame.inputs.time_s - wind.onset_s
    return np.asarray((since >= 0.0) & (since < wind.duration_s), dtype=np.float64)
