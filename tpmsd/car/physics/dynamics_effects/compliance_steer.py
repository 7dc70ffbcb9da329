"""The front wheels give way under side force."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class DynamicsComplianceSteer(DynamicsEffect):
    """The front wheels turn out of the bend by k * F_f, k = c l / (m b): by c * a_y in steady bends.

    F_f is the force of tyres without a limit: the axle has C / (1 + k C) instead of C. It gives way: c is
    positive. With by_accel = 1 they turn by c * a_y, as compliance measured in steady bends is stated and
    often simulated; front wheels that steer as the body rolls do the same. Source: 1 to 3 degrees per g with
    rack and bushings, a third of it by compliance ([Gillespie 1992], ch. 6).
    """

    name = "compliance_steer"
    kind = PHYSICS
    wording = Wording(
        formula="front wheels turned by -k * F_f, k = c * l / (m * b)",
        sentence="the front wheels give way under side force",
        distinguished_by="hold steady bends at two speeds and change lanes quickly",
    )
    order = 1  # after what else makes the slip angles: the wheels give way to all of the force
    channel = "yaw_rate"
    covariate = "accel_lat"
    confounded_with = ("cornering_stiffness_error",)
    positive = True
    parameters = (
        Parameter(
            "coefficient",
            "rad.s2/m",
            0.0015,
            -0.01,
            0.03,
            "c, angle of the front wheels per lateral acceleration",
            probe=1e-05,
            prior=Prior(0.0, 0.001, "a third of 1 to 3 degrees per g: Gillespie, ch. 6"),
        ),
        Parameter(
            "by_accel",
            "1",
            1.0,
            0.0,
            1.0,
            "1: the wheels turn by the lateral acceleration, 0: by the force of their axle",
        ),
    )
    coefficient: float = 0.0
    by_accel: float = 0.0

    @classmethod
    def variants(cls, nonlinear: bool) -> tuple[Mapping[str, float], ...]:
        """Return the values of the switches to try: compliance to the force alone where tyres feel loads."""
        return ({"by_accel": 0.0},) if nonlinear else ({"by_accel": 0.0}, {"by_accel": 1.0})

    def follows_instant(self) -> bool:
        """Return True if the wheels turn by the acceleration that the tyres give."""
        return self.by_accel > 0.0

    def adapt_angles(self, frame: Frame) -> None:
        """Turn the front wheels by -k F / (1 + k C), F the force of wheels that do not give way."""
        if self.by_accel > 0.0:
            frame.turn(-self.coefficient * frame.tyre_accel_lat, 0.0)
            return
        base = frame.front + frame.rear
        soft = self.coefficient * base / (frame.mass * frame.rear) * frame.cornering_front
        angle = frame.angle[: len(frame.angle) // 2].mean(axis=0)
        frame.turn(-angle * soft / (1.0 + soft), 0.0)
