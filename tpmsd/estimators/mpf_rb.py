"""MPF-RB: the daemon's default. A marginalized particle filter whose linear part is marginalised analytically.

In: `Tick`s. Out: `RadiusEstimate`s. Vectorised over particles, seeded.

The model is paper 000's, (5)-(10): rear wheels as inputs, radius errors that bend the trajectory, GNSS fixes. What
differs from `mpf_pn` is what is sampled and what is computed. Given the way and the turns, everything is so nearly linear
that a Kalman filter per particle is exact for practical purposes. Its state: east, north, heading, radius errors of 2 or 4
wheels (25), and what confounds them and is linear too: the slowly varying part of the receiver's position error, the age of a
fix (and how much older its Doppler speed is), the relative error of the track width, the antenna's forward offset, the
slip of the driven axle per acceleration and the lateral load transfer (effects gnss_latency, track_width_error,
antenna_lever_arm, longitudinal_slip and load_transfer_lateral of the catalogue). Sampled is only what is not linear: *whether and when a wheel's radius suddenly changed*. A particle is a history of such changes, its
weight the probability of that history: so a puncture is followed within seconds, and a quiet drive keeps a sharp posterior.

Quantisation. The reading error of a counter is bounded: it does not add up from tick to tick. So it is
part of the measurements (once per block), not of the process noise as in (9c), where it would be a random walk.

Blocks. About once a second the rotation of the block is held against the receiver (Doppler way) and, front against
rear, against the other wheels (`odometry_block`). Front wheels: see `mpf_pn`; they never bend the trajectory.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tpmsd.config.model import FilterConfig, GnssConfig, VehicleConfig
from tpmsd.estimators.base import RadiusEstimate
from tpmsd.estimators.batched_kalman import predict, scalar_update, symmetrise
from tpmsd.estimators.motion_gate import MotionGate
from tpmsd.estimators.odometry_block import Block, BlockBuilder
from tpmsd.estimators.pose_start import PoseFinder, PoseStart
from tpmsd.estimators.resampling import effective_number
from tpmsd.physics.kinematics import Geometry
from tpmsd.timeline.tick import Fix, Tick
from tpmsd.wheels import FL, FR, RL, RR, FloatArray

DEFAULT_PARTICLES = 40
PRIOR_RADIUS_STD = 0.01
"""Relative: nominal radii are often guessed."""
DRIFT_OWN_MPS5 = 0.010e-3
"""Random walk of one wheel's radius, m per sqrt(s): load, temperature, wear of the model."""
DRIFT_AXLE_MPS5 = 0.020e-3
"""The same for front against rear (slip of the driven axle, load)."""
DRIFT_COMMON_MPS5 = 0.040e-3
"""The same for all wheels together (centrifugal growth, warm-up)."""
CHANGE_RATE_PER_S = 1.0 / 3600.0
"""Prior rate of sudden changes of one wheel's radius."""
CHANGE_HEADING_STD = 0.05
"""Heading error that a change may have caused before it was supposed, rad."""
CHANGE_STD = 0.008
"""Size of a supposed change, relative to the radius."""
TURN_NOISE = 0.0004
"""Heading noise per sqrt(m) of way: side-slip, road crown, roughness, rad."""
WAY_NOISE = 0.003
"""Way noise per sqrt(m): m."""
ROUGH_WAY = 0.0015
"""Relative way noise in ticks that may not teach (slip)."""
ROUGH_TURN = 0.004
"""Relative turn noise, by way over track, in such ticks."""
BIAS_TAU_S = 40.0
WHITE_POSITION_STD_M = 0.25
DOPPLER_STD_MPS = 0.06
DOPPLER_TAU_S = 1.0
TIMING_STD_S = 0.03
COURSE_FLOOR_RAD = 0.004
FIX_INTERVAL_S = 0.45
"""Positions and courses are used at most this often: between, their errors are the same."""
ROUGHNESS_STD = 2.0e-4
"""Front against rear over one block, relative to the way per sqrt(m/20): road roughness and curvature."""
REFUSE_DISTANCE = 6.0
REFUSE_SLACK_M = 5.0
LOST_AFTER_S = 8.0
COAST_LIMIT_S = 3.0

