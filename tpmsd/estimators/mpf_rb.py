"""MPF-RB, the daemon's default: a marginalized particle filter that computes what is linear.

In: `Tick`s. Out: `RadiusEstimate`s. Vectorised over particles, seeded.

The model is paper 000's, (5)-(10): rear wheels as inputs, radius errors that bend the trajectory, GNSS fixes.
What differs from `mpf_pn` is what is sampled and what is computed. Given the way and the turns, everything is
so nearly linear that a Kalman filter per particle (state: `error_state`) is exact for practical purposes.
Sampled is only what is not linear: *whether and when a wheel's radius suddenly changed*. A particle is a
history of such changes, its weight the probability of that history: so a puncture is followed within seconds,
and a quiet drive keeps a sharp posterior. The histories are enumerated rather than drawn, and the least
probable dropped (Fearnhead and Clifford 2003, J. R. Statist. Soc. B 65(4), on particle filters with discrete
states).

Quantisation. The reading error of a counter is bounded: it does not add up from tick to tick. So it is part
of the measurements (once per block), not of the process noise as in (9c), where it would be a random walk.

Blocks. About once a second the rotation is held against the receiver (Doppler way), the bus's yaw rate where
it has shown to be one (`gyro_check`), and, front against rear, against the other wheels (`odometry_block`).
The front wheels' paths are those of `mpf_pn`; here they are measurements of all radii jointly, so that
left against right on the front axle steadies the rear one where the receiver is poor.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tpmsd.config.model import FilterConfig, GnssConfig, VehicleConfig
from tpmsd.estimators import error_state as state
from tpmsd.estimators import measurements
from tpmsd.estimators.base import RadiusEstimate, checked_radii
from tpmsd.estimators.batched_kalman import Weights, scalar_update, square_weights, symmetrise
from tpmsd.estimators.error_state import BE, BN, FWD, LAT, MU, PSI, SLIP, E, Motion, N, ProcessModel
from tpmsd.estimators.fix_gate import FIX_WEIGHTS, FixGate
from tpmsd.estimators.motion_gate import MotionGate
from tpmsd.estimators.odometry_block import Block, BlockBuilder
from tpmsd.estimators.pose_start import PoseFinder, PoseStart
from tpmsd.estimators.resampling import effective_number
from tpmsd.estimators.slip_gate import make_gate
from tpmsd.physics.grade import GradeTracker
from tpmsd.physics.kinematics import Geometry
from tpmsd.timeline.tick import Fix, Tick
from tpmsd.wheels import FL, FR, RL, RR, FloatArray

DEFAULT_PARTICLES = 40
CHANGE_RATE_PER_S = 1.0 / 3600.0
"""Prior rate of sudden changes of one wheel's radius."""
CHANGE_STD = 0.008
"""Size of a supposed change, relative to the radius."""
CHANGE_HEADING_STD = 0.05
"""Heading error that a change may have caused before it was supposed, rad."""
FIX_INTERVAL_S = 0.45
"""Positions and courses are used at most this often: between, their errors are the same."""
COAST_LIMIT_S = 3.0
UNUSED = -1e9
"""Log-weight of a particle that holds no history yet."""


