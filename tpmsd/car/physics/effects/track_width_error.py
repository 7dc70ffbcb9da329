"""The wheels of an axle are not as far apart as the configuration says."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.effect import Effect, Kind, Parameter
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.motion import Car
from tpmsd.car.physics.priors import TRACK_M
from tpmsd.foundation.wheels import WHEELS


@dataclass(frozen=True)
class TrackWidthError(Effect):
    """True track minus configured one, at the rear and at the front.

    The wheels' speeds are v -+ yaw rate * track / 2, so the error shows in proportion to the yaw rate.
    Source: [Lundquist 2013], eq. (6); other rims or spacers change a track by 10 to 60 mm.
    """

    name = "track_width_error"
    kind = Kind.INSTRUMENT
    wording = Wording(
        formula="hub speeds = v -+ yaw rate * (track + error) / 2",
        sentence="the track differs from the configured one",
        noun="an error of the track",
        answers=(
            "the rear track is {rear_m:size mm} {rear_m:wider|narrower} than configured",
            "the front track is {front_m:size mm} {front_m:wider|narrower} than configured",
        ),
        distinguished_by="drive full circles slowly, to both sides: load transfer is small there",
    )
    identification = Identification(shows_in=("wheel_ratio", "yaw_rate"), contrast=True)
    confounding = Confounding(estimated_jointly_with=("yaw_rate_scale",))
    in_calibration = (
        ("track_rear", "rear_relative", "1"),
        ("track_front", "front_relative", "1"),
    )
    parameters = (
        Parameter(
            "rear_m",
            "m",
            0.03,
            -0.5,
            0.5,
            "rear track, true minus configured",
            probe=1e-3,
            prior=TRACK_M,
            fitted=(-0.25, 0.25),
        ),
        Parameter(
            "front_m",
            "m",
            0.03,
            -0.5,
            0.5,
            "front track, true minus configured",
            probe=1e-3,
            prior=TRACK_M,
            fitted=(-0.25, 0.25),
        ),
    )
    rear_m: float = 0.0
    front_m: float = 0.0

    def track_error_m(self) -> tuple[float, float]:
        """(front, rear), in the order of the wheels."""
        return self.front_m, self.rear_m

    @classmethod
    def acting_wheels(cls, car: Car, fitted: tuple[str, ...]) -> tuple[str, ...]:
        """Return the wheels of the axles whose tracks were fitted."""
        axle = ("front_m", "front_m", "rear_m", "rear_m")
        return tuple(wheel for wheel, name in zip(WHEELS, axle, strict=True) if name in fitted)
