"""The car weighs more or less than configured."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class MassError(DynamicsEffect):
    """m = m_configured * (1 + relative); forces and lengths stay.

    Source: kerb mass to permitted mass is 25 to 35 %; passengers and fuel move it by a tenth.
    """

    name = "mass_error"
    kind = PHYSICS
    wording = Wording(
        formula="m = configured * (1 + relative)",
        sentence="the car's mass is not the configured one",
        distinguished_by="accelerate and brake firmly with known forces, and steer in between",
    )
    channel = "accel_lat"
    covariate = "accel_lat"
    confounded_with = ("drive_force_error", "cornering_stiffness_error")
    parameters = (
        Parameter(
            "relative",
            "1",
            0.1,
            -0.6,
            1.5,
            "true over configured, minus 1",
            probe=0.001,
            prior=Prior(0.0, 0.1, "passengers and fuel: a tenth"),
        ),
    )
    relative: float = 0.0

    def adapt_car(self, frame: Frame) -> None:
        """Scale the mass by 1 + relative."""
        frame.mass = frame.mass * (1.0 + self.relative)
