"""The gyro reads a rate while the car drives straight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from tpmsd.physics.effect import Effect, Kind, Parameter
from tpmsd.physics.priors import GYRO_ZERO_RADPS
from tpmsd.wheels import FloatArray


@dataclass(frozen=True)
class YawRateBias(Effect):
    """reading = truth + bias.

    Source: data sheets of automotive gyros, 1e-3 to 5e-3 rad/s uncalibrated, about 1e-4 after a standstill.
    """

    name: ClassVar[str] = "yaw_rate_bias"
    kind: ClassVar[Kind] = Kind.INSTRUMENT
    formula: ClassVar[str] = "reading = truth + bias"
    needs: ClassVar[tuple[str, ...]] = ("yaw_rate",)
    everywhere: ClassVar[bool] = True
    drifts_into: ClassVar[str] = "yaw_rate"
    sentence: ClassVar[str] = "the gyro reads a rate on the straight"
    telling_drive: ClassVar[str] = "stand still for a minute with the ignition on"
    shows_in: ClassVar[tuple[str, str]] = ("yaw_rate", "time")
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "bias",
            "rad/s",
            1e-3,
            -0.2,
            0.2,
            "reading minus truth",
            probe=1e-3,
            prior=GYRO_ZERO_RADPS,
        ),
    )
    bias: float

    def read_yaw_rate(self, true_radps: FloatArray) -> FloatArray:
        """Truth plus bias."""
        return true_radps + self.bias
