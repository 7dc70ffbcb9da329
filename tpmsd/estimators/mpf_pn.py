"""MPF-PN: tyre radii and trajectory with a marginalized particle filter, after paper 000.

Table I with eqs (1)-(24) and (36)-(38).

In: `Tick`s (rotation angles of the wheels, fixes). Out: `RadiusEstimate`s. Vectorised over particles, seeded.

State of each particle: pose (east, north, heading) of the middle of the rear axle, and Normal-inverse-Wishart
statistics of the radius errors w = (rl, rr[, fl, fr]). Per tick, with a_i the angle wheel i has turned (eq.
37, so T*omega):

    w_rear ~ Student-t predictive (21)                               Table I, line 10
    way     = (a_rl (r_rl + w_rl) + a_rr (r_rr + w_rr)) / 2          (6a)
    turn    = (a_rr (r_rr + w_rr) - a_rl (r_rl + w_rl)) / track      (6b)
    east   += way cos(heading + turn/2), north likewise              (7), heading at mid-step
    heading += turn                                                  (7)
    statistics take the realised w                                   (19), (20)
    weights are multiplied by p(fix | particle) when a fix comes     (22)

Front wheels. The paper stops at the rear pair, whose wheels point along the body. A steered front wheel rolls
along the path of its own hub, so given a particle's way and turn its path is known without any steering
signal (`physics.kinematics`), and its radius error is realised, not sampled: w_f = path_f / a_f - r_f. It
joins the statistics (d = 4), which makes the front radii as good as the trajectory, and differences between
axles as good as the odometry. It does not weigh the particles: the hub's path leaves out tyre side-slip and
steer geometry, and an error there must not bend the trajectory that the rear pair and the receiver agree on.

What was added for real cars: fixes are placed inside their tick, as they come; position errors have the
receiver's stated size and Student-t tails (`gnss_likelihood`) in place of one known Gaussian (10d); ticks
that may not teach are left out of the statistics (`motion_gate`); the pose is found again when lost; and a
small share of particles supposes a sudden change of a radius, without which a bootstrap proposal follows a
puncture too late (`change_rate_per_s=0` is the paper's filter). Only positions are used, as in the paper;
`mpf_rb` uses Doppler speed and course too.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tpmsd.config.model import FilterConfig, GnssConfig, VehicleConfig
from tpmsd.estimators.base import RadiusEstimate, checked_radii
from tpmsd.estimators.fix_gate import FixGate
from tpmsd.estimators.gnss_likelihood import position_variance, student_t_log
from tpmsd.estimators.niw import NormalInverseWishart
from tpmsd.estimators.pose_start import PoseFinder, PoseStart
from tpmsd.estimators.resampling import effective_number, systematic
from tpmsd.estimators.slip_gate import make_gate
from tpmsd.physics.kinematics import Geometry, wheel_speeds
from tpmsd.timeline.tick import Fix, Tick
from tpmsd.wheels import FL, FR, RL, RR, FloatArray

DEFAULT_PARTICLES = 500
PRIOR_RADIUS_STD = 0.01
"""Prior spread of a radius about its nominal value, relative: tread wear, pressure and a guessed nominal."""
NOISE_STD_M = 0.003
"""Prior standard deviation of one tick's radius error (about one cog of 48 at 20 m/s and 10 Hz)."""
NOISE_FLOOR_M = 0.0005
"""Floor of the same, so that a bus with fine speeds does not freeze the particles."""
CHANGE_RATE_PER_S = 0.003
"""How often a particle supposes that a radius has just changed."""
CHANGE_STD = 0.01
"""Size of the supposed change, relative to the radius."""
COAST_LIMIT_S = 3.0


