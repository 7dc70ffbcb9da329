"""Side slip and wheel slips of a car as it drives, from what its bus carries.

In: one tick's accelerations, yaw rate, steering and wheel speed. Out: `SlipEstimate`. The state comes from
the adaptive robust unscented Kalman filter (ARUPF's proposal without its particles; the reason is in
`docs/explanation/vehicle-state.md`), the wheels' slip from the forces that carry the measured acceleration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpmsd.car.vehicle_state.adaptive import RobustSettings
from tpmsd.car.vehicle_state.car import CarDynamics
from tpmsd.car.vehicle_state.kalman import FilterNoise, GaussianState, Ukf
from tpmsd.car.vehicle_state.model import MIN_SPEED_MPS, R, StepInputs, U, V
from tpmsd.car.vehicle_state.slips import wheel_slips
from tpmsd.foundation.wheels import FloatArray

NOISE = FilterNoise(process=(0.5, 0.3, 0.3), readings=(0.6, 0.02, 0.3))
"""For a car known by its geometry alone and ticks of a tenth of a second."""
START_STD = (0.2, 0.3, 0.05)
DEAF_S = 2.0
"""A reading refused for so long is right and the state wrong: start again."""
HARDLY = 0.01
"""Equivalent weight below which a reading counts as refused."""
TRUST_TAU_S = 20.0
TRUST = 0.5
"""Mean weight of the yaw rate below which signals and model contradict each other: another sign, unit or
steering ratio."""


@dataclass(frozen=True, slots=True)
class SlipEstimate:
    """What slips, at the end of a tick."""

    side_slip_rad: float
    """Course of the rear axle's middle minus the heading."""
    wheel_slip: FloatArray
    """(4,) longitudinal slip of fl, fr, rl, rr: omega r / v - 1, positive when driving."""
    side_slip_std_rad: float
    speed_mps: float
    yaw_rate_radps: float


class SlipObserver:
    """Keeps the state from tick to tick; `step` gives None where it cannot tell."""

    def __init__(self, car: CarDynamics) -> None:
        self._car = car
        self._trust = 1.0
        self.reset()

    def reset(self) -> None:
        """Forget the motion so far (after a gap)."""
        self._filter: Ukf | None = None
        self._rejected_s = np.zeros(3)

    @property
    def trusted(self) -> bool:
        """Whether yaw rate, steering and model have agreed of late."""
        return self._trust >= TRUST

    def step(
        self,
        dt_s: float,
        accel_long_mps2: float,
        accel_lat_mps2: float,
        yaw_rate_radps: float,
        steer_rad: float,
        speed_mps: float,
    ) -> SlipEstimate | None:
        """Take one tick; `speed_mps` is the wheels'.

        Lateral acceleration may be NaN. Without longitudinal acceleration, yaw rate, steering and speed, or
        below `MIN_SPEED_MPS`, nothing is returned, and the next tick that has them begins again.
        """
        needed = (accel_long_mps2, yaw_rate_radps, steer_rad, speed_mps)
        if not all(map(math.isfinite, needed)) or speed_mps < MIN_SPEED_MPS:
            self.reset()
            return None
        if self._filter is None:
            mean = np.array([self._car.rear_m * yaw_rate_radps, speed_mps, yaw_rate_radps])
            start = GaussianState(mean, np.diag(np.square(START_STD)))
            self._filter = Ukf(self._car, NOISE, start, RobustSettings())
        reading = np.array([accel_lat_mps2, yaw_rate_radps, speed_mps])
        belief = self._filter.step(StepInputs(dt_s, accel_long_mps2, steer_rad), reading)
        weights = self._filter.weights
        share = math.exp(-dt_s / TRUST_TAU_S)
        self._trust = share * self._trust + (1.0 - share) * float(weights[1])
        self._rejected_s = np.where(weights < HARDLY, self._rejected_s + dt_s, 0.0)
        if self._rejected_s.max() > DEAF_S or not np.all(np.isfinite(belief.mean)):
            self.reset()
            return None
        return self._estimate(belief, accel_long_mps2, steer_rad)

    def _estimate(self, belief: GaussianState, accel_long_mps2: float, steer_rad: float) -> SlipEstimate:
        v, u, r = belief.mean[V], max(float(belief.mean[U]), MIN_SPEED_MPS), belief.mean[R]
        side_slip = math.atan2(v - self._car.rear_m * r, u)
        by_state = np.array([1.0, -side_slip, -self._car.rear_m]) / u
        slips = wheel_slips(
            self._car,
            np.array(accel_long_mps2),
            np.array(u * r),
            np.array(side_slip),
            np.array(steer_rad - math.atan2(v + self._car.front_m * r, u)),
            np.array(steer_rad),
        )
        return SlipEstimate(
            side_slip_rad=side_slip,
            wheel_slip=slips,
            side_slip_std_rad=float(np.sqrt(by_state @ belief.covariance @ by_state)),
            speed_mps=u,
            yaw_rate_radps=float(r),
        )
