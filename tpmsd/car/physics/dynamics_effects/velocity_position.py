"""The lateral speed is that of a point ahead of or behind the centre of gravity."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import INSTRUMENT, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class VelocityPosition(DynamicsEffect):
    """v reads v + forward_m * r, and the side slip that of the same point.

    Source: kinematics of a rigid body; an inertial navigation system or an optical sensor states the speed of
    its own place, or of a centre of gravity that is known to 0.1 to 0.3 m.
    """

    name = "velocity_position"
    kind = INSTRUMENT
    wording = Wording(
        formula="v read = v + forward_m * r",
        sentence="the lateral speed is read ahead of or behind the centre of gravity",
        distinguished_by="turn tightly at walking pace and hold steady bends at 20 m/s",
    )
    channel = "velocity_lat"
    covariate = "yaw_rate"
    confounded_with = ("cg_position_error", "cornering_stiffness_error")
    parameters = (
        Parameter(
            "forward_m",
            "m",
            0.3,
            -4.0,
            4.0,
            "point ahead of the centre of gravity",
            probe=0.001,
            prior=Prior(0.0, 0.3, "0.1 to 0.3 m: installations, unknown load"),
        ),
    )
    forward_m: float = 0.0

    def read(self, frame: Frame) -> None:
        """Add forward_m * r to the lateral velocity; read the side slip of the same point."""
        out = frame.outputs
        out["velocity_lat"] = out["velocity_lat"] + self.forward_m * frame.r
        out["side_slip"] = out["side_slip"] + self.forward_m * frame.r / frame.u
