"""In a bend the rear axle drifts outwards."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.effect import Effect, Parameter, Prior
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.motion import Motion
from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True)
class LateralSlip(Effect):
    """Cornering force needs a slip angle: the rear axle's course leaves its heading by beta = -c * a_y.

    In a left turn (a_y > 0) the axle moves to the right of where the body points.
    Source: linear cornering stiffness at the rear axle, beta = -m_r * a_y / C_r (the KF-WLS paper calls it
    side-slip; Gillespie, ch. 6). 650 kg on 1e5 N/rad give c of about 6e-3 rad per m/s2.
    """

    name = "lateral_slip"
    wording = Wording(
        formula="beta = -c * a_y at the rear axle",
        sentence="the rear axle drifts outwards in bends",
        noun="drift of the rear axle in bends",
        answers=("in bends the rear axle drifts {coefficient:outwards|inwards}, by {coefficient:size}",),
        distinguished_by="drive the same bend slowly and fast: slip grows with speed, a lever arm does not",
    )
    identification = Identification(shows_in=("gnss_course", "accel_lat"), needs=("gnss",))
    confounding = Confounding(common=True)
    in_calibration = (("slip_lateral", "coefficient", "rad.s2/m"),)
    one_sign = True
    parameters = (
        Parameter(
            "coefficient",
            "rad.s2/m",
            5e-3,
            -0.1,
            0.1,
            "c, radians per m/s2",
            probe=1e-5,
            prior=Prior(5e-3, 3e-3, "650 kg on 1e5 N/rad; Gillespie, ch. 6"),
        ),
    )
    coefficient: float

    def axle_course_rad(self, motion: Motion) -> FloatArray:
        """(n,) -c * a_y."""
        return -self.coefficient * motion.accel_lat_mps2
