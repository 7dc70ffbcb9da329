"""The road wheels follow the steering reading later."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.inputs import Inputs
from tpmsd.car.physics.dynamics_effect import INSTRUMENT, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class SteeringDelay(DynamicsEffect):
    """delta(t) = reading(t - delay_s); less than 0 where the reading is older than the other signals.

    Source: play and twist of the column, 10 to 40 ms; buses and loggers add 5 to 50 ms either way.
    """

    name = "steering_delay"
    kind = INSTRUMENT
    wording = Wording(
        formula="delta at t = reading at t - delay_s",
        sentence="the road wheels follow the steering reading late",
        distinguished_by="steer quickly from side to side",
    )
    channel = "yaw_rate"
    covariate = "steering_rate"
    confounded_with = ("gyro_delay", "tyre_relaxation", "yaw_inertia_error")
    grid = ({"delay_s": 0.05}, {"delay_s": -0.05})
    parameters = (
        Parameter(
            "delay_s",
            "s",
            0.05,
            -0.3,
            0.3,
            "time by which the wheels follow",
            probe=1e-3,
            prior=Prior(0.0, 0.03, "10 to 50 ms: columns, buses"),
        ),
    )
    delay_s: float = 0.0

    @classmethod
    def near_neutral(cls, nonlinear: bool) -> bool:
        """Return True: the first order holds up to a tenth of a period of the steering, the grid beyond."""
        return True

    def shift_series(self, inputs: Inputs) -> Inputs:
        """Interpolate angle and rate at the earlier time."""
        return inputs.with_steering_shifted(-self.delay_s)
