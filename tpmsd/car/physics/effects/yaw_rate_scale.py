"""The gyro's scale is off."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.effect import Effect, Kind, Parameter
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.priors import GYRO_SCALE
from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True)
class YawRateScale(Effect):
    """reading = scale * truth; 1 is a perfect gyro.

    Source: data sheets of automotive gyros, 1 to 3 % over temperature.
    """

    name = "yaw_rate_scale"
    kind = Kind.INSTRUMENT
    wording = Wording(
        formula="reading = scale * truth",
        sentence="the gyro's scale is off",
        noun="an error of the gyro's scale",
        answers=("your gyro reads {scale:just %} {scale:high|low} ({scale})",),
        distinguished_by="drive ten full circles to each side",
    )
    identification = Identification(shows_in=("yaw_rate", "yaw_rate"), needs=("yaw_rate",))
    confounding = Confounding(estimated_jointly_with=("track_width_error",))
    in_calibration = (("gyro_gain", "scale_minus_one", "1"),)
    parameters = (
        Parameter(
            "scale",
            "1",
            1.01,
            0.5,
            2.0,
            "reading divided by truth",
            probe=0.01,
            neutral=1.0,
            prior=GYRO_SCALE,
        ),
    )
    scale: float

    def read_yaw_rate(self, true_radps: FloatArray) -> FloatArray:
        """Return the true yaw rate times the scale."""
        return true_radps * self.scale
