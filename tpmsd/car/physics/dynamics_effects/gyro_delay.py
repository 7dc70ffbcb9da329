"""The gyro's reading is old."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import INSTRUMENT, DynamicsEffect
from tpmsd.car.physics.dynamics_parameters import READING_DELAY
from tpmsd.car.physics.effect_records import Wording


@dataclass(frozen=True)
class DynamicsGyroDelay(DynamicsEffect):
    """reading(t) = yaw rate(t - delay_s).

    Source: filters of automotive gyros, 10 to 50 Hz corner: 3 to 30 ms; buses and loggers add 5 to 50 ms.
    """

    name = "gyro_delay"
    kind = INSTRUMENT
    wording = Wording(
        formula="yaw rate read at t = yaw rate at t - delay_s",
        sentence="the yaw rate is read late",
        distinguished_by="steer quickly from side to side",
    )
    channel = "yaw_rate"
    covariate = "steering_rate"
    confounded_with = ("steering_delay", "yaw_inertia_error")
    grid = ({"delay_s": 0.05},)
    parameters = (READING_DELAY,)
    delay_s: float = 0.0

    @classmethod
    def near_neutral(cls, nonlinear: bool) -> bool:
        """Return True: the first order holds up to a tenth of a period of the steering, the grid beyond."""
        return True

    def read(self, frame: Frame) -> None:
        """Add delay_s to the age of the yaw-rate reading."""
        frame.delays["yaw_rate"] = frame.delays.get("yaw_rate", 0.0) + self.delay_s
