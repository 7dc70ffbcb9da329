"""Driven wheels slip under the torque that the bus states."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.covariates import covariate
from tpmsd.car.physics.effect import Effect, Grid, Parameter, Prior
from tpmsd.car.physics.effect_records import Confounding, Identification, Nonlinear, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import WHEELS, FloatArray


@dataclass(frozen=True)
class TorqueSlip(Effect):
    """omega * r = v * (1 + c * T(t - lag_s)) on driven wheels, T the drive torque of the bus.

    Under the brakes it knows nothing of what they do, and against the wind it holds what the drag takes: by
    these it is distinguished from slip by the acceleration. The value holds the unknown gain of the bus's
    torque, and the lag what the control unit computes ahead of the wheels. Source: linear slip stiffness, F_x
    = C * s (Gustafsson, Automatica 33(6), 1997): 4e-3 s2/m of a car of 1500 kg on wheels of 0.31 m are 8.6e-6
    /Nm.
    """

    name = "torque_slip"
    wording = Wording(
        formula="omega * r = v * (1 + c * T(t - lag_s)) on driven wheels, T the drive torque",
        sentence="driven wheels slip under the drive torque",
        noun="slip under drive torque",
        answers=("driven wheels slip under the drive torque, by {slip_per_nm}",),
        distinguished_by=(
            "accelerate firmly, coast and brake at the same speeds on a straight, ten times each"
        ),
    )
    identification = Identification(shows_in=("wheel_ratio", "torque"), needs=("torque",))
    confounding = Confounding(
        common=True, limit="longitudinal_slip", widened_by=("load_transfer_longitudinal",)
    )
    nonlinear = Nonlinear(
        # A filling manifold and a drive shaft take a tenth of a second or two.
        grid=Grid(
            "lag_s",
            values=(0.03, 0.15),
            middle=0.03,
            range=(0.005, 1.0),
            penalty=lambda lag: 0.7 + 0.5 * (math.log(lag / 0.1) / 1.0) ** 2,
            step=2.0,
        )
    )
    one_sign = True
    parameters = (
        Parameter(
            "slip_per_nm",
            "1/Nm",
            8e-6,
            -1e-3,
            1e-3,
            "c, slip per torque of all driven wheels",
            probe=1e-8,
            prior=Prior(8e-6, 8e-6, "1e-3 to 8e-3 s2/m on 1500 kg and 0.31 m: Gustafsson 1997"),
            fitted=(0.0, 2e-4),
        ),
        Parameter(
            "lag_s",
            "s",
            0.1,
            -2.0,
            5.0,
            "age of the force behind the torque that the bus states",
            prior=Prior(0.1, 0.1, "manifold and drive shaft: 0.1 to 0.3 s"),
        ),
    )
    slip_per_nm: float
    lag_s: float = 0.0

    @classmethod
    def acting_wheels(cls, car: Car, fitted: tuple[str, ...]) -> tuple[str, ...]:
        """Return the driven wheels."""
        return tuple(wheel for wheel, drives in zip(WHEELS, car.driven, strict=True) if drives)

    def wheel_slip(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) c * T(t - lag_s) on the driven wheels; 0 where no torque is known."""
        torque = np.nan_to_num(covariate(motion, car, "torque"))
        late = np.interp(motion.time_s - self.lag_s, motion.time_s, torque)
        return np.asarray(self.slip_per_nm * late[:, None] * car.driven)
