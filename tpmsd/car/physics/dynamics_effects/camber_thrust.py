"""Wheels that the body's roll cambers push outwards."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.baselines.frame import Frame, stack_contacts
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.dynamics_parameters import INSTANT, values_of_instant
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.motion import GRAVITY_MPS2
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class CamberThrust(DynamicsEffect):
    """F_y = -c * F_z * a_y / g on each axle, c the camber stiffness per load times the roll per g.

    With by_stiffness = 1 the sum of both is shared as their cornering stiffnesses are; with rear = 0 the rear
    wheels stay upright, as those of a rigid axle do. To a linear car both are angles of the wheels, as those
    of roll steer.
    a_y = u r + instant * (F_y / m - u r): the body rolls by the steady acceleration or by all of it. Source:
    camber stiffness of about 1 per rad of load, roll of 3 to 7 degrees per g of which half remains between
    wheel and road: c of 0.02 to 0.06 ([Pacejka 2012], section 4.3), several times that where wheels camber by
    all of the body's roll and push with a tenth of their cornering stiffness.
    """

    name = "camber_thrust"
    order = 1  # after all other forces: it follows what they do
    kind = PHYSICS
    wording = Wording(
        formula="F_y = -c * F_z * a_y / g on each axle",
        sentence="wheels that the body's roll cambers push outwards in bends",
        distinguished_by="hold steady bends at two speeds and change lanes quickly",
    )
    channel = "velocity_lat"
    covariate = "accel_lat"
    confounded_with = ("cornering_stiffness_error", "mass_error", "roll_steer")
    parameters = (
        Parameter(
            "coefficient",
            "1",
            0.05,
            -0.5,
            0.5,
            "c",
            probe=0.0001,
            prior=Prior(0.0, 0.1, "0.02 to 0.06, thrice it without suspension: Pacejka, section 4.3"),
        ),
        INSTANT,
        Parameter(
            "by_stiffness",
            "1",
            1.0,
            0.0,
            1.0,
            "1: thrust in proportion to cornering stiffness, 0: to load",
        ),
        Parameter("rear", "1", 1.0, 0.0, 1.0, "1: the rear wheels camber too, 0: they stay upright"),
    )
    coefficient: float = 0.0
    instant: float = 0.0
    by_stiffness: float = 0.0
    rear: float = 1.0

    @classmethod
    def variants(cls, nonlinear: bool) -> tuple[Mapping[str, float], ...]:
        """Return each acceleration that the body may roll by with each share of the axles."""
        shares = [{"by_stiffness": by, "rear": rear} for by in (0.0, 1.0) for rear in (1.0, 0.0)]
        return tuple({**share, **instant} for instant in values_of_instant(nonlinear) for share in shares)

    def add_forces(self, frame: Frame) -> None:
        """Subtract the camber thrust of both axles from the lateral force, and its yaw moment.

        With a share p of all of a_y, m a_y = F - c * F_z / g * ((1 - p) * u r + p * a_y) is solved for a_y.
        """
        load = frame.load
        if not frame.axles:
            load = np.stack([load[0] + load[1], load[2] + load[3]])
        if self.by_stiffness > 0.0:
            share = frame.cornering_front / (frame.cornering_front + frame.cornering_rear)
            both = load[0] + load[1]
            load = stack_contacts(share * both, (1.0 - share) * both)
        load = np.stack([load[0], self.rear * load[1]])
        steady = (1.0 - self.instant) * frame.load_accel_lat
        by_accel = self.coefficient / GRAVITY_MPS2 * (load[0] + load[1])
        instant = (frame.force_y - by_accel * steady) / (frame.mass + by_accel * self.instant)
        pull = -self.coefficient / GRAVITY_MPS2 * frame.lagged_by_roll(steady + self.instant * instant)
        front, rear = load[0] * pull, load[1] * pull
        frame.force_y = frame.force_y + front + rear
        frame.moment = frame.moment + frame.front * front - frame.rear * rear
