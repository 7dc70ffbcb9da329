"""The body takes time to lean."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import NUISANCE, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior

FOLLOWS, FOLLOWS_RATE = "lean", "lean_rate"


@dataclass(frozen=True)
class RollLag(DynamicsEffect):
    """p + delay_s * dp/dt + square_s2 * d2p/dt2 = a_y: what follows the body's lean follows p, not a_y.

    With a roll of frequency f and damping D, delay_s = 2 D / w and square_s2 = 1 / w^2, w = 2 pi f. It
    changes what `roll_steer` and `camber_thrust` do, and nothing alone. Source: roll frequencies of 1 to
    2.5 Hz, damping 0.2 to 0.5 ([Gillespie 1992], ch. 6).
    """

    name = "roll_lag"
    kind = NUISANCE
    wording = Wording(
        formula="the body leans by p: p + delay_s * dp/dt + square_s2 * d2p/dt2 = a_y",
        sentence="the body takes time to lean",
        distinguished_by="weave at 0.5 to 2 Hz at a constant speed",
    )
    order = -1  # before what follows the lean
    channel = "accel_lat"
    covariate = "steering_rate"
    states = (FOLLOWS, FOLLOWS_RATE)
    state_sizes = (10.0, 100.0)  # m/s2 and, at 1.6 Hz, m/s3
    composes = False
    confounded_with = ("roll_dynamics", "steering_delay")
    parameters = (
        Parameter(
            "delay_s",
            "s",
            0.07,
            0.0,
            0.3,
            "time by which slow leaning lags",
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
        """State by how much the lean lags; without its states to first order, along a recording."""
        if FOLLOWS in frame.extra:
            frame.lean = frame.extra[FOLLOWS]
        else:
            frame.lean_delay, frame.lean_square = self.delay_s, self.square_s2

    def add_rates(self, frame: Frame) -> None:
        """Lean."""
        if FOLLOWS not in frame.extra:
            return
        lean, rate = frame.extra[FOLLOWS], frame.extra[FOLLOWS_RATE]
        accel = np.asarray(frame.force_y / frame.mass)
        frame.rates[FOLLOWS] = rate
        frame.rates[FOLLOWS_RATE] = (accel - lean - self.delay_s * rate) / self.square_s2
