"""Wheels steer as the body rolls."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.dynamics_parameters import DIRECTED, INSTANT, directions, values_of_instant
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class RollSteer(DynamicsEffect):
    """The rear wheels turn by c * a_y into the bend, the front ones by c_f * a_y out of it.

    a_y = u r + instant * (F_y / m - u r): the body rolls by the steady acceleration or by all of it. Source:
    roll steer of 0.02 to 0.15 rad/rad times a roll of 3 to 7 degrees per g: 1e-4 to 2e-3 rad per m/s2
    ([Gillespie 1992], ch. 6).
    """

    name = "roll_steer"
    kind = PHYSICS
    wording = Wording(
        formula="slip angle = geometric + c * a_y at the rear, - c_f * a_y at the front",
        sentence="the axles steer as the body rolls",
        distinguished_by="hold steady bends from 1 to 6 m/s2 at two speeds",
    )
    channel = "velocity_lat"
    covariate = "accel_lat"
    confounded_with = ("cornering_stiffness_error", "compliance_steer", "camber_thrust", "yaw_moment")
    separable = True
    parameters = (
        Parameter(
            "coefficient",
            "rad.s2/m",
            0.0015,
            -0.02,
            0.02,
            "c, angle of the rear wheels into the bend per lateral acceleration",
            probe=1e-05,
            prior=Prior(0.0, 0.001, "1e-4 to 2e-3: Gillespie, ch. 6"),
        ),
        Parameter(
            "front",
            "rad.s2/m",
            0.0015,
            -0.02,
            0.02,
            "c_f, angle of the front wheels out of the bend per lateral acceleration",
            probe=1e-05,
            prior=Prior(0.0, 0.001, "1e-4 to 2e-3: Gillespie, ch. 6"),
        ),
        INSTANT,
        DIRECTED,
    )
    coefficient: float = 0.0
    front: float = 0.0
    instant: float = 0.0
    directed: float = 1.0

    @classmethod
    def variants(cls, nonlinear: bool) -> tuple[Mapping[str, float], ...]:
        """Return each acceleration that the body may roll by with each direction of the rear forces."""
        return tuple(
            {**instant, **to} for instant in values_of_instant(nonlinear) for to in directions(nonlinear)
        )

    def follows_instant(self) -> bool:
        """Return True if the body rolls by more than the steady acceleration."""
        return self.instant > 0.0

    def adapt_angles(self, frame: Frame) -> None:
        """Turn the wheels of both axles in proportion to the lateral acceleration that roll follows."""
        accel = frame.load_accel_lat
        if self.instant > 0.0:
            accel = accel + self.instant * (frame.tyre_accel_lat - accel)
        accel = frame.lagged_by_roll(accel)
        frame.turn(-self.front * accel, self.coefficient * accel, self.directed)
