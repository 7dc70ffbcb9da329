"""The frame of paper 000's filters: odometry by the rear wheels, positions as measurements, nothing else.

In: `Tick`s. Out: `RadiusEstimate`s. Per tick, with a_i the angle wheel i has turned (eq. 37, so T*omega) and
w the radius errors that the method supposes:

    way     = (a_rl (r_rl + w_rl) + a_rr (r_rr + w_rr)) / 2          (6a)
    turn    = (a_rr (r_rr + w_rr) - a_rl (r_rl + w_rl)) / track      (6b)
    east   += way cos(heading + turn/2), north likewise              (7), heading at mid-step
    heading += turn                                                  (7)

The methods (`mpf_pn`, `aug_pf`, `aug_kf`, `mpf_mn`) differ in what w is, and share what real cars need on
top, so that they can be compared: fixes are placed inside their tick, as they come; ticks that may not teach
leave the radii alone (`motion_gate`); fixes far off are refused and the pose is found again when lost
(`pose_keeper`); front wheels are learned beside the filter (`front_contrast`).
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any

import numpy as np

from tpmsd.config.model import FilterConfig, GnssConfig, VehicleConfig
from tpmsd.estimators.base import RadiusEstimate, checked_radii
from tpmsd.estimators.front_contrast import FrontContrast
from tpmsd.estimators.pose_keeper import COAST_LIMIT_S, Pose, PoseKeeper
from tpmsd.timeline.tick import Fix, Tick
from tpmsd.wheels import FloatArray

PRIOR_RADIUS_STD = 0.01
"""Prior spread of a radius about its nominal value, relative: tread wear, pressure and a guessed nominal."""
NOISE_STD_M = 0.003
"""Prior standard deviation of one tick's radius error (about one cog of 48 at 20 m/s and 10 Hz)."""
NOISE_FLOOR_M = 0.0005
"""Floor of the same, so that a bus with fine speeds does not freeze the filter."""


class PositionFilter(PoseKeeper):
    """Base of the filters that use positions alone; `step` takes one tick and gives one estimate."""

    def __init__(self, vehicle: VehicleConfig, gnss: GnssConfig, settings: FilterConfig, front: bool) -> None:
        """`front`: whether the bus has the front wheels."""
        super().__init__(vehicle, gnss, settings, front)
        self._forgetting = 1.0 - 1.0 / max(settings.window_s * settings.rate_hz, 2.0)
        self._front = FrontContrast(self._nominal, self._geometry, self._forgetting) if front else None
        self._rear_mean = np.zeros(2)

    # -- what the methods fill in ---------------------------------------------------------------------------

    @abstractmethod
    def _advance(self, tick: Tick, rear_rad: FloatArray, teaches: bool) -> tuple[float, float]:
        """Move the pose by the rotation (2,) of the rear wheels, learn from it if it teaches; mean way and
        turn."""

    @abstractmethod
    def _distance(self, fix: Fix) -> tuple[float, float]:
        """How far a fix is from where it is expected, and the variance of that."""

    @abstractmethod
    def _weigh(self, fix: Fix) -> None:
        """Take a fix that is believed as a measurement."""

    @abstractmethod
    def _rear_moments(self) -> tuple[FloatArray, FloatArray]:
        """Mean (2,) and covariance (2, 2) of the mean radius errors of rl and rr."""

    @abstractmethod
    def _rear_noise(self) -> FloatArray:
        """(2,) variances of one tick's radius error of rl and rr."""

    @abstractmethod
    def _take_radii(self, mean_m: FloatArray, covariance_m2: FloatArray, noise_m2: FloatArray) -> None:
        """Set the rear radius errors: mean (2,), covariance (2, 2), noise (2,)."""

    @abstractmethod
    def _mean_pose(self) -> Pose:
        """Where the car is believed to be."""

    def _stand(self) -> None:
        """A tick in which the wheels did not turn."""

    def _after_fixes(self) -> None:
        """What follows the fixes of a tick."""

    def _effective(self) -> float:
        """Effective number of particles; 1 where there are none."""
        return 1.0

    # -- one tick -------------------------------------------------------------------------------------------

    def step(self, tick: Tick) -> RadiusEstimate:
        """Advance by one tick; never raises on odd input."""
        if tick.gap_s > COAST_LIMIT_S:
            self._lose_pose()
        informative = self._move(tick)
        for fix in tick.fixes:
            self._take_fix(fix, tick)
        self._after_fixes()
        return self._radius_estimate(
            tick, informative, self._radii(), self._noise_std(), self._mean_pose(), self._effective()
        )

    def _move(self, tick: Tick) -> bool:
        """Take the wheels' rotation; whether it taught the radii."""
        angle = tick.rotation_rad[self._order]
        rear = angle[:2]
        if not (math.isfinite(rear[0]) and math.isfinite(rear[1])):
            self._coast(tick.dt_s)
            return False
        self._coasting_s = 0.0
        way, turn = self._virtual_motion(rear)
        teaches = self._gate.update(tick, way / tick.dt_s, turn / tick.dt_s)
        if way == 0.0:
            self._take_stand()
            self._stand()
            return False
        way, turn = self._advance(tick, rear, teaches)
        self._take_motion(way, turn, tick.dt_s)
        if teaches:
            self._informative_s += tick.dt_s
            if self._front is not None:
                self._front.learn(angle, self._rear_mean, tick.dt_s)
        return teaches

    def _take_fix(self, fix: Fix, tick: Tick) -> None:
        moving = self._rate[0] > 0.5
        # At a standstill the radii are not in play, and correlated fixes would only sharpen a wrong position.
        if self._found(fix, tick, moving) and moving and not self._refused(fix, tick, *self._distance(fix)):
            self._weigh(fix)

    # -- out, and what survives a restart -------------------------------------------------------------------

    def _radii(self) -> tuple[FloatArray, FloatArray]:
        mean, covariance = self._rear_moments()
        self._rear_mean = mean
        return (mean, covariance) if self._front is None else self._front.moments(mean, covariance)

    def _noise_std(self) -> FloatArray:
        rear = np.sqrt(self._rear_noise())
        return rear if self._front is None else np.concatenate([rear, self._front.noise_std()])

    def snapshot(self) -> dict[str, Any]:
        """Mean and covariance of the radii, and the rear pair's noise, as plain numbers."""
        mean, covariance = self._radii()
        return {
            "order": list(self._order),
            "nominal_m": self._nominal.tolist(),
            "mean_m": mean.tolist(),
            "covariance_m2": covariance.tolist(),
            "noise_m2": self._rear_noise().tolist(),
            "informative_s": self._informative_s,
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Take up a snapshot of the same car; ValueError if it does not fit."""
        mean, covariance = checked_radii(saved, self._order, self._nominal)
        noise = np.asarray(saved["noise_m2"], dtype=np.float64)
        informative_s = float(saved["informative_s"])
        if noise.shape != (2,) or not np.all(np.isfinite(noise)) or np.any(noise <= 0.0):
            raise ValueError("the saved noise is not two positive variances")
        self._take_radii(mean[:2], covariance[:2, :2], noise)
        if self._front is not None:
            self._front.restore(mean, covariance)
        self._informative_s = informative_s
