"""The steering's ratio is not the configured one."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import INSTRUMENT, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class DynamicsSteeringRatioError(DynamicsEffect):
    """Road-wheel angle = configured angle / ratio.

    Source: makers state ratios of 12 to 20 for one model by engine and steering.
    """

    name = "steering_ratio_error"
    kind = INSTRUMENT
    wording = Wording(
        formula="delta = reading / (configured ratio * ratio)",
        sentence="the steering's ratio is not the configured one",
        distinguished_by="drive full circles slowly, to both sides",
    )
    channel = "yaw_rate"
    covariate = "steering"
    confounded_with = ("cornering_stiffness_error", "yaw_rate_scale")
    parameters = (
        Parameter(
            "ratio",
            "1",
            1.1,
            0.3,
            3.0,
            "true ratio divided by the configured one",
            probe=0.001,
            prior=Prior(1.0, 0.08, "12 to 20 for one model: makers"),
            neutral=1.0,
        ),
    )
    ratio: float = 1.0

    def adapt_inputs(self, frame: Frame) -> None:
        """Divide the steer angle of the front wheels by the ratio."""
        frame.steer = frame.steer / self.ratio
