"""MPF-MN: a marginalized particle filter with the radius errors in the measurements, paper 000, (30)-(35).

In: `Tick`s. Out: `RadiusEstimate`s. Vectorised over particles, seeded.

State of each particle: east, north, heading, yaw rate, speed, and Normal-inverse-Wishart statistics of the
radius errors delta = (rl, rr). Yaw rate and speed walk at random (31); the wheels' virtual yaw rate and speed
(4) are measurements of them, off by D delta (32). D is square and regular while the wheels turn, so its
pseudo-inverse (35) is its inverse, and the realised errors are plainly

    delta_i = path_i / a_i - r_i,   path = T (v -+ yaw_rate track / 2)

The weights take the Student-t predictive of delta (34), the statistics delta itself (19). Order and
signs are those of (32a) and (6); the printed (32c) is of two minds about both.

Realised errors are of no use where the wheels barely turn. In ticks that do not teach, the paths are weighed
instead, with a counter's quantum as their least error.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tpmsd.config.model import FilterConfig, GnssConfig, VehicleConfig
from tpmsd.estimators.gnss_likelihood import PositionLog, student_t_log
from tpmsd.estimators.mpf_pn import RadiusParticles, keep_noise, prior_statistics
from tpmsd.estimators.pose_start import PoseStart
from tpmsd.timeline.tick import Tick
from tpmsd.wheels import FloatArray

YAW_ACCEL_STD_RADPS2 = 0.25
"""Random walk of the yaw rate over one tick, per second; (31c)."""
ACCEL_STD_MPS2 = 2.0
"""The same of the speed."""
QUANTUM_M = 0.02
"""Least error of a wheel's path in one tick: half of a cog."""
START_STD = (0.05, 0.5)
"""Spread of yaw rate (rad/s) and speed (m/s) about the wheels' when they are taken up anew."""


class MpfMn(RadiusParticles):
    """The estimator; `step` takes one tick and gives one estimate."""

    def __init__(
        self,
        vehicle: VehicleConfig,
        gnss: GnssConfig,
        settings: FilterConfig,
        rng: np.random.Generator,
        front: bool,
        yaw_accel_std_radps2: float = YAW_ACCEL_STD_RADPS2,
        accel_std_mps2: float = ACCEL_STD_MPS2,
        position_log: PositionLog = student_t_log,
    ) -> None:
        """`front`: whether the bus has the front wheels; the others are the random walks' sizes."""
        super().__init__(vehicle, gnss, settings, rng, front, position_log)
        self._walk = np.array([[yaw_accel_std_radps2], [accel_std_mps2]])
        self._stats = prior_statistics(self._count, self._nominal[:2], rng)
        self._motion = np.zeros((2, self._count))
        """Yaw rate and speed."""
        self._rolling = False
        """Whether yaw rate and speed go on from the tick before."""

    def _advance(self, tick: Tick, rear_rad: FloatArray, teaches: bool) -> tuple[float, float]:
        dt, track = tick.dt_s, self._geometry.track_rear_m
        kick = self._rng.standard_normal(self._motion.shape)
        if self._rolling:
            self._motion += kick * (self._walk * dt)
        else:
            rolled, turned = self._virtual_motion(rear_rad)
            self._motion = np.array([[turned / dt], [rolled / dt]]) + kick * np.array(START_STD)[:, None]
            self._rolling = True
        yaw_rate, speed = self._motion
        way, turn = speed * dt, yaw_rate * dt
        paths = np.stack([way - turn * (track / 2), way + turn * (track / 2)], axis=1)
        if teaches and rear_rad.min() > 0.0:
            self._stats.forget(self._forgetting)
            realised = paths / rear_rad - self._nominal[:2]
            self._multiply(self._stats.log_predictive(realised))
            self._stats.learn(realised)
            keep_noise(self._stats)
        else:
            self._weigh_paths(paths, rear_rad)
            if (curvature := self._steered_curvature(tick)) is not None:
                turn = way * curvature
                self._motion[0] = turn / dt
        return self._go(way, turn)

    def _weigh_paths(self, paths: FloatArray, rear_rad: FloatArray) -> None:
        """Weigh particles by the wheels' paths (N, 2) in a tick that may not teach."""
        off = paths - rear_rad * (self._nominal[:2] + self._stats.mean)
        scale = np.diagonal(self._stats.predictive_scale(), axis1=1, axis2=2)
        squared = (off**2 / (scale * rear_rad**2 + QUANTUM_M**2)).sum(axis=1)
        dof = self._stats.predictive_dof
        self._multiply(-0.5 * (dof + 2.0) * np.log1p(squared / dof))

    def _stand(self) -> None:
        super()._stand()
        self._rolling = False

    def _drift_on(self, dt_s: float) -> None:
        super()._drift_on(dt_s)
        self._rolling = False

    def _place(self, start: PoseStart, tick: Tick) -> None:
        super()._place(start, tick)
        self._rolling = False

    def _select(self, index: NDArray[np.intp]) -> None:
        super()._select(index)
        self._motion = self._motion[:, index]
