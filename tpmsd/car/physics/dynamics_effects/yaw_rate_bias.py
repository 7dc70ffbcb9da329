"""The gyro reads a rate on the straight."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import INSTRUMENT, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class DynamicsYawRateBias(DynamicsEffect):
    """reading = truth + bias.

    Source: data sheets of automotive gyros, 1e-3 to 1e-2 rad/s uncalibrated.
    """

    name = "yaw_rate_bias"
    order = 1
    kind = INSTRUMENT
    wording = Wording(
        formula="yaw rate read = truth + bias",
        sentence="the gyro reads a rate on the straight",
        distinguished_by="stand still for a minute with the ignition on",
    )
    channel = "yaw_rate"
    covariate = "time"
    confounded_with = ("steering_offset",)
    parameters = (
        Parameter(
            "bias",
            "rad/s",
            0.005,
            -0.2,
            0.2,
            "reading minus truth",
            probe=1e-05,
            prior=Prior(0.0, 0.005, "1e-3 to 1e-2: data sheets"),
        ),
    )
    bias: float = 0.0

    def read(self, frame: Frame) -> None:
        """Add the bias to the yaw-rate reading."""
        frame.outputs["yaw_rate"] = frame.outputs["yaw_rate"] + self.bias