LATENCY_PRIOR_S = (0.05, 0.1)
"""Mean and standard deviation; `gnss_latency` beyond what is configured."""
DOPPLER_LAG_PRIOR_S = (0.03, 0.05)
"""How much older the Doppler speed is than the position: receivers smooth it (0.05 s in all recordings at hand)."""
LOAD_PRIOR_S2 = 1e-4
"""Radius lost per lateral acceleration by the outer wheels, gained by the inner; m per m/s2."""
TURN_RELATIVE = 0.02
"""Turn noise relative to the turn of a tick."""
LATENCY_DRIFT = 0.001
"""s per sqrt(s): what the tracking of the clocks leaves."""
TRACK_PRIOR = 0.03
"""Relative: tracks are often read off a data sheet for another rim."""
FORWARD_PRIOR_M = 0.4
SLIP_PRIOR = (0.004, 0.004)
"""Slip of the driven axle per m/s2: 0.23 % at Fx/Fz = 0.05 is 0.008."""
UNUSED = -1e9
"""Log-weight of a particle that holds no history yet."""

E, N, PSI, BE, BN, LAT, LATV, TRK, FWD, SLIP, LOAD, MU = range(12)
"""Places in the state; the radius errors (rl, rr[, fl, fr]) come last."""


class MpfRb:
    """The estimator; `step` takes one tick and gives one estimate."""

    def __init__(
        self,
        vehicle: VehicleConfig,
        gnss: GnssConfig,
        settings: FilterConfig,
        rng: np.random.Generator,
        front: bool,
    ) -> None:
        """`front`: whether the bus has the front wheels too."""
        self._order = [RL, RR, FL, FR] if front else [RL, RR]
        self._wheels = len(self._order)
        self._nominal = np.array([vehicle.wheel_radius_m[i] for i in self._order])
        self._geometry = Geometry(vehicle.track_front_m, vehicle.track_rear_m, vehicle.wheelbase_m)
        self._steering_ratio = vehicle.steering_ratio
        self._antenna = (gnss.antenna_forward_m, gnss.antenna_left_m)
        self._settings = settings
        self._rng = rng
        self._driven_rear = vehicle.driven_axle in ("rear", "all")
        self._driven_front = vehicle.driven_axle in ("front", "all")
        self._gate = MotionGate(settings)
        self._finder = PoseFinder()
        self._blocks = BlockBuilder(self._order, self._nominal, self._geometry)
        count, size = settings.particles or DEFAULT_PARTICLES, MU + self._wheels
        self._mean = np.zeros((count, size))
        self._cov = np.zeros((count, size, size))
        mu = slice(MU, MU + self._wheels)
        prior = np.outer(self._nominal, self._nominal) * PRIOR_RADIUS_STD**2
        # A guessed nominal is wrong for all wheels alike; wheels differ among themselves by half as much.
        self._cov[:, mu, mu] = prior * (0.75 + 0.25 * np.eye(self._wheels))
        self._mean[:, LAT], self._cov[:, LAT, LAT] = LATENCY_PRIOR_S[0], LATENCY_PRIOR_S[1] ** 2
        self._mean[:, SLIP], self._cov[:, SLIP, SLIP] = SLIP_PRIOR[0], SLIP_PRIOR[1] ** 2
        self._mean[:, LATV], self._cov[:, LATV, LATV] = DOPPLER_LAG_PRIOR_S[0], DOPPLER_LAG_PRIOR_S[1] ** 2
        self._cov[:, LOAD, LOAD] = LOAD_PRIOR_S2**2
        self._cov[:, TRK, TRK] = TRACK_PRIOR**2
        self._cov[:, FWD, FWD] = FORWARD_PRIOR_M**2
        self._log_weights = np.full(count, UNUSED)
        self._log_weights[0] = 0.0
        self._drift = self._drift_covariance()
        self._located = False
        self._informative_s = 0.0
        self._last_fix_s = -math.inf
        self._last_used_s = -math.inf
        self._refused_since: float | None = None
        self._coasting_s = 0.0
        self._next_wheel = 0
        self._load_turn = 0.0
        self._rate = (0.0, 0.0)
        self.counts: dict[str, int] = {"fixes": 0, "refused_fixes": 0, "lost_pose": 0}

    def _drift_covariance(self) -> FloatArray:
        """(d, d) growth of the radii's covariance per second."""
        d = self._wheels
        out = np.eye(d) * DRIFT_OWN_MPS5**2 + np.ones((d, d)) * DRIFT_COMMON_MPS5**2
        if d == 4:
            axle = np.array([1.0, 1.0, -1.0, -1.0])
            out += np.outer(axle, axle) * DRIFT_AXLE_MPS5**2
        return out

    # -- one tick -------------------------------------------------------------------------------------------------

    def step(self, tick: Tick) -> RadiusEstimate:
        """Advance by one tick; never raises on odd input."""
        if tick.gap_s > COAST_LIMIT_S:
            self._lose_pose()
        teaches = self._move(tick)
        for fix in tick.fixes:
            self._take_fix(fix, tick)
        block = self._blocks.add(tick, teaches, self._weighted_mu(), self._gate.accel_mps2)
        if block is not None:
            self._suppose_changes(block)
            self._learn(block)
            symmetrise(self._cov)
            self._log_weights -= self._log_weights.max()
            np.maximum(self._log_weights, UNUSED, out=self._log_weights)
        return self._estimate(tick, teaches)

    def _move(self, tick: Tick) -> bool:
        """Propagate all particles through the tick, eq. (7); whether it may teach the radii."""
        angle = tick.rotation_rad[self._order]
        rear = angle[:2]
        if not np.all(np.isfinite(rear)):
            self._coast(tick)
            return False
        self._coasting_s = 0.0
        nominal_roll = rear * self._nominal[:2]
        track = self._geometry.track_rear_m
        teaches = self._gate.update(
            tick,
            float(nominal_roll.sum()) / 2 / tick.dt_s,
            float(nominal_roll[1] - nominal_roll[0]) / track / tick.dt_s,
        )
        if nominal_roll.sum() == 0.0:
            self._rate = (0.0, 0.0)
            return False
        roll = nominal_roll + rear * self._mean[:, MU : MU + 2]
        way = roll.sum(axis=1) / 2
        if self._driven_rear:
            way *= 1.0 - self._mean[:, SLIP] * self._gate.accel_mps2
        turn = (roll[:, 1] - roll[:, 0]) / track * (1.0 + self._mean[:, TRK])
        # In a left turn the right radius shrinks by c*a_y and the left one grows, so the rotations show too much turn.
        accel_lat = self._gate.speed_mps * self._gate.yaw_rate_radps
        self._load_turn = -accel_lat * float(rear.sum()) / track
        turn += self._mean[:, LOAD] * self._load_turn
        by_wheels = True
        if (
            not teaches
            and self._gate.speed_mps < self._settings.min_speed_mps
            and self._steering_ratio is not None
        ):
            steering = tick.steering_wheel_angle_rad
            if math.isfinite(steering):  # eq. (38c)
                turn = way * math.tan(steering / self._steering_ratio) / self._geometry.wheelbase_m
                by_wheels = False
        mean_way = float(way.mean())
        self._propagate(tick, rear, way, turn, by_wheels, rough=not teaches)
        self._rate = (mean_way / tick.dt_s, float(turn.mean()) / tick.dt_s)
        if teaches:
            self._informative_s += tick.dt_s
        return teaches

    def _propagate(
        self, tick: Tick, rear: FloatArray, way: FloatArray, turn: FloatArray, by_wheels: bool, rough: bool
    ) -> None:
        """Mean and covariance through eq. (7) with its Jacobian, mid-step heading."""
        mean, size = self._mean, self._mean.shape[1]
        track = self._geometry.track_rear_m
        middle = mean[:, PSI] + turn / 2
        cos, sin = np.cos(middle), np.sin(middle)
        mean[:, E] += way * cos
        mean[:, N] += way * sin
        mean[:, PSI] += turn
        jacobian = np.zeros((mean.shape[0], size, size))
        jacobian[:, range(size), range(size)] = 1.0
        jacobian[:, E, PSI] = -way * sin
        jacobian[:, N, PSI] = way * cos
        half = rear / 2
        bend = np.array([-rear[0], rear[1]]) / track if by_wheels else np.zeros(2)
        for k in range(2):
            jacobian[:, E, MU + k] = half[k] * cos - way * sin * bend[k] / 2
            jacobian[:, N, MU + k] = half[k] * sin + way * cos * bend[k] / 2
            jacobian[:, PSI, MU + k] = bend[k]
        if self._driven_rear:
            jacobian[:, E, SLIP] = -way * self._gate.accel_mps2 * cos
            jacobian[:, N, SLIP] = -way * self._gate.accel_mps2 * sin
        if by_wheels:
            jacobian[:, PSI, TRK] = turn
            jacobian[:, PSI, LOAD] = self._load_turn
            jacobian[:, E, TRK] = -way * sin * turn / 2
            jacobian[:, N, TRK] = way * cos * turn / 2
        decay = math.exp(-tick.dt_s / BIAS_TAU_S)
        mean[:, BE : BN + 1] *= decay
        jacobian[:, BE, BE] = jacobian[:, BN, BN] = decay
        distance = abs(float(way.mean()))
        noise = np.zeros((size, size))
        along = WAY_NOISE**2 * distance + (ROUGH_WAY * distance * 10) ** 2 * rough
        noise[E, E] = noise[N, N] = along
        noise[PSI, PSI] = (
            TURN_NOISE**2 * distance
            + (TURN_RELATIVE * float(turn.mean())) ** 2
            + (ROUGH_TURN * distance / track) ** 2 * rough
        )
        noise[MU : MU + self._wheels, MU : MU + self._wheels] = self._drift * tick.dt_s
        noise[LAT, LAT] = LATENCY_DRIFT**2 * tick.dt_s
        noise[BE, BE] = noise[BN, BN] = self._bias_std() ** 2 * (1.0 - decay**2)
        self._cov = predict(self._cov, jacobian, noise)

    def _bias_std(self) -> float:
        return self._position_std_m if self._located else 1.5

    _position_std_m = 1.5

    def _coast(self, tick: Tick) -> None:
        """No rear rotation: go on as before, ever less sure; give the pose up after a while."""
        self._blocks.reset()
        self._coasting_s += tick.dt_s
        if self._coasting_s > COAST_LIMIT_S:
            if self._located:
                self._lose_pose()
            return
        speed, yaw_rate = self._rate
        mean, dt = self._mean, tick.dt_s
        mean[:, E] += speed * dt * np.cos(mean[:, PSI])
        mean[:, N] += speed * dt * np.sin(mean[:, PSI])
        mean[:, PSI] += yaw_rate * dt
        self._cov[:, [E, N], [E, N]] += (1.0 * dt) ** 2 + (speed * dt * 0.1) ** 2
        self._cov[:, PSI, PSI] += 0.1**2 * dt

    # -- fixes ----------------------------------------------------------------------------------------------------

    def _take_fix(self, fix: Fix, tick: Tick) -> None:
        """Hold the particles against position and course."""
        self._blocks.add_fix(fix, tick)
        moving = self._rate[0] > 0.5
        if not self._located:
            start = self._finder.update(fix, moving)
            if start is not None:
                self._place(start, tick)
            return
        if not moving or fix.time_s - self._last_used_s < FIX_INTERVAL_S:
            # At a standstill correlated fixes would only sharpen a wrong position.
            if self._refused_since is None:
                self._last_fix_s = max(self._last_fix_s, fix.time_s)
            return
        interval = min(max(fix.time_s - self._last_used_s, FIX_INTERVAL_S), 2.0)
        self._last_used_s = fix.time_s
        self._position_std_m = fix.position_std_m
        east_row, north_row, east, north, heading = self._antenna_at(fix, tick)
        weights = self._weights()
        off = math.hypot(fix.east_m - float(weights @ east), fix.north_m - float(weights @ north))
        own = float(weights @ (self._cov[:, E, E] + self._cov[:, N, N]))
        if off > REFUSE_SLACK_M + REFUSE_DISTANCE * math.sqrt(own + fix.position_std_m**2):
            self._refuse(fix, tick)
            return
        self._refused_since = None
        self._last_fix_s = fix.time_s
        self.counts["fixes"] += 1
        speed, yaw_rate = self._rate
        white = min(WHITE_POSITION_STD_M, fix.position_std_m) ** 2 + (TIMING_STD_S * speed) ** 2 + 0.02**2
        log, _ = scalar_update(self._mean, self._cov, fix.east_m - east, east_row, white)
        _, _, _, north, _ = self._antenna_at(fix, tick)
        more, _ = scalar_update(self._mean, self._cov, fix.north_m - north, north_row, white)
        log += more
        if math.isfinite(fix.heading_rad) and speed > self._settings.min_speed_mps:
            log += self._use_course(fix, tick, interval)
        self._log_weights += log

    def _use_course(self, fix: Fix, tick: Tick, interval: float) -> FloatArray:
        """Heading against the receiver's course; Doppler cross-track noise, reading error of the counters."""
        speed, yaw_rate = self._rate
        forward, left = self._antenna
        behind = (1.0 - fix.fraction) * tick.dt_s + self._mean[:, LAT] + self._mean[:, LATV]
        course = self._mean[:, PSI] - yaw_rate * behind
        along = max(speed - yaw_rate * left, 0.1)
        course = course + np.arctan2(yaw_rate * (forward + self._mean[:, FWD]), along)
        off = np.remainder(fix.heading_rad - course + math.pi, 2 * math.pi) - math.pi
        row = np.zeros(self._mean.shape[1])
        row[PSI], row[LAT], row[LATV], row[FWD] = 1.0, -yaw_rate, -yaw_rate, yaw_rate / along
        std = tick.rotation_std_rad[self._order[:2]]
        reading = float(np.nansum((std * self._nominal[:2]) ** 2)) / 2 / self._geometry.track_rear_m**2
        doppler = (DOPPLER_STD_MPS / speed) ** 2 * max(1.0, 2 * DOPPLER_TAU_S / interval)
        variance = doppler + (TIMING_STD_S * yaw_rate) ** 2 + COURSE_FLOOR_RAD**2 + reading
        log, _ = scalar_update(self._mean, self._cov, off, row, variance)
        return log

    def _antenna_at(
        self, fix: Fix, tick: Tick
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Measurement rows (N, n) and predictions (N,) of the antenna's position at the time of a fix."""
        mean = self._mean
        forward, left = self._antenna
        cos, sin = np.cos(mean[:, PSI]), np.sin(mean[:, PSI])
        speed = self._rate[0]
        ahead = forward + mean[:, FWD] - speed * ((1.0 - fix.fraction) * tick.dt_s + mean[:, LAT])
        east_row = np.zeros_like(mean)
        north_row = np.zeros_like(mean)
        east_row[:, E] = east_row[:, BE] = 1.0
        north_row[:, N] = north_row[:, BN] = 1.0
        east_row[:, PSI] = -ahead * sin - left * cos
        north_row[:, PSI] = ahead * cos - left * sin
        east_row[:, LAT], north_row[:, LAT] = -speed * cos, -speed * sin
        east_row[:, FWD], north_row[:, FWD] = cos, sin
        east = mean[:, E] + mean[:, BE] + ahead * cos - left * sin
        north = mean[:, N] + mean[:, BN] + ahead * sin + left * cos
        return east_row, north_row, east, north, mean[:, PSI]

    def _refuse(self, fix: Fix, tick: Tick) -> None:
        """Leave an outlying fix out; believe the receiver again if it insists."""
        self.counts["refused_fixes"] += 1
        if self._refused_since is None:
            self._refused_since = fix.time_s
        elif fix.time_s - self._refused_since > LOST_AFTER_S:
            self._lose_pose()
            start = self._finder.update(fix, True)
            if start is not None:
                self._place(start, tick)

    def _lose_pose(self) -> None:
        """Give the pose up and keep what was learned of the radii."""
        self._located = False
        self._finder.reset()
        self._gate.reset()
        self._blocks.reset()
        self._refused_since = None
        self.counts["lost_pose"] += 1

    def _place(self, start: PoseStart, tick: Tick) -> None:
        """Set every particle's pose to what the fixes tell, uncorrelated with the radii."""
        fix = start.fix
        forward, left = self._antenna
        cos, sin = math.cos(start.heading_rad), math.sin(start.heading_rad)
        weights = self._weights()
        late = (1.0 - fix.fraction) * tick.dt_s + float(weights @ self._mean[:, LAT])
        rest = late * self._rate[0] - forward - float(weights @ self._mean[:, FWD])
        pose_and_bias = [E, N, PSI, BE, BN]
        self._mean[:, pose_and_bias] = [
            fix.east_m + rest * cos + left * sin,
            fix.north_m + rest * sin - left * cos,
            start.heading_rad,
            0.0,
            0.0,
        ]
        self._cov[:, pose_and_bias, :] = 0.0
        self._cov[:, :, pose_and_bias] = 0.0
        bias_variance = fix.position_std_m**2
        # Pose errors are those of the fix: the correlated part is in the bias, so the pose carries it with opposite sign.
        for pose, bias in ((E, BE), (N, BN)):
            self._cov[:, pose, pose] = bias_variance + WHITE_POSITION_STD_M**2
            self._cov[:, bias, bias] = bias_variance
            self._cov[:, pose, bias] = self._cov[:, bias, pose] = -bias_variance
        self._cov[:, PSI, PSI] = start.heading_std_rad**2
        self._position_std_m = fix.position_std_m
        self._located = True
        self._last_fix_s = self._last_used_s = fix.time_s

    # -- radii ----------------------------------------------------------------------------------------------------

    def _suppose_changes(self, block: Block) -> None:
        """For each wheel, one history branches off the best: this wheel has just changed.

        The branches take the places of the least probable particles, with the prior probability of a change in this
        block as their weight; how much has changed is left to the Kalman filter. Drawing branches at random instead
        would leave seconds without one, and after a burst the heading has gone astray; for the same
        reason a branch allows for some heading error.
        """
        if not block.teaches:
            return
        order = np.argsort(self._log_weights)
        best = order[-1]
        chance = math.log(CHANGE_RATE_PER_S * block.duration_s)
        # The wheels take turns when particles are few.
        number = min(self._wheels, self._mean.shape[0] // 4)
        for child in order[:number]:
            wheel = self._next_wheel
            self._next_wheel = (wheel + 1) % self._wheels
            self._mean[child] = self._mean[best]
            self._cov[child] = self._cov[best]
            self._cov[child, MU + wheel, MU + wheel] += (CHANGE_STD * self._nominal[wheel]) ** 2
            self._cov[child, PSI, PSI] += CHANGE_HEADING_STD**2
            self._log_weights[child] = self._log_weights[best] + chance

    def _learn(self, block: Block) -> None:
        """Doppler way against the rear wheels, front wheels against rear."""
        if not block.teaches:
            return
        mu = slice(MU, MU + self._wheels)
        radii = self._mean[:, mu]
        row = np.zeros(self._mean.shape[1])
        if math.isfinite(block.doppler_way_m):
            row[MU : MU + 2] = block.angle_rad[:2] / 2
            slip = self._mean[:, SLIP] * block.accel_mps2 if self._driven_rear else 0.0
            predicted = (self._nominal[:2] + radii[:, :2]) @ block.angle_rad[:2] / 2 * (1.0 - slip)
            age = self._mean[:, LAT] + self._mean[:, LATV]
            predicted -= age * block.speed_change_mps + self._antenna[1] * block.turn_rad
            row[LAT] = row[LATV] = -block.speed_change_mps
            row[SLIP] = -block.way_m * block.accel_mps2 if self._driven_rear else 0.0
            doppler = DOPPLER_STD_MPS**2 * 2 * DOPPLER_TAU_S * block.duration_s
            variance = doppler + (TIMING_STD_S * block.speed_swing_mps) ** 2 + block.reading_way_m**2
            log, _ = scalar_update(self._mean, self._cov, block.doppler_way_m - predicted, row, variance)
            self._log_weights += log
        if self._wheels == 4:
            rough = ROUGHNESS_STD * math.sqrt(max(block.way_m, 1.0) * 20.0)
            for k, front in enumerate(block.front):
                if front is None:
                    continue
                row = np.zeros(self._mean.shape[1])
                row[MU : MU + 2] = front.by_rear
                row[MU + 2 + k] = -block.angle_rad[2 + k]
                row[TRK] = front.by_track
                # omega r = v (1 + slip): a driven rear pair makes the predicted path shorter, a driven front wheel its own.
                sign = float(self._driven_front) - float(self._driven_rear)
                row[SLIP] = sign * block.way_m * block.accel_mps2
                off = -(front.residual_m + (self._mean[:, mu] - block.at_radii) @ row[mu])
                off -= self._mean[:, TRK] * row[TRK] + self._mean[:, SLIP] * row[SLIP]
                log, _ = scalar_update(self._mean, self._cov, off, row, rough**2 + front.reading_m**2)
                self._log_weights += log

    # -- particles ------------------------------------------------------------------------------------------------

    def _weighted_mu(self) -> FloatArray:
        """(d,) present estimate of the radius errors."""
        out: FloatArray = self._weights() @ self._mean[:, MU : MU + self._wheels]
        return out

    def _weights(self) -> FloatArray:
        weights = np.exp(self._log_weights - self._log_weights.max())
        return weights / weights.sum()

    def _moments(self) -> tuple[FloatArray, FloatArray]:
        """Mean and covariance of the whole state over the mixture."""
        weights = self._weights()
        mean = weights @ self._mean
        centred = self._mean - mean
        cov = np.einsum("i,ijk->jk", weights, self._cov) + (centred * weights[:, None]).T @ centred
        return mean, cov

    def _estimate(self, tick: Tick, teaches: bool) -> RadiusEstimate:
        mean, cov = self._moments()
        mu = slice(MU, MU + self._wheels)
        deviation, full, noise = np.full(4, np.nan), np.full((4, 4), np.nan), np.full(4, np.nan)
        deviation[self._order] = mean[mu]
        full[np.ix_(self._order, self._order)] = cov[mu, mu]
        noise[self._order] = np.sqrt(np.diag(self._drift))
        found = self._located
        return RadiusEstimate(
            time_s=tick.time_s,
            deviation_m=deviation,
            covariance_m2=full,
            noise_std_m=noise,
            informative=teaches,
            informative_s=self._informative_s,
            speed_mps=self._rate[0],
            yaw_rate_radps=self._rate[1],
            east_m=float(mean[E]) if found else math.nan,
            north_m=float(mean[N]) if found else math.nan,
            heading_rad=math.remainder(float(mean[PSI]), 2 * math.pi) if found else math.nan,
            position_std_m=math.sqrt(max(cov[E, E] + cov[N, N], 0.0) / 2) if found else math.inf,
            heading_std_rad=math.sqrt(max(cov[PSI, PSI], 0.0)) if found else math.inf,
            gnss_age_s=tick.time_s - self._last_fix_s,
            effective_particles=effective_number(self._weights()),
        )

    def snapshot(self) -> dict[str, Any]:
        """Mean and covariance of the radii as plain numbers."""
        mean, cov = self._moments()
        mu = slice(MU, MU + self._wheels)
        return {
            "order": list(self._order),
            "nominal_m": self._nominal.tolist(),
            "mean_m": mean[mu].tolist(),
            "covariance_m2": cov[mu, mu].tolist(),
            "informative_s": self._informative_s,
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Take up a snapshot of the same car; ValueError if it does not fit."""
        from tpmsd.estimators.base import checked_radii

        mean, cov = checked_radii(saved, self._order, self._nominal)
        mu = slice(MU, MU + self._wheels)
        self._mean[:, mu] = mean
        self._cov[:, mu, mu] = cov
        self._informative_s = float(saved["informative_s"])