class MpfPn:
    """The estimator; `step` takes one tick and gives one estimate."""

    def __init__(
        self,
        vehicle: VehicleConfig,
        gnss: GnssConfig,
        settings: FilterConfig,
        rng: np.random.Generator,
        front: bool,
        change_rate_per_s: float = CHANGE_RATE_PER_S,
    ) -> None:
        """`front`: whether the bus has the front wheels; `change_rate_per_s`: of supposed sudden changes."""
        self._order = [RL, RR, FL, FR] if front else [RL, RR]
        self._nominal = np.array([vehicle.wheel_radius_m[i] for i in self._order])
        self._geometry = Geometry(vehicle.track_front_m, vehicle.track_rear_m, vehicle.wheelbase_m)
        self._steering_ratio = vehicle.steering_ratio
        self._antenna = (gnss.antenna_forward_m, gnss.antenna_left_m)
        self._settings = settings
        self._change_rate = change_rate_per_s
        self._rng = rng
        self._forgetting = 1.0 - 1.0 / max(settings.window_s * settings.rate_hz, 2.0)
        self._gate = make_gate(settings, vehicle)
        self._fix_gate = FixGate()
        self._finder = PoseFinder()
        count = settings.particles or DEFAULT_PARTICLES
        dim = len(self._order)
        self._pose = np.zeros((3, count))
        self._before = self._pose.copy()
        self._log_weights = np.zeros(count)
        prior_nu = dim + 3.0
        # The prior spread of a radius sits in the particles' means, not in gamma: a wide gamma would make the
        # first ticks' noise as large as the prior and lose the heading.
        spread = PRIOR_RADIUS_STD * self._nominal
        self._stats = NormalInverseWishart(
            gamma=0.2,
            mean=rng.standard_normal((count, dim)) * spread,
            nu=prior_nu,
            scale=np.tile(np.eye(dim) * NOISE_STD_M**2 * (prior_nu - dim - 1.0), (count, 1, 1)),
        )
        self._located = False
        self._informative_s = 0.0
        self._last_fix_s = -math.inf
        self._coasting_s = 0.0
        self._rate = (0.0, 0.0)
        self.counts: dict[str, int] = {"fixes": 0, "refused_fixes": 0, "lost_pose": 0, "resampled": 0}

    # -- one tick --------------------------------------------------------------------------------------------

    def step(self, tick: Tick) -> RadiusEstimate:
        """Advance by one tick; never raises on odd input."""
        if tick.gap_s > COAST_LIMIT_S:
            self._lose_pose()
        informative = self._move(tick)
        for fix in tick.fixes:
            self._take_fix(fix, tick)
        self._resample_if_needed()
        return self._estimate(tick, informative)

    def _move(self, tick: Tick) -> bool:
        """Propagate all particles through the tick; whether it taught the radii."""
        self._before = self._pose.copy()
        angle = tick.rotation_rad[self._order]
        if not np.all(np.isfinite(angle[:2])):
            self._coast(tick)
            return False
        self._coasting_s = 0.0
        virtual_way = float(angle[:2] @ self._nominal[:2]) / 2
        virtual_turn = (
            float(angle[1] * self._nominal[1] - angle[0] * self._nominal[0]) / self._geometry.track_rear_m
        )
        teaches = self._gate.update(tick, virtual_way / tick.dt_s, virtual_turn / tick.dt_s)
        if virtual_way == 0.0:
            self._rate = (0.0, 0.0)
            return False
        if teaches:
            self._stats.forget(self._forgetting)
            self._suppose_changes(tick.dt_s)
        noise = self._stats.sample(self._rng, 2)
        roll = angle[:2] * (self._nominal[:2] + noise)
        way = (roll[:, 0] + roll[:, 1]) / 2
        turn = (roll[:, 1] - roll[:, 0]) / self._geometry.track_rear_m
        if teaches:
            self._learn(noise, angle, way, turn, tick.dt_s)
            self._informative_s += tick.dt_s
        elif self._gate.speed_mps < self._settings.min_speed_mps and self._steering_ratio is not None:
            steering = tick.steering_wheel_angle_rad
            if math.isfinite(steering):  # eq. (38c)
                turn = way * math.tan(steering / self._steering_ratio) / self._geometry.wheelbase_m
        middle = self._pose[2] + turn / 2
        self._pose[0] += way * np.cos(middle)
        self._pose[1] += way * np.sin(middle)
        self._pose[2] += turn
        self._rate = (float(way.mean()) / tick.dt_s, float(turn.mean()) / tick.dt_s)
        return teaches

    def _learn(
        self, rear: FloatArray, angle: FloatArray, way: FloatArray, turn: FloatArray, dt_s: float
    ) -> None:
        """Update the statistics with the realised radius errors of all wheels, eq. (19)."""
        realised = self._stats.mean.copy()  # a wheel without a reading in this tick is taken at its mean
        realised[:, :2] = rear
        if len(self._order) == 4:
            # The hub's lateral part enters squared, so the sampled noise would bias it: there it is smoothed.
            lateral = (self._gate.yaw_rate_radps * dt_s - turn) * self._geometry.wheelbase_m
            paths = wheel_speeds(way, turn, self._geometry, lateral)
            for column, wheel in ((2, FL), (3, FR)):
                if angle[column] > 0.0:  # false for NaN
                    realised[:, column] = paths[:, wheel] / angle[column] - self._nominal[column]
        self._stats.learn(realised)
        floor = NOISE_FLOOR_M**2 * (self._stats.nu - self._stats.dimension - 1.0)
        for k in range(2):
            np.maximum(self._stats.scale[:, k, k], floor, out=self._stats.scale[:, k, k])

    def _suppose_changes(self, dt_s: float) -> None:
        """Let a few particles suppose that one rear radius has just changed.

        The bootstrap proposal explores a mean only as fast as the forgetting lets it; a puncture is faster.
        With this mixture in the prior, p(mu_k | mu_k-1) = (1 - e) delta + e N(mu_k-1, change), the weights
        decide.
        """
        count = self._stats.mean.shape[0]
        number = int(self._rng.poisson(self._change_rate * dt_s * count))
        if number == 0:
            return
        who = self._rng.integers(count, size=number)
        wheel = self._rng.integers(2, size=number)
        self._stats.mean[who, wheel] += self._rng.standard_normal(number) * CHANGE_STD * self._nominal[wheel]
        self._pose[2, who] += self._rng.standard_normal(number) * 0.03

    def _coast(self, tick: Tick) -> None:
        """No rear rotation: go on as before, ever less sure; give the pose up after a while."""
        self._coasting_s += tick.dt_s
        if self._coasting_s > COAST_LIMIT_S:
            if self._located:
                self._lose_pose()
            self._rate = (0.0, 0.0)  # no longer known
            return
        count = self._pose.shape[1]
        speed, yaw_rate = self._rate
        way = tick.dt_s * (speed + self._rng.standard_normal(count))
        self._pose[2] += tick.dt_s * yaw_rate + 0.05 * math.sqrt(tick.dt_s) * self._rng.standard_normal(count)
        self._pose[0] += way * np.cos(self._pose[2])
        self._pose[1] += way * np.sin(self._pose[2])

    # -- fixes -----------------------------------------------------------------------------------------------

    def _take_fix(self, fix: Fix, tick: Tick) -> None:
        """Weigh the particles by a fix, eq. (22), or find the pose by it."""
        moving = self._rate[0] > 0.5
        if not self._located and self._coasting_s > 0.0:
            return  # a pose is of no use before the wheels turn again
        if not self._located:
            start = self._finder.update(fix, moving)
            if start is not None:
                self._place(start, tick)
            return
        if not moving:
            # At a standstill the radii are not in play, and correlated fixes would only sharpen a wrong
            # position.
            return
        weights = self._weights()
        east, north = self._antenna_at(fix.fraction)
        east_off, north_off = fix.east_m - east, fix.north_m - north
        variance = position_variance(fix)
        mean_off = float(weights @ np.hypot(east_off, north_off))
        # The spread of the particles is in mean_off already; the correlation-inflated variance covers the
        # rest.
        verdict = self._fix_gate.judge(mean_off, fix.position_std_m**2 + variance / 9.0, fix.time_s)
        if verdict != "use":
            self._refuse(fix, tick, lost=verdict == "lost")
            return
        self.counts["fixes"] += 1
        self._log_weights += student_t_log((east_off**2 + north_off**2) / variance, 2)
        self._log_weights -= self._log_weights.max()
        self._last_fix_s = fix.time_s

    def _antenna_at(self, fraction: float) -> tuple[FloatArray, FloatArray]:
        """Antenna position (N,), (N,) of each particle at a fraction of the tick."""
        pose = self._before + fraction * (self._pose - self._before)
        forward, left = self._antenna
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        return pose[0] + forward * cos - left * sin, pose[1] + forward * sin + left * cos

    def _refuse(self, fix: Fix, tick: Tick, lost: bool) -> None:
        """Leave an outlying fix out; if the receiver insists, find the pose anew."""
        self.counts["refused_fixes"] += 1
        if not lost:
            return
        self._lose_pose()
        start = self._finder.update(fix, True)
        if start is not None:
            self._place(start, tick)

    def _lose_pose(self) -> None:
        """Give the pose up and keep what was learned of the radii."""
        self._located = False
        self._finder.reset()
        self._gate.reset()
        self._fix_gate.reset()
        self.counts["lost_pose"] += 1

    def _place(self, start: PoseStart, tick: Tick) -> None:
        """Spread the particles about a pose that the fixes tell."""
        count = self._pose.shape[1]
        fix = start.fix
        heading = start.heading_rad + start.heading_std_rad * self._rng.standard_normal(count)
        forward, left = self._antenna
        cos, sin = np.cos(heading), np.sin(heading)
        std = math.sqrt(position_variance(fix))
        rest = (1.0 - fix.fraction) * tick.dt_s * self._rate[0]
        east = fix.east_m + std * self._rng.standard_normal(count)
        north = fix.north_m + std * self._rng.standard_normal(count)
        self._pose = np.stack(
            [
                east - forward * cos + left * sin + rest * cos,
                north - forward * sin - left * cos + rest * sin,
                heading,
            ]
        )
        self._before = self._pose.copy()
        self._log_weights[:] = 0.0
        self._located = True
        self._last_fix_s = fix.time_s

    # -- particles -------------------------------------------------------------------------------------------

    def _weights(self) -> FloatArray:
        weights = np.exp(self._log_weights - self._log_weights.max())
        return np.asarray(weights / weights.sum())

    def _resample_if_needed(self) -> None:
        weights = self._weights()
        if effective_number(weights) > 0.5 * weights.size:
            return
        chosen = systematic(weights, self._rng)
        self._pose = self._pose[:, chosen]
        self._before = self._before[:, chosen]
        self._stats.select(chosen)
        self._log_weights[:] = 0.0
        self.counts["resampled"] += 1

    def _estimate(self, tick: Tick, informative: bool) -> RadiusEstimate:
        weights = self._weights()
        mean, covariance = self._stats.mean_moments(weights)
        deviation = np.full(4, np.nan)
        full = np.full((4, 4), np.nan)
        noise_std = np.full(4, np.nan)
        deviation[self._order] = mean
        full[np.ix_(self._order, self._order)] = covariance
        noise_std[self._order] = np.sqrt(np.diag(self._stats.noise_covariance(weights)))
        east, north, heading = self._pose
        mean_east, mean_north = float(weights @ east), float(weights @ north)
        direction = complex(weights @ np.cos(heading), weights @ np.sin(heading))
        spread = float(weights @ ((east - mean_east) ** 2 + (north - mean_north) ** 2)) / 2
        return RadiusEstimate(
            time_s=tick.time_s,
            deviation_m=deviation,
            covariance_m2=full,
            noise_std_m=noise_std,
            informative=informative,
            informative_s=self._informative_s,
            speed_mps=self._rate[0],
            yaw_rate_radps=self._rate[1],
            east_m=mean_east if self._located else math.nan,
            north_m=mean_north if self._located else math.nan,
            heading_rad=math.atan2(direction.imag, direction.real) if self._located else math.nan,
            position_std_m=math.sqrt(spread) if self._located else math.inf,
            heading_std_rad=math.sqrt(max(-2.0 * math.log(max(abs(direction), 1e-12)), 0.0))
            if self._located
            else math.inf,
            gnss_age_s=tick.time_s - self._last_fix_s,
            effective_particles=effective_number(weights),
        )

    # -- what survives a restart -----------------------------------------------------------------------------

    def snapshot(self) -> dict[str, Any]:
        """Mean and covariance of the radii, and the noise, as plain numbers."""
        mean, covariance = self._stats.mean_moments(self._weights())
        return {
            "order": list(self._order),
            "nominal_m": self._nominal.tolist(),
            "mean_m": mean.tolist(),
            "covariance_m2": covariance.tolist(),
            "noise_m2": self._stats.noise_covariance(self._weights()).tolist(),
            "informative_s": self._informative_s,
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Take up a snapshot of the same car; ValueError if it does not fit."""
        mean, covariance = checked_radii(saved, self._order, self._nominal)
        noise = np.asarray(saved["noise_m2"], dtype=np.float64)
        informative_s = float(saved["informative_s"])
        dim = len(self._order)
        if noise.shape != (dim, dim) or not np.all(np.isfinite(noise)):
            raise ValueError("the saved noise is not finite numbers of the right shape")
        count = self._pose.shape[1]
        self._stats.mean = self._rng.multivariate_normal(mean, covariance + np.eye(dim) * 1e-10, count)
        self._stats.scale = np.tile(noise * (self._stats.nu - dim - 1.0), (count, 1, 1))
        self._informative_s = informative_s
