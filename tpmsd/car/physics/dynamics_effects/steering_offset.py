"""The steering angle's zero is off."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import INSTRUMENT, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class DynamicsSteeringOffset(DynamicsEffect):
    """reading = truth + offset_rad, of the angle that is recorded: the steering wheel's, or the road wheels'.

    Source: zeros of steering angle sensors, 1 to 5 degrees at the steering wheel; a fifteenth at the wheels.
    """

    name = "steering_offset"
    kind = INSTRUMENT
    wording = Wording(
        formula="reading = truth + offset_rad",
        sentence="the steering angle reads a constant on the straight",
        distinguished_by="drive straight on for a minute there and back",
    )
    channel = "yaw_rate"
    covariate = "time"
    confounded_with = ("yaw_rate_bias", "side_wind", "road_bank")
    parameters = (
        Parameter(
            "offset_rad",
            "rad",
            0.05,
            -3.0,
            3.0,
            "reading minus truth",
            probe=0.0001,
            prior=Prior(0.0, 0.05, "1 to 5 degrees: service manuals"),
        ),
    )
    offset_rad: float = 0.0

    def adapt_inputs(self, frame: Frame) -> None:
        """Subtract the offset of the steering wheel from the steer angle of the front wheels."""
        frame.steer = frame.steer - self.offset_rad / frame.steering_ratio
