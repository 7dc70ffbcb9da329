"""The gyro reads a rate while the car drives straight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from tpmsd.physics.effect import Effect, Parameter
from tpmsd.wheels import FloatArray


@dataclass(frozen=True)
class YawRateBias(Effect):
    """reading = truth + bias.

    Source: data sheets of automotive gyros, 1e-3 to 5e-3 rad/s uncalibrated, about 1e-4 after a standstill.
    """

    name: ClassVar[str] = "yaw_rate_bias"
    sentence: ClassVar[str] = "the gyro reads a rate on the straight"
    telling_drive: ClassVar[str] = "stand still for a minute with the ignition on"
    shows_in: ClassVar[tuple[str, str]] = ("yaw_rate", "time")
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("bias", "rad/s", 1e-3, -0.2, 0.2, "reading minus truth", probe=1e-3),
    )
    bias: float

    def read_yaw_rate(self, true_radps: FloatArray) -> FloatArray:
        """Truth plus bias."""
        return true_radps + self.bias
