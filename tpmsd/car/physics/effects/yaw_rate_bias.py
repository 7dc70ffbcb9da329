"""The gyro reads a rate while the car drives straight."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.effect import Effect, Kind, Parameter
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.priors import GYRO_ZERO_RADPS
from tpmsd.foundation.wheels import FloatArray

TOLERANCE_RADPS = 5e-4
"""Up to which a zero is usual: what a standstill leaves (1e-4), flicker noise, and a bus that rounds to
0.01 to 0.05 degrees per second."""


@dataclass(frozen=True)
class YawRateBias(Effect):
    """reading = truth + bias.

    Source: data sheets of automotive gyros, 1e-3 to 5e-3 rad/s uncalibrated, about 1e-4 after a standstill.
    """

    name = "yaw_rate_bias"
    kind = Kind.INSTRUMENT
    wording = Wording(
        formula="reading = truth + bias",
        sentence="the gyro reads a rate on the straight",
        noun="an offset of the gyro",
        answers=("the gyro reads {bias:deg/s} on the straight",),
        distinguished_by="stand still for a minute with the ignition on",
    )
    identification = Identification(shows_in=("yaw_rate", "time"), needs=("yaw_rate",), everywhere=True)
    confounding = Confounding(drifts_into="yaw_rate")
    parameters = (
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

    @classmethod
    def tolerance_note(cls, value: float, std: float, speeds: bool) -> str:
        """Return the note on a bias that is usual for gyros; empty for a larger one."""
        if abs(value) - 2.0 * std > TOLERANCE_RADPS:
            return ""
        return f"the gyro reads {value:.1e} +- {std:.1e} rad/s on the straight, as they do"

    def read_yaw_rate(self, true_radps: FloatArray) -> FloatArray:
        """Return the true yaw rate plus the bias."""
        return true_radps + self.bias
