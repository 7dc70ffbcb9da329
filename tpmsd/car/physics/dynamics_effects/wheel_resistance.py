"""Each wheel resists rolling by its own load."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import NUISANCE, DynamicsEffect
from tpmsd.car.physics.dynamics_parameters import formula_coefficient
from tpmsd.car.physics.effect_records import Wording


@dataclass(frozen=True)
class WheelResistance(DynamicsEffect):
    """M_z = -c * c_rr * sum of t / 2 * (F_z,right - F_z,left), c = 1: -c_rr * h * m * a_y in steady bends.

    With 0 the resistance of all wheels acts on the centre line. Source: rolling resistance is proportional to
    the load of a tyre (ISO 28580; [Gillespie 1992], ch. 4).
    """

    name = "wheel_resistance"
    kind = NUISANCE
    wording = Wording(
        formula="M_z = -c * c_rr * sum of t / 2 * (F_z,right - F_z,left)",
        sentence="wheels that carry more resist rolling more",
        distinguished_by="hold steady bends with little side slip",
    )
    channel = "yaw_rate"
    covariate = "accel_lat"
    confounded_with = ("yaw_moment", "cg_position_error")
    parameters = (
        formula_coefficient(
            "share of the loads in the wheels' resistance", "1 where it is proportional to loads"
        ),
    )
    coefficient: float = 0.0

    @classmethod
    def applies(cls, nonlinear: bool, forces: bool) -> bool:
        """Return True if the baseline has four wheels with loads."""
        return nonlinear

    def add_forces(self, frame: Frame) -> None:
        """Add the yaw moment of unequal rolling resistances; there is none where the contacts are axles."""
        if frame.axles:
            return
        left_front, right_front, left_rear, right_rear = frame.load
        front = frame.track_front * (right_front - left_front)
        rear = frame.track_rear * (right_rear - left_rear)
        share = self.coefficient * frame.rolling_resistance
        frame.moment = frame.moment - 0.5 * share * (front + rear)
