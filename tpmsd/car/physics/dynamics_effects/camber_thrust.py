"""Wheels that lean out with the body push outwards."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.dynamics_parameters import INSTANT, leans
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.motion import GRAVITY_MPS2
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class CamberThrust(DynamicsEffect):
    """F_y = -c * F_z * a_y / g on each axle, c the camber stiffness per load times the roll per g.

    a_y = u r + instant * (F_y / m - u r): the body leans by the steady acceleration or by all of it. Source:
    camber stiffness of about 1 per rad of load, roll of 3 to 7 degrees per g of which half remains between
    wheel and road: c of 0.02 to 0.06 ([Pacejka 2012], section 4.3).
    """

    name = "camber_thrust"
    order = 1  # after all other forces: it follows what they do
    kind = PHYSICS
    wording = Wording(
        formula="F_y = -c * F_z * a_y / g on each axle",
        sentence="leaning wheels push outwards in bends",
        distinguished_by="hold steady bends at two speeds and change lanes quickly",
    )
    channel = "velocity_lat"
    covariate = "accel_lat"
    confounded_with = ("cornering_stiffness_error", "mass_error")
    parameters = (
        Parameter(
            "coefficient",
            "1",
            0.05,
            -0.5,
            0.5,
            "c",
            probe=0.0001,
            prior=Prior(0.0, 0.04, "0.02 to 0.06: Pacejka, section 4.3"),
        ),
        INSTANT,
    )
    coefficient: float = 0.0
    instant: float = 0.0

    @classmethod
    def variants(cls, nonlinear: bool) -> tuple[Mapping[str, float], ...]:
        """Return the ways to lean."""
        return leans(nonlinear)

    def add_forces(self, frame: Frame) -> None:
        """Push both axles outwards.

        With a share p of all of a_y, m a_y = F - c * F_z / g * ((1 - p) * u r + p * a_y) is solved for a_y.
        """
        load = frame.load
        if not frame.axles:
            load = np.stack([load[0] + load[1], load[2] + load[3]])
        steady = (1.0 - self.instant) * frame.across
        by_accel = self.coefficient / GRAVITY_MPS2 * (load[0] + load[1])
        instant = (frame.force_y - by_accel * steady) / (frame.mass + by_accel * self.instant)
        pull = -self.coefficient / GRAVITY_MPS2 * (steady + self.instant * instant)
        front, rear = load[0] * pull, load[1] * pull
        frame.force_y = frame.force_y + front + rear
        frame.moment = frame.moment + frame.front * front - frame.rear * rear
