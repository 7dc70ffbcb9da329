"""The gyro's scale is off."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import INSTRUMENT, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class DynamicsYawRateScale(DynamicsEffect):
    """reading = scale * truth.

    Source: data sheets of automotive gyros, 1 to 3 % over temperature.
    """

    name = "yaw_rate_scale"
    kind = INSTRUMENT
    wording = Wording(
        formula="yaw rate read = scale * truth",
        sentence="the gyro's scale is off",
        distinguished_by="drive ten full circles to each side",
    )
    channel = "yaw_rate"
    covariate = "yaw_rate"
    confounded_with = ("steering_ratio_error",)
    parameters = (
        Parameter(
            "scale",
            "1",
            1.03,
            0.5,
            2.0,
            "reading divided by truth",
            probe=0.001,
            prior=Prior(1.0, 0.02, "1 to 3 %: data sheets"),
            neutral=1.0,
        ),
    )
    scale: float = 1.0

    def read(self, frame: Frame) -> None:
        """Multiply the yaw-rate reading by the scale."""
        frame.outputs["yaw_rate"] = frame.outputs["yaw_rate"] * self.scale