class MpfRb:
    """The estimator; `step` takes one tick and gives one estimate."""

    def __init__(
        self,
        vehicle: VehicleConfig,
        gnss: GnssConfig,
        settings: FilterConfig,
        rng: np.random.Generator,
        front: bool,
        gate: MotionGate | None = None,
    ) -> None:
        """`front`: whether the bus has the front wheels too. `rng` is not drawn from: histories are
        enumerated. `gate` None: the one that `settings` name."""
        self._order = [RL, RR, FL, FR] if front else [RL, RR]
        self._wheels = len(self._order)
        self._nominal = np.array([vehicle.wheel_radius_m[i] for i in self._order])
        self._geometry = Geometry(vehicle.track_front_m, vehicle.track_rear_m, vehicle.wheelbase_m)
        self._steering_ratio = vehicle.steering_ratio
        self._antenna = (gnss.antenna_forward_m, gnss.antenna_left_m)
        self._settings = settings
        self._driven_rear = vehicle.driven_axle in ("rear", "all")
        self._driven_front = vehicle.driven_axle in ("front", "all")
        self._process = ProcessModel(self._nominal, vehicle.track_rear_m, self._driven_rear)
        self._gate = gate or make_gate(settings, vehicle)
        self._fix_gate = FixGate()
        self._fix_weights = FIX_WEIGHTS[settings.fix_weights]
        self._finder = PoseFinder()
        self._grade = GradeTracker()
        self._blocks = BlockBuilder(self._order, self._nominal, self._geometry)
        count = settings.particles or DEFAULT_PARTICLES
        self._mean, self._cov = state.initial_state(count, self._nominal)
        self._log_weights = np.full(count, UNUSED)
        self._log_weights[0] = 0.0
        self._position_std_m = state.DEFAULT_POSITION_STD_M
        self._located = self._teaches = False
        self._informative_s = 0.0
        self._last_fix_s = self._last_used_s = -math.inf
        self._coasting_s = 0.0
        self._next_wheel = 0
        self._rate = (0.0, 0.0)
        self.counts: dict[str, int] = {"fixes": 0, "refused_fixes": 0, "lost_pose": 0}

    # -- one tick -------------------------------------------------------------------------------------------

    def step(self, tick: Tick) -> RadiusEstimate:
        """Advance by one tick; never raises on odd input."""
        if tick.gap_s > COAST_LIMIT_S:
            self._lose_pose()
        teaches = self._teaches = self._move(tick)
        for fix in tick.fixes:
            self._take_fix(fix, tick)
        block = self._blocks.add(tick, teaches, self._radii(), self._gate.accel_mps2)
        if block is not None:
            if block.teaches:
                self._suppose_changes(block)
                self._learn(block)
            symmetrise(self._cov)
            self._log_weights -= self._log_weights.max()
            np.maximum(self._log_weights, UNUSED, out=self._log_weights)
        return self._estimate(tick, teaches)

    def _move(self, tick: Tick) -> bool:
        """Propagate all particles through the tick; whether it may teach the radii."""
        rear = tick.rotation_rad[self._order[:2]]
        if not (math.isfinite(rear[0]) and math.isfinite(rear[1])):
            self._coast(tick)
            return False
        self._coasting_s = 0.0
        roll = rear * self._nominal[:2]
        speed = float(roll[0] + roll[1]) / 2 / tick.dt_s
        yaw_rate = float(roll[1] - roll[0]) / self._geometry.track_rear_m / tick.dt_s
        teaches = self._gate.update(tick, speed, yaw_rate)
        if roll[0] + roll[1] == 0.0:
            self._rate = (0.0, 0.0)
            return False
        gate = self._gate
        curvature = None if teaches else self._steered_curvature(tick)
        accel_lat = gate.speed_mps * gate.yaw_rate_radps
        self._grade.move(speed * tick.dt_s)
        horizontal = self._grade.horizontal
        motion = Motion(tick.dt_s, rear, gate.accel_mps2, accel_lat, teaches, horizontal, curvature)
        std = self._position_std_m
        self._cov, way, turn = self._process.propagate(self._mean, self._cov, motion, std)
        self._rate = (way / tick.dt_s, turn / tick.dt_s)
        if teaches:
            self._informative_s += tick.dt_s
        return teaches

    def _steered_curvature(self, tick: Tick) -> float | None:
        """Curvature by the steering at low speed, eq. (38c); None where the wheels tell the turn."""
        steering = tick.steering_wheel_angle_rad
        slow = self._gate.speed_mps < self._settings.min_speed_mps
        if not slow or self._steering_ratio is None or not math.isfinite(steering):
            return None
        return math.tan(steering / self._steering_ratio) / self._geometry.wheelbase_m

    def _coast(self, tick: Tick) -> None:
        """No rear rotation: go on as before, ever less sure; give the pose up after a while."""
        self._blocks.reset()
        self._coasting_s += tick.dt_s
        if self._coasting_s > COAST_LIMIT_S:
            if self._located:
                self._lose_pose()
            self._rate = (0.0, 0.0)  # no longer known
            return
        speed, yaw_rate = self._rate
        mean, dt = self._mean, tick.dt_s
        mean[:, E] += speed * dt * np.cos(mean[:, PSI])
        mean[:, N] += speed * dt * np.sin(mean[:, PSI])
        mean[:, PSI] += yaw_rate * dt
        self._cov[:, [E, N], [E, N]] += dt**2 + (speed * dt * 0.1) ** 2
        self._cov[:, PSI, PSI] += 0.1**2 * dt

    # -- fixes ----------------------------------------------------------------------------------------------

    def _take_fix(self, fix: Fix, tick: Tick) -> None:
        """Hold the particles against position and course."""
        self._blocks.add_fix(fix, tick)
        self._grade.update(fix.up_m)
        moving = self._rate[0] > 0.5
        if not self._located and self._coasting_s > 0.0:
            return  # a pose is of no use before the wheels turn again
        if not self._located:
            start = self._finder.update(fix, moving)
            if start is not None:
                self._place(start, tick)
            return
        if not moving or fix.time_s - self._last_used_s < FIX_INTERVAL_S:
            # At a standstill correlated fixes would only sharpen a wrong position.
            if not self._fix_gate.refusing:
                self._last_fix_s = max(self._last_fix_s, fix.time_s)
            return
        interval_s = min(fix.time_s - self._last_used_s, 2.0)
        self._last_used_s = fix.time_s
        self._position_std_m = fix.position_std_m
        now = measurements.Present(*self._rate, *self._antenna)
        east, north, east_row, north_row = measurements.antenna_position(self._mean, fix, tick, now)
        weights = self._weights()
        off = math.hypot(fix.east_m - float(weights @ east), fix.north_m - float(weights @ north))
        own = float(weights @ (self._cov[:, E, E] + self._cov[:, N, N]))
        verdict = self._fix_gate.judge(off, own + fix.position_std_m**2, fix.time_s)
        if verdict != "use":
            self._refuse(fix, tick, lost=verdict == "lost")
            return
        self._last_fix_s = fix.time_s
        self.counts["fixes"] += 1
        variance = measurements.position_variance(fix, now)
        self._update(measurements.Scalar(fix.east_m - east, east_row, variance), self._fix_weights)
        _, north, _, north_row = measurements.antenna_position(self._mean, fix, tick, now)
        self._update(measurements.Scalar(fix.north_m - north, north_row, variance), self._fix_weights)
        if math.isfinite(fix.heading_rad) and now.speed_mps > self._settings.min_speed_mps / 2:
            reading = self._reading_heading(tick)
            course = measurements.course(self._mean, fix, tick, now, reading, interval_s)
            self._update(course, self._fix_weights)

    def _reading_heading(self, tick: Tick) -> float:
        """The counters' reading error at one instant (half of a tick's variance) as an error of heading,
        rad."""
        rolls = tick.rotation_std_rad[self._order[:2]] * self._nominal[:2]
        return math.hypot(*np.nan_to_num(rolls)) / math.sqrt(2.0) / self._geometry.track_rear_m

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
        self._blocks.reset()
        self._grade.reset()
        self._fix_gate.reset()
        self.counts["lost_pose"] += 1

    def _place(self, start: PoseStart, tick: Tick) -> None:
        """Set every particle's pose to what the fixes tell, uncorrelated with the radii."""
        fix = start.fix
        forward, left = self._antenna
        weights = self._weights()
        late_s = (1.0 - fix.fraction) * tick.dt_s + float(weights @ self._mean[:, LAT])
        ahead = late_s * self._rate[0] - forward - float(weights @ self._mean[:, FWD])
        cos, sin = math.cos(start.heading_rad), math.sin(start.heading_rad)
        east, north = fix.east_m + ahead * cos + left * sin, fix.north_m + ahead * sin - left * cos
        anew = [E, N, PSI, BE, BN]
        self._mean[:, anew] = [east, north, start.heading_rad, 0.0, 0.0]
        self._cov[:, anew, :] = 0.0
        self._cov[:, :, anew] = 0.0
        slow = fix.position_std_m**2
        # The slow part of the fix's error is in the bias, so the pose carries it with opposite sign.
        for pose, bias in ((E, BE), (N, BN)):
            self._cov[:, pose, pose] = slow + measurements.WHITE_POSITION_STD_M**2
            self._cov[:, bias, bias] = slow
            self._cov[:, pose, bias] = self._cov[:, bias, pose] = -slow
        self._cov[:, PSI, PSI] = start.heading_std_rad**2
        self._position_std_m = fix.position_std_m
        self._located = True
        self._last_fix_s = self._last_used_s = fix.time_s

    # -- radii ----------------------------------------------------------------------------------------------

    def _suppose_changes(self, block: Block) -> None:
        """For each wheel, one history branches off the best: this wheel has just changed.

        The branches take the places of the least probable particles, with the prior probability of a change
        in this block as their weight; how much has changed is left to the Kalman filter. A branch allows for
        some heading error too, for a rear wheel that changed has turned the heading before anyone supposed
        it.
        """
        order = np.argsort(self._log_weights)
        best = order[-1]
        chance = math.log(CHANGE_RATE_PER_S * block.duration_s)
        # The wheels take turns when particles are few.
        for child in order[: min(self._wheels, order.size // 4)]:
            wheel = self._next_wheel
            self._next_wheel = (wheel + 1) % self._wheels
            self._mean[child] = self._mean[best]
            self._cov[child] = self._cov[best]
            self._cov[child, MU + wheel, MU + wheel] += (CHANGE_STD * self._nominal[wheel]) ** 2
            self._cov[child, PSI, PSI] += CHANGE_HEADING_STD**2
            self._log_weights[child] = self._log_weights[best] + chance

    def _learn(self, block: Block) -> None:
        """Doppler way and yaw rate against the rear wheels, front wheels against rear."""
        if math.isfinite(block.doppler_way_m):
            left = self._antenna[1]
            scalar = measurements.doppler_way(
                self._mean, block, self._nominal, left, self._grade.horizontal, self._driven_rear
            )
            self._update(scalar, self._fix_weights)
        if self._gate.gyro_trusted and math.isfinite(block.gyro_turn_rad):
            self._update(measurements.gyro_turn(self._mean, block, self._geometry.track_rear_m))
        driven = float(self._driven_front) - float(self._driven_rear)
        for place, front in enumerate(block.front, start=2):
            if front is not None:
                self._update(measurements.front_wheel(self._mean, block, front, place, driven))

    # -- particles ------------------------------------------------------------------------------------------

    def _update(self, scalar: measurements.Scalar, weights: Weights = square_weights) -> None:
        """Update all particles; in ticks that may not teach, the radii and what acts on them stay as they
        are."""
        frozen = None if self._teaches else SLIP
        self._log_weights += scalar_update(
            self._mean, self._cov, scalar.innovation, scalar.row, scalar.variance, frozen, weights
        )

    def _weights(self) -> FloatArray:
        weights = np.exp(self._log_weights - self._log_weights.max())
        return np.asarray(weights / weights.sum())

    def _radii(self) -> FloatArray:
        """(d,) present estimate of the radius errors."""
        return np.asarray(self._weights() @ self._mean[:, MU:])

    def _moments(self) -> tuple[FloatArray, FloatArray]:
        """Mean and covariance of the whole state over the mixture."""
        weights = self._weights()
        mean = weights @ self._mean
        centred = self._mean - mean
        size = mean.size
        own = (weights @ self._cov.reshape(weights.size, -1)).reshape(size, size)
        return mean, own + (centred * weights[:, None]).T @ centred

    def _estimate(self, tick: Tick, teaches: bool) -> RadiusEstimate:
        mean, cov = self._moments()
        deviation, full, noise = np.full(4, np.nan), np.full((4, 4), np.nan), np.full(4, np.nan)
        deviation[self._order] = mean[MU:]
        full[np.ix_(self._order, self._order)] = cov[MU:, MU:]
        noise[self._order] = np.sqrt(np.diag(self._process.drift))
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

    # -- what survives a restart ----------------------------------------------------------------------------

    def snapshot(self) -> dict[str, Any]:
        """Mean and covariance of everything but the pose, as plain numbers."""
        mean, cov = self._moments()
        return {
            "order": list(self._order),
            "nominal_m": self._nominal.tolist(),
            "mean_m": mean[MU:].tolist(),
            "covariance_m2": cov[MU:, MU:].tolist(),
            "nuisance": mean[LAT:MU].tolist(),
            "nuisance_covariance": cov[LAT:MU, LAT:MU].tolist(),
            "informative_s": self._informative_s,
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Take up a snapshot of the same car; ValueError if it does not fit.

        The radii may have changed while the car stood, and the receiver may be another: the saved covariances
        are widened by what a night can do.
        """
        mean, cov = checked_radii(saved, self._order, self._nominal)
        informative_s = float(saved["informative_s"])
        nuisance = np.asarray(saved["nuisance"], dtype=np.float64)
        nuisance_cov = np.asarray(saved["nuisance_covariance"], dtype=np.float64)
        size = MU - LAT
        if nuisance.shape != (size,) or nuisance_cov.shape != (size, size):
            raise ValueError("the saved nuisance parameters have another shape")
        if not (np.all(np.isfinite(nuisance)) and np.all(np.isfinite(nuisance_cov))):
            raise ValueError("the saved nuisance parameters are not finite")
        self._mean[:, MU:] = mean
        self._cov[:, MU:, MU:] = cov + self._process.drift * 1000.0
        self._mean[:, LAT:MU] = nuisance
        self._cov[:, LAT:MU, LAT:MU] = nuisance_cov * 2.0
        self._informative_s = informative_s
