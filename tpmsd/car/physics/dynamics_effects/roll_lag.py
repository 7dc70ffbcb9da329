"""The body's roll lags the lateral acceleration."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import NUISANCE, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior

ROLL_ACCEL, ROLL_ACCEL_RATE = "roll_accel", "roll_accel_rate"
"""States: p, the lateral acceleration at which a steady bend has the present roll angle, and dp/dt."""


@dataclass(frozen=True)
class RollLag(DynamicsEffect):
    """p + delay_s * dp/dt + square_s2 * d2p/dt2 = a_y: effects of the body's roll take p for a_y.

    With a roll of frequency f and damping D, delay_s = 2 D / w and square_s2 = 1 / w^2, w = 2 pi f. It
    changes what `roll_steer` and `camber_thrust` do, and nothing alone. Source: roll frequencies of 1 to
    2.5 Hz, damping 0.2 to 0.5 ([Gillespie 1992], ch. 6).
    """

    name = "roll_lag"
    kind = NUISANCE
    wording = Wording(
        formula="the body rolls by p: p + delay_s * dp/dt + square_s2 * d2p/dt2 = a_y",
        sentence="the body's roll lags the lateral acceleration",
        distinguished_by="weave at 0.5 to 2 Hz at a constant speed",
    )
    order = -1  # before the effects that roll drives
    channel = "accel_lat"
    covariate = "steering_rate"
    states = (ROLL_ACCEL, ROLL_ACCEL_RATE)
    state_sizes = (10.0, 100.0)  # m/s2 and, at 1.6 Hz, m/s3
    composes = False
    acts_with = ("roll_steer", "camber_thrust")
    confounded_with = ("roll_dynamics", "steering_delay")
    parameters = (
        Parameter(
            "delay_s",
            "s",
            0.07,
            0.0,
            0.3,
            "time by which slow roll lags",
            probe=1e-3,
            prior=Prior(0.07, 0.03, "2 D / w: 20 to 130 ms, Gillespie, ch. 6"),
            fitted=(0.005, 0.25),
        ),
        Parameter(
            "square_s2",
            "s2",
            0.01,
            0.0,
            0.05,
            "one over the angular frequency, squared",
            probe=1e-4,
            prior=Prior(0.01, 0.005, "1 / w^2: 0.004 to 0.025, Gillespie, ch. 6"),
            fitted=(0.0003, 0.04),
        ),
    )
    delay_s: float = 0.0
    square_s2: float = 0.0

    def fastest_rate_per_s(self, speed_mps: float) -> float:
        """Return the faster of angular frequency and decay."""
        square = max(float(np.min(self.square_s2)), 1e-4)
        return max(1.0 / math.sqrt(square), float(np.max(self.delay_s)) / square)

    def adapt_angles(self, frame: Frame) -> None:
        """Give the frame the state p for the effects that roll drives; where the states are not there, as
        along a recorded path, the coefficients of p = a_y - delay_s * da_y/dt - square_s2 * d2a_y/dt2."""
        if ROLL_ACCEL in frame.extra:
            frame.roll_accel = frame.extra[ROLL_ACCEL]
        else:
            frame.roll_delay, frame.roll_square = self.delay_s, self.square_s2

    def add_rates(self, frame: Frame) -> None:
        """Add dp/dt and d2p/dt2 = (a_y - p - delay_s * dp/dt) / square_s2, where these are states."""
        if ROLL_ACCEL not in frame.extra:
            return
        reached, rate = frame.extra[ROLL_ACCEL], frame.extra[ROLL_ACCEL_RATE]
        accel = np.asarray(frame.force_y / frame.mass)
        frame.rates[ROLL_ACCEL] = rate
        frame.rates[ROLL_ACCEL_RATE] = (accel - reached - self.delay_s * rate) / self.square_s2
