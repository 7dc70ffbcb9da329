"""Driving and braking shift load between the axles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Parameter, Prior
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.car.physics.priors import tail_nats
from tpmsd.foundation.wheels import IS_FRONT, FloatArray

TYPICAL = Prior(6e-5, 5e-5, "156 N per wheel and m/s2, 0.25 mm per 500 N")


@dataclass(frozen=True)
class LoadTransferLongitudinal(Effect):
    """More load, smaller effective radius: delta_r = -c * a_x at the rear, +c * a_x at the front.

    a_x is the specific force (kinematic acceleration plus g*sin(grade)), because gravity's pull along the
    slope tips the car about its contact points just as inertia does: each rear wheel gains m*h*a_x /
    (2*wheelbase). Source: moment balance about the front contact patch, e.g. [Gillespie 1992], ch. 1. 156 N
    per m/s2 on a 1500 kg car, and 0.25 mm per 500 N, give c of about 8e-5 s2.
    """

    name = "load_transfer_longitudinal"
    wording = Wording(
        formula="delta_r = +c * a_x front, -c * a_x rear",
        sentence="driving and braking shift load between the axles and change the radii",
        noun="load shifted by driving and braking",
        answers=("driving and braking shift load between the axles and change the radii, by {coefficient}",),
        distinguished_by="brake and accelerate firmly on a straight, ten times",
    )
    identification = Identification(shows_in=("wheel_ratio", "accel_long"), contrast=True)
    confounding = Confounding(common=True)
    one_sign = True
    parameters = (
        Parameter(
            "coefficient",
            "s2",
            6e-5,
            -2e-3,
            2e-3,
            "c, metres of radius per m/s2",
            probe=1e-6,
            prior=TYPICAL,
            fitted=(-5e-4, 2e-3),  # of the other sign no more than a simulation has alone: beyond, it is slip
        ),
    )
    coefficient: float

    @classmethod
    def penalty(cls, value: float) -> float:
        """Return nats against a value far from that of usual cars, by Student's distribution."""
        return super().penalty(value) + tail_nats(max(value - TYPICAL.mean, 0.0), TYPICAL)

    @classmethod
    def goes_before(cls, value: float) -> bool:
        """Return whether 95 of 100 cars have this much or less."""
        return value < TYPICAL.mean + 2.0 * TYPICAL.std

    def radius_change_m(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) +c*a_x on the front pair, -c*a_x on the rear pair."""
        sign = np.where(IS_FRONT, 1.0, -1.0)
        return self.coefficient * motion.specific_force_long_mps2[:, None] * sign
