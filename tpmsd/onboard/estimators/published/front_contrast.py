"""Front wheels for the filters of [Lundquist 2013], which know the rear pair alone.

In: rotations, and the rear radii's moments. Out: the moments of all four. The rear wheels point along the
body; a steered front wheel rolls along the path of its own hub, which way and turn of the rear axle tell
without any steering signal (`physics.kinematics`). So its radius error is realised, w_f = path_f / a_f - r_f,
and what it has beyond the rear pair's share in that path does not depend on the trajectory: one set of
Normal-inverse-Wishart statistics learns it beside the filter. It never acts back on the rear pair or the
trajectory: the hub's path leaves out side-slip and steer geometry, and an error there must not bend what rear
pair and receiver agree on.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tpmsd.car.physics.kinematics import WheelPositions, wheel_speeds
from tpmsd.foundation.wheels import FL, FR, FloatArray
from tpmsd.onboard.estimators.base import NIGHT_S
from tpmsd.onboard.estimators.belief import (
    Belief,
    FilterCar,
    FixMeasurement,
    GatedTick,
    Moments,
    Movement,
    RolledTick,
    Saved,
    saved_radii,
)
from tpmsd.onboard.estimators.odometry_block import Block
from tpmsd.onboard.estimators.pose_start import PoseStart
from tpmsd.onboard.estimators.published.niw import NormalInverseWishart
from tpmsd.onboard.estimators.settings import SETTINGS


class FrontContrast:
    """Radius errors of fl and fr beyond what the rear pair's explain."""

    def __init__(self, nominal_m: FloatArray, geometry: WheelPositions, forgetting_factor: float) -> None:
        """`nominal_m` (4,) in the order rl, rr, fl, fr."""
        self._nominal, self._geometry, self._forgetting = nominal_m, geometry, forgetting_factor
        ratio = geometry.track_front_m / geometry.track_rear_m
        self.by_rear = np.array([[1 + ratio, 1 - ratio], [1 - ratio, 1 + ratio]]) / 2
        """(2, 2) derivative of the hub paths' radius errors (fl, fr) by those of rl, rr."""
        spread = (SETTINGS.front_prior * float(nominal_m.mean())) ** 2
        scale = np.eye(2)[None] * SETTINGS.noise_m**2 * 2.0
        self._stats = NormalInverseWishart(spread / SETTINGS.noise_m**2, np.zeros((1, 2)), 5.0, scale)
        self._turn = 0.0

    def learn(self, angle_rad: FloatArray, rear_m: FloatArray, dt_s: float) -> None:
        """Update the contrasts by an informative tick: rotations (4,) and the present rear radius errors
        (2,)."""
        roll = angle_rad[:2] * (self._nominal[:2] + rear_m)
        travel, turn = float(roll.sum()) / 2, float(roll[1] - roll[0]) / self._geometry.track_rear_m
        # The hub's lateral part enters squared, so quantisation in the turn would bias it: there it is
        # smoothed.
        self._turn += (1.0 - math.exp(-dt_s / SETTINGS.front_smoothing_s)) * (turn / dt_s - self._turn)
        lateral = (self._turn * dt_s - turn) * self._geometry.wheelbase_m
        paths = wheel_speeds(travel, turn, self._geometry, lateral)
        own = self._stats.mean[0].copy()  # a wheel without a reading in this tick is taken at its mean
        for index, wheel in enumerate((FL, FR)):
            angle = float(angle_rad[2 + index])
            if angle > 0.0:  # false for NaN
                realised = float(paths[wheel]) / angle - self._nominal[2 + index]
                own[index] = realised - self.by_rear[index] @ rear_m
        self._stats.forget(self._forgetting)
        self._stats.learn(own[None, :])

    def moments(self, rear_m: FloatArray, rear_m2: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean (4,) and covariance (4, 4) of all radius errors, from those of the rear pair."""
        own, own_m2 = self._stats.mean_moments(np.ones(1))
        spread = np.zeros((4, 4))
        spread[:2, :2] = rear_m2
        spread[2:, :2] = self.by_rear @ rear_m2
        spread[:2, 2:] = spread[2:, :2].T
        spread[2:, 2:] = spread[2:, :2] @ self.by_rear.T + own_m2
        return np.concatenate([rear_m, self.by_rear @ rear_m + own]), spread

    def noise_std(self) -> FloatArray:
        """Return the (2,) standard deviation of one tick's radius error of fl and fr."""
        return np.sqrt(np.diag(self._stats.noise_covariance(np.ones(1))))

    def restore(self, mean_m: FloatArray, covariance_m2: FloatArray) -> None:
        """Restore the moments (4,), (4, 4) of a snapshot."""
        rows = np.hstack([-self.by_rear, np.eye(2)])
        own_m2 = rows @ covariance_m2 @ rows.T
        self._stats.mean = (rows @ mean_m)[None, :]
        noise = np.diag(self._stats.noise_covariance(np.ones(1)))
        self._stats.gamma = float(np.max(np.diag(own_m2) / noise))


class FourWheelBelief:
    """A `Belief` of four wheels: that of the rear pair, and the front wheels learned beside it."""

    def __init__(self, rear: Belief, car: FilterCar, forgetting_factor: float) -> None:
        """`rear` is of the rear pair of the same car."""
        self.rear = rear
        self.takes_blocks = rear.takes_blocks
        self._car = car
        self._contrast = FrontContrast(car.nominal_m, car.geometry, forgetting_factor)
        self._rear_m = np.zeros(2)

    def predict(self, movement: Movement) -> tuple[float, float]:
        """Move the rear belief, and update the contrasts by informative ticks."""
        moved = self.rear.predict(movement)
        if isinstance(movement, RolledTick) and movement.gated.informative:
            self._contrast.learn(movement.angle_rad, self._rear_m, movement.gated.tick.dt_s)
        return moved

    def distance(self, measurement: FixMeasurement) -> tuple[float, float]:
        """Return the distance from the rear belief, which alone uses fixes."""
        return self.rear.distance(measurement)

    def update(self, measurement: FixMeasurement) -> None:
        """Update the rear belief alone."""
        self.rear.update(measurement)

    def correct_by_block(self, block: Block, bias_rad2: float) -> None:
        """Correct the rear belief alone."""
        self.rear.correct_by_block(block, bias_rad2)

    def finish_tick(self, gated: GatedTick) -> None:
        """Finish the tick of the rear belief alone."""
        self.rear.finish_tick(gated)

    def set_pose(self, start: PoseStart, measurement: FixMeasurement) -> None:
        """Set the pose of the rear belief, the only one."""
        self.rear.set_pose(start, measurement)

    def forget_pose(self) -> None:
        """Forget the pose of the rear belief, the only one."""
        self.rear.forget_pose()

    def moments(self) -> Moments:
        """Return the moments of all four wheels."""
        said = self.rear.moments()
        self._rear_m = said.mean_m
        mean, covariance = self._contrast.moments(said.mean_m, said.covariance_m2)
        noise = np.concatenate([said.noise_std_m, self._contrast.noise_std()])
        drawn = said.effective, said.ancestors, said.between_std_m
        return Moments(mean, covariance, noise, said.pose, *drawn)

    def snapshot(self) -> dict[str, Any]:
        """Return the rear belief's snapshot, with the moments of all four."""
        said = self.moments()
        radii = {"mean_m": said.mean_m.tolist(), "covariance_m2": said.covariance_m2.tolist()}
        return {**self.rear.snapshot(), **radii}

    def restore(self, saved: Saved, since_s: float = NIGHT_S) -> None:
        """Restore the moments of all four wheels."""
        mean, covariance = saved_radii(saved, self._car.nominal_m)
        self.rear.restore({**saved, "mean_m": mean[:2], "covariance_m2": covariance[:2, :2]}, since_s)
        self._contrast.restore(mean, covariance)
